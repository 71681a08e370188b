//! Labels of faces: objects, groups, materials and their combinations (parts).
//!
//! In: label changes in input order. Out: the part index of each face, and finally the [`Catalogue`]. Invariant: names,
//! materials and parts are numbered in order of their first use by a face, so unused labels take no memory. Hash maps
//! are only looked up, never iterated.
//!
//! # Memory
//! The catalogue: about 100 bytes plus the name for each used object, group and material, 28 for each part.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

use super::records::LabelKind;
use crate::base::{Allowance, Error, Result};
use crate::model::catalogue::MaterialDefinition;
use crate::model::{Catalogue, Material, Part};
use crate::os::path::path_of_name;

/// Labels of the current face, and all labels used so far.
#[derive(Debug)]
pub struct Labels {
    catalogue: Catalogue,
    allowance: Allowance,
    name_ids: HashMap<Vec<u8>, u32>,
    part_ids: HashMap<Part, u32>,
    file_materials: FileMaterials,
    object: Option<Label>,
    group: Option<Label>,
    material: Option<Label>,
    part: Option<u32>,
}

#[derive(Debug)]
struct Label {
    name: Vec<u8>,
    id: Option<u32>,
}

/// The materials that the faces of one file use.
#[derive(Debug, Default)]
pub struct FileMaterials {
    first: usize,
    ids: HashMap<Vec<u8>, u32>,
}

impl FileMaterials {
    /// Returns the catalogue index of a material, or `None` if no face of the file uses it.
    pub fn find(&self, name: &[u8]) -> Option<usize> {
        self.ids.get(name).map(|id| *id as usize)
    }

    /// Catalogue index of the file's first material; its others follow.
    pub fn first(&self) -> usize {
        self.first
    }
}

impl Labels {
    /// Creates an empty catalogue whose memory is charged to `allowance`.
    pub fn new(allowance: Allowance) -> Self {
        Self {
            catalogue: Catalogue::default(),
            allowance,
            name_ids: HashMap::new(),
            part_ids: HashMap::new(),
            file_materials: FileMaterials::default(),
            object: None,
            group: None,
            material: None,
            part: None,
        }
    }

    /// Begins a file: its faces have no object, group or material until a statement sets one.
    pub fn begin_file(&mut self, path: &Path) {
        self.catalogue.files.push(path.to_owned());
        (self.object, self.group, self.material, self.part) = (None, None, None, None);
        self.file_materials = FileMaterials { first: self.catalogue.materials.len(), ids: HashMap::new() };
    }

    /// Sets the object, group or material of the faces that follow; a `usemtl` without a name clears the material.
    pub fn change(&mut self, kind: LabelKind, name: &[u8]) {
        let label = match kind {
            LabelKind::Object => &mut self.object,
            LabelKind::Group => &mut self.group,
            LabelKind::Material => &mut self.material,
        };
        if label.as_ref().is_some_and(|label| label.name == name) {
            return;
        }
        let is_none = kind == LabelKind::Material && name.is_empty();
        *label = (!is_none).then(|| Label { name: name.to_vec(), id: None });
        self.part = None;
    }

    /// Returns the part index of a face with the current labels.
    ///
    /// # Errors
    /// [`Error::Limit`] if there are more than 2³² of a kind, [`Error::Budget`] if they exceed their memory.
    pub fn part(&mut self) -> Result<u32> {
        match self.part {
            Some(part) => Ok(part),
            None => self.find_part(),
        }
    }

    fn find_part(&mut self) -> Result<u32> {
        let mut ids = [None; 2];
        let mut bytes = 0;
        for (id, label) in ids.iter_mut().zip([&mut self.object, &mut self.group]) {
            let Some(label) = label else { continue };
            *id = Some(find_or_number(&mut self.name_ids, &mut label.id, &label.name, self.catalogue.names.len())?);
            if *id == Some(self.catalogue.names.len() as u32) {
                self.catalogue.names.push(label.name.clone());
                bytes += label.name.len() as u64;
            }
        }
        let mut material = None;
        if let Some(label) = &mut self.material {
            let next = self.catalogue.materials.len();
            let id = find_or_number(&mut self.file_materials.ids, &mut label.id, &label.name, next)?;
            if id as usize == next {
                let (name, output_name) = (label.name.clone(), label.name.clone());
                let material = Material { name, output_name, definition: None };
                bytes += material.bytes();
                self.catalogue.materials.push(material);
            }
            material = Some(id);
        }
        let file = numbered(self.catalogue.files.len())? - 1;
        let part = Part { file, object: ids[0], group: ids[1], material };
        let next = numbered(self.catalogue.parts.len())?;
        let index = *self.part_ids.entry(part).or_insert(next);
        if index == next {
            self.catalogue.parts.push(part);
            bytes += Part::BYTES;
        }
        self.part = Some(index);
        self.allow(bytes)?;
        Ok(index)
    }

    /// Charges bytes to the current file.
    ///
    /// # Errors
    /// [`Error::Budget`] if the allowance is used up.
    pub fn allow(&mut self, bytes: u64) -> Result<()> {
        let path = self.catalogue.files.last().map_or(Path::new(""), PathBuf::as_path);
        self.allowance.take(bytes, path)
    }

    /// Returns the catalogue so far, the current file's materials in it, and the memory left.
    pub fn materials_of_file(&mut self) -> (&mut Catalogue, &FileMaterials, &mut Allowance) {
        (&mut self.catalogue, &self.file_materials, &mut self.allowance)
    }

    /// Returns the catalogue, once all files are read and their materials defined. Merges equal materials of several
    /// files, and gives different materials of the same name distinct output names.
    pub fn finish(mut self) -> Catalogue {
        merge_materials(&mut self.catalogue);
        name_outputs(&mut self.catalogue.materials);
        self.catalogue
    }
}

fn find_or_number(ids: &mut HashMap<Vec<u8>, u32>, known: &mut Option<u32>, name: &[u8], next: usize) -> Result<u32> {
    if let Some(id) = known {
        return Ok(*id);
    }
    let id = match ids.get(name) {
        Some(id) => *id,
        None => {
            let id = numbered(next)?;
            ids.insert(name.to_vec(), id);
            id
        }
    };
    *known = Some(id);
    Ok(id)
}

fn numbered(count: usize) -> Result<u32> {
    u32::try_from(count).map_err(|_| Error::Limit("more than 2³² names, materials or parts".into()))
}

fn merge_materials(catalogue: &mut Catalogue) {
    let mut kept: Vec<Material> = Vec::new();
    let mut ids: HashMap<Vec<u8>, u32> = HashMap::new();
    let mut renumbered = Vec::with_capacity(catalogue.materials.len());
    for material in std::mem::take(&mut catalogue.materials) {
        let next = kept.len() as u32;
        let id = *ids.entry(identity(&material)).or_insert(next);
        if id == next {
            kept.push(material);
        }
        renumbered.push(id);
    }
    catalogue.materials = kept;
    for part in &mut catalogue.parts {
        part.material = part.material.map(|material| renumbered[material as usize]);
    }
}

/// Returns a key that is equal for two materials if and only if they look the same: name, statements, and textures with
/// their resolved paths.
fn identity(material: &Material) -> Vec<u8> {
    let mut key = Vec::new();
    put_text(&mut key, &material.name);
    if let Some(MaterialDefinition { folder, statements, textures }) = &material.definition {
        key.push(1);
        for statement in statements {
            put_text(&mut key, statement);
        }
        key.push(2);
        for texture in textures {
            put_text(&mut key, &texture.key_and_options);
            put_text(&mut key, resolve(folder, &texture.name).as_os_str().as_encoded_bytes());
        }
    }
    key
}

fn put_text(key: &mut Vec<u8>, text: &[u8]) {
    key.push(0);
    key.extend_from_slice(&(text.len() as u64).to_le_bytes());
    key.extend_from_slice(text);
}

fn resolve(folder: &Path, name: &[u8]) -> PathBuf {
    use std::path::Component;
    let mut out = PathBuf::new();
    for component in folder.join(path_of_name(name)).components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir if matches!(out.components().next_back(), Some(Component::Normal(_))) => {
                out.pop();
            }
            other => out.push(other),
        }
    }
    out
}

fn name_outputs(materials: &mut [Material]) {
    let mut taken: HashSet<Vec<u8>> = materials.iter().map(|material| material.name.clone()).collect();
    let mut last_suffix: HashMap<Vec<u8>, u64> = HashMap::new();
    for material in materials {
        let Some(suffix) = last_suffix.get_mut(&material.name) else {
            last_suffix.insert(material.name.clone(), 1);
            continue;
        };
        loop {
            *suffix += 1;
            let mut name = material.name.clone();
            name.extend_from_slice(format!("_{suffix}").as_bytes());
            if taken.insert(name.clone()) {
                material.output_name = name;
                break;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::catalogue::TextureStatement;

    fn textured(folder: &str, texture: &str) -> Option<MaterialDefinition> {
        let texture = TextureStatement { key_and_options: b"map_Kd".to_vec(), name: texture.into() };
        Some(MaterialDefinition { folder: folder.into(), statements: vec![], textures: vec![texture] })
    }

    fn use_material(labels: &mut Labels, name: &str, definition: Option<MaterialDefinition>) -> u32 {
        labels.change(LabelKind::Material, name.as_bytes());
        let part = labels.part().unwrap();
        let (catalogue, materials, _) = labels.materials_of_file();
        let place = materials.find(name.as_bytes()).unwrap();
        catalogue.materials[place].definition = definition;
        part
    }

    #[test]
    fn equal_materials_of_two_files_become_one() {
        let mut labels = Labels::new(Allowance::new(1 << 20));
        labels.begin_file(Path::new("t/a.obj"));
        let first = use_material(&mut labels, "wall", textured("t", "sub/../wall.png"));
        labels.begin_file(Path::new("t/x/b.obj"));
        let second = use_material(&mut labels, "wall", textured("t/x", "..\\wall.png"));
        let catalogue = labels.finish();
        assert_ne!(first, second);
        assert_eq!(catalogue.materials.len(), 1);
        assert_eq!(catalogue.parts.iter().map(|part| part.material).collect::<Vec<_>>(), [Some(0), Some(0)]);
    }

    #[test]
    fn different_materials_of_one_name_get_names_that_collide_with_none() {
        let mut labels = Labels::new(Allowance::new(1 << 20));
        for folder in ["t/a", "t/b", "t/c"] {
            labels.begin_file(&Path::new(folder).join("mesh.obj"));
            use_material(&mut labels, "wall", textured(folder, "wall.png"));
            use_material(&mut labels, "wall_2", textured("t", "other.png"));
        }
        let names: Vec<_> = labels.finish().materials.into_iter().map(|material| material.output_name).collect();
        assert_eq!(names, [&b"wall"[..], b"wall_2", b"wall_3", b"wall_4"]);
    }

    #[test]
    fn labels_without_faces_cost_nothing() {
        let mut labels = Labels::new(Allowance::new(1 << 20));
        labels.begin_file(Path::new("a.obj"));
        for i in 0..2000 {
            labels.change(LabelKind::Material, format!("m{i}").as_bytes());
        }
        labels.change(LabelKind::Group, b"roof");
        assert_eq!(labels.part().unwrap(), 0);
        labels.change(LabelKind::Material, b"");
        assert_eq!(labels.part().unwrap(), 1);
        labels.change(LabelKind::Material, b"m1999");
        assert_eq!(labels.part().unwrap(), 0);
        let catalogue = labels.finish();
        assert_eq!((catalogue.materials.len(), catalogue.names.len(), catalogue.parts.len()), (1, 1, 2));
        assert_eq!(catalogue.parts[1], Part { file: 0, object: None, group: Some(0), material: None });
    }
}

//! Labels of faces: objects, groups, materials and their combinations (parts).
//!
//! In: label changes in input order. Out: the part of each face, and finally the [`Catalogue`]. Invariant: names,
//! materials and parts are numbered in order of their first use by a face, so unused labels take no memory. Hash maps
//! are only looked up, never iterated.
//!
//! # Memory
//! The catalogue: about 100 bytes plus the name for each used object, group and material, 28 for each part.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::fs;
use std::path::{Path, PathBuf};

use super::records::LabelKind;
use crate::base::id::{Id, TiSlice, TiVec};
use crate::base::{Allowance, Error, Result};
use crate::model::catalogue::{MaterialDefinition, TextureStatement};
use crate::model::id::{FileId, MaterialId, NameId, PartId};
use crate::model::{Catalogue, Material, Part};
use crate::os::durable::folder_of;
use crate::os::path::path_of_name;

/// A name is in the catalogue and the key by which it is found.
const NAME_COPIES: u64 = 2;

/// Labels of the current face, and all labels used so far.
#[derive(Debug)]
pub struct Labels {
    catalogue: Catalogue,
    allowance: Allowance,
    name_ids: HashMap<Vec<u8>, NameId>,
    part_ids: HashMap<Part, PartId>,
    file_materials: FileMaterials,
    object: Option<Label<NameId>>,
    group: Option<Label<NameId>>,
    material: Option<Label<MaterialId>>,
    part: Option<PartId>,
}

/// A label, and its id once a face has it.
#[derive(Debug)]
struct Label<I> {
    name: Vec<u8>,
    id: Option<I>,
}

impl<I: Id> Label<I> {
    /// Changes what a statement sets to this name; returns whether it was another one.
    fn change(current: &mut Option<Self>, name: &[u8]) -> bool {
        let differs = current.as_ref().is_none_or(|label| label.name != name);
        if differs {
            *current = Some(Self { name: name.to_vec(), id: None });
        }
        differs
    }

    /// Its id: `next` if `ids` have none of this name yet.
    fn number(&mut self, ids: &mut HashMap<Vec<u8>, I>, next: usize) -> Result<I> {
        let id = match self.id.or_else(|| ids.get(&self.name).copied()) {
            Some(id) => id,
            None => {
                let id = numbered(next)?;
                ids.insert(self.name.clone(), id);
                id
            }
        };
        self.id = Some(id);
        Ok(id)
    }
}

/// The materials that the faces of one file use.
#[derive(Debug, Default)]
pub struct FileMaterials {
    first: MaterialId,
    ids: HashMap<Vec<u8>, MaterialId>,
}

impl FileMaterials {
    /// The material of this name, or `None` if no face of the file uses it.
    pub fn find(&self, name: &[u8]) -> Option<MaterialId> {
        self.ids.get(name).copied()
    }

    /// The file's first material; its others follow.
    pub fn first(&self) -> MaterialId {
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
        self.object = None;
        self.group = None;
        self.material = None;
        self.part = None;
        self.file_materials = FileMaterials { first: self.catalogue.materials.next_key(), ids: HashMap::new() };
    }

    /// Sets the object, group or material of the faces that follow; a `usemtl` without a name clears the material.
    pub fn change(&mut self, kind: LabelKind, name: &[u8]) {
        let differs = match kind {
            LabelKind::Object => Label::change(&mut self.object, name),
            LabelKind::Group => Label::change(&mut self.group, name),
            LabelKind::Material if name.is_empty() => self.material.take().is_some(),
            LabelKind::Material => Label::change(&mut self.material, name),
        };
        if differs {
            self.part = None;
        }
    }

    /// Returns the part of a face with the current labels.
    ///
    /// # Errors
    /// [`Error::Limit`] if there are more than 2³² of a kind, [`Error::Budget`] if they exceed their memory.
    pub fn part(&mut self) -> Result<PartId> {
        match self.part {
            Some(part) => Ok(part),
            None => self.find_part(),
        }
    }

    fn find_part(&mut self) -> Result<PartId> {
        let Catalogue { names, materials, parts, files, .. } = &mut self.catalogue;
        let mut ids = [None; 2];
        let mut bytes = 0;
        for (id, label) in ids.iter_mut().zip([&mut self.object, &mut self.group]) {
            let Some(label) = label else { continue };
            let name = label.number(&mut self.name_ids, names.len())?;
            if name == names.next_key() {
                names.push(label.name.clone());
                bytes += NAME_COPIES * label.name.len() as u64;
            }
            *id = Some(name);
        }
        let [object, group] = ids;
        let mut material = None;
        if let Some(label) = &mut self.material {
            let id = label.number(&mut self.file_materials.ids, materials.len())?;
            if id == materials.next_key() {
                let (name, output_name) = (label.name.clone(), label.name.clone());
                let material = Material { name, output_name, definition: None };
                // The name is a key, too, now and when materials are merged.
                bytes += material.bytes() + NAME_COPIES * material.name.len() as u64;
                materials.push(material);
            }
            material = Some(id);
        }
        let part = Part { file: FileId::from(files.len() - 1), object, group, material };
        let next = numbered(parts.len())?;
        let id = *self.part_ids.entry(part).or_insert(next);
        if id == next {
            parts.push(part);
            bytes += Part::BYTES;
        }
        self.part = Some(id);
        self.allow(bytes)?;
        Ok(id)
    }

    /// Takes the current labels and a chunk's `bytes` off what the catalogue may take.
    pub fn lend(&mut self, bytes: u64) {
        self.allowance.lend(bytes + self.label_bytes());
    }

    /// Memory of the catalogue so far and of the current labels, in bytes.
    pub fn taken(&self) -> u64 {
        self.allowance.taken() + self.label_bytes()
    }

    fn label_bytes(&self) -> u64 {
        let names = [self.object.as_ref().map(|label| &label.name), self.group.as_ref().map(|label| &label.name)];
        let names = names.into_iter().chain([self.material.as_ref().map(|label| &label.name)]);
        names.flatten().map(|name| name.len() as u64).sum()
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

    /// Gives each of these materials that faces of the current file use its texture image, whose name is relative to the
    /// folder of the file.
    ///
    /// # Errors
    /// [`Error::Budget`] if they take too much memory.
    pub fn define_textures<'a>(&mut self, textures: impl Iterator<Item = (Cow<'a, [u8]>, &'a [u8])>) -> Result<()> {
        let path = self.catalogue.files.last().cloned().unwrap_or_default();
        // A job may be resumed from another working directory.
        let folder = folder_of(&path);
        let folder = fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
        for (material, texture) in textures {
            let Some(material) = self.file_materials.find(&material) else { continue };
            let definition = &mut self.catalogue.materials[material].definition;
            if definition.is_none() {
                let texture = TextureStatement { key_and_options: b"map_Kd".to_vec(), name: texture.to_vec() };
                let own =
                    MaterialDefinition { folder: folder.clone(), statements: Vec::new(), textures: vec![texture] };
                self.allowance.take(own.bytes(), &path)?;
                *definition = Some(own);
            }
        }
        Ok(())
    }

    /// Returns the catalogue of the only file: equal materials are not merged yet.
    pub fn of_one_file(self) -> Catalogue {
        self.catalogue
    }

    /// Adds the catalogue of the current file, which another process read; returns the part that it calls 0.
    ///
    /// # Errors
    /// [`Error::Limit`] if there are more than 2³² of a kind, [`Error::Budget`] if they exceed their memory.
    pub fn adopt(&mut self, own: Catalogue) -> Result<PartId> {
        let Catalogue { names, materials, parts, files, .. } = &mut self.catalogue;
        let (first_part, first_material) = (numbered::<PartId>(parts.len())?, materials.len());
        let mut bytes = Part::BYTES * own.parts.len() as u64;
        let mut adopted: TiVec<NameId, NameId> = TiVec::with_capacity(own.names.len());
        for name in own.names {
            let id = match self.name_ids.get(&name) {
                Some(&id) => id,
                None => {
                    bytes += NAME_COPIES * name.len() as u64;
                    let id = numbered(names.len())?;
                    names.push(name.clone());
                    self.name_ids.insert(name, id);
                    id
                }
            };
            adopted.push(id);
        }
        let definitions = own.materials.iter().filter_map(|material| material.definition.as_ref());
        bytes += definitions.map(MaterialDefinition::bytes).sum::<u64>();
        bytes += own.materials.iter().map(Material::bytes).sum::<u64>();
        let material_of = |own: MaterialId| numbered::<MaterialId>(first_material + own.index());
        numbered::<MaterialId>(first_material + own.materials.len())?;
        numbered::<PartId>(parts.len() + own.parts.len())?;
        materials.extend(own.materials);
        let file = FileId::from(files.len() - 1);
        for Part { object, group, material, .. } in own.parts {
            let [object, group] = [object, group].map(|name| name.map(|name| adopted[name]));
            parts.push(Part { file, object, group, material: material.map(material_of).transpose()? });
        }
        self.catalogue.has_normals |= own.has_normals;
        self.catalogue.has_texcoords |= own.has_texcoords;
        self.catalogue.position_decimals = self.catalogue.position_decimals.max(own.position_decimals);
        self.catalogue.texcoord_decimals = self.catalogue.texcoord_decimals.max(own.texcoord_decimals);
        self.allow(bytes)?;
        Ok(first_part)
    }

    /// Returns the catalogue, once all files are read and their materials defined. Merges equal materials of several
    /// files, and gives different materials of the same name distinct output names.
    pub fn finish(mut self) -> Catalogue {
        merge_materials(&mut self.catalogue);
        name_outputs(&mut self.catalogue.materials);
        self.catalogue
    }
}

fn numbered<I: Id>(count: usize) -> Result<I> {
    u32::try_from(count).map(I::new).map_err(|_| Error::Limit("more than 2³² names, materials or parts".into()))
}

fn merge_materials(catalogue: &mut Catalogue) {
    let mut kept: TiVec<MaterialId, Material> = TiVec::new();
    let mut ids: HashMap<Vec<u8>, MaterialId> = HashMap::new();
    let mut renumbered: TiVec<MaterialId, MaterialId> = TiVec::with_capacity(catalogue.materials.len());
    for material in std::mem::take(&mut catalogue.materials) {
        let next = kept.next_key();
        let id = *ids.entry(identity(&material)).or_insert(next);
        if id == next {
            kept.push(material);
        }
        renumbered.push(id);
    }
    catalogue.materials = kept;
    for part in &mut catalogue.parts {
        part.material = part.material.map(|material| renumbered[material]);
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

fn name_outputs(materials: &mut TiSlice<MaterialId, Material>) {
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

    fn use_material(labels: &mut Labels, name: &str, definition: Option<MaterialDefinition>) -> PartId {
        labels.change(LabelKind::Material, name.as_bytes());
        let part = labels.part().unwrap();
        let (catalogue, materials, _) = labels.materials_of_file();
        let material = materials.find(name.as_bytes()).unwrap();
        catalogue.materials[material].definition = definition;
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
        assert!(catalogue.parts.iter().all(|part| part.material == Some(MaterialId::new(0))));
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
        assert_eq!(labels.part().unwrap(), PartId::new(0));
        labels.change(LabelKind::Material, b"");
        assert_eq!(labels.part().unwrap(), PartId::new(1));
        labels.change(LabelKind::Material, b"m1999");
        assert_eq!(labels.part().unwrap(), PartId::new(0));
        let catalogue = labels.finish();
        assert_eq!((catalogue.materials.len(), catalogue.names.len(), catalogue.parts.len()), (1, 1, 2));
        let group = Some(NameId::new(0));
        assert_eq!(catalogue.parts.raw[1], Part { file: FileId::new(0), object: None, group, material: None });
    }
}

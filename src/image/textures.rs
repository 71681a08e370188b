//! The texture images of materials, as files, and the matching of a result's images with those of the original.
//!
//! ```text
//! result's  city_textures/wall.png    same name and content as  original's  photos/wall.png     that one
//!           city_textures/wall_2.png  same content as           original's  roofs/wall.png      that one
//!           wall.png                  same name as              original's  photos/wall.png     that one, re-encoded
//! ```
//! In: a catalogue. Out: [`TextureImages`]. Invariant: no image is decoded here, and only regular files are opened.

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;

use glam::DVec2;

use crate::base::Findings;
use crate::base::error::{escape, escape_path};
use crate::base::id::{TiSlice, TiVec};
use crate::model::Catalogue;
use crate::model::catalogue::MaterialDefinition;
use crate::model::diffuse::{ImagePlacement, diffuse_colour, diffuse_image};
use crate::model::id::{ImageId, MaterialId, PartId};
use crate::model::texture_file::{TextureReach, Unusable, base_name};
use crate::os::content::Content;

/// Advice for an image out of reach.
const UNREAD: &str = "it is not read; --textures-outside copy allows it";

/// An image file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextureImage {
    /// The file, all links followed.
    pub path: PathBuf,
    /// Its name in the MTL, without folders.
    pub name: Vec<u8>,
}

/// The texture images of a mesh.
#[derive(Debug, Clone, Default)]
pub struct TextureImages {
    /// The image files, each once.
    pub files: TiVec<ImageId, TextureImage>,
    /// Image of each part of the catalogue, or none.
    pub of_part: TiVec<PartId, ImageId>,
    /// Where the image of each part lies, if an option of its statement moves it.
    placements: TiVec<PartId, Option<ImagePlacement>>,
    /// The plain colours (`Kd`) of parts; their ids follow those of the images.
    pub plain: Vec<[u8; 3]>,
    /// Id of the plain colour of each part, or none: what shows where the image of the part does not.
    plain_of_part: TiVec<PartId, ImageId>,
}

impl TextureImages {
    /// No image for any part.
    pub fn none(catalogue: &Catalogue) -> Self {
        let parts = catalogue.parts.len();
        Self {
            of_part: vec![ImageId::NONE; parts].into(),
            placements: vec![None; parts].into(),
            plain_of_part: vec![ImageId::NONE; parts].into(),
            ..Self::default()
        }
    }

    /// Finds the diffuse images (`map_Kd`) of a catalogue's materials within reach; notes those that are missing, and
    /// those that are refused.
    pub fn find(catalogue: &Catalogue, reach: &TextureReach, findings: &mut Findings) -> Self {
        let mut images = Self::default();
        let mut known: HashMap<PathBuf, ImageId> = HashMap::new();
        let of_material: TiVec<MaterialId, ImageId> = catalogue
            .materials
            .iter()
            .map(|material| {
                let Some((definition, name)) = material.definition.as_ref().and_then(diffuse) else {
                    return ImageId::NONE;
                };
                let path = match find_file(definition, name, reach) {
                    Ok(path) => path,
                    Err(why @ Unusable::Refused(_)) => {
                        why.note(&definition.folder, name, UNREAD, findings);
                        return ImageId::NONE;
                    }
                    Err(Unusable::Missing(..) | Unusable::NoFile(_)) => {
                        findings.note("missing_image", || {
                            format!("{} in {}: no such file", escape(name), escape_path(&definition.folder))
                        });
                        return ImageId::NONE;
                    }
                };
                *known.entry(path.clone()).or_insert_with(|| {
                    images.files.push_and_get_key(TextureImage { path, name: base_name(name).to_vec() })
                })
            })
            .collect();
        let material_of =
            |part: &crate::model::Part| part.material.map_or(ImageId::NONE, |material| of_material[material]);
        images.of_part = catalogue.parts.iter().map(material_of).collect();
        let placement_of = |part: &crate::model::Part| {
            let definition = catalogue.materials[part.material?].definition.as_ref()?;
            ImagePlacement::of(diffuse_image(definition)?)
        };
        images.placements = catalogue.parts.iter().map(placement_of).collect();
        images.plain_of_part = vec![ImageId::NONE; catalogue.parts.len()].into();
        images
    }

    /// Gives each part the plain colour of its material (`Kd`), as an image of its own: instead of one if it has none.
    pub fn add_plain_colours(&mut self, catalogue: &Catalogue) {
        let Self { files, of_part, plain, plain_of_part, .. } = self;
        let mut known: BTreeMap<[u8; 3], ImageId> = BTreeMap::new();
        for (id, part) in catalogue.parts.iter_enumerated() {
            let definition = part.material.and_then(|material| catalogue.materials[material].definition.as_ref());
            let Some(colour) = definition.and_then(diffuse_colour) else { continue };
            plain_of_part[id] = *known.entry(colour).or_insert_with(|| {
                plain.push(colour);
                ImageId::from(files.len() + plain.len() - 1)
            });
            if of_part[id] == ImageId::NONE {
                of_part[id] = plain_of_part[id];
            }
        }
    }

    /// Id of the plain colour of a part, or none.
    #[inline]
    pub fn plain_of(&self, part: PartId) -> ImageId {
        self.plain_of_part[part]
    }

    /// The plain colour of each image: what shows if it cannot be decoded.
    pub fn plain_of_files(&self) -> TiVec<ImageId, Option<[u8; 3]>> {
        let mut plain: TiVec<ImageId, Option<[u8; 3]>> = vec![None; self.files.len()].into();
        for (part, &image) in self.of_part.iter_enumerated() {
            // NOTE: of several materials with one image, the first that has a colour counts for all: a triangle knows
            // its image, and no material.
            if let Some(colour) = plain.get_mut(image).filter(|colour| colour.is_none()) {
                *colour = self.plain_colour(self.plain_of_part[part]);
            }
        }
        plain
    }

    /// The plain colour that an id stands for; `None` for an image.
    #[inline]
    pub fn plain_colour(&self, image: ImageId) -> Option<[u8; 3]> {
        self.plain.get(image.index().checked_sub(self.files.len())?).copied()
    }

    /// The texture coordinate in the image that a part shows at one of the file.
    #[inline]
    pub fn placed(&self, part: PartId, texcoord: DVec2) -> DVec2 {
        match self.placements[part] {
            None => texcoord,
            Some(placement) => placement.place(texcoord),
        }
    }

    /// How many times the image is shown on an area of the file's texture space that it would fill once.
    pub fn repeats(&self, part: PartId) -> f64 {
        self.placements[part].map_or(1.0, ImagePlacement::repeats)
    }

    /// Content of each file; `None` for a file that cannot be read.
    pub fn contents(&self) -> TiVec<ImageId, Option<Content>> {
        self.files.iter().map(|file| Content::of(&file.path).ok()).collect()
    }

    /// For each texture image, those of `original` that it matches by name or content, ascending; `own` are its
    /// contents.
    pub fn sources(
        &self,
        own: &TiSlice<ImageId, Option<Content>>,
        (original, contents): (&Self, &TiSlice<ImageId, Option<Content>>),
    ) -> TiVec<ImageId, Vec<ImageId>> {
        let mut by_name: BTreeMap<&[u8], Vec<ImageId>> = BTreeMap::new();
        let mut by_content: BTreeMap<Content, Vec<ImageId>> = BTreeMap::new();
        for (image, file) in original.files.iter_enumerated() {
            by_name.entry(&file.name).or_default().push(image);
            if let Some(content) = contents[image] {
                by_content.entry(content).or_default().push(image);
            }
        }
        let sources = |(file, &content): (&TextureImage, &Option<Content>)| {
            let named = by_name.get(&*file.name).cloned().unwrap_or_default();
            let same = |&image: &ImageId| content.is_some() && contents[image] == content;
            if named.iter().any(same) {
                named.into_iter().filter(same).collect()
            } else if named.is_empty() {
                content.and_then(|content| by_content.get(&content).cloned()).unwrap_or_default()
            } else {
                named
            }
        };
        self.files.iter().zip(own).map(sources).collect()
    }
}

/// The name of a material's diffuse image.
fn diffuse(definition: &MaterialDefinition) -> Option<(&MaterialDefinition, &[u8])> {
    diffuse_image(definition).map(|texture| (definition, &texture.name[..]))
}

/// The file of a texture name: by the whole path, else by its last part beside the MTL file.
fn find_file(definition: &MaterialDefinition, name: &[u8], reach: &TextureReach) -> Result<PathBuf, Unusable> {
    let find = |name| reach.find(&definition.folder, name);
    find(name).or_else(|why| find(base_name(name)).map_err(|_| why))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::*;

    fn images(folder: &Path, files: &[(&str, &str)]) -> TextureImages {
        fs::create_dir_all(folder).unwrap();
        let image = |&(name, content): &(&str, &str)| {
            fs::write(folder.join(name), content).unwrap();
            TextureImage { path: folder.join(name), name: name.as_bytes().to_vec() }
        };
        TextureImages { files: files.iter().map(image).collect(), ..TextureImages::default() }
    }

    #[test]
    fn a_image_is_known_by_name_and_content_then_by_name_then_by_content() {
        let folder = tempfile::tempdir().unwrap();
        let original = images(&folder.path().join("a"), &[("wall.png", "1"), ("roof.png", "2"), ("door.png", "3")]);
        let result = images(
            &folder.path().join("b"),
            &[("wall.png", "1"), ("roof.png", "2, smaller"), ("wall_2.png", "3"), ("other.png", "4")],
        );
        let found = result.sources(&result.contents(), (&original, &original.contents()));
        assert_eq!(
            found.raw,
            [vec![0], vec![1], vec![2], vec![]].map(|images| images.into_iter().map(ImageId::new).collect::<Vec<_>>())
        );
    }
}

//! The texture images of a PLY: one per material at most, named by comments.
//!
//! In: the catalogue, and which parts have faces. Out: the names of the images, and the image of each material. What a
//! PLY cannot hold of objects, groups and materials is reported.

use std::collections::{BTreeSet, HashMap};

use crate::base::error::escape;
use crate::base::id::TiVec;
use crate::base::{Findings, Result};
use crate::model::Catalogue;
use crate::model::diffuse::diffuse_image;
use crate::model::id::MaterialId;
use crate::write::losses::{note_unwritten, used_materials};
use crate::write::numbering::Usage;
use crate::write::textures::TextureStage;

/// Texture images of the result.
#[derive(Debug, Default)]
pub(in crate::write) struct PlyImages {
    /// Names as the file refers to them.
    pub(in crate::write) names: Vec<Vec<u8>>,
    /// Index of the image of each material of the catalogue.
    pub(in crate::write) of_material: TiVec<MaterialId, Option<usize>>,
    /// What is not written.
    pub(super) findings: Findings,
}

/// Stages the images of the materials that faces use.
///
/// # Errors
/// Those of [`TextureStage::reference`].
pub(in crate::write) fn stage_images(
    catalogue: &Catalogue,
    usage: &Usage,
    textures: &mut TextureStage,
) -> Result<PlyImages> {
    let used = used_materials(catalogue, usage);
    let mut images = of_materials(catalogue, &used, textures)?;
    for material in used {
        let name = || escape(&catalogue.materials[material].output_name);
        if images.of_material[material].is_none() {
            let words = || format!("'{}' is not written: it has no image for map_Kd", name());
            images.findings.note("unwritten_materials", words);
        }
    }
    note_unwritten(catalogue, usage, "PLY", &mut images.findings, |definition| {
        usize::from(diffuse_image(definition).is_some())
    });
    Ok(images)
}

/// The images if every material used by the input were used by the result.
///
/// # Errors
/// Those of [`TextureStage::reference`].
pub(in crate::write) fn stage_whole_images(catalogue: &Catalogue, textures: &mut TextureStage) -> Result<PlyImages> {
    of_materials(catalogue, &catalogue.parts.iter().filter_map(|part| part.material).collect(), textures)
}

fn of_materials(catalogue: &Catalogue, used: &BTreeSet<MaterialId>, textures: &mut TextureStage) -> Result<PlyImages> {
    let mut images = PlyImages { of_material: vec![None; catalogue.materials.len()].into(), ..PlyImages::default() };
    let mut known: HashMap<Vec<u8>, usize> = HashMap::new();
    for &material in used {
        let Some(definition) = &catalogue.materials[material].definition else { continue };
        let Some(image) = diffuse_image(definition) else { continue };
        let name = in_one_line(textures.reference(&definition.folder, &image.name)?);
        let next = images.names.len();
        let index = *known.entry(name.clone()).or_insert(next);
        if index == next {
            images.names.push(name);
        }
        images.of_material[material] = Some(index);
    }
    Ok(images)
}

/// A name without control characters, which would end the line that it stands in.
fn in_one_line(mut name: Vec<u8>) -> Vec<u8> {
    name.iter_mut().filter(|c| c.is_ascii_control()).for_each(|c| *c = b' ');
    name
}

//! Writes the MTL: every material that a written face uses, with its statements as in the input.
//!
//! In: the catalogue, and which parts have faces. Out: the text of the file. Texture statements refer to the files that
//! [`textures`](super::textures) provides.

use std::collections::BTreeSet;
use std::path::Path;

use super::numbering::Usage;
use super::obj::put_statement;
use super::signature::signature;
use super::textures::TextureStage;
use crate::base::error::escape;
use crate::base::{Findings, Result, counted};
use crate::model::Catalogue;

/// Text of the MTL; `None` if no used material has a definition.
///
/// # Errors
/// Those of [`TextureStage::reference`].
pub(super) fn library(catalogue: &Catalogue, usage: &Usage, textures: &mut TextureStage) -> Result<Option<Vec<u8>>> {
    let parts = catalogue.parts.iter().zip(&usage.faces_per_part).filter(|&(_, &faces)| faces > 0);
    let used: BTreeSet<u32> = parts.filter_map(|(part, _)| part.material).collect();
    note_losses(catalogue, &used, &mut textures.findings);
    text_of(catalogue, used, textures)
}

/// Text of the MTL if every material used by the input were used by the result.
///
/// # Errors
/// Those of [`TextureStage::reference`].
pub(super) fn whole_library(catalogue: &Catalogue, textures: &mut TextureStage) -> Result<Option<Vec<u8>>> {
    text_of(catalogue, catalogue.parts.iter().filter_map(|part| part.material).collect(), textures)
}

fn text_of(catalogue: &Catalogue, used: BTreeSet<u32>, textures: &mut TextureStage) -> Result<Option<Vec<u8>>> {
    let mut names = BTreeSet::new();
    let mut text = Vec::new();
    for index in used {
        let material = &catalogue.materials[index as usize];
        let Some(definition) = material.definition.as_ref().filter(|_| names.insert(&material.output_name)) else {
            continue;
        };
        text.push(b'\n');
        put_statement(&mut text, b"newmtl", &material.output_name);
        for statement in &definition.statements {
            let (key, value) = statement.split_at(statement.iter().position(|&c| c == b' ').unwrap_or(statement.len()));
            match value.split_first() {
                Some((_, value)) => put_statement(&mut text, key, value),
                None => text.extend_from_slice(&[key, b"\n"].concat()),
            }
        }
        for texture in &definition.textures {
            let reference = textures.reference(&definition.folder, &texture.name)?;
            put_statement(&mut text, &texture.key_and_options, &reference);
        }
    }
    Ok((!text.is_empty()).then(|| [signature(), text].concat()))
}

/// Reports the materials and textures that no face of the result uses any more.
fn note_losses(catalogue: &Catalogue, used: &BTreeSet<u32>, findings: &mut Findings) {
    let all = 0..catalogue.materials.len() as u32;
    let lost = all.clone().filter(|index| !used.contains(index));
    let lost = lost.map(|index| &catalogue.materials[index as usize].output_name[..]).collect();
    note_lost("lost_materials", "material", all.len(), lost, findings);

    let (before, left) = (textures(catalogue, all), textures(catalogue, used.iter().copied()));
    let lost = before.difference(&left).map(|(_, name)| *name).collect();
    note_lost("lost_textures", "texture", before.len(), lost, findings);
}

/// Textures of some materials: the folder of the MTL, and the name in it.
fn textures(catalogue: &Catalogue, materials: impl Iterator<Item = u32>) -> BTreeSet<(&Path, &[u8])> {
    let definitions = materials.filter_map(|index| catalogue.materials[index as usize].definition.as_ref());
    definitions.flat_map(|d| d.textures.iter().map(|texture| (d.folder.as_path(), &texture.name[..]))).collect()
}

/// Number of textures that the materials of the input name.
pub fn texture_count(catalogue: &Catalogue) -> u64 {
    textures(catalogue, 0..catalogue.materials.len() as u32).len() as u64
}

/// Notes each lost item; the first note also says how many of `total` are left.
fn note_lost(kind: &'static str, what: &str, total: usize, lost: Vec<&[u8]>, findings: &mut Findings) {
    let left = format!("{} of {} left; ", total - lost.len(), counted(total as u64, what));
    for (place, name) in lost.into_iter().enumerate() {
        let left = if place == 0 { left.as_str() } else { "" };
        findings.note(kind, || format!("{left}'{}' is on no face of the result", escape(name)));
    }
}

//! Writes the MTL: every material that a written face uses, with its statements as in the input.
//!
//! In: the catalogue, and which parts have faces. Out: the text of the file. Texture statements refer to the files that
//! [`textures`](crate::write::textures) provides.

use std::collections::BTreeSet;

use crate::base::Result;
use crate::model::Catalogue;
use crate::model::id::MaterialId;
use crate::write::losses::used_materials;
use crate::write::numbering::Usage;
use crate::write::signature::{put_statement, signature};
use crate::write::textures::TextureStage;

/// Text of the MTL; `None` if no used material has a definition.
///
/// # Errors
/// Those of [`TextureStage::reference`].
pub(in crate::write) fn library(
    catalogue: &Catalogue,
    usage: &Usage,
    textures: &mut TextureStage,
) -> Result<Option<Vec<u8>>> {
    text_of(catalogue, used_materials(catalogue, usage), textures)
}

/// Text of the MTL if every material used by the input were used by the result.
///
/// # Errors
/// Those of [`TextureStage::reference`].
pub(in crate::write) fn whole_library(catalogue: &Catalogue, textures: &mut TextureStage) -> Result<Option<Vec<u8>>> {
    text_of(catalogue, catalogue.parts.iter().filter_map(|part| part.material).collect(), textures)
}

fn text_of(catalogue: &Catalogue, used: BTreeSet<MaterialId>, textures: &mut TextureStage) -> Result<Option<Vec<u8>>> {
    let mut names = BTreeSet::new();
    let mut text = Vec::new();
    for id in used {
        let material = &catalogue.materials[id];
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

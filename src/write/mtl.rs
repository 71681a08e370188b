//! The MTL: every material that a written face uses, with its statements as the input wrote them.
//!
//! In: the catalogue and which parts have faces. Out: the file's text; texture statements refer to where
//! [`textures`](super::textures) puts the images.

use std::collections::BTreeSet;

use super::numbering::Usage;
use super::obj::put_statement;
use super::textures::TextureStage;
use crate::base::Result;
use crate::store::Catalogue;

/// The text of the MTL, or nothing if no used material has a definition.
///
/// # Errors
/// Those of [`TextureStage::reference`].
pub(super) fn library(catalogue: &Catalogue, usage: &Usage, textures: &mut TextureStage) -> Result<Option<Vec<u8>>> {
    let parts = catalogue.parts.iter().zip(&usage.faces_per_part).filter(|&(_, &faces)| faces > 0);
    let used: BTreeSet<u32> = parts.filter_map(|(part, _)| part.material).collect();
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
    Ok((!text.is_empty()).then(|| [super::signature(), text].concat()))
}

//! Lists the textures that materials name, and decides which of them may be copied.

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

use crate::model::Catalogue;
use crate::model::texture_file::{self, TextureReach};

/// A texture that a material names.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct NamedTexture {
    /// Its path, whether it exists or not.
    pub path: PathBuf,
    /// Folder of the MTL; only files inside it are copied.
    pub folder: PathBuf,
    /// Whether it is never copied: its name leads out of that folder, or the folder is outside of the input.
    pub stays: bool,
}

/// Returns the files that the texture statements of the materials name, sorted by path; `brings_outside` as in
/// [`WriteOptions`](super::WriteOptions::brings_outside).
pub fn named_textures(catalogue: &Catalogue, brings_outside: bool) -> BTreeSet<NamedTexture> {
    let reach = TextureReach::of(catalogue, brings_outside);
    let named = |folder: &Path, name: &[u8]| {
        Some(NamedTexture {
            stays: reach.refuses(folder, name),
            path: texture_file::place_of(folder, name)?,
            folder: folder.to_owned(),
        })
    };
    let named = &named;
    let definitions = catalogue.materials.iter().filter_map(|material| material.definition.as_ref());
    definitions.flat_map(|d| d.textures.iter().filter_map(move |texture| named(&d.folder, &texture.name))).collect()
}

/// Relative path from a folder to a file, both canonical; the absolute path if they have no common root.
pub(super) fn path_between(folder: &Path, file: &Path) -> PathBuf {
    let common = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    if common == 0 {
        return file.to_owned();
    }
    let up = folder.components().skip(common).map(|_| Component::ParentDir);
    up.chain(file.components().skip(common)).collect()
}

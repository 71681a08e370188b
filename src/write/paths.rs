//! Lists the textures that materials name, and decides which of them may be copied.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Component, Path, PathBuf};

use crate::model::Catalogue;
use crate::model::texture_file::{self, Reach, Unusable};
use crate::os::durable::folder_of;

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
    let roots = roots(catalogue);
    let named = |folder: &Path, name: &[u8]| {
        let leaves_roots = texture_file::leads_out(name) || is_outside(folder, &roots);
        Some(NamedTexture {
            stays: leaves_roots && !brings_outside,
            path: texture_file::place_of(folder, name)?,
            folder: folder.to_owned(),
        })
    };
    let named = &named;
    let definitions = catalogue.materials.iter().filter_map(|material| material.definition.as_ref());
    definitions.flat_map(|d| d.textures.iter().filter_map(move |texture| named(&d.folder, &texture.name))).collect()
}

/// The file of a texture that an MTL in `folder` names, if it may be copied without being asked for; `roots` are those
/// of its catalogue.
///
/// # Errors
/// If there is none, or it lies outside of that folder, or the folder outside of the input.
pub fn find_inside(folder: &Path, name: &[u8], roots: &BTreeSet<PathBuf>) -> Result<PathBuf, Unusable> {
    let found = texture_file::find(folder, name, Reach::Inside)?;
    if is_outside(folder, roots) {
        return Err(Unusable::Refused("its material library lies outside of the OBJ's folder"));
    }
    Ok(found)
}

/// Canonical folders of the OBJ files and of the files that they link to, and the input folders.
pub fn roots(catalogue: &Catalogue) -> BTreeSet<PathBuf> {
    let named_in = |path: &PathBuf| fs::canonicalize(folder_of(path)).ok();
    let lies_in = |path: &PathBuf| Some(fs::canonicalize(path).ok()?.parent()?.to_owned());
    let folders = catalogue.files.iter().flat_map(|path| [named_in(path), lies_in(path)]).flatten();
    folders.chain(catalogue.folders.iter().filter_map(|folder| fs::canonicalize(folder).ok())).collect()
}

/// Reports whether a canonical folder is outside of all roots; false if there are no roots.
fn is_outside(folder: &Path, roots: &BTreeSet<PathBuf>) -> bool {
    !roots.is_empty() && !folder.ancestors().any(|above| roots.contains(above))
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

//! Resolves the texture names of an MTL to paths, and decides which files may be copied.
//!
//! In: names from MTL files, which are not trusted. Out: canonical paths of regular files inside the MTL's own folder.
//! No file is opened.

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};
use std::{fs, io};

use crate::model::Catalogue;
use crate::os::durable::folder_of;
use crate::os::path::path_of_bytes;

/// Why a texture is not copied.
pub(super) enum Unusable {
    Missing(PathBuf, io::Error),
    Refused(&'static str),
}

/// Reports whether a texture name of an MTL in `mtl_folder` resolves to a file that would be copied.
pub fn is_texture_there(mtl_folder: &Path, name: &[u8]) -> bool {
    find_source(mtl_folder, name).is_ok()
}

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
        let leaves_roots = relative_path(name).is_none_or(|relative| leaves(&relative)) || is_outside(folder, &roots);
        Some(NamedTexture {
            stays: leaves_roots && !brings_outside,
            path: place_of(folder, name)?,
            folder: folder.to_owned(),
        })
    };
    let named = &named;
    let definitions = catalogue.materials.iter().filter_map(|material| material.definition.as_ref());
    definitions.flat_map(|d| d.textures.iter().filter_map(move |texture| named(&d.folder, &texture.name))).collect()
}

/// Reports whether a relative path leads out of its folder at any component.
fn leaves(relative: &Path) -> bool {
    let depth_after = |depth: i64, component: Component<'_>| match component {
        Component::Normal(_) => Some(depth + 1),
        Component::ParentDir => (depth > 0).then_some(depth - 1),
        _ => Some(depth),
    };
    relative.components().try_fold(0, depth_after).is_none()
}

/// Canonical folders of the OBJ files and of the files that they link to, and the input folders.
pub(super) fn roots(catalogue: &Catalogue) -> BTreeSet<PathBuf> {
    let named_in = |path: &PathBuf| fs::canonicalize(folder_of(path)).ok();
    let lies_in = |path: &PathBuf| Some(fs::canonicalize(path).ok()?.parent()?.to_owned());
    let folders = catalogue.files.iter().flat_map(|path| [named_in(path), lies_in(path)]).flatten();
    folders.chain(catalogue.folders.iter().filter_map(|folder| fs::canonicalize(folder).ok())).collect()
}

/// Reports whether a canonical folder is outside of all roots; false if there are no roots.
pub(super) fn is_outside(folder: &Path, roots: &BTreeSet<PathBuf>) -> bool {
    !roots.is_empty() && !folder.ancestors().any(|above| roots.contains(above))
}

/// Returns the canonical path of a regular file inside the MTL's folder.
pub(super) fn find_source(mtl_folder: &Path, name: &[u8]) -> Result<PathBuf, Unusable> {
    let relative = relative_path(name).ok_or(Unusable::Refused("it is an absolute path"))?;
    if leaves(&relative) {
        return Err(Unusable::Refused("it leaves the folder of its MTL"));
    }
    let mtl_folder = if mtl_folder.as_os_str().is_empty() { Path::new(".") } else { mtl_folder };
    let missing = |error: io::Error| Unusable::Missing(mtl_folder.join(&relative), error);
    let folder = fs::canonicalize(mtl_folder).map_err(missing)?;
    let source = fs::canonicalize(folder.join(&relative)).map_err(missing)?;
    if !source.starts_with(&folder) {
        return Err(Unusable::Refused("it leaves the folder of its MTL through a link"));
    }
    match fs::metadata(&source).map_err(missing)?.is_file() {
        true => Ok(source),
        false => Err(Unusable::Refused("it is not a regular file")),
    }
}

/// Returns the canonical path of a regular file, inside the MTL's folder or not.
pub(super) fn find_anywhere(mtl_folder: &Path, name: &[u8]) -> Result<PathBuf, Unusable> {
    let place = place_of(mtl_folder, name).ok_or(Unusable::Refused("it is a path of another system"))?;
    let missing = |error: io::Error| Unusable::Missing(place.clone(), error);
    let source = fs::canonicalize(&place).map_err(missing)?;
    match fs::metadata(&source).map_err(missing)?.is_file() {
        true => Ok(source),
        false => Err(Unusable::Refused("it is not a regular file")),
    }
}

/// Path that a name of an MTL in `mtl_folder` leads to, inside the folder or not; `None` if it is not a path of this
/// system.
pub(super) fn place_of(mtl_folder: &Path, name: &[u8]) -> Option<PathBuf> {
    let name = with_slashes(name);
    let is_place = name.first() == Some(&b'/') && !name.contains(&0);
    Some(mtl_folder.join(relative_path(&name).or_else(|| is_place.then(|| path_of_bytes(&name)))?))
}

/// Converts a name of an MTL to a path, with `\` as `/`; `None` if it is absolute or empty.
pub(super) fn relative_path(name: &[u8]) -> Option<PathBuf> {
    let name = with_slashes(name);
    let drive = name.len() > 1 && name[0].is_ascii_alphabetic() && name[1] == b':';
    (!drive && name.first().is_some_and(|&c| c != b'/') && !name.contains(&0)).then(|| path_of_bytes(&name))
}

fn with_slashes(name: &[u8]) -> Vec<u8> {
    name.iter().map(|&c| if c == b'\\' { b'/' } else { c }).collect()
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

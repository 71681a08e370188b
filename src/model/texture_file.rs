//! Finds the files that texture names lead to.
//!
//! In: names from MTL and PLY files, which are not trusted. Out: canonical paths of regular files. No file is opened.

use std::path::{Component, Path, PathBuf};
use std::{fs, io};

use crate::os::path::{path_of_bytes, with_slashes};

/// Where the file of a texture name may lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// In the folder of the file that names it, or below.
    Inside,
    /// Anywhere.
    Anywhere,
}

/// Why the file of a texture name cannot be used.
#[derive(Debug)]
pub enum Unusable {
    /// It does not exist, or cannot be looked at; its path.
    Missing(PathBuf, io::Error),
    /// There is something else than a file of this system; what.
    NoFile(&'static str),
    /// There is a file, but it may not be used, with the reason.
    Refused(&'static str),
}

/// The canonical path of the regular file that a name leads to from the folder of the file that names it.
///
/// # Errors
/// If there is none, wherever it may lie; or if it lies out of reach.
pub fn find(folder: &Path, name: &[u8], reach: Reach) -> Result<PathBuf, Unusable> {
    let place = place_of(folder, name).ok_or(Unusable::NoFile("it is a path of another system"))?;
    let missing = |error: io::Error| Unusable::Missing(place.clone(), error);
    let found = fs::canonicalize(&place).map_err(missing)?;
    if !fs::metadata(&found).map_err(missing)?.is_file() {
        return Err(Unusable::NoFile("it is not a regular file"));
    }
    if reach == Reach::Inside {
        let relative = relative_path(name).ok_or(Unusable::Refused("it is an absolute path"))?;
        if leaves(&relative) {
            return Err(Unusable::Refused("it leaves the folder of its MTL"));
        }
        if !found.starts_with(fs::canonicalize(or_here(folder)).map_err(missing)?) {
            return Err(Unusable::Refused("it leaves the folder of its MTL through a link"));
        }
    }
    Ok(found)
}

/// The folder; where none is named, the current one.
fn or_here(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
}

/// Reports whether a name leads out of its folder by its components alone.
pub fn leads_out(name: &[u8]) -> bool {
    relative_path(name).is_none_or(|relative| leaves(&relative))
}

/// The last component of a name.
pub fn base_name(name: &[u8]) -> &[u8] {
    name.rsplit(|&c| c == b'/' || c == b'\\').next().unwrap_or(name)
}

/// Path that a name in a file in `folder` leads to, inside the folder or not; `None` if it is not a path of this
/// system.
pub fn place_of(folder: &Path, name: &[u8]) -> Option<PathBuf> {
    let name = with_slashes(name);
    let is_place = name.first() == Some(&b'/') && !name.contains(&0);
    Some(folder.join(relative_path(&name).or_else(|| is_place.then(|| path_of_bytes(&name)))?))
}

/// Converts a name of an MTL to a path, with `\` as `/`; `None` if it is absolute or empty.
pub fn relative_path(name: &[u8]) -> Option<PathBuf> {
    let name = with_slashes(name);
    let drive = name.len() > 1 && name[0].is_ascii_alphabetic() && name[1] == b':';
    (!drive && name.first().is_some_and(|&c| c != b'/') && !name.contains(&0)).then(|| path_of_bytes(&name))
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

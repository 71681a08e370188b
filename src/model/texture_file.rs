//! Finds the files that texture names lead to.
//!
//! In: names from MTL and PLY files, which are not trusted. Out: canonical paths of regular files. No file is opened.

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};
use std::{fs, io};

use super::catalogue::Catalogue;
use crate::base::Findings;
use crate::base::error::{escape, escape_path};
use crate::os::durable::folder_of;
use crate::os::path::{path_of_bytes, with_slashes};

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

impl Unusable {
    /// Notes the texture that an MTL in `folder` names so as missing, or as refused, with some advice.
    pub fn note(&self, folder: &Path, name: &[u8], advice: &str, findings: &mut Findings) {
        let place = |why: &str| format!("{} in {}: {why}", escape(name), escape_path(folder));
        match self {
            Self::Missing(_, error) => findings.note("missing_texture", || place(&error.to_string())),
            Self::NoFile(why) => findings.note("missing_texture", || place(why)),
            Self::Refused(why) => findings.note("refused_texture", || place(&format!("{why}; {advice}"))),
        }
    }
}

/// Where the files of texture names may lie.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TextureReach {
    /// Anywhere.
    Anywhere,
    /// In the folder of the file that names them, or below, which is in one of these folders, or below; anywhere below
    /// the former if these are none.
    Inside(BTreeSet<PathBuf>),
}

impl TextureReach {
    /// That of the textures of an input: its canonical folders, those of its files and of the files that they link to;
    /// or anywhere, if the user trusts it.
    pub fn of(catalogue: &Catalogue, is_trusted: bool) -> Self {
        if is_trusted {
            return Self::Anywhere;
        }
        let named_in = |path: &PathBuf| fs::canonicalize(folder_of(path)).ok();
        let lies_in = |path: &PathBuf| Some(fs::canonicalize(path).ok()?.parent()?.to_owned());
        let folders = catalogue.files.iter().flat_map(|path| [named_in(path), lies_in(path)]).flatten();
        Self::Inside(
            folders.chain(catalogue.folders.iter().filter_map(|folder| fs::canonicalize(folder).ok())).collect(),
        )
    }

    /// The canonical path of the regular file that a name leads to from the folder of the file that names it.
    ///
    /// # Errors
    /// If there is none, wherever it may lie; or if it lies out of reach.
    pub fn find(&self, folder: &Path, name: &[u8]) -> Result<PathBuf, Unusable> {
        let place = place_of(folder, name).ok_or(Unusable::NoFile("it is a path of another system"))?;
        let missing = |error: io::Error| Unusable::Missing(place.clone(), error);
        let found = fs::canonicalize(&place).map_err(missing)?;
        if !fs::metadata(&found).map_err(missing)?.is_file() {
            return Err(Unusable::NoFile("it is not a regular file"));
        }
        if *self == Self::Anywhere {
            return Ok(found);
        }
        let relative = relative_path(name).ok_or(Unusable::Refused("it is an absolute path"))?;
        if leaves(&relative) {
            return Err(Unusable::Refused("it leaves the folder of its MTL"));
        }
        if !found.starts_with(fs::canonicalize(or_here(folder)).map_err(missing)?) {
            return Err(Unusable::Refused("it leaves the folder of its MTL through a link"));
        }
        if !self.holds(folder) {
            return Err(Unusable::Refused("its material library lies outside of the OBJ's folder"));
        }
        Ok(found)
    }

    /// Whether a name in a file in a canonical folder leads out of reach, whether there is a file or not.
    pub fn refuses(&self, folder: &Path, name: &[u8]) -> bool {
        let leads_out = || relative_path(name).is_none_or(|relative| leaves(&relative));
        *self != Self::Anywhere && (leads_out() || !self.holds(folder))
    }

    /// Whether textures may lie in a canonical folder.
    fn holds(&self, folder: &Path) -> bool {
        match self {
            Self::Anywhere => true,
            Self::Inside(roots) => roots.is_empty() || folder.ancestors().any(|above| roots.contains(above)),
        }
    }
}

/// The folder; where none is named, the current one.
fn or_here(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
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

//! Which files a path stands for.
//!
//! In: a path as the user gave it. Out: OBJ files sorted by the bytes of their paths, so that the order is the same on
//! every machine.

use std::collections::HashSet;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::base::{Error, Result};

/// The OBJ files that `path` stands for: a regular file itself, or every `*.obj` (in any case) below a folder.
///
/// Symbolic links are followed; a folder that is reached twice is read once, so loops end.
///
/// # Errors
/// [`Error::Input`] if the path is neither file nor folder or nothing is there, if something named `*.obj` is neither,
/// or if nothing is found; [`Error::Io`] if a folder cannot be read.
pub fn find_inputs(path: &Path) -> Result<Vec<PathBuf>> {
    if path.as_os_str() == "-" && !path.exists() {
        return Err(not_a_file(path));
    }
    let kind = fs::metadata(path).map_err(|e| match e.kind() {
        ErrorKind::NotFound => Error::input(path, 0, format!("cannot open: {e}")),
        _ => Error::io(path, "open", e),
    })?;
    if kind.is_file() {
        return Ok(vec![path.to_owned()]);
    }
    if !kind.is_dir() {
        return Err(not_a_file(path));
    }
    let mut seen = HashSet::new();
    let mut folders = vec![path.to_owned()];
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        let real = fs::canonicalize(&folder).map_err(|e| Error::io(&folder, "open", e))?;
        if seen.insert(real) {
            read_folder(&folder, &mut folders, &mut found)?;
        }
    }
    found.sort_unstable_by(|a, b| a.as_os_str().as_encoded_bytes().cmp(b.as_os_str().as_encoded_bytes()));
    if found.is_empty() {
        return Err(Error::input(path, 0, "expected OBJ files, found no *.obj in this folder or below it"));
    }
    Ok(found)
}

fn read_folder(folder: &Path, folders: &mut Vec<PathBuf>, found: &mut Vec<PathBuf>) -> Result<()> {
    let entries = fs::read_dir(folder).and_then(Iterator::collect::<std::io::Result<Vec<_>>>);
    let mut paths: Vec<_> =
        entries.map_err(|e| Error::io(folder, "read", e))?.into_iter().map(|entry| entry.path()).collect();
    // The last folder pushed is read next: the order of names decides which of two links to a folder is taken.
    paths.sort_unstable_by(|a, b| b.cmp(a));
    for path in paths {
        let is_obj = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("obj"));
        match fs::metadata(&path) {
            Ok(kind) if kind.is_dir() => folders.push(path),
            Ok(kind) if is_obj && kind.is_file() => found.push(path),
            Ok(_) if is_obj => return Err(not_a_file(&path)),
            Err(e) if is_obj => return Err(Error::io(&path, "open", e)),
            _ => {}
        }
    }
    Ok(())
}

fn not_a_file(path: &Path) -> Error {
    Error::input(
        path,
        0,
        "expected a file or a folder; pipes and devices cannot be read: save the mesh to a file and name that",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_stands_for_every_obj_below_it_in_byte_order() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("b")).unwrap();
        for name in ["c.OBJ", "b/x.obj", "a.obj", "Z.obj", "a.mtl"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        let found = find_inputs(folder.path()).unwrap();
        let names: Vec<_> = found.iter().map(|path| path.strip_prefix(folder.path()).unwrap()).collect();
        assert_eq!(names, ["Z.obj", "a.obj", "b/x.obj", "c.OBJ"].map(Path::new));
        assert_eq!(find_inputs(&found[1]).unwrap(), [found[1].clone()]);
    }

    #[test]
    fn an_empty_folder_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(find_inputs(folder.path()), Err(Error::Input { .. })));
        let error = find_inputs(&folder.path().join("gone")).unwrap_err();
        assert_eq!(error.exit_code(), 4, "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn links_in_a_circle_are_harmless() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("tiles")).unwrap();
        fs::write(folder.path().join("tiles/a.obj"), "").unwrap();
        std::os::unix::fs::symlink(folder.path(), folder.path().join("tiles/up")).unwrap();
        assert_eq!(find_inputs(folder.path()).unwrap().len(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_refused() {
        assert!(matches!(find_inputs(Path::new("/dev/null")), Err(Error::Input { .. })));
    }
}

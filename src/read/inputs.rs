//! Finds the input files.
//!
//! In: files and folders as the user named them. Out: mesh files sorted by the bytes of their paths, so that the order
//! is the same on every machine and in whatever order they were named.

use std::cell::Cell;
use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use glob::Pattern;

use super::source::MeshFormat;
use crate::base::error::escape;
use crate::base::{Error, Findings, Result};

/// The input as the user named it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct InputChoice {
    /// OBJ and PLY files, and folders that hold some.
    pub paths: Vec<PathBuf>,
    /// Glob patterns of names, or of paths relative to a folder, that exclude files and folders.
    pub exclude: Vec<String>,
}

impl<P: AsRef<Path>> From<P> for InputChoice {
    fn from(path: P) -> Self {
        Self { paths: vec![path.as_ref().to_owned()], exclude: Vec::new() }
    }
}

impl InputChoice {
    /// Returns the first path, by which messages name the input.
    pub fn name(&self) -> &Path {
        self.paths.first().map_or(Path::new(""), PathBuf::as_path)
    }

    /// Returns the paths that are folders.
    pub fn folders(&self) -> impl Iterator<Item = &PathBuf> {
        self.paths.iter().filter(|path| path.is_dir())
    }
}

/// Returns the mesh files of a choice: the files named, and every `*.obj` and `*.ply` (in any case) below a named folder
/// that no pattern excludes. A file that is named twice is read once.
///
/// Follows symbolic links. Reads a folder once even if several paths lead to it, so loops end.
///
/// # Errors
/// [`Error::Input`] if a path does not exist or is neither a file nor a folder, if an `*.obj` or `*.ply` is neither, or if
/// a folder contains none; [`Error::Io`] if a folder cannot be read; [`Error::Usage`] if a pattern is invalid, or for a
/// GLB.
pub fn find_inputs(choice: &InputChoice) -> Result<Vec<PathBuf>> {
    find_inputs_and_idle(choice).map(|(found, _)| found)
}

/// Like [`find_inputs`], and adds a finding for each pattern that excludes nothing.
///
/// # Errors
/// Those of [`find_inputs`].
pub fn find_inputs_and_idle(choice: &InputChoice) -> Result<(Vec<PathBuf>, Findings)> {
    let pattern = |text: &String| {
        // Shells complete a folder name to `./old/`.
        let plain = text.strip_prefix("./").unwrap_or(text);
        let plain = plain.strip_suffix('/').unwrap_or(plain);
        let pattern = Pattern::new(plain)
            .map_err(|error| Error::Usage(format!("`exclude: {text}`: {}, at character {}", error.msg, error.pos)))?;
        Ok(Exclusion { pattern, has_matched: Cell::new(false) })
    };
    let left_out = choice.exclude.iter().map(pattern).collect::<Result<Vec<_>>>()?;
    let mut found = Vec::new();
    for path in &choice.paths {
        add_inputs(path, &left_out, &mut found)?;
    }
    found.sort_unstable_by(|a, b| a.as_os_str().as_encoded_bytes().cmp(b.as_os_str().as_encoded_bytes()));
    let mut seen = HashSet::new();
    found.retain(|path| seen.insert(fs::canonicalize(path).unwrap_or_else(|_| path.clone())));
    let mut findings = Findings::default();
    for (text, _) in choice.exclude.iter().zip(&left_out).filter(|(_, exclusion)| !exclusion.has_matched.get()) {
        findings.note("unused_exclude", || format!("--exclude '{}' leaves nothing out", escape(text.as_bytes())));
    }
    Ok((found, findings))
}

/// An exclusion pattern.
struct Exclusion {
    pattern: Pattern,
    has_matched: Cell<bool>,
}

impl Exclusion {
    fn matches(&self, part: &Path) -> bool {
        let matches = self.pattern.matches_path(part);
        self.has_matched.set(self.has_matched.get() || matches);
        matches
    }
}

/// Adds the mesh files of a path.
fn add_inputs(path: &Path, left_out: &[Exclusion], found: &mut Vec<PathBuf>) -> Result<()> {
    if path.as_os_str() == "-" && !path.exists() {
        return Err(not_a_file(path));
    }
    let kind = fs::metadata(path).map_err(|e| match e.kind() {
        std::io::ErrorKind::NotFound => Error::input(path, 0, format!("cannot open: {e}")),
        _ => Error::io(path, "open", e),
    })?;
    if kind.is_file() {
        MeshFormat::of(path)?;
        found.push(path.to_owned());
        return Ok(());
    }
    if !kind.is_dir() {
        return Err(not_a_file(path));
    }
    let before = found.len();
    let is_left_out = |entry: &Path| {
        let name = entry.file_name().map(Path::new);
        let inside = entry.strip_prefix(path).ok();
        // Test every pattern, to know which of them match nothing.
        let matching =
            left_out.iter().filter(|exclusion| name.into_iter().chain(inside).any(|part| exclusion.matches(part)));
        matching.count() > 0
    };
    let mut seen = HashSet::new();
    let mut folders = vec![path.to_owned()];
    while let Some(folder) = folders.pop() {
        let real = fs::canonicalize(&folder).map_err(|e| Error::io(&folder, "open", e))?;
        if seen.insert(real) {
            read_folder(&folder, &is_left_out, &mut folders, found)?;
        }
    }
    if found.len() > before {
        return Ok(());
    }
    let words = match left_out {
        [] => "expected OBJ or PLY files, found no *.obj and no *.ply in this folder or below it",
        _ => {
            "expected OBJ or PLY files, found no *.obj and no *.ply in this folder or below it that `exclude` does not leave \
             out"
        }
    };
    Err(Error::input(path, 0, words))
}

fn read_folder(
    folder: &Path,
    is_left_out: &impl Fn(&Path) -> bool,
    folders: &mut Vec<PathBuf>,
    found: &mut Vec<PathBuf>,
) -> Result<()> {
    let entries = fs::read_dir(folder).and_then(Iterator::collect::<std::io::Result<Vec<_>>>);
    let mut paths: Vec<_> =
        entries.map_err(|e| Error::io(folder, "read", e))?.into_iter().map(|entry| entry.path()).collect();
    // The folder pushed last is read next: the order of names decides which of two links to a folder is read.
    paths.sort_unstable_by(|a, b| b.cmp(a));
    for path in paths {
        if is_left_out(&path) {
            continue;
        }
        let is_mesh = MeshFormat::is_sought(&path);
        match fs::metadata(&path) {
            Ok(kind) if kind.is_dir() => folders.push(path),
            Ok(kind) if is_mesh && kind.is_file() => found.push(path),
            Ok(_) if is_mesh => return Err(not_a_file(&path)),
            Err(e) if is_mesh => return Err(Error::io(&path, "open", e)),
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
    use crate::base::ErrorKind;

    #[test]
    fn a_folder_stands_for_every_mesh_below_it_in_byte_order() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("b")).unwrap();
        for name in ["c.OBJ", "b/x.obj", "a.obj", "Z.obj", "a.mtl", "d.Ply", "e.stl"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        let found = find_inputs(&folder.path().into()).unwrap();
        let names: Vec<_> = found.iter().map(|path| path.strip_prefix(folder.path()).unwrap()).collect();
        assert_eq!(names, ["Z.obj", "a.obj", "b/x.obj", "c.OBJ", "d.Ply"].map(Path::new));
        assert_eq!(find_inputs(&(&found[1]).into()).unwrap(), [found[1].clone()]);
    }

    #[test]
    fn several_inputs_are_sorted_taken_once_and_left_out_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("tiles/lod/deep")).unwrap();
        let names = ["tiles/b.obj", "tiles/a_lod1.obj", "tiles/lod/deep/c.obj", "tiles/lod/d.obj", "z.obj"];
        names.iter().for_each(|name| fs::write(at(name), "").unwrap());
        let find = |paths: &[&str], exclude: &[&str]| {
            let paths = paths.iter().map(|name| at(name)).collect();
            let choice = InputChoice { paths, exclude: exclude.iter().map(|&text| text.to_owned()).collect() };
            let found = find_inputs(&choice).map_err(|error| error.kind())?;
            Ok(found.iter().map(|path| path.strip_prefix(folder.path()).unwrap().display().to_string()).collect())
        };
        let ok = |names: &[&str]| Ok::<Vec<String>, ErrorKind>(names.iter().map(|&name| name.to_owned()).collect());
        assert_eq!(
            find(&["z.obj", "tiles/lod", "tiles"], &[]),
            ok(&[names[1], names[0], names[3], names[2], names[4]])
        );
        assert_eq!(find(&["tiles"], &["*_lod*"]), ok(&[names[0], names[3], names[2]]));
        assert_eq!(find(&["tiles"], &["lod"]), ok(&[names[1], names[0]]));
        assert_eq!(find(&["tiles"], &["lod/*/*.obj", "?.obj"]), ok(&[names[1]]));
        assert_eq!(find(&["tiles"], &["*"]), Err(ErrorKind::Input));
        assert_eq!(find(&["tiles"], &["[z"]), Err(ErrorKind::Usage));
        assert_eq!(find(&["z.obj"], &["z*"]), ok(&["z.obj"]), "who names a file wants it");
    }

    #[test]
    fn an_empty_folder_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(find_inputs(&folder.path().into()), Err(Error::Input { .. })));
        let error = find_inputs(&folder.path().join("gone").into()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input, "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn links_in_a_circle_are_harmless() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("tiles")).unwrap();
        fs::write(folder.path().join("tiles/a.obj"), "").unwrap();
        std::os::unix::fs::symlink(folder.path(), folder.path().join("tiles/up")).unwrap();
        assert_eq!(find_inputs(&folder.path().into()).unwrap().len(), 1);
    }

    #[cfg(unix)]
    #[test]
    fn a_file_beside_a_link_to_it_is_read_once() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("b.obj"), "").unwrap();
        std::os::unix::fs::symlink(folder.path().join("b.obj"), folder.path().join("a.obj")).unwrap();
        assert_eq!(find_inputs(&folder.path().into()).unwrap(), [folder.path().join("a.obj")]);
    }

    #[cfg(unix)]
    #[test]
    fn of_many_links_to_a_folder_the_first_by_name_is_taken() {
        let (folder, tiles) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        fs::write(tiles.path().join("a.obj"), "").unwrap();
        for i in (10..40).rev() {
            std::os::unix::fs::symlink(tiles.path(), folder.path().join(format!("link{i}"))).unwrap();
        }
        assert_eq!(find_inputs(&folder.path().into()).unwrap(), [folder.path().join("link10/a.obj")]);
    }

    #[test]
    fn a_glb_is_refused_before_anything_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.glb");
        fs::write(&path, b"glTF\x02\0\0\0").unwrap();
        let error = find_inputs(&path.into()).unwrap_err();
        assert!(matches!(&error, Error::Usage(words) if words.contains("a GLB is written, but not read")), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_refused() {
        assert!(matches!(find_inputs(&"/dev/null".into()), Err(Error::Input { .. })));
    }
}

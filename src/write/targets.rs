//! Chooses the paths of the result, and refuses to replace files that must be kept.
//!
//! In: the path of the output, and the files that the result depends on. Out: paths of the mesh and the MTL in a
//! canonical folder. Invariant: no target is a file of the input, by whatever name either is given.

use std::collections::{HashMap, HashSet};
use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Path, PathBuf};

use super::copy::{Look, look};
use super::format::ResultFormat;
use crate::base::error::escape_path;
use crate::base::{Error, Result};
use crate::os::durable::{DurableFile, folder_of, make_folders};

/// The files that a result depends on: mesh files, material libraries, texture images.
#[derive(Debug, Clone, Default)]
pub struct Sources {
    /// Their directory entries: canonical paths, and the paths as named with the folder made canonical.
    entries: HashSet<PathBuf>,
    /// Other ways to reach them: a name in different case, or the same name in a folder that is mounted twice.
    identities: HashSet<Identity>,
    places: HashSet<(Identity, OsString)>,
}

/// Device and inode of a file or folder.
type Identity = (u64, u64);

impl Sources {
    /// Collects these files, whether they exist or not.
    pub fn new<'a>(paths: impl IntoIterator<Item = &'a Path>) -> Self {
        let mut sources = Self::default();
        let mut folders = HashMap::new();
        for path in paths {
            let folder = folder_of(path);
            let known = folders.entry(folder).or_insert_with(|| {
                let folder = fs::canonicalize(folder).ok()?;
                let identity = fs::metadata(&folder).ok().and_then(|meta| identity(&meta));
                Some((folder, identity))
            });
            if let (Some((folder, identity)), Some(name)) = (known, path.file_name()) {
                sources.entries.insert(folder.join(name));
                sources.places.extend(identity.map(|identity| (identity, name.to_owned())));
            }
            let Ok(look) = fs::symlink_metadata(path) else { continue };
            sources.identities.extend(only_name(&look));
            if !look.is_file() {
                sources.entries.extend(fs::canonicalize(path));
                sources.identities.extend(fs::metadata(path).iter().filter_map(only_name));
            }
        }
        sources
    }

    /// Reports whether a file written to this path would replace one of them.
    pub fn forbid(&self, target: &Path) -> bool {
        let known = |meta: fs::Metadata| only_name(&meta).is_some_and(|identity| self.identities.contains(&identity));
        entry(target).is_some_and(|entry| self.entries.contains(&entry))
            || place(target).is_some_and(|place| self.places.contains(&place))
            || fs::symlink_metadata(target).is_ok_and(known)
    }

    /// Reports whether a path leads to one of them, possibly through links.
    pub fn are_at(&self, target: &Path) -> bool {
        self.forbid(target) || fs::canonicalize(target).is_ok_and(|there| self.entries.contains(&there))
    }
}

/// The path with its folder made canonical; its last component may be a link.
fn entry(path: &Path) -> Option<PathBuf> {
    Some(fs::canonicalize(folder_of(path)).ok()?.join(path.file_name()?))
}

/// Identity of the file's folder, and the file name.
fn place(path: &Path) -> Option<(Identity, OsString)> {
    let entry = entry(path)?;
    Some((identity(&fs::metadata(entry.parent()?).ok()?)?, entry.file_name()?.to_owned()))
}

/// Identity of a file that has a single name; `None` for one with several, since another name of it may be replaced.
fn only_name(meta: &fs::Metadata) -> Option<Identity> {
    #[cfg(unix)]
    if std::os::unix::fs::MetadataExt::nlink(meta) > 1 {
        return None;
    }
    identity(meta).filter(|_| !meta.is_dir())
}

/// Identity of a file; `None` if the system does not provide one.
fn identity(meta: &fs::Metadata) -> Option<Identity> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        Some((meta.dev(), meta.ino()))
    }
    #[cfg(not(unix))]
    {
        let _ = meta;
        None
    }
}

/// Returns why an OBJ or MTL could not refer to a file of this name, or `None` if it can.
pub fn why_unnameable(name: &OsStr) -> Option<&'static str> {
    let name = name.as_encoded_bytes();
    if name.iter().any(u8::is_ascii_control) {
        return Some("the output's name has control characters, which an MTL cannot refer to");
    }
    let is_blank = |byte: Option<&u8>| byte == Some(&b' ');
    if name.contains(&b'\\') || name.get(1) == Some(&b':') || is_blank(name.first()) || is_blank(name.last()) {
        return Some("the output's name has a backslash, a drive or a blank at an end, which an OBJ cannot refer to");
    }
    None
}

/// Folder for the textures of an output.
pub fn textures_folder(output: &Path) -> PathBuf {
    let mut name = output.file_stem().unwrap_or_default().to_owned();
    name.push("_textures");
    output.with_file_name(name)
}

/// Paths of the result in a canonical folder.
#[derive(Debug)]
pub(super) struct Targets {
    pub(super) folder: PathBuf,
    /// The OBJ, PLY or GLB.
    pub(super) mesh: PathBuf,
    pub(super) format: ResultFormat,
    /// The MTL of an OBJ.
    pub(super) mtl: Option<PathBuf>,
}

impl Targets {
    /// Creates the folder, and checks that no file which must be kept is in the way.
    ///
    /// # Errors
    /// [`Error::Usage`] that names the file in the way.
    pub(super) fn choose(output: &Path, sources: &Sources, force: bool) -> Result<Self> {
        let refuse = |why: &str| Err(Error::Usage(format!("{}: {why}", escape_path(output))));
        let (Some(name), Some(stem)) = (output.file_name(), output.file_stem()) else {
            return refuse("the output must be a file name");
        };
        if let Some(why) = why_unnameable(name) {
            return refuse(why);
        }
        let folder = folder_of(output);
        make_folders(folder)?;
        let folder = fs::canonicalize(folder).map_err(|e| Error::io(folder, "open", e))?;
        let mut mtl_name = stem.to_owned();
        mtl_name.push(".mtl");
        let format = ResultFormat::by_ending(output).unwrap_or(ResultFormat::Obj);
        let mtl = (format == ResultFormat::Obj).then(|| folder.join(mtl_name));
        let targets = Self { mesh: folder.join(name), mtl, format, folder };
        if targets.mtl.as_ref() == Some(&targets.mesh) {
            return refuse("the output is the OBJ; its MTL takes this name");
        }
        for target in targets.files() {
            if target.is_dir() {
                return Err(Error::Usage(format!("{}: is a folder; choose another output", escape_path(target))));
            }
            if sources.are_at(target) {
                let target = escape_path(target);
                return Err(Error::Usage(format!(
                    "{target}: a file of the input would be replaced; choose another output"
                )));
            }
        }
        if !force && targets.mesh.symlink_metadata().is_ok() {
            return refuse("exists; `force` replaces it");
        }
        Ok(targets)
    }

    /// Folder for the textures.
    pub(super) fn textures(&self) -> PathBuf {
        textures_folder(&self.mesh)
    }

    /// The mesh file and the MTL.
    pub(super) fn files(&self) -> Vec<&Path> {
        std::iter::once(&self.mesh).chain(&self.mtl).map(PathBuf::as_path).collect()
    }

    /// Name of the MTL as the OBJ refers to it.
    pub(super) fn library_name(&self) -> &[u8] {
        self.mtl.as_deref().and_then(Path::file_name).unwrap_or_default().as_encoded_bytes()
    }

    /// Refuses to replace an MTL that is not a part of `whole`.
    ///
    /// # Errors
    /// [`Error::Usage`] if there is one and `force` is not set.
    pub(super) fn check_mtl(&self, mtl: &Path, whole: &[u8], force: bool) -> Result<()> {
        let is_ours = || {
            fs::metadata(mtl).is_ok_and(|found| found.len() <= whole.len() as u64)
                && fs::read(mtl).is_ok_and(|found| is_part_of(&found, whole))
        };
        if look(mtl).is_some() && !force && !is_ours() {
            return Err(exists(mtl));
        }
        Ok(())
    }

    /// Writes the MTL under a temporary name; also returns the state of the file that it replaces.
    ///
    /// # Errors
    /// [`Error::Usage`] if a different MTL exists and `force` is not set; those of the file system.
    pub(super) fn begin_mtl(&self, mtl: &Path, text: &[u8], force: bool, job: u64) -> Result<(DurableFile, Look)> {
        // NOTE: the same MTL may exist already, left by a run that was killed before it renamed its OBJ.
        let before = look(mtl);
        let same = || {
            fs::metadata(mtl).is_ok_and(|found| found.len() == text.len() as u64)
                && fs::read(mtl).is_ok_and(|found| found == text)
        };
        if before.is_some() && !force && !same() {
            return Err(exists(mtl));
        }
        let mut file = DurableFile::create_outside(mtl, job, 64 << 10)?;
        file.write(text)?;
        file.seal()?;
        Ok((file, before))
    }
}

fn exists(path: &Path) -> Error {
    Error::Usage(format!("{}: exists; `force` replaces it", escape_path(path)))
}

/// Reports whether an MTL equals `whole`, or `whole` without some of its materials, as an interrupted run may have left
/// it.
fn is_part_of(mtl: &[u8], whole: &[u8]) -> bool {
    let (mut found, mut all) = (blocks(mtl), blocks(whole));
    found.next() == all.next() && found.all(|block| all.any(|other| other == block))
}

/// Splits an MTL into its signature and its materials.
fn blocks(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    const BEGINNING: &[u8] = b"\n\nnewmtl ";
    let mut rest = Some(text);
    std::iter::from_fn(move || {
        let text = rest?;
        match text.windows(BEGINNING.len()).position(|window| window == BEGINNING) {
            Some(end) => {
                rest = Some(&text[end + 1..]);
                Some(&text[..=end])
            }
            None => rest.take(),
        }
    })
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_the_input_is_known_by_any_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::create_dir(path("store")).unwrap();
        fs::write(path("store/a.jpg"), "a").unwrap();
        std::os::unix::fs::symlink("store/a.jpg", path("wall.jpg")).unwrap();
        std::os::unix::fs::symlink("store", path("shop")).unwrap();
        let sources = Sources::new([path("wall.jpg").as_path(), &path("not/there.jpg")]);
        assert!(sources.forbid(&path("wall.jpg")) && sources.forbid(&path("store/a.jpg")));
        assert!(sources.forbid(&path("shop/../store/a.jpg")));
        // A link to the input may be replaced, but an output that is one was meant to be the input.
        std::os::unix::fs::symlink("store/a.jpg", path("link.jpg")).unwrap();
        assert!(!sources.forbid(&path("link.jpg")) && sources.are_at(&path("link.jpg")));
        assert!(!sources.are_at(&path("new.jpg")));
    }

    #[test]
    fn another_name_of_an_input_file_may_be_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let (one, other) = (folder.path().join("one.obj"), folder.path().join("other.obj"));
        fs::write(&one, "").unwrap();
        fs::hard_link(&one, &other).unwrap();
        assert!(!Sources::new([one.as_path()]).are_at(&other));
    }

    #[test]
    fn an_mtl_without_some_materials_is_a_part_of_the_whole() {
        let whole = b"# drystone 0\n\nnewmtl a\nKd 1 1 1\n\nnewmtl b\n\nnewmtl c\nKd 0 0 0\n";
        for part in ["\nnewmtl b\n", "\nnewmtl a\nKd 1 1 1\n\nnewmtl c\nKd 0 0 0\n", ""] {
            assert!(is_part_of(format!("# drystone 0\n{part}").as_bytes(), whole), "{part}");
        }
        for other in ["# drystone 0\n\nnewmtl b\nKd 1 1 1\n", "\nnewmtl b\n", "", "# drystone 0\n\nnewmtl d\n"] {
            assert!(!is_part_of(other.as_bytes(), whole), "{other}");
        }
    }
}

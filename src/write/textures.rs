//! Where the images of a material go, and how the MTL refers to them.
//!
//! ```text
//! map_Kd -s 1 1 1 ..\wall.png      refused: leaves the MTL's folder; the statement stays as it was
//! map_Kd photos/wall.png      →    map_Kd city_textures/wall.png
//! map_Kd roofs/wall.png       →    map_Kd city_textures/wall_2.png
//! ```
//! In: texture names as MTL files write them, which nobody vouches for. Out: references, and files that wait under
//! temporary names until [`TextureStage::commit`]. Invariant: only regular files inside the MTL's own folder are
//! copied or linked, and only into one folder, under names that hold no separator. No image is decoded.
//!
//! # Files
//! `<stem>_textures/` beside the output.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Component, Path, PathBuf};

use super::Textures;
use crate::base::error::{escape, escape_path};
use crate::base::{Error, Findings, Result};
use crate::os::durable::sync_folder;
use crate::os::system::is_of_machine;
use crate::store::Catalogue;

const COPY_BUFFER_BYTES: usize = 256 << 10;

/// Textures on their way to the result.
#[derive(Debug)]
pub(super) struct TextureStage {
    mode: Textures,
    force: bool,
    output_folder: PathBuf,
    folder: PathBuf,
    folder_name: Vec<u8>,
    /// References by the MTL's folder and the name that it writes.
    references: BTreeMap<(PathBuf, Vec<u8>), Vec<u8>>,
    /// Names in the folder by source.
    names: BTreeMap<PathBuf, Vec<u8>>,
    /// Names in the folder in lower case, since some file systems do not tell the case.
    taken: BTreeSet<Vec<u8>>,
    staged: Vec<StagedFile>,
    /// Removed again, if empty, when nothing is committed; dropped after the files in it.
    made_folder: Option<MadeFolder>,
    /// What was refused or missing.
    pub(super) findings: Findings,
}

/// A finished file under a temporary name, removed on drop unless it got its own.
#[derive(Debug)]
struct StagedFile {
    temporary: PathBuf,
    target: PathBuf,
}

impl Drop for StagedFile {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.temporary);
    }
}

#[derive(Debug)]
struct MadeFolder(PathBuf);

impl Drop for MadeFolder {
    fn drop(&mut self) {
        let _ = fs::remove_dir(&self.0);
    }
}

/// Why a texture stays where it is.
enum Unusable {
    Missing(PathBuf, io::Error),
    Refused(&'static str),
}

impl TextureStage {
    /// Textures for an output in `output_folder` (a canonical path) with the file stem `stem`.
    pub(super) fn new(mode: Textures, force: bool, output_folder: &Path, stem: &std::ffi::OsStr) -> Self {
        let mut folder_name = stem.to_owned();
        folder_name.push("_textures");
        let folder = output_folder.join(&folder_name);
        Self {
            mode,
            force,
            output_folder: output_folder.to_owned(),
            // The folder may be a symbolic link; what matters is where the files really go.
            folder: fs::canonicalize(&folder).unwrap_or(folder),
            folder_name: folder_name.into_encoded_bytes(),
            references: BTreeMap::new(),
            names: BTreeMap::new(),
            taken: BTreeSet::new(),
            staged: Vec::new(),
            made_folder: None,
            findings: Findings::default(),
        }
    }

    /// How the new MTL refers to the texture `name` of an MTL in `mtl_folder`; copies or links it on first mention.
    ///
    /// # Errors
    /// [`Error::Usage`] if a file is in the way, [`Error::Io`] or [`Error::NoSpace`] if the copy fails.
    pub(super) fn reference(&mut self, mtl_folder: &Path, name: &[u8]) -> Result<Vec<u8>> {
        let key = (mtl_folder.to_owned(), name.to_owned());
        if let Some(reference) = self.references.get(&key) {
            return Ok(reference.clone());
        }
        let outcome = match self.mode {
            Textures::Reference => Ok(self.refer(mtl_folder, name)),
            Textures::Copy | Textures::Link => match find_source(mtl_folder, name) {
                Ok(source) => self.bring(&source, name)?,
                Err(unusable) => Err(unusable),
            },
        };
        let place = |why: &str| format!("{} of {}: {why}", escape(name), escape_path(mtl_folder));
        let reference = match outcome {
            Ok(reference) => reference,
            // A picture that cannot be read just now is not left out for that.
            Err(Unusable::Missing(path, error)) if is_of_machine(&error) => {
                return Err(Error::io(&path, "read", error));
            }
            Err(Unusable::Missing(_, error)) => {
                self.findings.note("missing_texture", || place(&error.to_string()));
                name.to_owned()
            }
            Err(Unusable::Refused(why)) => {
                self.findings.note("refused_texture", || place(why));
                name.to_owned()
            }
        };
        self.references.insert(key, reference.clone());
        Ok(reference)
    }

    /// The path from the output's folder to a file that stays where it is.
    fn refer(&mut self, mtl_folder: &Path, name: &[u8]) -> Vec<u8> {
        let Some(relative) = relative_path(name) else { return name.to_owned() };
        let source = mtl_folder.join(relative);
        match fs::canonicalize(&source).and_then(|path| Ok((fs::metadata(&path)?, path))) {
            Ok((metadata, path)) if metadata.is_file() => {
                not_an_option(slashes(&path_between(&self.output_folder, &path)))
            }
            _ => {
                let place = || format!("{}: no such file", escape_path(&source));
                self.findings.note("missing_texture", place);
                name.to_owned()
            }
        }
    }

    /// Copies or links a file into the folder, unless it is on its way already.
    fn bring(&mut self, source: &Path, name: &[u8]) -> Result<std::result::Result<Vec<u8>, Unusable>> {
        if let Some(known) = self.names.get(source) {
            return Ok(Ok(self.reference_to(known)));
        }
        let file = match open_regular(source) {
            Ok(file) => file,
            Err(error) => return Ok(Err(Unusable::Missing(source.to_owned(), error))),
        };
        let unique = self.unique_name(name);
        let target = self.folder.join(path_of(&unique));
        if target == source {
            let message = format!("{}: the texture would replace itself; choose another output", escape_path(source));
            return Err(Error::Usage(message));
        }
        let link = path_between(&self.folder, source);
        let exists = fs::symlink_metadata(&target).is_ok();
        let same = exists
            && match self.mode {
                Textures::Link => fs::read_link(&target).is_ok_and(|present| present == link),
                _ => same_content(&target, source).unwrap_or(false),
            };
        if exists && !same && !self.force {
            let message = format!("{}: exists and differs; --force replaces it", escape_path(&target));
            return Err(Error::Usage(message));
        }
        // NOTE: a left-over of a killed run may stand there; it is ours by its name.
        let temporary = self.folder.join(path_of(&[&unique, b".drystone.tmp".as_slice()].concat()));
        let _ = fs::remove_file(&temporary);
        if !same {
            self.make_folder()?;
            let staged = StagedFile { temporary, target };
            let linked = self.mode == Textures::Link
                && (symlink(&link, &staged.temporary).is_ok() || fs::hard_link(source, &staged.temporary).is_ok());
            if !linked && let Err(error) = copy(file, &staged.temporary)? {
                self.taken.remove(&unique.to_ascii_lowercase());
                return Ok(Err(Unusable::Missing(source.to_owned(), error)));
            }
            self.staged.push(staged);
        }
        let reference = self.reference_to(&unique);
        self.names.insert(source.to_owned(), unique);
        Ok(Ok(reference))
    }

    fn reference_to(&self, name: &[u8]) -> Vec<u8> {
        not_an_option([&self.folder_name, b"/".as_slice(), name].concat())
    }

    /// The last component of `name`, made harmless and different from all names so far.
    fn unique_name(&mut self, name: &[u8]) -> Vec<u8> {
        let base = name.rsplit(|&c| c == b'/' || c == b'\\').next().unwrap_or(name);
        let unsafe_in_names = |c: u8| c.is_ascii_control() || b"/\\:*?\"<>|".contains(&c);
        let mut base: Vec<u8> = base.iter().map(|&c| if unsafe_in_names(c) { b'_' } else { c }).collect();
        match base.first() {
            None => base.push(b'_'),
            Some(b'.' | b'-' | b' ') => base[0] = b'_',
            Some(_) => {}
        }
        let dot = base.iter().rposition(|&c| c == b'.').unwrap_or(base.len());
        let (stem, extension) = base.split_at(dot);
        let mut unique = base.clone();
        for number in 2u64.. {
            if self.taken.insert(unique.to_ascii_lowercase()) {
                break;
            }
            unique = [stem, format!("_{number}").as_bytes(), extension].concat();
        }
        unique
    }

    fn make_folder(&mut self) -> Result<()> {
        match fs::create_dir(&self.folder) {
            Ok(()) => {
                self.made_folder = Some(MadeFolder(self.folder.clone()));
                Ok(())
            }
            Err(_) if self.folder.is_dir() => Ok(()),
            Err(error) => Err(Error::io(&self.folder, "create", error)),
        }
    }

    /// Refuses to go on if a file that was read would be replaced.
    ///
    /// # Errors
    /// [`Error::Usage`] naming the file; `others` are the further targets of the run.
    pub(super) fn check_targets(&self, others: &[&Path]) -> Result<()> {
        let targets = self.staged.iter().map(|staged| staged.target.as_path()).chain(others.iter().copied());
        match targets.into_iter().find(|&target| self.names.contains_key(target)) {
            None => Ok(()),
            Some(target) => {
                let target = escape_path(target);
                Err(Error::Usage(format!("{target}: a texture of the input would be replaced; choose another output")))
            }
        }
    }

    /// Gives the files their names.
    ///
    /// # Errors
    /// [`Error::Io`] if a file cannot be renamed.
    pub(super) fn commit(self) -> Result<()> {
        for file in &self.staged {
            fs::rename(&file.temporary, &file.target).map_err(|e| Error::io(&file.target, "rename", e))?;
        }
        if let Some(file) = self.staged.first() {
            sync_folder(&file.target)?;
            sync_folder(&self.folder)?;
        }
        Ok(())
    }
}

/// Whether a texture that an MTL in `mtl_folder` names is a file that would be copied.
pub fn is_texture_there(mtl_folder: &Path, name: &[u8]) -> bool {
    find_source(mtl_folder, name).is_ok()
}

/// The files that the materials' texture statements name, there or not, in order of their paths.
pub fn texture_paths(catalogue: &Catalogue) -> BTreeSet<PathBuf> {
    let definitions = catalogue.materials.iter().filter_map(|material| material.definition.as_ref());
    let path = |folder: &Path, name: &[u8]| Some(folder.join(relative_path(name)?));
    definitions.flat_map(|d| d.textures.iter().filter_map(move |texture| path(&d.folder, &texture.name))).collect()
}

/// The canonical path of a regular file inside the MTL's folder.
fn find_source(mtl_folder: &Path, name: &[u8]) -> std::result::Result<PathBuf, Unusable> {
    let relative = relative_path(name).ok_or(Unusable::Refused("it is an absolute path"))?;
    let mut depth = 0;
    for component in relative.components() {
        depth += match component {
            Component::Normal(_) => 1,
            Component::ParentDir => -1,
            _ => 0,
        };
        if depth < 0 {
            return Err(Unusable::Refused("it leaves the folder of its MTL"));
        }
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

fn open_regular(source: &Path) -> io::Result<File> {
    let file = File::open(source)?;
    match file.metadata()?.is_file() {
        true => Ok(file),
        false => Err(io::Error::other("not a regular file")),
    }
}

/// A name of an MTL as a path, `\` taken for `/`; nothing if it is absolute or names nothing.
fn relative_path(name: &[u8]) -> Option<PathBuf> {
    let name: Vec<u8> = name.iter().map(|&c| if c == b'\\' { b'/' } else { c }).collect();
    let drive = name.len() > 1 && name[0].is_ascii_alphabetic() && name[1] == b':';
    (!drive && name.first().is_some_and(|&c| c != b'/') && !name.contains(&0)).then(|| path_of(&name))
}

#[cfg(unix)]
fn path_of(name: &[u8]) -> PathBuf {
    use std::os::unix::ffi::OsStrExt;
    PathBuf::from(std::ffi::OsStr::from_bytes(name))
}

#[cfg(not(unix))]
fn path_of(name: &[u8]) -> PathBuf {
    PathBuf::from(String::from_utf8_lossy(name).into_owned())
}

/// The path from a folder to a file, both canonical; absolute if they have no root in common.
fn path_between(folder: &Path, file: &Path) -> PathBuf {
    let common = folder.components().zip(file.components()).take_while(|(a, b)| a == b).count();
    if common == 0 {
        return file.to_owned();
    }
    let up = folder.components().skip(common).map(|_| Component::ParentDir);
    up.chain(file.components().skip(common)).collect()
}

/// A reference that begins with `-` would be read as an option; `./` keeps it from that.
fn not_an_option(reference: Vec<u8>) -> Vec<u8> {
    if reference.starts_with(b"-") { [b"./", reference.as_slice()].concat() } else { reference }
}

fn slashes(path: &Path) -> Vec<u8> {
    let bytes = path.as_os_str().as_encoded_bytes();
    bytes.iter().map(|&c| if cfg!(windows) && c == b'\\' { b'/' } else { c }).collect()
}

#[cfg(unix)]
fn symlink(target: &Path, link: &Path) -> io::Result<()> {
    std::os::unix::fs::symlink(target, link)
}

#[cfg(windows)]
fn symlink(target: &Path, link: &Path) -> io::Result<()> {
    std::os::windows::fs::symlink_file(target, link)
}

/// Copies a file to a new one and syncs it; the inner error is that of reading.
fn copy(mut source: File, target: &Path) -> Result<io::Result<()>> {
    let wrap = |error| Error::io(target, "write", error);
    let mut copy = OpenOptions::new().write(true).create_new(true).open(target).map_err(wrap)?;
    let mut buffer = vec![0; COPY_BUFFER_BYTES];
    loop {
        match source.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => copy.write_all(&buffer[..count]).map_err(wrap)?,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Ok(Err(error)),
        }
    }
    copy.sync_data().map_err(wrap)?;
    Ok(Ok(()))
}

/// Whether both are regular files (no links) with the same bytes.
fn same_content(a: &Path, b: &Path) -> io::Result<bool> {
    let metadata = fs::symlink_metadata(a)?;
    if !metadata.is_file() || metadata.len() != fs::metadata(b)?.len() {
        return Ok(false);
    }
    let mut a = io::BufReader::with_capacity(COPY_BUFFER_BYTES, File::open(a)?);
    let mut b = File::open(b)?;
    let (mut left, mut right) = (vec![0; COPY_BUFFER_BYTES], vec![0; COPY_BUFFER_BYTES]);
    loop {
        let count = b.read(&mut right)?;
        if count == 0 {
            return Ok(true);
        }
        a.read_exact(&mut left[..count])?;
        if left[..count] != right[..count] {
            return Ok(false);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Folders {
        root: tempfile::TempDir,
        input: PathBuf,
        output: PathBuf,
    }

    fn folders() -> Folders {
        let root = tempfile::tempdir().unwrap();
        let (input, output) = (root.path().join("in"), root.path().join("out"));
        fs::create_dir_all(input.join("a")).unwrap();
        fs::create_dir_all(input.join("b")).unwrap();
        fs::create_dir(&output).unwrap();
        fs::write(root.path().join("secret.txt"), "secret").unwrap();
        fs::write(input.join("a/wall.png"), "first").unwrap();
        fs::write(input.join("b/Wall.png"), "second").unwrap();
        let output = fs::canonicalize(output).unwrap();
        Folders { input, output, root }
    }

    fn stage(folders: &Folders, mode: Textures) -> TextureStage {
        TextureStage::new(mode, false, &folders.output, "city".as_ref())
    }

    fn refer(stage: &mut TextureStage, folders: &Folders, name: &str) -> String {
        String::from_utf8(stage.reference(&folders.input, name.as_bytes()).unwrap()).unwrap()
    }

    #[test]
    fn textures_of_one_name_are_told_apart_and_copied_once() {
        let folders = folders();
        let mut stage = stage(&folders, Textures::Copy);
        assert_eq!(refer(&mut stage, &folders, "a/wall.png"), "city_textures/wall.png");
        assert_eq!(refer(&mut stage, &folders, "b\\Wall.png"), "city_textures/Wall_2.png");
        assert_eq!(refer(&mut stage, &folders, "./b/../a/wall.png"), "city_textures/wall.png");
        let textures = folders.output.join("city_textures");
        assert!(!textures.join("wall.png").exists());
        stage.commit().unwrap();
        assert_eq!(fs::read(textures.join("wall.png")).unwrap(), b"first");
        assert_eq!(fs::read(textures.join("Wall_2.png")).unwrap(), b"second");
        assert_eq!(fs::read_dir(textures).unwrap().count(), 2);
    }

    #[test]
    fn nothing_outside_the_folder_is_copied() {
        let folders = folders();
        let mut stage = stage(&folders, Textures::Copy);
        let absolute = folders.root.path().join("secret.txt");
        let names =
            ["../secret.txt", "..\\secret.txt", "a/../../secret.txt", absolute.to_str().unwrap(), "C:\\x.png", "a"];
        for name in names {
            assert_eq!(refer(&mut stage, &folders, name), name);
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&absolute, folders.input.join("innocent.png")).unwrap();
            assert_eq!(refer(&mut stage, &folders, "innocent.png"), "innocent.png");
            assert_eq!(stage.findings.get("refused_texture"), 7);
        }
        assert_eq!(refer(&mut stage, &folders, "none.png"), "none.png");
        assert_eq!(stage.findings.get("missing_texture"), 1);
        stage.commit().unwrap();
        assert_eq!(fs::read_dir(&folders.output).unwrap().count(), 0);
    }

    #[test]
    fn hostile_names_become_harmless() {
        let folders = folders();
        let mut stage = stage(&folders, Textures::Copy);
        for (name, expected) in [
            ("-rf.png", "_rf.png"),
            (".hidden", "_hidden"),
            ("..", "_."),
            ("", "_"),
            ("a\u{1b}[31m.png", "a_[31m.png"),
            ("x/y:z.png", "y_z.png"),
            ("Y_z.png", "Y_z_2.png"),
        ] {
            assert_eq!(stage.unique_name(name.as_bytes()), expected.as_bytes());
        }
    }

    #[test]
    fn an_abandoned_stage_leaves_nothing() {
        let folders = folders();
        let mut stage = stage(&folders, Textures::Copy);
        refer(&mut stage, &folders, "a/wall.png");
        drop(stage);
        assert_eq!(fs::read_dir(&folders.output).unwrap().count(), 0);
    }

    #[test]
    fn what_a_killed_run_left_of_other_textures_goes() {
        let folders = folders();
        let textures = folders.output.join("city_textures");
        fs::create_dir(&textures).unwrap();
        fs::write(textures.join("wall.png"), "first").unwrap();
        fs::write(textures.join("Wall_2.png.drystone.tmp"), "seco").unwrap();
        let mut stage = stage(&folders, Textures::Copy);
        refer(&mut stage, &folders, "a/wall.png");
        refer(&mut stage, &folders, "b/Wall.png");
        stage.commit().unwrap();
        assert_eq!(fs::read_dir(textures).unwrap().count(), 2);
    }

    #[test]
    fn another_file_in_the_way_is_kept_and_the_same_one_is_used() {
        let folders = folders();
        let textures = folders.output.join("city_textures");
        fs::create_dir(&textures).unwrap();
        fs::write(textures.join("wall.png"), "first").unwrap();
        let mut same = stage(&folders, Textures::Copy);
        assert_eq!(refer(&mut same, &folders, "a/wall.png"), "city_textures/wall.png");
        fs::write(textures.join("wall.png"), "mine!").unwrap();
        let mut other = stage(&folders, Textures::Copy);
        let error = other.reference(&folders.input, b"a/wall.png").unwrap_err();
        assert!(matches!(error, Error::Usage(message) if message.contains("--force")));
    }

    #[test]
    fn a_texture_never_replaces_itself() {
        let folders = folders();
        fs::create_dir(folders.input.join("city_textures")).unwrap();
        fs::write(folders.input.join("city_textures/wall.png"), "own").unwrap();
        let folder = fs::canonicalize(&folders.input).unwrap();
        let mut stage = TextureStage::new(Textures::Copy, true, &folder, "city".as_ref());
        assert!(matches!(stage.reference(&folder, b"city_textures/wall.png"), Err(Error::Usage(_))));
        let mut stage = TextureStage::new(Textures::Copy, true, &folder, "city".as_ref());
        refer(&mut stage, &folders, "a/wall.png");
        // The second `wall.png` gets another name, but the first one would replace it.
        refer(&mut stage, &folders, "city_textures/wall.png");
        assert!(matches!(stage.check_targets(&[]), Err(Error::Usage(_))));
    }

    #[test]
    fn references_lead_to_the_original() {
        let folders = folders();
        let mut stage = stage(&folders, Textures::Reference);
        assert_eq!(refer(&mut stage, &folders, "a\\wall.png"), "../in/a/wall.png");
        assert_eq!(refer(&mut stage, &folders, "../in/a/wall.png"), "../in/a/wall.png");
        assert_eq!(refer(&mut stage, &folders, "none.png"), "none.png");
        assert_eq!(stage.findings.get("missing_texture"), 1);
        let mut stage = TextureStage::new(Textures::Copy, false, &folders.output, "-city".as_ref());
        assert_eq!(refer(&mut stage, &folders, "a/wall.png"), "./-city_textures/wall.png");
    }

    #[cfg(unix)]
    #[test]
    fn links_lead_to_the_original() {
        let folders = folders();
        for _ in 0..2 {
            let mut stage = stage(&folders, Textures::Link);
            assert_eq!(refer(&mut stage, &folders, "a/wall.png"), "city_textures/wall.png");
            stage.commit().unwrap();
            let link = folders.output.join("city_textures/wall.png");
            assert_eq!(fs::read_link(&link).unwrap(), Path::new("../../in/a/wall.png"));
            assert_eq!(fs::read(link).unwrap(), b"first");
        }
    }
}

//! Provides the texture images of the result, and how the MTL refers to them.
//!
//! ```text
//! map_Kd -s 1 1 1 ..\wall.png  →    map_Kd -s 1 1 1 ../in/wall.png (outside of the MTL's folder: never copied)
//! map_Kd photos/wall.png      →    map_Kd city_textures/wall.png
//! map_Kd roofs/wall.png       →    map_Kd city_textures/wall_2.png
//! ```
//! In: texture names from MTL files, which are not trusted. Out: references, and files under temporary names until
//! [`TextureStage::commit`]. Invariant: only regular files inside the MTL's own folder are copied or linked, and only
//! if that folder lies in the OBJ's, unless the user allows more. All of them go to one folder, under names without
//! separators. No image is decoded.
//!
//! # Files
//! `<stem>_textures/` beside the output.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs;
use std::path::{Path, PathBuf};

use super::companion::{Companion, CopiedTexture};
use super::copy::{CopyError, Look, copy, look, open_regular, same_content, symlink};
use super::options::{Textures, WriteOptions};
use super::paths::path_between;
use super::targets::{Sources, Targets};
use crate::base::error::escape_path;
use crate::base::{Error, Findings, Result};
use crate::model::Catalogue;
use crate::model::texture_file::{TextureReach, Unusable, base_name, place_of};
use crate::os::content::Content;
use crate::os::durable::{give_name, sync_folder, waiting_place};
use crate::os::path::path_of_bytes;
use crate::os::system::is_of_machine;

/// Longest stem in bytes; leaves room for a number and an extension in the 255 bytes that file systems allow.
const STEM_BYTES_MAX: usize = 220;

/// Advice for a texture that is not copied.
const REFERRED: &str = "the MTL refers to it in place; copy it with --textures-outside copy";

/// Advice for a texture that does not become a part of the mesh file.
const NOT_EMBEDDED: &str = "it is not in the result; --textures-outside copy takes it in";

/// Why a texture does not come to the result.
enum LeftOut {
    Missing,
    Refused,
}

/// Textures being prepared for the result.
#[derive(Debug)]
pub(super) struct TextureStage {
    mode: Textures,
    /// Where textures that are copied may lie.
    reach: TextureReach,
    force: bool,
    /// Whether files are only checked, before any work is done.
    is_rehearsal: bool,
    job: u64,
    sources: Sources,
    output_folder: PathBuf,
    folder: PathBuf,
    folder_name: Vec<u8>,
    /// References by the folder of the MTL and the name in it.
    references: BTreeMap<(PathBuf, Vec<u8>), Vec<u8>>,
    /// Names in the textures folder by source path.
    names: BTreeMap<PathBuf, Vec<u8>>,
    /// Names in the textures folder in lower case, since some file systems ignore case.
    taken: BTreeSet<Vec<u8>>,
    /// Last number that was appended to a repeated name.
    numbers: HashMap<Vec<u8>, u64>,
    staged: Vec<StagedFile>,
    /// Files that are written or replaced.
    targets: Vec<PathBuf>,
    /// All textures of the result.
    pub(super) companions: Vec<Companion>,
    /// Textures that were copied.
    pub(super) copied: Vec<CopiedTexture>,
    /// Textures that existed already with the right content, and their state.
    kept: Vec<(PathBuf, Look)>,
    /// Content of the files that become parts of the mesh file.
    embedded: HashMap<PathBuf, Content>,
    /// Created folder; removed on drop if it is empty. Declared after the files in it, to be dropped after them.
    made_folder: Option<MadeFolder>,
    /// Textures that were refused or missing.
    pub(super) findings: Findings,
    /// Paths of those.
    pub(super) left_out: BTreeSet<PathBuf>,
}

/// A complete file under a temporary name, removed on drop unless it was renamed.
#[derive(Debug)]
struct StagedFile {
    temporary: PathBuf,
    target: PathBuf,
    /// State of the file that it replaces.
    looked: Look,
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

impl TextureStage {
    /// Prepares the textures of an input for an output.
    pub(super) fn new(options: &WriteOptions, targets: &Targets, catalogue: &Catalogue) -> Self {
        Self::make(options, targets, catalogue, false)
    }

    /// Prepares a rehearsal, which writes nothing and finds files in the way.
    pub(super) fn rehearsal(options: &WriteOptions, targets: &Targets, catalogue: &Catalogue) -> Self {
        Self::make(options, targets, catalogue, true)
    }

    fn make(options: &WriteOptions, targets: &Targets, catalogue: &Catalogue, is_rehearsal: bool) -> Self {
        let folder = targets.textures();
        let folder_name = folder.file_name().unwrap_or_default().as_encoded_bytes().to_owned();
        Self {
            mode: options.textures,
            reach: TextureReach::of(catalogue, options.brings_outside),
            force: options.force,
            is_rehearsal,
            job: options.job,
            sources: options.sources.clone(),
            output_folder: targets.folder.clone(),
            // The folder may be a symbolic link; resolve it to where files really go.
            folder: fs::canonicalize(&folder).unwrap_or(folder),
            folder_name,
            references: BTreeMap::new(),
            names: BTreeMap::new(),
            taken: BTreeSet::new(),
            numbers: HashMap::new(),
            staged: Vec::new(),
            targets: Vec::new(),
            companions: Vec::new(),
            copied: Vec::new(),
            kept: Vec::new(),
            embedded: HashMap::new(),
            made_folder: None,
            findings: Findings::default(),
            left_out: BTreeSet::new(),
        }
    }

    /// Returns how the new MTL refers to the texture `name` of an MTL in `mtl_folder`; copies or links it on first use.
    ///
    /// # Errors
    /// [`Error::Usage`] if a file is in the way, [`Error::Io`] or [`Error::NoSpace`] if copying fails.
    pub(super) fn reference(&mut self, mtl_folder: &Path, name: &[u8]) -> Result<Vec<u8>> {
        let key = (mtl_folder.to_owned(), name.to_owned());
        if let Some(reference) = self.references.get(&key) {
            return Ok(reference.clone());
        }
        let outcome = match self.mode {
            Textures::Reference => Ok(self.refer(mtl_folder, name)?),
            Textures::Copy | Textures::Link => match self.reach.find(mtl_folder, name) {
                Ok(source) => self.bring(&source, name)?,
                Err(unusable) => Err(unusable),
            },
        };
        let reference = match outcome {
            Ok(reference) => reference,
            Err(unusable) => match self.leave_out(mtl_folder, name, unusable, REFERRED)? {
                LeftOut::Missing => name.to_owned(),
                LeftOut::Refused => self.refer(mtl_folder, name)?,
            },
        };
        self.references.insert(key, reference.clone());
        Ok(reference)
    }

    /// Returns the file of a texture that becomes a part of the mesh file, and its content; `None`, with a finding, if it
    /// is missing or may not be read.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(super) fn embed(&mut self, mtl_folder: &Path, name: &[u8]) -> Result<Option<(PathBuf, Content)>> {
        let read = self.reach.find(mtl_folder, name).and_then(|path| match self.embedded.get(&path) {
            Some(&content) => Ok((path, content)),
            None => match Content::of(&path) {
                Ok(content) => Ok((path, content)),
                Err(error) => Err(Unusable::Missing(path, error)),
            },
        });
        match read {
            Ok((path, content)) => {
                if self.embedded.insert(path.clone(), content).is_none() {
                    self.copied.push((path.clone(), content));
                }
                Ok(Some((path, content)))
            }
            Err(unusable) => {
                self.leave_out(mtl_folder, name, unusable, NOT_EMBEDDED)?;
                Ok(None)
            }
        }
    }

    /// Notes a texture that is missing or refused, the latter with some advice.
    ///
    /// # Errors
    /// If it only cannot be read at present: a texture is not left out because of a temporary error.
    fn leave_out(&mut self, mtl_folder: &Path, name: &[u8], why: Unusable, advice: &str) -> Result<LeftOut> {
        self.left_out.extend(place_of(mtl_folder, name));
        why.note(mtl_folder, name, advice, &mut self.findings);
        match why {
            Unusable::Missing(path, error) if is_of_machine(&error) => Err(Error::io(&path, "read", error)),
            Unusable::Missing(..) | Unusable::NoFile(_) => Ok(LeftOut::Missing),
            Unusable::Refused(_) => Ok(LeftOut::Refused),
        }
    }

    /// Returns the path from the output's folder to a file that stays in place.
    fn refer(&mut self, mtl_folder: &Path, name: &[u8]) -> Result<Vec<u8>> {
        let Some(source) = place_of(mtl_folder, name) else { return Ok(name.to_owned()) };
        match fs::canonicalize(&source).and_then(|path| Ok((fs::metadata(&path)?, path))) {
            Ok((metadata, path)) if metadata.is_file() => {
                Ok(not_an_option(slashes(&path_between(&self.output_folder, &path))))
            }
            Err(error) if is_of_machine(&error) => Err(Error::io(&source, "read", error)),
            _ => {
                let place = || format!("{}: no such file", escape_path(&source));
                self.findings.note("missing_texture", place);
                Ok(name.to_owned())
            }
        }
    }

    /// Copies or links a file into the textures folder, unless that was done already.
    fn bring(&mut self, source: &Path, name: &[u8]) -> Result<std::result::Result<Vec<u8>, Unusable>> {
        if let Some(known) = self.names.get(source) {
            return Ok(Ok(self.reference_to(known)));
        }
        let file = match open_regular(source) {
            Ok(file) => file,
            Err(error) => return Ok(Err(Unusable::Missing(source.to_owned(), error))),
        };
        let unique = self.unique_name(name);
        let target = self.folder.join(path_of_bytes(&unique));
        if target == source {
            let message = format!("{}: the texture would replace itself; choose another output", escape_path(source));
            return Err(Error::Usage(message));
        }
        if target.is_dir() {
            return Err(Error::Usage(format!("{}: is a folder; choose another output", escape_path(&target))));
        }
        let link = path_between(&self.folder, source);
        let exists = fs::symlink_metadata(&target).is_ok();
        let same = exists
            && match self.mode {
                Textures::Link => fs::read_link(&target).is_ok_and(|present| present == link),
                _ => same_content(&target, source).unwrap_or(false),
            };
        if exists && !same && !self.force {
            let message = format!("{}: exists and differs; `force` replaces it", escape_path(&target));
            return Err(Error::Usage(message));
        }
        if !same {
            self.targets.push(target.clone());
        }
        if self.is_rehearsal {
            let reference = self.reference_to(&unique);
            self.names.insert(source.to_owned(), unique);
            return Ok(Ok(reference));
        }
        // NOTE: a killed run may have left this file; only this program uses the name.
        let temporary = waiting_place(&target, self.job);
        let _ = fs::remove_file(&temporary);
        let mut content = None;
        if !same {
            self.make_folder()?;
            let staged = StagedFile { temporary, target: target.clone(), looked: look(&target) };
            let linked = self.mode == Textures::Link
                && (symlink(&link, &staged.temporary).is_ok() || fs::hard_link(source, &staged.temporary).is_ok());
            if !linked {
                match copy(file, &staged.temporary, &target) {
                    Ok(copied) => content = Some(copied),
                    Err(CopyError::Write(error)) => return Err(error),
                    Err(CopyError::Read(error)) => {
                        self.taken.remove(&unique.to_ascii_lowercase());
                        self.targets.pop();
                        return Ok(Err(Unusable::Missing(source.to_owned(), error)));
                    }
                }
            }
            self.staged.push(staged);
        } else {
            self.kept.push((target.clone(), look(&target)));
            if self.mode != Textures::Link {
                content = Some(Content::of(&target).map_err(|e| Error::io(&target, "read", e))?);
            }
        }
        self.copied.extend(content.map(|content| (source.to_owned(), content)));
        self.companions.push(Companion { path: target, content });
        let reference = self.reference_to(&unique);
        self.names.insert(source.to_owned(), unique);
        Ok(Ok(reference))
    }

    fn reference_to(&self, name: &[u8]) -> Vec<u8> {
        not_an_option([&self.folder_name, b"/".as_slice(), name].concat())
    }

    /// Returns the last component of `name`, sanitised and different from all names so far.
    fn unique_name(&mut self, name: &[u8]) -> Vec<u8> {
        let base = base_name(name);
        let unsafe_in_names = |c: u8| c.is_ascii_control() || b"/\\:*?\"<>|".contains(&c);
        let mut base: Vec<u8> = base.iter().map(|&c| if unsafe_in_names(c) { b'_' } else { c }).collect();
        match base.first() {
            None => base.push(b'_'),
            Some(b'.' | b'-' | b' ') => base[0] = b'_',
            Some(_) => {}
        }
        let dot = base.iter().rposition(|&c| c == b'.').filter(|dot| base.len() - dot < 16).unwrap_or(base.len());
        let extension = base.split_off(dot);
        if base.len() > STEM_BYTES_MAX {
            // Do not cut within a UTF-8 character: a leading byte and up to three more.
            let is_end = |&end: &usize| base[end] & 0xc0 != 0x80;
            let end = (STEM_BYTES_MAX - 3..=STEM_BYTES_MAX).rev().find(is_end).unwrap_or(STEM_BYTES_MAX);
            base.truncate(end);
        }
        let stem = base;
        let base = [&stem[..], &extension[..]].concat();
        let mut unique = base.clone();
        let number = self.numbers.entry(base.to_ascii_lowercase()).or_insert(1);
        while !self.taken.insert(unique.to_ascii_lowercase()) {
            *number += 1;
            unique = [&stem[..], format!("_{number}").as_bytes(), &extension[..]].concat();
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

    /// Refuses targets that would replace a file of the input.
    ///
    /// # Errors
    /// [`Error::Usage`] that names the file; `others` are the further targets of the run.
    pub(super) fn check_targets(&self, others: &[&Path]) -> Result<()> {
        let targets = self.targets.iter().map(PathBuf::as_path).chain(others.iter().copied());
        match targets.into_iter().find(|&target| self.names.contains_key(target) || self.sources.forbid(target)) {
            None => Ok(()),
            Some(target) => {
                let target = escape_path(target);
                Err(Error::Usage(format!("{target}: a texture of the input would be replaced; choose another output")))
            }
        }
    }

    /// Files that will be renamed, with the state of those that they replace.
    pub(super) fn replaced(&self) -> impl Iterator<Item = (&Path, &Look)> {
        self.staged.iter().map(|file| (file.target.as_path(), &file.looked))
    }

    /// Renames the files to their final names.
    ///
    /// # Errors
    /// [`Error::Changed`] if an existing texture has changed meanwhile, [`Error::Io`] if a file cannot be renamed.
    pub(super) fn commit(self) -> Result<()> {
        if let Some((path, _)) = self.kept.iter().find(|(path, looked)| look(path) != *looked) {
            let path = escape_path(path);
            return Err(Error::Changed(format!("{path}: has changed while the result was written; try again")));
        }
        for file in &self.staged {
            give_name(&file.temporary, &file.target)?;
        }
        // Existing textures may have been renamed by a process that was interrupted before it synced the folder.
        let kept = self.kept.iter().map(|(path, _)| path);
        if let Some(path) = self.staged.iter().map(|file| &file.target).chain(kept).next() {
            sync_folder(path)?;
            sync_folder(&self.folder)?;
        }
        Ok(())
    }
}

/// Prefixes `./` to a reference that begins with `-`, which would be read as an option.
fn not_an_option(reference: Vec<u8>) -> Vec<u8> {
    if reference.starts_with(b"-") { [b"./", reference.as_slice()].concat() } else { reference }
}

fn slashes(path: &Path) -> Vec<u8> {
    let bytes = path.as_os_str().as_encoded_bytes();
    bytes.iter().map(|&c| if cfg!(windows) && c == b'\\' { b'/' } else { c }).collect()
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
        stage_for(&folders.output.join("city.obj"), mode, false)
    }

    fn stage_for(output: &Path, mode: Textures, force: bool) -> TextureStage {
        let sources = Sources::default();
        let targets = Targets::choose(output, &sources, force).unwrap();
        let options = WriteOptions {
            textures: mode,
            brings_outside: false,
            normals: false,
            turns_z_up: false,
            force,
            replaces_own: false,
            work_bytes: 0,
            sources,
            job: 1,
        };
        TextureStage::new(&options, &targets, &Catalogue::default())
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
            let is_there = name.contains("secret");
            assert_eq!(refer(&mut stage, &folders, name), if is_there { "../secret.txt" } else { name });
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&absolute, folders.input.join("innocent.png")).unwrap();
            assert_eq!(refer(&mut stage, &folders, "innocent.png"), "../secret.txt");
            assert_eq!(stage.findings.get("refused_texture"), 5);
        }
        for name in ["none.png", "../none.png"] {
            assert_eq!(refer(&mut stage, &folders, name), name);
        }
        // Two missing files, a folder and the drive of another system, each once: to allow them would not help.
        assert_eq!(stage.findings.get("missing_texture"), 4);
        let lines = stage.findings.warnings();
        let advised = |line: &&String| line.contains("--textures-outside");
        assert!(lines.iter().filter(advised).all(|line| line.starts_with("refused texture: ")), "{lines:?}");
        assert!(lines.iter().any(|line| line.contains("C:\\x.png in ")), "{lines:?}");
        stage.commit().unwrap();
        assert_eq!(fs::read_dir(&folders.output).unwrap().count(), 0);
    }

    #[test]
    fn textures_of_a_library_outside_of_the_objs_folder_stay_where_they_are() {
        let folders = folders();
        fs::write(folders.input.join("b/city.obj"), "").unwrap();
        let sources = Sources::default();
        let targets = Targets::choose(&folders.output.join("city.obj"), &sources, false).unwrap();
        let options = WriteOptions {
            textures: Textures::Copy,
            brings_outside: false,
            normals: false,
            turns_z_up: false,
            force: false,
            replaces_own: false,
            work_bytes: 0,
            sources,
            job: 1,
        };
        let mut catalogue = Catalogue { files: vec![folders.input.join("b/city.obj")].into(), ..Catalogue::default() };
        let mut stage = TextureStage::new(&options, &targets, &catalogue);
        let folder = fs::canonicalize(folders.input.join("a")).unwrap();
        assert_eq!(stage.reference(&folder, b"wall.png").unwrap(), b"../in/a/wall.png");
        assert_eq!(stage.findings.get("refused_texture"), 1);
        // Tiles share texture images in the folder that was given.
        catalogue.folders = vec![folders.input.clone()];
        let mut stage = TextureStage::new(&options, &targets, &catalogue);
        let folder = fs::canonicalize(&folders.input).unwrap();
        assert_eq!(stage.reference(&folder, b"a/wall.png").unwrap(), b"city_textures/wall.png");
    }

    #[test]
    fn many_textures_of_one_name_are_named_in_a_moment() {
        let folders = folders();
        let mut stage = stage(&folders, Textures::Copy);
        let names: BTreeSet<Vec<u8>> = (0..20_000).map(|_| stage.unique_name(b"wall.png")).collect();
        assert_eq!(names.len(), 20_000);
        let long = stage.unique_name(&[b"\xc3\xa4".repeat(140), b".png".to_vec()].concat());
        assert!(long.len() < 230 && std::str::from_utf8(&long).unwrap().ends_with(".png"));
        // Not valid UTF-8.
        let long = stage.unique_name(&[0x80; 230]);
        assert!((200..230).contains(&long.len()));
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
        fs::write(waiting_place(&textures.join("Wall_2.png"), 1), "seco").unwrap();
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
        assert!(matches!(error, Error::Usage(message) if message.contains("`force`")));
    }

    #[test]
    fn a_texture_never_replaces_itself() {
        let folders = folders();
        fs::create_dir(folders.input.join("city_textures")).unwrap();
        fs::write(folders.input.join("city_textures/wall.png"), "own").unwrap();
        let folder = fs::canonicalize(&folders.input).unwrap();
        let mut stage = stage_for(&folder.join("city.obj"), Textures::Copy, true);
        assert!(matches!(stage.reference(&folder, b"city_textures/wall.png"), Err(Error::Usage(_))));
        let mut stage = stage_for(&folder.join("city.obj"), Textures::Copy, true);
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
        let mut stage = stage_for(&folders.output.join("-city.obj"), Textures::Copy, false);
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

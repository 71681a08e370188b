//! The work folder of a job: its manifest, its finished steps and their files.
//!
//! In: finished steps, each with its files and a value. Out: the same steps after an interruption, verified. Invariant:
//! a step is recorded either completely or not at all; a file is trusted only if its length and checksum match the
//! journal.
//!
//! ```text
//! keep     write, sync and rename files, sync folder ──▶ value, likewise ──▶ entry in the journal
//! recall   entry in the journal ──▶ read its files and its value and verify them ──▶ the value, or `None`
//! retain   sync the journal ──▶ remove all files that are no longer needed
//! ```
//! Between two phases, keep and retain run together, in the background ([`WorkFolder::supersede`]).
//!
//! # Files
//! `manifest.bin`, `journal.bin`, `lock`, the values of steps (`*.state`), and the files of the phases. A folder with
//! foreign files is never used, nor one with files but no manifest of ours, so no file of the user is ever removed.

mod finished;
mod foreign;
mod journal;
mod lock;
mod manifest;
mod recalled;
mod stamp;
mod status;

use std::collections::hash_map::Entry::Vacant;
use std::collections::{HashMap, HashSet};
use std::fs::{self, File};
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;

use serde::Serialize;

use self::finished::{Finished, append, sync};
use self::foreign::{entries, is_phase_file, refuse_foreign};
pub use self::journal::{Entry, Step, StepRecord};
use self::journal::{JOURNAL, Journal, Value, now};
use self::lock::{LOCK, lock_folder};
use self::manifest::MANIFEST;
pub use self::manifest::{InputFile, Manifest};
pub use self::recalled::Recalled;
use self::stamp::Condition;
pub use self::status::{WorkStatus, folder_bytes, look};
use crate::base::error::escape_path;
use crate::base::threads::beside;
use crate::base::{Error, Result};
use crate::file::codec;
pub use crate::file::header::FORMAT_VERSION;
use crate::file::header::HEADER_BYTES;
use crate::os::durable::{new_job_number, no_links, sync_file, sync_folder};

/// What to do with an existing job in the work folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Resume {
    /// Resume it if it is the same job; otherwise refuse.
    #[default]
    Auto,
    /// Resume it or refuse; a damaged file is an error.
    Require,
    /// Start over.
    Never,
    /// Start over, but refuse a folder of a job with other options; for work that cannot be resumed.
    Again,
}

/// A locked work folder.
#[derive(Debug)]
pub struct WorkFolder {
    path: PathBuf,
    is_ours: bool,
    lock: Option<File>,
    resume: Resume,
    recalled: HashMap<Step, StepRecord>,
    order: Vec<Step>,
    journal: Arc<Mutex<Option<Journal>>>,
    /// Thread that records a step in the background.
    under_way: Mutex<Option<JoinHandle<Result<()>>>>,
    /// The first step that this process superseded others with; records of an earlier process for steps that follow it
    /// are void.
    first_redone: Mutex<Option<Step>>,
    /// Descriptions of damage found.
    damage: Mutex<Vec<String>>,
    is_resumed: bool,
    /// Whether anything is recorded that another process could resume; true until known otherwise.
    holds_steps: AtomicBool,
    /// Id of the job.
    number: u64,
}

impl WorkFolder {
    /// Creates a folder or takes one over, locks it and reads its journal.
    ///
    /// # Errors
    /// [`Error::Locked`] if another process works in it, [`Error::Usage`] if it contains foreign files,
    /// [`Error::Changed`] if it belongs to a different job or, under [`Resume::Require`], holds no finished step,
    /// [`Error::Damaged`] if its manifest is damaged or, under [`Resume::Require`], its manifest or journal is missing
    /// or damaged.
    pub fn open(path: &Path, manifest: &Manifest, resume: Resume) -> Result<Self> {
        let is_new = !path.exists();
        match is_new {
            true if resume == Resume::Require => return Err(nothing_in(path, "is not there")),
            true => {}
            false => refuse_foreign(path)?,
        }
        let is_ours = is_new || manifest.owns_folder;
        let lock = lock_folder(path)?;
        let mut folder = Self {
            path: path.to_owned(),
            is_ours,
            lock: Some(lock),
            resume,
            recalled: HashMap::new(),
            order: Vec::new(),
            journal: Arc::default(),
            under_way: Mutex::new(None),
            first_redone: Mutex::new(None),
            damage: Mutex::new(Vec::new()),
            is_resumed: false,
            holds_steps: AtomicBool::new(true),
            number: new_job_number(path),
        };
        let journal = match resume {
            Resume::Never => {
                folder.remember_outside();
                None
            }
            Resume::Again => {
                let path = folder.path.join(MANIFEST);
                let earlier = path.exists().then(|| Manifest::read(&path)).transpose()?;
                if let Some((earlier, _)) = earlier {
                    if earlier.options != manifest.options {
                        let shown = escape_path(&folder.path);
                        return Err(Error::Changed(format!("{shown}: holds another job; give another `work`")));
                    }
                    folder.is_ours |= earlier.owns_folder;
                }
                None
            }
            Resume::Auto | Resume::Require => folder.take_over(manifest)?,
        };
        let mut journal = match journal {
            Some(journal) => journal,
            None => {
                folder.holds_steps = AtomicBool::new(false);
                folder.begin(manifest)?
            }
        };
        folder.holds_steps = AtomicBool::new(folder.is_resumed);
        journal.append(&Entry::Began { time: now() })?;
        if resume == Resume::Never {
            folder.recalled.values().try_for_each(|record| journal.append(&Entry::Kept(record.clone())))?;
        }
        folder.journal = Arc::new(Mutex::new(Some(journal)));
        remove_files(&folder.all_but(&folder.named_files())?)?;
        Ok(folder)
    }

    /// Resumes the job in the folder; `None` if there is none.
    fn take_over(&mut self, manifest: &Manifest) -> Result<Option<Journal>> {
        let nothing = |why: &str| match self.resume {
            Resume::Require => Err(nothing_in(&self.path, why)),
            _ => Ok(None),
        };
        let path = self.path.join(MANIFEST);
        if !path.exists() {
            return match self.path.join(JOURNAL).exists() {
                true => self.damaged(MANIFEST, "it is gone".into()),
                false => nothing("holds no job to resume"),
            };
        }
        let (earlier, checksum) = Manifest::read(&path)?;
        (self.number, self.is_ours) = (earlier.job, self.is_ours || earlier.owns_folder);
        let differences = earlier.differences(manifest);
        if !differences.is_empty() {
            let (shown, what) = (escape_path(&self.path), differences.join("; "));
            return Err(Error::Changed(format!("{shown}: made for a job that differs: {what}; {}", manifest::AFRESH)));
        }
        let path = self.path.join(JOURNAL);
        if !path.exists() {
            return match self.all_but(&HashSet::new())?.is_empty() {
                true => nothing("holds no finished step"),
                false => self.damaged(JOURNAL, "it is gone".into()),
            };
        }
        let (journal, entries, cut_off, is_spoilt) =
            match Journal::open(&path, checksum, self.resume == Resume::Require) {
                Err(Error::Damaged { message, .. }) => return self.damaged(JOURNAL, message),
                opened => opened?,
            };
        if cut_off > 0 {
            match is_spoilt {
                true => self.note_damage(JOURNAL, &format!("its last {cut_off} bytes are not whole")),
                false => {
                    let path = escape_path(&path);
                    lock(&self.damage).push(format!("{path}: its last entry was cut short; that step is redone"));
                }
            }
        }
        // If a step was recorded several times, the last record counts.
        for entry in entries.into_iter().rev() {
            if let Entry::Kept(record) = entry
                && let Vacant(place) = self.recalled.entry(record.step)
            {
                self.order.push(record.step);
                place.insert(record);
            }
        }
        self.order.reverse();
        if self.order.is_empty() {
            return nothing("holds no finished step").map(|_: Option<Journal>| Some(journal));
        }
        self.is_resumed = true;
        Ok(Some(journal))
    }

    /// Keeps the data of the previous job that is needed to find its files outside of the folder: its id, and the path
    /// of its output.
    fn remember_outside(&mut self) {
        let Ok((earlier, checksum)) = Manifest::read(&self.path.join(MANIFEST)) else { return };
        (self.number, self.is_ours) = (earlier.job, self.is_ours || earlier.owns_folder);
        let entries = journal::read(&self.path.join(JOURNAL), checksum).map_or(Vec::new(), |reading| reading.entries);
        let output = |entry| match entry {
            Entry::Kept(record) if record.step == Step::Output && matches!(record.value, Value::Here(_)) => {
                Some((Step::Output, record))
            }
            _ => None,
        };
        self.recalled = entries.into_iter().filter_map(output).collect();
    }

    /// Empties the folder and begins a job in it.
    fn begin(&self, manifest: &Manifest) -> Result<Journal> {
        // First of all, so that no entry refers to files that are removed.
        let path = self.path.join(JOURNAL);
        if let Ok(journal) = no_links(File::options().write(true)).open(&path) {
            let _ = journal.set_len(HEADER_BYTES).and_then(|()| sync_file(&journal, &path));
        }
        self.clear()?;
        let began = Manifest { began: now(), job: self.number, owns_folder: self.is_ours, ..manifest.clone() };
        let path = self.path.join(MANIFEST);
        let checksum = began.write(&path)?;
        // A job whose manifest a faulty disk lost could neither be resumed nor replaced in this folder.
        if let Err(error) = Manifest::read(&path) {
            self.clear()?;
            return Err(error);
        }
        Journal::create(&self.path.join(JOURNAL), checksum)
    }

    /// Path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Id of the job, which marks its files outside of the folder.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Makes all records durable.
    ///
    /// # Errors
    /// [`Error::Io`] if the sync fails, and those of [`wait_until_durable`](WorkFolder::wait_until_durable).
    pub fn sync(&self) -> Result<()> {
        self.wait_until_durable()?;
        sync(&self.journal)
    }

    /// Reports whether steps of an earlier process were found.
    pub fn is_resumed(&self) -> bool {
        self.is_resumed
    }

    /// Discards all records: the job starts over.
    ///
    /// # Errors
    /// If files cannot be removed or written.
    pub fn restart(&mut self, manifest: &Manifest) -> Result<()> {
        *self.journal() = None;
        (self.recalled, self.order, self.is_resumed) = (HashMap::new(), Vec::new(), false);
        self.holds_steps = AtomicBool::new(false);
        *self.journal() = Some(self.begin(manifest)?);
        Ok(())
    }

    /// Steps that an earlier process finished, latest first.
    pub fn latest(&self) -> impl Iterator<Item = Step> + '_ {
        self.order.iter().rev().copied()
    }

    /// Returns and clears the descriptions of damage found so far; the steps concerned are recomputed.
    pub fn take_damage(&self) -> Vec<String> {
        std::mem::take(&mut lock(&self.damage))
    }

    /// Returns the value of a step that an earlier process finished; `None` if there is none, if its files are not
    /// intact, or if it does not fit the context although its checksum matches.
    ///
    /// # Errors
    /// [`Error::Damaged`] under [`Resume::Require`] if they are not intact; [`Error::Io`] if they cannot be read.
    pub fn recall<T: Recalled>(&self, step: Step, context: &T::Context<'_>) -> Result<Option<T>> {
        if lock(&self.first_redone).is_some_and(|made| step.follows(made)) {
            return Ok(None);
        }
        let Some(record) = self.recalled.get(&step) else { return Ok(None) };
        let in_file = match &record.value {
            Value::InFile(stamp) => Some(stamp),
            Value::Here(_) => None,
        };
        for stamp in record.files.iter().chain(in_file) {
            match stamp.verify(&self.path)? {
                Condition::Whole => {}
                Condition::Gone if self.is_superseded(step) => return Ok(None),
                Condition::Gone => return self.damaged(stamp.name(), "it is gone".into()),
                Condition::Damaged(message) => return self.damaged(stamp.name(), message),
            }
        }
        let decoded = match &record.value {
            Value::Here(bytes) => codec::decode(bytes),
            Value::InFile(stamp) => codec::decode(&read_value(&self.path.join(stamp.name()))?),
        };
        let sound = decoded.and_then(|mut value: T| {
            value.locate(&self.path, context);
            if value.is_sound(context) { Ok(value) } else { Err("its content is inconsistent".into()) }
        });
        match sound {
            Ok(value) => Ok(Some(value)),
            Err(message) => self.damaged(&step.file_name(), message),
        }
    }

    /// Reports whether the files of a step were removed because a later step replaces them.
    fn is_superseded(&self, step: Step) -> bool {
        let takes_its_place =
            |later: &Step| matches!(later, Step::Cut { .. } | Step::Pass { .. }) && later.follows(step);
        // A finished job may have been killed while it removed its files.
        let is_done = self.recalled.contains_key(&Step::Written);
        is_done || step != Step::Input && self.recalled.keys().any(takes_its_place)
    }

    fn damaged<T>(&self, name: &str, message: String) -> Result<Option<T>> {
        if self.resume == Resume::Require {
            return Err(Error::Damaged { path: self.path.join(name), message });
        }
        self.note_damage(name, &message);
        Ok(None)
    }

    fn note_damage(&self, name: &str, message: &str) {
        let path = escape_path(&self.path.join(name));
        lock(&self.damage).push(format!("{path}: damaged, so its step is redone: {message}"));
    }

    /// Records a finished step; `files` must be committed. `drystone status` reports `amount`.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes.
    pub fn keep<'a, T: Serialize>(
        &self,
        step: Step,
        amount: u64,
        files: impl IntoIterator<Item = &'a Path>,
        value: &T,
    ) -> Result<()> {
        self.holds_steps.store(true, Ordering::Relaxed);
        Finished::new(&self.path, step, amount, files, value)?.keep(&self.journal)
    }

    /// Records a finished step. Then removes all files except `files`, which are its own and those still needed, and
    /// the values of `steps`. Most of this runs on a background thread, since it waits for the disk; the next call of
    /// this or of [`wait_until_durable`](WorkFolder::wait_until_durable) returns its error.
    ///
    /// # Errors
    /// As [`keep`](WorkFolder::keep).
    pub fn supersede<'a, T: Serialize>(
        &self,
        step: Step,
        amount: u64,
        files: impl IntoIterator<Item = &'a Path>,
        value: &T,
        steps: &[Step],
    ) -> Result<()> {
        self.wait_until_durable()?;
        self.holds_steps.store(true, Ordering::Relaxed);
        let files: Vec<&Path> = files.into_iter().collect();
        let finished = Finished::new(&self.path, step, amount, files.iter().copied(), value)?;
        let mut names = names_of(files, steps);
        names.insert(step.file_name());
        // Files of an earlier process for later steps must go first: this process writes files with the same names. All
        // others can be removed in the background, since they are listed here.
        lock(&self.first_redone).get_or_insert(step);
        remove_files(&self.left_after(step, &names)?)?;
        let superseded = self.all_but(&names)?;
        let journal = Arc::clone(&self.journal);
        let keep = move || {
            finished.keep(&journal)?;
            sync(&journal)?;
            remove_files(&superseded)
        };
        *lock(&self.under_way) = beside(keep)?;
        Ok(())
    }

    /// Waits for the step that is being recorded in the background.
    ///
    /// # Errors
    /// Those of [`keep`](WorkFolder::keep) and [`retain`](WorkFolder::retain).
    ///
    /// # Panics
    /// Propagates a panic of the background thread.
    pub fn wait_until_durable(&self) -> Result<()> {
        let under_way = lock(&self.under_way).take();
        under_way.map_or(Ok(()), |thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    }

    /// Returns the value of a step: recalled, or else computed by `make` and recorded.
    ///
    /// # Errors
    /// Those of [`recall`](WorkFolder::recall), [`keep`](WorkFolder::keep) and `make`.
    pub fn once<T: Serialize + Recalled>(
        &self,
        step: Step,
        context: &T::Context<'_>,
        make: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        if let Some(value) = self.recall(step, context)? {
            return Ok(value);
        }
        let value = make()?;
        self.keep(step, 0, [], &value)?;
        Ok(value)
    }

    /// Records why the process ends early, on a best-effort basis.
    pub fn note_failure(&self, error: &Error) {
        let _ = self.wait_until_durable();
        let _ = append(&self.journal, &Entry::Failed { time: now(), message: error.to_string() });
        let _ = sync(&self.journal);
    }

    /// Marks the job as not resumable: its folder is removed when it ends.
    pub fn give_up(&self) {
        self.holds_steps.store(false, Ordering::Relaxed);
    }

    /// Removes all files except those given and the values of some steps.
    ///
    /// # Errors
    /// If the journal cannot be synced first, or a file cannot be removed.
    pub fn retain<'a>(&self, files: impl IntoIterator<Item = &'a Path>, steps: &[Step]) -> Result<()> {
        self.wait_until_durable()?;
        sync(&self.journal)?;
        remove_files(&self.all_but(&names_of(files, steps))?)
    }

    /// Ends the job: removes the folder unless `keep` is set or the user created it.
    ///
    /// # Errors
    /// If the journal cannot be synced.
    pub fn finish(mut self, keep: bool) -> Result<()> {
        self.wait_until_durable()?;
        sync(&self.journal)?;
        if !keep {
            self.remove();
        }
        Ok(())
    }

    fn journal(&self) -> MutexGuard<'_, Option<Journal>> {
        lock(&self.journal)
    }

    /// Names of the files that the journal lists.
    fn named_files(&self) -> HashSet<String> {
        self.recalled.iter().flat_map(|(step, record)| record.names(step)).collect()
    }

    /// Files of an earlier process for steps that follow `step`, except these names.
    fn left_after(&self, step: Step, names: &HashSet<String>) -> Result<Vec<PathBuf>> {
        let later = self.recalled.iter().filter(|(other, _)| other.follows(step));
        let left: HashSet<String> = later.flat_map(|(other, record)| record.names(other)).collect();
        let mut files = self.all_but(names)?;
        files.retain(|path| path.file_name().is_some_and(|name| left.contains(&*name.to_string_lossy())));
        Ok(files)
    }

    /// Files of phases, except these names.
    fn all_but(&self, names: &HashSet<String>) -> Result<Vec<PathBuf>> {
        let is_superseded = |entry: &fs::DirEntry| {
            let name = entry.file_name();
            let name = name.to_string_lossy();
            is_phase_file(&name) && !names.contains(&*name)
        };
        Ok(entries(&self.path)?.iter().filter(|entry| is_superseded(entry)).map(fs::DirEntry::path).collect())
    }

    /// Removes all files of an earlier job, the manifest last.
    fn clear(&self) -> Result<()> {
        let superseded = self.all_but(&HashSet::new())?;
        remove_files(&superseded)?;
        // Without a manifest they would count as foreign.
        superseded.first().map_or(Ok(()), |path| sync_folder(path))?;
        for name in [JOURNAL, MANIFEST] {
            for name in [name.to_owned(), format!("{name}.tmp")] {
                let path = self.path.join(name);
                match fs::remove_file(&path) {
                    Err(error) if error.kind() != ErrorKind::NotFound => return Err(Error::io(&path, "remove", error)),
                    _ => {}
                }
            }
        }
        Ok(())
    }

    fn remove(&mut self) {
        let _ = self.wait_until_durable();
        *self.journal() = None;
        let _ = self.clear();
        let _ = fs::remove_file(self.path.join(LOCK));
        self.lock = None;
        if self.is_ours {
            let _ = fs::remove_dir(&self.path);
        }
    }
}

impl Drop for WorkFolder {
    /// Removes a folder without a finished step; one that can be resumed stays.
    fn drop(&mut self) {
        // Not by `wait_until_durable`: it could panic during another panic.
        let _ = lock(&self.under_way).take().map(JoinHandle::join);
        if self.lock.is_some() && !self.holds_steps.load(Ordering::Relaxed) {
            self.remove();
        }
    }
}

/// Returns [`Error::Changed`] for a job that should be resumed and does not exist.
fn nothing_in(path: &Path, why: &str) -> Error {
    Error::Changed(format!("{}: {why}; to start over, leave out `resume: require`", escape_path(path)))
}

fn names_of<'a>(files: impl IntoIterator<Item = &'a Path>, steps: &[Step]) -> HashSet<String> {
    let names = files.into_iter().filter_map(|path| path.file_name()).map(|name| name.to_string_lossy().into_owned());
    names.chain(steps.iter().map(Step::file_name)).collect()
}

fn remove_files(paths: &[PathBuf]) -> Result<()> {
    paths.iter().try_for_each(|path| fs::remove_file(path).map_err(|e| Error::io(path, "remove", e)))
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

fn read_value(path: &Path) -> Result<Vec<u8>> {
    let wrap = |e| Error::io(path, "read", e);
    let mut file = File::open(path).map_err(wrap)?;
    file.read_exact(&mut [0; HEADER_BYTES as usize]).map_err(wrap)?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(wrap)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests;

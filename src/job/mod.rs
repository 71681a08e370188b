//! The work folder of a job: its manifest, its finished steps and their files.
//!
//! In: finished steps, each with its files and a value. Out: the same steps after an interruption, verified. Invariant:
//! a step is recorded either completely or not at all; a file is trusted only if its length and checksum match the
//! journal.
//!
//! ```text
//! keep     write, sync and rename files, sync folder ──▶ value, likewise ──▶ entry in the journal
//! recall   entry in the journal ──▶ read its files and its value and verify them ──▶ the value, or `None`
//! retain   entry that says which steps are still wanted ──▶ remove the files of all others
//! ```
//! Between two phases, keep and retain run together, in the background ([`WorkFolder::supersede`]).
//!
//! # Files
//! `manifest.bin`, `journal.bin`, `lock`, `lease`, the values of steps (`*.state`), and the files of the phases. A folder with
//! foreign files is never used, nor one with files but no manifest of ours, so no file of the user is ever removed.

mod finished;
mod foreign;
mod journal;
mod lease;
mod lock_file;
mod manifest;
mod names;
mod open;
mod recalled;
pub mod stage;
mod stamp;
mod status;
mod step;
mod steps;

use std::collections::HashSet;
use std::fs::{self, File};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

use serde::Serialize;

use self::finished::{Finished, append, sync, sync_before_removal};
use self::foreign::entries;
pub use self::journal::Entry;
use self::journal::{Journal, now};
use self::lease::Lease;
use self::lock_file::LOCK;
pub use self::manifest::{InputFile, Manifest};
use self::names::is_phase_file;
pub use self::recalled::Recalled;
use self::stage::Lending;
use self::stamp::Condition;
pub use self::status::{WorkStatus, folder_bytes, look};
use self::step::Value;
pub use self::step::{Step, StepKey, StepRecord};
use self::steps::RecordedSteps;
use crate::base::error::escape_path;
use crate::base::threads::beside;
use crate::base::{Error, Result, lock};
use crate::file::codec;
pub use crate::file::header::FORMAT_VERSION;
use crate::file::header::HEADER_BYTES;

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
    lease: Option<Lease>,
    lock: Option<File>,
    resume: Resume,
    steps: Arc<Mutex<RecordedSteps>>,
    journal: Arc<Mutex<Option<Journal>>>,
    /// Thread that records a step in the background.
    under_way: Mutex<Option<JoinHandle<Result<()>>>>,
    /// Descriptions of damage found.
    damage: Mutex<Vec<String>>,
    is_resumed: bool,
    /// Whether anything is recorded that another process could resume; true until known otherwise.
    holds_steps: AtomicBool,
    /// Id of the job.
    number: u64,
    /// How its tasks are done elsewhere, if they are.
    lending: Option<Lending>,
}

impl WorkFolder {
    /// Path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Id of the job, which marks its files outside of the folder.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// From now on tasks of the job are done elsewhere.
    pub fn lend_tasks(&mut self, lending: Lending) {
        self.lending = Some(lending);
    }

    /// How tasks of the job are done elsewhere; `None` if they are not.
    pub fn lending(&self) -> Option<&Lending> {
        self.lending.as_ref()
    }

    /// From now on the folder holds something that another process could resume.
    pub(in crate::job) fn note_steps(&self) {
        self.holds_steps.store(true, Ordering::Relaxed);
    }

    /// Makes all records durable.
    ///
    /// # Errors
    /// [`Error::Io`] if the sync fails, and those of [`wait_until_durable`](WorkFolder::wait_until_durable).
    pub fn sync(&self) -> Result<()> {
        self.wait_until_durable()?;
        sync(&self.journal)
    }

    /// Makes all records durable before files are removed because of them, where the job must outlast a power cut.
    ///
    /// # Errors
    /// Those of [`sync`](WorkFolder::sync).
    pub fn sync_before_removal(&self) -> Result<()> {
        self.wait_until_durable()?;
        sync_before_removal(&self.journal)
    }

    /// Reports whether steps of an earlier process were found.
    pub fn is_resumed(&self) -> bool {
        self.is_resumed
    }

    /// Steps that an earlier process finished, latest first.
    pub fn latest(&self) -> Vec<StepKey> {
        lock(&self.steps).latest()
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
    pub fn recall<T: Recalled>(&self, key: &StepKey, context: &T::Context<'_>) -> Result<Option<T>> {
        let Some((record, may_be_gone)) = self.recorded(key) else { return Ok(None) };
        let in_file = match &record.value {
            Value::InFile(stamp) => Some(stamp),
            Value::Here(_) => None,
        };
        for stamp in record.files.iter().chain(in_file) {
            match stamp.verify(&self.path)? {
                Condition::Whole => {}
                Condition::Gone if may_be_gone => return Ok(None),
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
            Err(message) => self.damaged(&key.file_name(), message),
        }
    }

    /// The record of a step that an earlier process finished, and whether its files may be gone.
    fn recorded(&self, key: &StepKey) -> Option<(StepRecord, bool)> {
        let steps = lock(&self.steps);
        let record = steps.recall(key)?;
        Some((record.clone(), steps.may_be_gone(record.id)))
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

    /// Records a finished step; `files` must be committed.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes.
    pub fn keep<'a, T: Serialize>(
        &self,
        step: Step,
        files: impl IntoIterator<Item = &'a Path>,
        value: &T,
    ) -> Result<()> {
        self.note_steps();
        Finished::new(&self.path, step, files, value, &self.steps)?.keep(&self.journal)
    }

    /// Records a finished step; then removes all files but those of this step and of `others`, whose values are still
    /// wanted. Most of this runs on a background thread, since it waits for the disk; the next call of this or of
    /// [`wait_until_durable`](WorkFolder::wait_until_durable) returns its error.
    ///
    /// # Errors
    /// As [`keep`](WorkFolder::keep).
    pub fn supersede<'a, T: Serialize>(
        &self,
        step: Step,
        files: impl IntoIterator<Item = &'a Path>,
        value: &T,
        others: &[StepKey],
    ) -> Result<()> {
        self.wait_until_durable()?;
        self.note_steps();
        let key = step.key.clone();
        let finished = Finished::new(&self.path, step, files, value, &self.steps)?;
        let (wanted, names) = self.want_only(&[&[key], others].concat());
        self.confirm()?;
        // Files of void records must go first: this process writes files with the same names. All others can be removed
        // in the background, since they are listed here.
        remove_files(&self.left_of_void_records(&names)?)?;
        let superseded = self.all_but(&names)?;
        let journal = Arc::clone(&self.journal);
        let lease = self.lease.as_ref().map(Lease::file);
        let keep = move || {
            finished.keep(&journal)?;
            append(&journal, &wanted)?;
            sync_before_removal(&journal)?;
            lease.iter().try_for_each(|lease| lease.confirm())?;
            remove_files(&superseded)
        };
        *lock(&self.under_way) = beside(keep)?;
        Ok(())
    }

    /// The entry that says that only some steps are wanted any more, and the names of their files.
    fn want_only(&self, keys: &[StepKey]) -> (Entry, HashSet<String>) {
        let mut steps = lock(&self.steps);
        let names = steps.names_of(keys);
        (steps.want_only(keys), names)
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
        if let Some(value) = self.recall(&step.key, context)? {
            return Ok(value);
        }
        let value = make()?;
        self.keep(step, [], &value)?;
        Ok(value)
    }

    /// Makes sure that this process still holds the folder: another machine's may have taken it for dead.
    ///
    /// # Errors
    /// [`Error::Locked`] if another process works there, [`Error::Changed`] if one has ended the job, or the folder was
    /// removed; [`Error::Io`] if nothing can be found out.
    pub fn confirm(&self) -> Result<()> {
        self.lease.as_ref().map_or(Ok(()), |lease| lease.file().confirm_now())
    }

    /// Whether it is known that this process lost the folder.
    pub(crate) fn is_lost(&self) -> bool {
        self.lease.as_ref().is_some_and(|lease| lease.file().is_lost())
    }

    /// Why this process lost the folder, if it did: what failed since failed because of that.
    pub fn loss(&self) -> Option<Error> {
        let lease = self.lease.as_ref()?.file();
        let _ = lease.confirm_now();
        lease.outcome().err()
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

    /// Removes all files but those of some steps, whose values are still wanted.
    ///
    /// # Errors
    /// If the journal cannot be synced first, or a file cannot be removed.
    pub fn retain(&self, keys: &[StepKey]) -> Result<()> {
        self.wait_until_durable()?;
        let (wanted, names) = self.want_only(keys);
        append(&self.journal, &wanted)?;
        sync_before_removal(&self.journal)?;
        self.confirm()?;
        remove_files(&self.all_but(&names)?)
    }

    /// Ends the job: removes the folder unless `keep` is set or the user created it.
    ///
    /// # Errors
    /// If the journal cannot be synced.
    pub fn finish(mut self, keep: bool) -> Result<()> {
        self.wait_until_durable()?;
        if !keep {
            let (none_wanted, _) = self.want_only(&[]);
            append(&self.journal, &none_wanted)?;
        }
        sync(&self.journal)?;
        if !keep {
            self.remove();
        }
        Ok(())
    }

    /// Files of records that do not count any more, except these names.
    fn left_of_void_records(&self, names: &HashSet<String>) -> Result<Vec<PathBuf>> {
        let left = lock(&self.steps).names(false);
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

    fn remove(&mut self) {
        let _ = self.wait_until_durable();
        *lock(&self.journal) = None;
        if self.confirm().is_err() {
            return;
        }
        let _ = self.clear();
        self.lease = None;
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

fn remove_files(paths: &[PathBuf]) -> Result<()> {
    paths.iter().try_for_each(|path| fs::remove_file(path).map_err(|e| Error::io(path, "remove", e)))
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

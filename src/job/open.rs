//! Opens a work folder: begins a job in it, resumes one, or starts over.

use std::collections::HashSet;
use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use super::foreign::refuse_foreign;
use super::journal::{self, Entry, JOURNAL, Journal, now};
use super::lease::Lease;
use super::lock_file::lock_folder;
use super::manifest::{AFRESH, MANIFEST, Manifest};
use super::stage::remove_stages;
use super::steps::RecordedSteps;
use super::{Resume, WorkFolder, remove_files};
use crate::base::error::escape_path;
use crate::base::{Error, Progress, Result, Silent, lock};
use crate::file::header::HEADER_BYTES;
use crate::os::durable::{new_job_number, no_links, sync_file, sync_folder};

impl WorkFolder {
    /// Creates a folder or takes one over, locks it and reads its journal.
    ///
    /// # Errors
    /// [`Error::Locked`] if another process works in it, [`Error::Usage`] if it contains foreign files,
    /// [`Error::Changed`] if it belongs to a different job or, under [`Resume::Require`], holds no finished step,
    /// [`Error::Damaged`] if its manifest is damaged or, under [`Resume::Require`], its manifest or journal is missing
    /// or damaged.
    pub fn open(path: &Path, manifest: &Manifest, resume: Resume) -> Result<Self> {
        Self::open_watched(path, manifest, resume, &Silent)
    }

    /// As [`open`](WorkFolder::open), and tells if it has to wait, which a stop ends.
    ///
    /// # Errors
    /// Those of [`open`](WorkFolder::open), and [`Error::Stopped`].
    pub fn open_watched(path: &Path, manifest: &Manifest, resume: Resume, progress: &dyn Progress) -> Result<Self> {
        let is_new = !path.exists();
        if is_new && resume == Resume::Require {
            return Err(nothing_in(path, "is not there"));
        }
        if !is_new {
            refuse_foreign(path)?;
        }
        let mut folder = Self {
            path: path.to_owned(),
            is_ours: is_new || manifest.owns_folder,
            lock: Some(lock_folder(path)?),
            lease: None,
            resume,
            steps: Arc::default(),
            journal: Arc::default(),
            under_way: Mutex::new(None),
            damage: Mutex::new(Vec::new()),
            is_resumed: false,
            holds_steps: AtomicBool::new(true),
            number: new_job_number(path),
            lending: None,
        };
        let lease = Lease::claim(path, progress)?;
        let lease_file = lease.file();
        folder.lease = Some(lease);
        let earlier = match resume {
            Resume::Never => {
                folder.remember_outside();
                None
            }
            Resume::Again => {
                folder.refuse_other_options(manifest)?;
                None
            }
            Resume::Auto | Resume::Require => folder.take_over(manifest)?,
        };
        let journal = match earlier {
            Some(journal) => journal,
            None => {
                folder.holds_steps = AtomicBool::new(false);
                folder.begin(manifest)?
            }
        };
        let mut journal = journal.under(lease_file);
        folder.holds_steps = AtomicBool::new(folder.is_resumed);
        journal.append(&Entry::Began { time: now() })?;
        if resume == Resume::Never {
            let steps = lock(&folder.steps);
            steps.records().try_for_each(|record| journal.append(&Entry::Kept(record.clone())))?;
        }
        *lock(&folder.journal) = Some(journal);
        let named = lock(&folder.steps).names(true);
        remove_files(&folder.all_but(&named)?)?;
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
            return if self.path.join(JOURNAL).exists() {
                self.damaged(MANIFEST, "it is gone".into())
            } else {
                nothing("holds no job to resume")
            };
        }
        let (earlier, checksum) = Manifest::read(&path)?;
        self.number = earlier.job;
        self.is_ours |= earlier.owns_folder;
        let differences = earlier.differences(manifest);
        if !differences.is_empty() {
            let (shown, what) = (escape_path(&self.path), differences.join("; "));
            return Err(Error::Changed(format!("{shown}: made for a job that differs: {what}; {AFRESH}")));
        }
        let path = self.path.join(JOURNAL);
        if !path.exists() {
            return if self.all_but(&HashSet::new())?.is_empty() {
                nothing("holds no finished step")
            } else {
                self.damaged(JOURNAL, "it is gone".into())
            };
        }
        let (journal, entries, cut_off, is_spoilt) =
            match Journal::open(&path, checksum, self.resume == Resume::Require) {
                Err(Error::Damaged { message, .. }) => return self.damaged(JOURNAL, message),
                opened => opened?,
            };
        if cut_off > 0 {
            if is_spoilt {
                self.note_damage(JOURNAL, &format!("its last {cut_off} bytes are not whole"))
            } else {
                let path = escape_path(&path);
                lock(&self.damage).push(format!("{path}: its last entry was cut short; that step is redone"));
            }
        }
        let steps = RecordedSteps::replay(entries);
        if steps.is_empty() {
            return nothing("holds no finished step").map(|_: Option<Journal>| Some(journal));
        }
        self.steps = Arc::new(Mutex::new(steps));
        self.is_resumed = true;
        Ok(Some(journal))
    }

    /// Keeps the data of the previous job that is needed to find its files outside of the folder: its id, and the steps
    /// that name them.
    fn remember_outside(&mut self) {
        let Ok((earlier, checksum)) = Manifest::read(&self.path.join(MANIFEST)) else { return };
        self.number = earlier.job;
        self.is_ours |= earlier.owns_folder;
        let entries = journal::read(&self.path.join(JOURNAL), checksum).map_or(Vec::new(), |reading| reading.entries);
        self.steps = Arc::new(Mutex::new(RecordedSteps::replay(entries).outlasting()));
    }

    /// Refuses to start over in a folder whose job has other options.
    fn refuse_other_options(&mut self, manifest: &Manifest) -> Result<()> {
        let path = self.path.join(MANIFEST);
        if !path.exists() {
            return Ok(());
        }
        let (earlier, _) = Manifest::read(&path)?;
        if earlier.options != manifest.options {
            let shown = escape_path(&self.path);
            return Err(Error::Changed(format!("{shown}: holds another job; give another `work`")));
        }
        self.is_ours |= earlier.owns_folder;
        Ok(())
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

    /// Discards all records: the job starts over.
    ///
    /// # Errors
    /// If files cannot be removed or written.
    pub fn restart(&mut self, manifest: &Manifest) -> Result<()> {
        self.confirm()?;
        *lock(&self.journal) = None;
        self.steps = Arc::default();
        self.is_resumed = false;
        self.holds_steps = AtomicBool::new(false);
        let lease = self.lease.as_ref().map(Lease::file);
        let journal = self.begin(manifest)?;
        *lock(&self.journal) = Some(lease.into_iter().fold(journal, Journal::under));
        Ok(())
    }

    /// Removes all files of an earlier job, the manifest last.
    pub(super) fn clear(&self) -> Result<()> {
        remove_stages(&self.path, None);
        let superseded = self.all_but(&HashSet::new())?;
        remove_files(&superseded)?;
        // Without a manifest they would count as foreign.
        superseded.first().map_or(Ok(()), |path| sync_folder(path))?;
        for name in [JOURNAL, MANIFEST] {
            for name in [name.to_owned(), format!("{name}.tmp")] {
                let path: PathBuf = self.path.join(name);
                match fs::remove_file(&path) {
                    Err(error) if error.kind() != ErrorKind::NotFound => return Err(Error::io(&path, "remove", error)),
                    _ => {}
                }
            }
        }
        Ok(())
    }
}

/// Returns [`Error::Changed`] for a job that should be resumed and does not exist.
fn nothing_in(path: &Path, why: &str) -> Error {
    Error::Changed(format!("{}: {why}; to start over, leave out `resume: require`", escape_path(path)))
}

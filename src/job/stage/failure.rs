//! Why a task failed on another machine, in a file that the job reads.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::folder::{ERROR, FULL, failure_name, is_stage_folder};
use super::stage_file::Stage;
use crate::base::error::escape;
use crate::base::{Error, ErrorKind};
use crate::file::codec;
use crate::os::durable::no_links;

/// Longest file that is read.
const FAILURE_BYTES_MAX: u64 = 16 << 10;

/// Why a process could not do a task.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct TaskFailure {
    /// The machine.
    host: String,
    kind: ErrorKind,
    message: String,
}

impl TaskFailure {
    /// Whether the task fails everywhere.
    pub(super) fn is_final(&self) -> bool {
        !matches!(self.kind, ErrorKind::Io | ErrorKind::Stopped | ErrorKind::Locked)
    }

    /// The error of the job.
    pub(super) fn into_error(self, task: usize) -> Error {
        let [host, message] = [&self.host, &self.message].map(|text| escape(text.as_bytes()));
        Error::Elsewhere { kind: self.kind, message: format!("task {task} failed on {host}: {message}") }
    }
}

/// Says why a task of a stage failed here, also where the stage could not be read; on a best-effort basis.
pub fn note_failure(stage: &Path, task: usize, error: &Error) {
    if !stage.parent().is_some_and(is_stage_folder) {
        return;
    }
    let host = crate::os::system::host_name();
    let failure = TaskFailure { host, kind: error.kind(), message: error.to_string() };
    let mut options = fs::File::options();
    let opened = no_links(options.write(true).create(true).truncate(true)).open(place(stage, task));
    let encoded = codec::encode(&failure).unwrap_or_default();
    let _ = opened.and_then(|mut file| file.write_all(&encoded));
    if error.kind() == ErrorKind::NoSpace {
        // A full disk has no room for words.
        let _ = fs::File::create_new(stage.with_file_name(failure_name(task, FULL)));
    }
}

fn place(stage: &Path, task: usize) -> PathBuf {
    stage.with_file_name(failure_name(task, ERROR))
}

impl Stage {
    /// Forgets why a task failed before.
    pub fn forget_failure(&self, task: usize) {
        for ending in [ERROR, FULL] {
            let _ = fs::remove_file(self.path().with_file_name(failure_name(task, ending)));
        }
    }

    /// Why a task failed last, if a process said so.
    pub(super) fn failure(&self, task: usize) -> Option<TaskFailure> {
        let path = place(&self.path(), task);
        let is_short = fs::symlink_metadata(&path).is_ok_and(|meta| meta.is_file() && meta.len() <= FAILURE_BYTES_MAX);
        let words = if is_short { fs::read(path).ok() } else { None };
        let said = words.and_then(|bytes| codec::decode(&bytes).ok());
        let is_full = || self.path().with_file_name(failure_name(task, FULL)).exists();
        let full_disk = || TaskFailure {
            host: "another machine".into(),
            kind: ErrorKind::NoSpace,
            message: "no space left, not even to say more".into(),
        };
        said.or_else(|| is_full().then(full_disk))
    }
}

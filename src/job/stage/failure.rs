//! Why a task failed on another machine, in a file that the job reads.

use std::fs;
use std::io::Write as _;

use serde::{Deserialize, Serialize};

use super::stage_file::{Stage, StageTask};
use crate::base::error::escape;
use crate::base::{Error, ErrorKind};
use crate::file::codec;
use crate::os::durable::no_links;

/// Ending of the name of its file.
const ERROR: &str = "error";
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

impl Stage {
    /// Says why a task failed here; on a best-effort basis.
    pub fn note_failure(&self, task: &StageTask, error: &Error) {
        let host = crate::os::system::host_name();
        let failure = TaskFailure { host, kind: error.kind(), message: error.to_string() };
        let path = self.file_of(task, ERROR);
        let mut options = fs::File::options();
        let opened = no_links(options.write(true).create(true).truncate(true)).open(path);
        let encoded = codec::encode(&failure).unwrap_or_default();
        let _ = opened.and_then(|mut file| file.write_all(&encoded));
    }

    /// Forgets why a task failed before.
    pub fn forget_failure(&self, task: &StageTask) {
        let _ = fs::remove_file(self.file_of(task, ERROR));
    }

    /// Why a task failed last, if a process said so.
    pub(super) fn failure(&self, task: &StageTask) -> Option<TaskFailure> {
        let path = self.file_of(task, ERROR);
        let meta = fs::symlink_metadata(&path).ok()?;
        let is_short = meta.is_file() && meta.len() <= FAILURE_BYTES_MAX;
        codec::decode(&fs::read(path).ok().filter(|_| is_short)?).ok()
    }
}

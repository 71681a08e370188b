//! Reads the state of a job from its work folder, without a lock and while the job runs.

use std::fs;
use std::path::Path;

use super::journal::{self, Entry, JOURNAL};
use super::lease::is_held;
use super::lock_file::is_locked;
use super::manifest::{AFRESH, MANIFEST, Manifest};
use super::stage::{StageStatus, look_at_stages, sizes};
use crate::base::error::escape_path;
use crate::base::{Error, Result};
use crate::file::header::Header;

/// State of a job, readable while it runs.
#[derive(Debug)]
pub struct WorkStatus {
    /// Its manifest.
    pub manifest: Manifest,
    /// Entries of its journal.
    pub entries: Vec<Entry>,
    /// Whether a process holds the lock of the folder.
    pub is_running: bool,
    /// The stage whose tasks other processes do, if there is one.
    pub stage: Option<StageStatus>,
    /// Size of all its files in bytes.
    pub bytes: u64,
}

/// Reads the state of a work folder without disturbing it.
///
/// # Errors
/// [`Error::Usage`] if it is no work folder; [`Error::Damaged`] and [`Error::Changed`] if it cannot be read.
pub fn look(path: &Path) -> Result<WorkStatus> {
    if !path.join(MANIFEST).is_file() {
        if Header::is_at(&path.join(JOURNAL)) {
            return Err(Error::Damaged { path: path.join(MANIFEST), message: format!("it is gone; {AFRESH}") });
        }
        let folder = escape_path(path);
        return Err(Error::Usage(format!(
            "{folder}: holds no job: none was begun there, or it is done and its files were removed (`keep_work` keeps them)"
        )));
    }
    let (manifest, checksum) = Manifest::read(&path.join(MANIFEST))?;
    let entries =
        if path.join(JOURNAL).exists() { journal::read(&path.join(JOURNAL), checksum)?.entries } else { Vec::new() };
    // A stage that is being written, or removed, is none.
    let stage = look_at_stages(path).unwrap_or_default().pop();
    Ok(WorkStatus { manifest, entries, is_running: is_locked(path) || is_held(path), stage, bytes: folder_bytes(path) })
}

/// Size of all files in a work folder, in bytes.
pub fn folder_bytes(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let own: u64 =
        entries.filter_map(|entry| entry.metadata().ok()).filter(|meta| meta.is_file()).map(|meta| meta.len()).sum();
    own + sizes(folder)
}

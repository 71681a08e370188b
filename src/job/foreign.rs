//! Checks that a work folder contains only files that this program writes, so that no file of the user is ever removed.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use super::journal::JOURNAL;
use super::lease::{LEASE, is_lease_at};
use super::lock_file::{LOCK, is_locked};
use super::manifest::{MANIFEST, MANIFEST_BYTES_MAX};
use super::names::{is_phase_file, is_remains};
use super::stage::is_stage_folder;
use crate::base::error::{escape, escape_path};
use crate::base::{Error, Result};
use crate::file::header::Header;
use crate::os::durable::no_links;

/// Returns the entries of a folder.
///
/// # Errors
/// [`Error::Io`] if the folder cannot be read.
pub(super) fn entries(folder: &Path) -> Result<Vec<fs::DirEntry>> {
    fs::read_dir(folder).and_then(Iterator::collect).map_err(|e| Error::io(folder, "read", e))
}

/// Refuses a folder with files that this program does not write, or with files but no manifest or journal.
pub(super) fn refuse_foreign(path: &Path) -> Result<()> {
    if !path.is_dir() {
        return Err(Error::Usage(format!("{}: the work folder is not a folder", escape_path(path))));
    }
    let is_job = [MANIFEST, JOURNAL].iter().any(|name| Header::is_at(&path.join(name)));
    for entry in entries(path)? {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        let is_own = match &*name {
            LEASE => is_lease_at(&entry.path()),
            LOCK => entry.metadata().is_ok_and(|meta| meta.len() == 0),
            // Left by a process that was killed at its start; contains zeros after a power cut.
            "manifest.bin.tmp" => is_job || Header::is_at(&entry.path()) || is_all_zero(&entry.path()),
            name if is_remains(name) => true,
            name => is_job && ([MANIFEST, JOURNAL, "journal.bin.tmp"].contains(&name) || is_phase_file(name)),
        };
        // A late process may have kept one from being removed with its job.
        let is_stage = || is_stage_folder(&entry.path());
        if !(is_own && entry.file_type().is_ok_and(|kind| kind.is_file()) || is_stage()) {
            // A job may be starting or ending there just now, whose files come and go.
            if is_locked(path) {
                return Err(Error::Locked(path.to_owned()));
            }
            let message = format!(
                "{}: '{}' is not a file of a job, or a damaged one; choose an empty or new folder with `work`",
                escape_path(path),
                escape(name.as_bytes()),
            );
            return Err(Error::Usage(message));
        }
    }
    Ok(())
}

/// Reports whether a file is empty, or holds zeros up to the largest size of a manifest.
fn is_all_zero(path: &Path) -> bool {
    let mut bytes = Vec::new();
    let mut options = File::options();
    let file = no_links(options.read(true)).open(path);
    let read = file.and_then(|file| file.take(MANIFEST_BYTES_MAX).read_to_end(&mut bytes));
    read.is_ok() && bytes.iter().all(|byte| *byte == 0)
}

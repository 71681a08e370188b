//! The work folder of a job: a lock, a manifest that says what it was made for, and the files of the phases.
//!
//! # Files
//! `manifest.bin` (bincode: [`Manifest`]), `lock`, and what the phases write. A folder that holds anything foreign is
//! never used, so nothing of the user's is ever removed.

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use fs4::FileExt;
use serde::{Deserialize, Serialize};

use crate::base::error::escape_path;
use crate::base::{Error, Result};
use crate::os::durable::DurableFile;

/// Version of the work folder's files.
pub const FORMAT_VERSION: u32 = 1;
const MANIFEST: &str = "manifest.bin";
const LOCK: &str = "lock";

/// What a work folder was made for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of the files.
    pub format: u32,
    /// Version of the program.
    pub program: String,
    /// The options that shape the result, in words.
    pub options: String,
    /// The input files with their sizes in bytes.
    pub inputs: Vec<(PathBuf, u64)>,
}

/// A locked work folder; removed on drop unless kept.
#[derive(Debug)]
pub struct WorkFolder {
    path: PathBuf,
    is_ours: bool,
    lock: Option<File>,
    /// Whether the folder stays when the job ends.
    pub keep: bool,
}

impl WorkFolder {
    /// Makes or takes over a folder, locks it and writes the manifest.
    ///
    /// # Errors
    /// [`Error::Locked`] if another process works in it, [`Error::Usage`] if it holds foreign files.
    pub fn open(path: &Path, manifest: &Manifest) -> Result<Self> {
        let is_new = !path.exists();
        if !is_new {
            refuse_foreign(path)?;
        }
        // A killed job's folder was made by it, and goes with the job that takes it over.
        let is_ours = is_new || path.join(MANIFEST).exists();
        fs::create_dir_all(path).map_err(|e| Error::io(path, "create", e))?;
        let lock_path = path.join(LOCK);
        let lock = File::options().create(true).truncate(false).write(true).open(&lock_path);
        let lock = lock.map_err(|e| Error::io(&lock_path, "create", e))?;
        if FileExt::try_lock(&lock).is_err() {
            return Err(Error::Locked(path.to_owned()));
        }
        let folder = Self { path: path.to_owned(), is_ours, lock: Some(lock), keep: false };
        folder.clear()?;
        folder.write_manifest(manifest)?;
        Ok(folder)
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes of all files in it.
    pub fn bytes(&self) -> u64 {
        let entries = fs::read_dir(&self.path).into_iter().flatten().flatten();
        entries.filter_map(|entry| entry.metadata().ok()).map(|meta| meta.len()).sum()
    }

    fn write_manifest(&self, manifest: &Manifest) -> Result<()> {
        let path = self.path.join(MANIFEST);
        let bytes = bincode::serde::encode_to_vec(manifest, bincode::config::standard())
            .map_err(|e| Error::Damaged { path: path.clone(), message: e.to_string() })?;
        let mut file = DurableFile::create(&path, 4096)?;
        file.write(b"drystone-job\n")?;
        file.write(&bytes)?;
        file.commit()?;
        Ok(())
    }

    /// Removes all files of an earlier job.
    fn clear(&self) -> Result<()> {
        for entry in fs::read_dir(&self.path).map_err(|e| Error::io(&self.path, "read", e))?.flatten() {
            if entry.file_name() != LOCK {
                fs::remove_file(entry.path()).map_err(|e| Error::io(&entry.path(), "remove", e))?;
            }
        }
        Ok(())
    }
}

impl Drop for WorkFolder {
    fn drop(&mut self) {
        if self.keep {
            return;
        }
        let _ = self.clear();
        let _ = fs::remove_file(self.path.join(LOCK));
        self.lock = None;
        if self.is_ours {
            let _ = fs::remove_dir(&self.path);
        }
    }
}

/// Refuses a folder that holds a file which this program does not write.
fn refuse_foreign(path: &Path) -> Result<()> {
    if !path.is_dir() {
        return Err(Error::Usage(format!("{}: the work folder is not a folder", escape_path(path))));
    }
    for entry in fs::read_dir(path).map_err(|e| Error::io(path, "read", e))?.flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        let name = name.strip_suffix(".tmp").unwrap_or(&name);
        let is_phase = ["scan-", "pass-", "write-", "measure-"].iter().any(|prefix| name.starts_with(prefix));
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        if !(is_file && (is_phase || name == MANIFEST || name == LOCK)) {
            let message = format!("{}: holds files of others; give an empty or a new work folder", escape_path(path));
            return Err(Error::Usage(message));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn manifest() -> Manifest {
        Manifest { format: FORMAT_VERSION, program: "0".into(), options: String::new(), inputs: Vec::new() }
    }

    #[test]
    fn a_folder_is_removed_with_its_job_and_locked_while_it_runs() {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("work");
        let job = WorkFolder::open(&path, &manifest()).unwrap();
        assert!(matches!(WorkFolder::open(&path, &manifest()), Err(Error::Locked(_))));
        drop(job);
        assert!(!path.exists());
    }

    #[test]
    fn a_folder_left_by_a_killed_job_goes_with_the_next_one() {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("work");
        fs::create_dir(&path).unwrap();
        for name in [MANIFEST, LOCK, "scan-0.piece.tmp"] {
            fs::write(path.join(name), "cut sho").unwrap();
        }
        drop(WorkFolder::open(&path, &manifest()).unwrap());
        assert!(!path.exists());
    }

    #[test]
    fn an_empty_folder_of_the_user_stays() {
        let parent = tempfile::tempdir().unwrap();
        drop(WorkFolder::open(parent.path(), &manifest()).unwrap());
        assert!(parent.path().exists());
    }

    #[test]
    fn a_folder_with_foreign_files_is_refused_and_left_alone() {
        let parent = tempfile::tempdir().unwrap();
        fs::write(parent.path().join("thesis.txt"), "years of work").unwrap();
        assert!(matches!(WorkFolder::open(parent.path(), &manifest()), Err(Error::Usage(_))));
        assert!(parent.path().join("thesis.txt").exists());
    }
}

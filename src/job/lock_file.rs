//! The lock of a work folder, which admits one process at a time and is released when that process ends.
//!
//! The system holds the lock while the file is open, so a kill releases it. The file itself is removed with the folder.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::Path;
use std::time::Duration;

use fs4::{FileExt, TryLockError};

use crate::base::{Error, Result};
use crate::os::durable::{make_folders, no_links};

/// Name of the file that a running process locks in its work folder.
pub(super) const LOCK: &str = "lock";
/// Attempts to lock, and the time between them: another process may briefly test the lock.
const TRIES: u32 = 8;
const INTERVAL: Duration = Duration::from_millis(25);

/// Creates the folder if needed and locks it for this process.
///
/// # Errors
/// [`Error::Locked`] if another process holds the lock; [`Error::Io`] if the folder or the file cannot be created.
pub(super) fn lock_folder(path: &Path) -> Result<File> {
    let lock_path = path.join(LOCK);
    for _ in 0..TRIES {
        make_folders(path)?;
        let mut options = File::options();
        let file = match no_links(options.create(true).truncate(false).write(true)).open(&lock_path) {
            // A job that has just ended may have removed its folder.
            Err(error) if error.kind() == ErrorKind::NotFound => continue,
            opened => opened.map_err(|e| Error::io(&lock_path, "create", e))?,
        };
        match FileExt::try_lock(&file) {
            Ok(()) if is_file_at(&file, &lock_path) => return Ok(file),
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => std::thread::sleep(INTERVAL),
            Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Interrupted => {}
            Err(TryLockError::Error(error)) => return Err(Error::io(&lock_path, "lock", error)),
        }
    }
    Err(Error::Locked(path.to_owned()))
}

/// Reports whether another process holds the lock of a folder.
pub(super) fn is_locked(path: &Path) -> bool {
    let mut options = File::options();
    let lock = no_links(options.read(true)).open(path.join(LOCK));
    lock.is_ok_and(|file| matches!(FileExt::try_lock_shared(&file), Err(TryLockError::WouldBlock)))
}

/// Reports whether a path still leads to an open file: a lock on a removed file excludes nobody.
fn is_file_at(file: &File, path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let identity = |meta: fs::Metadata| (meta.dev(), meta.ino());
        file.metadata().ok().map(identity) == fs::symlink_metadata(path).ok().map(identity)
    }
    #[cfg(not(unix))]
    {
        let _ = file;
        path.exists()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_lock_on_a_file_that_was_removed_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(LOCK);
        let file = File::create(&path).unwrap();
        assert!(is_file_at(&file, &path));
        fs::remove_file(&path).unwrap();
        assert!(!is_file_at(&file, &path));
        let other = File::create(&path).unwrap();
        assert!(!is_file_at(&file, &path) && is_file_at(&other, &path));
    }

    #[test]
    fn what_is_no_file_is_no_lock_of_another_process() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join(LOCK)).unwrap();
        assert!(matches!(lock_folder(folder.path()), Err(Error::Io { .. })));
    }

    #[test]
    fn a_locked_folder_is_locked_until_the_lock_is_given_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("work");
        assert!(!is_locked(&path));
        let lock = lock_folder(&path).unwrap();
        assert!(is_locked(&path));
        assert!(matches!(lock_folder(&path), Err(Error::Locked(found)) if found == path));
        drop(lock);
        assert!(!is_locked(&path) && lock_folder(&path).is_ok());
    }
}

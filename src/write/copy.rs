//! Opens, copies, links and compares files.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::Path;

use crate::base::Error;
use crate::os::content::Content;
use crate::os::durable::sync_file;

/// Most bytes compared at once.
const COMPARED_BYTES: u64 = 256 << 10;

/// Length and modification time of a file, by which a change is detected; `None` if it does not exist.
pub(super) type Look = Option<(u64, Option<std::time::SystemTime>)>;

/// Returns the current length and modification time of a file or link; `None` if it does not exist.
pub(super) fn look(path: &Path) -> Look {
    let meta = fs::symlink_metadata(path).ok()?;
    Some((meta.len(), meta.modified().ok()))
}

/// Opens a regular file.
pub(super) fn open_regular(source: &Path) -> io::Result<File> {
    let file = File::open(source)?;
    if file.metadata()?.is_file() { Ok(file) } else { Err(io::Error::other("not a regular file")) }
}

/// Creates a symbolic link.
#[cfg(unix)]
pub(super) fn symlink(target: &Path, link: &Path) -> io::Result<()> {
    std::os::unix::fs::symlink(target, link)
}

/// Creates a symbolic link.
#[cfg(windows)]
pub(super) fn symlink(target: &Path, link: &Path) -> io::Result<()> {
    std::os::windows::fs::symlink_file(target, link)
}

/// What went wrong while a file was copied.
pub(super) enum CopyError {
    /// The source could not be read.
    Read(io::Error),
    /// The copy could not be written.
    Write(Error),
}

impl From<io::Error> for CopyError {
    fn from(error: io::Error) -> Self {
        Self::Read(error)
    }
}

/// Copies a file to the new file `temporary` and syncs it; returns its content. An error of writing names `target`.
pub(super) fn copy(source: File, temporary: &Path, target: &Path) -> Result<Content, CopyError> {
    let wrap = |error| CopyError::Write(Error::io(target, "write", error));
    let mut copy = OpenOptions::new().write(true).create_new(true).open(temporary).map_err(wrap)?;
    let content = Content::pass(source, |bytes| copy.write_all(bytes).map_err(wrap))?;
    sync_file(&copy, temporary).map_err(wrap)?;
    Ok(content)
}

/// Reports whether both are regular files (`a` not a link) with the same bytes.
pub(super) fn same_content(a: &Path, b: &Path) -> io::Result<bool> {
    let metadata = fs::symlink_metadata(a)?;
    if !metadata.is_file() || metadata.len() != fs::metadata(b)?.len() {
        return Ok(false);
    }
    let (mut a, mut b) = (File::open(a)?, File::open(b)?);
    let bytes = metadata.len().clamp(1, COMPARED_BYTES) as usize;
    let (mut left, mut right) = (vec![0; bytes], vec![0; bytes]);
    loop {
        let count = b.read(&mut right)?;
        if count == 0 {
            return Ok(true);
        }
        a.read_exact(&mut left[..count])?;
        if left[..count] != right[..count] {
            return Ok(false);
        }
    }
}

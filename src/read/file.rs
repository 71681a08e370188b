//! An input file, with its state when it was opened: one that is written to meanwhile is noticed.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::Path;
use std::time::SystemTime;

use xxhash_rust::xxh3::xxh3_64;

use crate::base::error::escape_path;
use crate::base::{Error, Result};
use crate::os::system::read_exact_at;

/// An open input file.
#[derive(Debug)]
pub struct OpenFile {
    file: File,
    length: u64,
    modified: Option<SystemTime>,
}

impl OpenFile {
    /// Opens a regular file.
    ///
    /// # Errors
    /// Those of [`open_regular`].
    pub fn open(path: &Path) -> Result<Self> {
        let (file, length) = open_regular(path)?;
        let modified = file.metadata().and_then(|meta| meta.modified()).ok();
        Ok(Self { file, length, modified })
    }

    /// The file, for reads at an offset.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Length in bytes when it was opened.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Checks that the file is still the one that was opened.
    ///
    /// # Errors
    /// [`Error::Changed`] if its length or modification time differs.
    pub fn check_unchanged(&self, path: &Path) -> Result<()> {
        let now = self.file.metadata().map_err(|e| Error::io(path, "open", e))?;
        if now.len() == self.length && now.modified().ok() == self.modified { Ok(()) } else { Err(written_to(path)) }
    }

    /// Replaces the contents of `buffer` with a range of the file.
    ///
    /// # Errors
    /// [`Error::Changed`] if the file was truncated; [`Error::Io`] if it cannot be read.
    pub fn read(&self, path: &Path, start: u64, bytes: usize, buffer: &mut Vec<u8>) -> Result<()> {
        buffer.resize(bytes, 0);
        read_exact_at(&self.file, buffer, start).map_err(|e| unread(path, e))
    }
}

/// Converts the error of a failed read.
pub fn unread(path: &Path, error: std::io::Error) -> Error {
    match error.kind() {
        ErrorKind::UnexpectedEof => written_to(path),
        _ => Error::io(path, "read", error),
    }
}

fn written_to(path: &Path) -> Error {
    let path = escape_path(path);
    Error::Changed(format!("{path}: was written to while it was read; run the same command again once it is complete"))
}

/// Opens a regular file and returns it with its length in bytes.
///
/// # Errors
/// [`Error::Input`] if it is not a regular file: opening a pipe could block forever.
pub fn open_regular(path: &Path) -> Result<(File, u64)> {
    let kind = fs::metadata(path).map_err(|e| Error::io(path, "open", e))?;
    if !kind.is_file() {
        return Err(Error::input(path, 0, "expected a regular file; pipes and devices cannot be read in chunks"));
    }
    let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    let length = file.metadata().map_err(|e| Error::io(path, "open", e))?.len();
    Ok((file, length))
}

/// Chains the hash of a chunk to the hash of its file.
pub fn chain(file_hash: &mut u64, bytes: u64, hash: u64) {
    let mut words = [0; 24];
    for (place, word) in words.chunks_exact_mut(8).zip([*file_hash, bytes, hash]) {
        place.copy_from_slice(&word.to_le_bytes());
    }
    *file_hash = xxh3_64(&words);
}

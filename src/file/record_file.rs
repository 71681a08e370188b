//! The one writer behind every file of records.
//!
//! ```text
//! create ──▶ put, put, …  ──▶ finish   header with checksum, sync, rename: the file is whole, or absent
//!                         └─▶ seal     the same without sync and rename, which the caller does later
//!                         └─▶ scratch  no header: for this process alone
//! ```

use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::Xxh3;

use super::header::{HEADER_BYTES, Header};
use crate::base::Result;
use crate::os::durable::DurableFile;

/// Bytes gathered before they are written.
const BUFFER_BYTES: usize = 256 << 10;

/// A new file: a header, then bytes in the order in which they are put.
pub struct RecordFile {
    file: DurableFile,
    hash: Xxh3,
    offset_bytes: u64,
}

impl RecordFile {
    /// Creates the file `path`, with room for the header. Several processes may write it at once: the last one that
    /// finishes it counts.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: &Path) -> Result<Self> {
        let mut file = DurableFile::create_shared(path, BUFFER_BYTES)?;
        file.write(&[0; HEADER_BYTES as usize])?;
        Ok(Self { file, hash: Xxh3::new(), offset_bytes: HEADER_BYTES })
    }

    /// Appends bytes; returns the offset in the file at which they begin.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn put(&mut self, bytes: &[u8]) -> Result<u64> {
        self.hash.update(bytes);
        self.file.write(bytes)?;
        let begin = self.offset_bytes;
        self.offset_bytes += bytes.len() as u64;
        Ok(begin)
    }

    /// Writes the header; [`DurableFile::commit`] makes the file durable and gives it its name.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn seal(mut self, kind: [u8; 8], record_bytes: u32, count: u64) -> Result<DurableFile> {
        let header = Header { kind, record_bytes, count, checksum: self.hash.digest() };
        self.file.write_at(0, &header.encode())?;
        Ok(self.file)
    }

    /// Writes the header, makes the file durable and gives it its name; returns its path.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish(self, kind: [u8; 8], record_bytes: u32, count: u64) -> Result<PathBuf> {
        let path = self.file.target().to_owned();
        self.seal(kind, record_bytes, count)?.commit()?;
        Ok(path)
    }

    /// Gives the file its name without a header and without syncing it: no other process may read it.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn scratch(self) -> Result<PathBuf> {
        let path = self.file.target().to_owned();
        self.file.commit_scratch()?;
        Ok(path)
    }
}

#[cfg(test)]
mod tests {
    use super::super::header::checked_header;
    use super::*;

    #[test]
    fn a_file_begins_with_a_header_that_matches_the_rest() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.col");
        let mut file = RecordFile::create(&path).unwrap();
        assert_eq!(file.put(b"four").unwrap(), HEADER_BYTES);
        assert_eq!(file.put(b"five5").unwrap(), HEADER_BYTES + 4);
        assert!(!path.exists(), "no file before it is whole");
        assert_eq!(file.finish(*b"test    ", 3, 3).unwrap(), path);
        let header = checked_header(&path);
        assert_eq!((header.kind, header.record_bytes, header.count), (*b"test    ", 3, 3));
    }
}

//! The mesh file of a result while it is written: its length and hash are known at the end.

use std::path::Path;

use xxhash_rust::xxh3::Xxh3;

use crate::base::{Findings, Result};
use crate::os::content::Content;
use crate::os::durable::DurableFile;

const FILE_BUFFER_BYTES: usize = 64 << 10;
/// Bytes after which those before are synced beside what follows.
const SYNC_BYTES: u64 = 16 << 20;

/// Counts of what a format cannot hold as it was.
#[derive(Debug, Default)]
pub(super) struct Replaced {
    /// Numbers that were NaN or infinite and are written as 0.
    pub(super) non_finite: u64,
    /// Vertices that have no colour while others do.
    pub(super) uncoloured: u64,
}

impl Replaced {
    /// Adds them to the findings.
    pub(super) fn note(&self, findings: &mut Findings) {
        findings.count("non_finite_numbers", self.non_finite);
        findings.count("uncoloured_vertices", self.uncoloured);
    }
}

/// A mesh file under a temporary name.
pub(super) struct ResultFile {
    file: DurableFile,
    bytes: u64,
    hash: Xxh3,
}

impl std::fmt::Debug for ResultFile {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("ResultFile").field("file", &self.file).field("bytes", &self.bytes).finish_non_exhaustive()
    }
}

impl ResultFile {
    /// Creates a temporary file of the job that will become `target`.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub(super) fn create(target: &Path, job: u64) -> Result<Self> {
        let file = DurableFile::create_outside(target, job, FILE_BUFFER_BYTES)?;
        Ok(Self { file, bytes: 0, hash: Xxh3::new() })
    }

    /// Appends bytes.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<()> {
        let before = self.bytes;
        self.bytes += bytes.len() as u64;
        self.hash.update(bytes);
        self.file.write(bytes)?;
        if before / SYNC_BYTES < self.bytes / SYNC_BYTES { self.file.sync_ahead() } else { Ok(()) }
    }

    /// Syncs the file under its temporary name; returns its content.
    ///
    /// # Errors
    /// Those of the file system.
    pub(super) fn seal(&mut self) -> Result<Content> {
        self.file.seal()?;
        Ok(Content { bytes: self.bytes, hash: self.hash.digest() })
    }

    /// Renames the file to its final name.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub(super) fn commit(self) -> Result<()> {
        self.file.commit().map(drop)
    }
}

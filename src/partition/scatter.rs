//! Fixed-size records by cell, in one file: each cell's records lie in extents that are spread over the file.

use std::fs::File;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

use crate::base::{Error, Result};
use crate::job::header::{HEADER_BYTES, Header};
use crate::os::durable::DurableFile;
use crate::os::system::read_exact_at;
use crate::store::column::file_name;

/// Bytes of all buffers together.
const BUFFERS_BYTES: usize = 12 << 20;

/// Collects records by cell.
pub struct ScatterWriter<T> {
    file: DurableFile,
    pending: Vec<Vec<T>>,
    extents: Vec<Vec<(u64, u32)>>,
    extent_records: usize,
    offset_bytes: u64,
    count: u64,
    hash: Xxh3,
}

impl<T: Pod> ScatterWriter<T> {
    /// Begins a file for `cell_count` cells.
    ///
    /// # Errors
    /// If the file cannot be made.
    pub fn create(path: &Path, cell_count: usize) -> Result<Self> {
        let mut file = DurableFile::create(path, 256 << 10)?;
        file.write(&[0; HEADER_BYTES as usize])?;
        Ok(Self {
            file,
            pending: vec![Vec::new(); cell_count],
            extents: vec![Vec::new(); cell_count],
            extent_records: (BUFFERS_BYTES / size_of::<T>() / cell_count.max(1)).clamp(64, 32 << 10),
            offset_bytes: HEADER_BYTES,
            count: 0,
            hash: Xxh3::new(),
        })
    }

    /// Adds a record to a cell.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    #[inline]
    pub fn push(&mut self, cell: u32, record: T) -> Result<()> {
        let pending = &mut self.pending[cell as usize];
        pending.push(record);
        if pending.len() >= self.extent_records { self.flush(cell as usize) } else { Ok(()) }
    }

    fn flush(&mut self, cell: usize) -> Result<()> {
        let pending = &mut self.pending[cell];
        let bytes: &[u8] = bytemuck::cast_slice(pending);
        self.hash.update(bytes);
        self.count += pending.len() as u64;
        self.file.write(bytes)?;
        self.extents[cell].push((self.offset_bytes, pending.len() as u32));
        self.offset_bytes += bytes.len() as u64;
        pending.clear();
        Ok(())
    }

    /// Writes what is pending and opens the file for reading by this process; it goes when the value is dropped.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish(mut self) -> Result<Scatter<T>> {
        self.flush_all()?;
        let path = self.file.target().to_owned();
        self.file.commit_scratch()?;
        Ok(Scatter { path, extents: self.extents, is_scratch: true, record: PhantomData })
    }

    /// Writes what is pending, makes the file durable and opens it for reading.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish_durable(mut self) -> Result<Scatter<T>> {
        self.flush_all()?;
        let record_bytes = size_of::<T>() as u32;
        let header = Header { kind: *b"scatter ", record_bytes, count: self.count, checksum: self.hash.digest() };
        self.file.write_at(0, &header.encode())?;
        let path = self.file.target().to_owned();
        self.file.commit()?;
        Ok(Scatter { path, extents: self.extents, is_scratch: false, record: PhantomData })
    }

    fn flush_all(&mut self) -> Result<()> {
        for cell in 0..self.pending.len() {
            if !self.pending[cell].is_empty() {
                self.flush(cell)?;
            }
        }
        Ok(())
    }
}

/// Records by cell.
#[derive(Debug, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Scatter<T> {
    #[serde(with = "file_name")]
    path: PathBuf,
    extents: Vec<Vec<(u64, u32)>>,
    /// Whether the file goes with the value.
    #[serde(skip)]
    is_scratch: bool,
    record: PhantomData<T>,
}

impl<T: Pod + Zeroable> Scatter<T> {
    /// Hands the records of a cell to `take`, extent after extent, in the order in which they were pushed.
    ///
    /// # Errors
    /// On failed reads, and what `take` returns.
    pub fn read(&self, cell: usize, mut take: impl FnMut(&[T]) -> Result<()>) -> Result<()> {
        let file = File::open(&self.path).map_err(|e| Error::io(&self.path, "open", e))?;
        let mut records = Vec::new();
        for &(offset, count) in &self.extents[cell] {
            records.clear();
            records.resize(count as usize, T::zeroed());
            let bytes = bytemuck::cast_slice_mut(&mut records);
            read_exact_at(&file, bytes, offset).map_err(|e| Error::io(&self.path, "read", e))?;
            take(&records)?;
        }
        Ok(())
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Says in which folder the file lies, after the value was read back.
    pub fn locate(&mut self, folder: &Path) {
        self.path = folder.join(&self.path);
    }

    /// Number of records of a cell.
    pub fn len(&self, cell: usize) -> u64 {
        self.extents[cell].iter().map(|extent| u64::from(extent.1)).sum()
    }
}

impl<T> Drop for Scatter<T> {
    fn drop(&mut self) {
        if self.is_scratch {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

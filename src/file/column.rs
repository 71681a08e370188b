//! Stores fixed-size records of one kind in a file: appended in order, read in windows.
//!
//! # Memory
//! A writer holds its buffer; a reader holds the windows in use.

use std::fs::File;
use std::io::ErrorKind;
use std::marker::PhantomData;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytemuck::Pod;
use serde::{Deserialize, Serialize};

use super::name::{file_name, holds};
use super::record_file::RecordFile;
use crate::base::{Error, Result};
use crate::file::header::HEADER_BYTES;
use crate::os::mmap::{self, MappedRecords};

/// Appends records to a new file.
pub struct ColumnWriter<T> {
    file: RecordFile,
    kind: [u8; 8],
    count: u64,
    record: PhantomData<T>,
}

impl<T: Pod> ColumnWriter<T> {
    /// Creates the file `path`; `kind` identifies the records.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: &Path, kind: [u8; 8]) -> Result<Self> {
        Ok(Self { file: RecordFile::create(path)?, kind, count: 0, record: PhantomData })
    }

    /// Number of records so far.
    pub fn len(&self) -> u64 {
        self.count
    }

    /// Whether no record was appended yet.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Appends records.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn append(&mut self, records: &[T]) -> Result<()> {
        self.count += records.len() as u64;
        self.file.put(bytemuck::cast_slice(records))?;
        Ok(())
    }

    /// Writes the header, makes the file durable and opens it for reading.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish(self) -> Result<Column<T>> {
        let path = self.file.finish(self.kind, size_of::<T>() as u32, self.count)?;
        Ok(Segment { path: path.into(), offset_bytes: HEADER_BYTES, count: self.count, record: PhantomData })
    }
}

/// A file of records.
pub type Column<T> = Segment<T>;

/// A range of a file that contains records of one kind.
#[derive(Debug, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Segment<T> {
    #[serde(with = "file_name")]
    path: Arc<Path>,
    offset_bytes: u64,
    count: u64,
    record: PhantomData<T>,
}

impl<T> Clone for Segment<T> {
    fn clone(&self) -> Self {
        Self { path: self.path.clone(), ..*self }
    }
}

impl<T: Pod> Segment<T> {
    /// `count` records at an offset (in bytes, a multiple of 8) in a file.
    pub fn new(path: PathBuf, offset_bytes: u64, count: u64) -> Self {
        Self { path: path.into(), offset_bytes, count, record: PhantomData }
    }

    /// Number of records.
    pub fn len(&self) -> u64 {
        self.count
    }

    /// Whether there is no record.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Bytes of the records.
    pub fn bytes(&self) -> u64 {
        self.count.saturating_mul(size_of::<T>() as u64)
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Sets the folder of the file of a recalled value.
    pub fn locate(&mut self, folder: &Path) {
        self.path = folder.join(&self.path).into();
    }

    /// Reports whether the file of a recalled and located value exists and is large enough.
    pub fn is_sound(&self) -> bool {
        let bytes = self.count.checked_mul(size_of::<T>() as u64);
        bytes.is_some_and(|bytes| holds(&self.path, [(self.offset_bytes, bytes)]))
    }

    /// Maps a range of the records; its pages are released on drop.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the range exceeds the file, else [`Error::Io`].
    pub fn window(&self, range: Range<u64>) -> Result<MappedRecords<T>> {
        let fits = range.start <= range.end && range.end <= self.count;
        let count = usize::try_from(range.end.saturating_sub(range.start)).ok().filter(|_| fits);
        let Some(count) = count else {
            let message = format!("records {range:?} asked for, it holds {}", self.count);
            return Err(Error::Damaged { path: self.path.to_path_buf(), message });
        };
        let file = File::open(&self.path).map_err(|e| Error::io(&self.path, "open", e))?;
        let offset = self.offset_bytes + range.start * size_of::<T>() as u64;
        mmap::map_records(&file, offset, count).map_err(|e| match e.kind() {
            ErrorKind::InvalidInput => Error::Damaged { path: self.path.to_path_buf(), message: e.to_string() },
            _ => Error::io(&self.path, "map", e),
        })
    }

    /// Splits the segment into ranges of at most `records` records, in order.
    pub fn ranges(&self, records: u64) -> impl Iterator<Item = Range<u64>> + use<T> {
        let (count, step) = (self.count, records.max(1));
        (0..count.div_ceil(step)).map(move |i| i * step..((i + 1) * step).min(count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::header::checked_header;

    #[test]
    fn records_come_back_in_windows() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = ColumnWriter::create(&folder.path().join("a.col"), *b"test    ").unwrap();
        writer.append(&[1u64, 2, 3]).unwrap();
        writer.append(&[4, 5]).unwrap();
        let column = writer.finish().unwrap();
        assert_eq!(&*column.window(1..4).unwrap(), &[2, 3, 4]);
        assert_eq!(column.ranges(2).collect::<Vec<_>>(), [0..2, 2..4, 4..5]);
        assert!(column.window(3..6).is_err());
    }

    #[test]
    fn the_header_has_the_checksum_of_all_records() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.col");
        let mut writer = ColumnWriter::create(&path, *b"test    ").unwrap();
        writer.append(&[1u64, 2, 3]).unwrap();
        writer.append(&[4, 5]).unwrap();
        writer.finish().unwrap();
        let header = checked_header(&path);
        assert_eq!((header.count, header.record_bytes), (5, 8));
    }
}

//! One kind of fixed-size record in a file: appended in order, read in windows.
//!
//! ```text
//! 0        8        16      20      24       32         40                64
//! | magic  | kind   | vers. | size  | count  | checksum | zeros            | records, little-endian …
//! ```
//!
//! # Memory
//! A writer holds its buffer, a reader the windows that are alive.

use std::fs::File;
use std::marker::PhantomData;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytemuck::Pod;
use xxhash_rust::xxh3::Xxh3;

use crate::base::{Error, Result};
use crate::os::durable::DurableFile;
use crate::os::mmap::{self, MappedRecords};

/// Bytes of the header that every file of the work folder begins with.
pub const HEADER_BYTES: u64 = 64;
const MAGIC: [u8; 8] = *b"drystone";
const VERSION: u32 = 1;
const WRITE_BUFFER_BYTES: usize = 256 << 10;

#[cfg(target_endian = "big")]
compile_error!("drystone's files are little-endian and are mapped as they are: big-endian machines are not supported");

/// The header of a file of records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// What the records are, in ASCII, padded with blanks.
    pub kind: [u8; 8],
    /// Bytes of a record.
    pub record_bytes: u32,
    /// Number of records.
    pub count: u64,
    /// XXH3 of the records' bytes.
    pub checksum: u64,
}

impl Header {
    /// The 64 bytes.
    pub fn encode(&self) -> [u8; HEADER_BYTES as usize] {
        let mut bytes = [0; HEADER_BYTES as usize];
        bytes[0..8].copy_from_slice(&MAGIC);
        bytes[8..16].copy_from_slice(&self.kind);
        bytes[16..20].copy_from_slice(&VERSION.to_le_bytes());
        bytes[20..24].copy_from_slice(&self.record_bytes.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.count.to_le_bytes());
        bytes[32..40].copy_from_slice(&self.checksum.to_le_bytes());
        bytes
    }

    /// Reads the 64 bytes.
    ///
    /// # Errors
    /// Says in words what does not fit.
    pub fn decode(bytes: &[u8; HEADER_BYTES as usize]) -> std::result::Result<Self, String> {
        let word = |at: usize| u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let long = |at: usize| u64::from(word(at)) | u64::from(word(at + 4)) << 32;
        if bytes[0..8] != MAGIC {
            return Err("it does not begin with 'drystone'".into());
        }
        if word(16) != VERSION {
            return Err(format!("its format is version {}, this program writes version {VERSION}", word(16)));
        }
        let mut kind = [0; 8];
        kind.copy_from_slice(&bytes[8..16]);
        Ok(Self { kind, record_bytes: word(20), count: long(24), checksum: long(32) })
    }
}

/// Appends records to a new file.
pub struct ColumnWriter<T> {
    file: DurableFile,
    kind: [u8; 8],
    hash: Xxh3,
    count: u64,
    record: PhantomData<T>,
}

impl<T: Pod> ColumnWriter<T> {
    /// Begins the file `path`; `kind` names the records.
    ///
    /// # Errors
    /// If the file cannot be made.
    pub fn create(path: &Path, kind: [u8; 8]) -> Result<Self> {
        let mut file = DurableFile::create(path, WRITE_BUFFER_BYTES)?;
        file.write(&[0; HEADER_BYTES as usize])?;
        Ok(Self { file, kind, hash: Xxh3::new(), count: 0, record: PhantomData })
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
        let bytes: &[u8] = bytemuck::cast_slice(records);
        self.hash.update(bytes);
        self.count += records.len() as u64;
        self.file.write(bytes)
    }

    /// Writes the header, makes the file durable and opens it for reading.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish(mut self) -> Result<Column<T>> {
        let checksum = self.hash.digest();
        let header = Header { kind: self.kind, record_bytes: size_of::<T>() as u32, count: self.count, checksum };
        self.file.write_at(0, &header.encode())?;
        let path = self.file.target().to_owned();
        self.file.commit()?;
        Ok(Segment { path: path.into(), offset_bytes: HEADER_BYTES, count: self.count, record: PhantomData })
    }
}

/// A whole file of records.
pub type Column<T> = Segment<T>;

/// A range of a file that holds records of one kind.
#[derive(Debug)]
pub struct Segment<T> {
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
    /// `count` records at an offset (in bytes, a multiple of 8) of a file.
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

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Maps a range of the records; its pages leave memory on drop.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the range passes the end of the file, else [`Error::Io`].
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
            std::io::ErrorKind::InvalidInput => {
                Error::Damaged { path: self.path.to_path_buf(), message: e.to_string() }
            }
            _ => Error::io(&self.path, "map", e),
        })
    }

    /// Ranges of at most `records` records that cover the segment, in order.
    pub fn ranges(&self, records: u64) -> impl Iterator<Item = Range<u64>> + use<T> {
        let (count, step) = (self.count, records.max(1));
        (0..count.div_ceil(step)).map(move |i| i * step..((i + 1) * step).min(count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn a_header_of_another_version_is_refused() {
        let header = Header { kind: *b"test    ", record_bytes: 8, count: 3, checksum: 9 };
        let mut bytes = header.encode();
        assert_eq!(Header::decode(&bytes), Ok(header));
        bytes[16] = 77;
        assert!(Header::decode(&bytes).unwrap_err().contains("version 77"));
    }
}

//! Stores records by cell in one file; the records of a cell lie in extents spread over the file.
//!
//! The checksum of an extent is verified on every read, because ids from it are used as indices into memory.

use std::fs::File;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use bytemuck::Pod;
use glam::DVec2;
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use super::record_file::RecordFile;
use crate::base::{Error, Result};
use crate::file::name::{file_name, holds};
use crate::file::packed::{self, Coordinates};
use crate::file::varint::{self, VARINT_BYTES_MAX, unzigzag, zigzag};
use crate::os::system::read_exact_at;

/// Memory of all buffers together, in bytes.
const BUFFERS_BYTES: usize = 12 << 20;
/// Largest number of records in an extent.
const EXTENT_RECORDS_MAX: usize = 32 << 10;
/// Smallest number of records of one cell, in a batch, that are written as an extent of their own.
const MANY_RECORDS: usize = 1024;
/// Largest size of an extent in bytes; no writer exceeds it.
const EXTENT_BYTES_MAX: usize = EXTENT_RECORDS_MAX * 64;

/// A record that is encoded together with others of its cell.
pub trait Record: Copy + Send + Sync {
    /// Appends the encoded records to `out`.
    fn encode(records: &[Self], out: &mut Vec<u8>);

    /// Decodes `count` records and appends them to `out`.
    ///
    /// # Errors
    /// A description of the fault if the bytes are invalid.
    fn decode(bytes: &[u8], count: usize, out: &mut Vec<Self>) -> std::result::Result<(), String>;
}

/// Appends pairs of numbers to `out`, each number as the difference from that of the pair before.
pub fn encode_pairs(pairs: impl ExactSizeIterator<Item = [u32; 2]>, out: &mut Vec<u8>) {
    let mut at = out.len();
    out.resize(at + pairs.len() * 2 * VARINT_BYTES_MAX, 0);
    let mut last = [0; 2];
    for pair in pairs {
        for (number, last) in pair.into_iter().zip(&mut last) {
            at = varint::put(out, at, zigzag(i64::from(number) - *last));
            *last = i64::from(number);
        }
    }
    out.truncate(at);
}

/// Decodes `count` pairs of numbers.
///
/// # Errors
/// A description of the fault if the bytes are invalid.
pub fn decode_pairs(bytes: &[u8], count: usize, mut take: impl FnMut([u32; 2])) -> std::result::Result<(), String> {
    let (mut at, mut last) = (0, [0i64; 2]);
    for _ in 0..count {
        for last in &mut last {
            let difference = varint::take(bytes, &mut at).ok_or("an extent ends inside a number")?;
            *last = last.wrapping_add(unzigzag(difference));
        }
        take(last.map(|number| number as u32));
    }
    if at == bytes.len() { Ok(()) } else { Err(format!("{} bytes are left after an extent", bytes.len() - at)) }
}

impl Record for DVec2 {
    fn encode(records: &[Self], out: &mut Vec<u8>) {
        encode_coordinates(records, out);
    }

    fn decode(bytes: &[u8], count: usize, out: &mut Vec<Self>) -> std::result::Result<(), String> {
        let rest = decode_coordinates(bytes, count, out)?;
        if rest.is_empty() { Ok(()) } else { Err(format!("{} bytes are left after an extent", rest.len())) }
    }
}

/// A record that is stored as it lies in memory.
pub trait Verbatim: Pod + Send + Sync {}

impl<T: Verbatim> Record for T {
    fn encode(records: &[Self], out: &mut Vec<u8>) {
        out.extend_from_slice(bytemuck::cast_slice(records));
    }

    fn decode(bytes: &[u8], count: usize, out: &mut Vec<Self>) -> std::result::Result<(), String> {
        if bytes.len() != count * size_of::<Self>() {
            return Err(format!("{} bytes for {count} records", bytes.len()));
        }
        out.extend(bytes.chunks_exact(size_of::<Self>()).map(bytemuck::pod_read_unaligned::<Self>));
        Ok(())
    }
}

/// Encodes coordinates in blocks, each preceded by its length.
pub fn encode_coordinates<T: Coordinates>(records: &[T], out: &mut Vec<u8>) {
    let mut decimals = 0;
    for records in records.chunks(packed::BLOCK_RECORDS) {
        let start = out.len();
        out.extend([0; 4]);
        packed::encode_block(records, &mut decimals, out);
        let bytes = (out.len() - start - 4) as u32;
        out[start..start + 4].copy_from_slice(&bytes.to_le_bytes());
    }
}

/// Decodes `count` coordinates from the front of `bytes`; returns the remaining bytes.
pub fn decode_coordinates<'a, T: Coordinates>(
    mut bytes: &'a [u8],
    count: usize,
    out: &mut Vec<T>,
) -> std::result::Result<&'a [u8], String> {
    let mut left = count;
    while left > 0 {
        let (length, rest) = bytes.split_first_chunk::<4>().ok_or("an extent ends before a block")?;
        let (block, rest) =
            rest.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or("an extent ends inside a block")?;
        packed::decode_block(block, left.min(packed::BLOCK_RECORDS), out)?;
        left = left.saturating_sub(packed::BLOCK_RECORDS);
        bytes = rest;
    }
    Ok(bytes)
}

/// What numbers the cells of a file of records: an id, or a plain index.
pub trait CellKey: Copy + Ord + Send + Sync + From<usize> + Into<usize> {}

impl<K: Copy + Ord + Send + Sync + From<usize> + Into<usize>> CellKey for K {}

/// A batch of records, sorted by cell.
#[derive(Debug)]
pub struct Sorted<T, K = usize> {
    /// Encoded records of cells with many.
    many: Vec<EncodedBatch<K>>,
    /// Records of the other cells.
    few: Vec<(K, T)>,
}

/// Encoded records of one cell.
#[derive(Debug)]
struct EncodedBatch<K> {
    cell: K,
    bytes: Vec<u8>,
    records: u32,
}

/// Largest number of records in an extent, large records as they are included.
fn extent_records_max<T>() -> usize {
    EXTENT_RECORDS_MAX.min(EXTENT_BYTES_MAX / size_of::<T>())
}

impl<T: Record, K: CellKey> Sorted<T, K> {
    /// Sorts records by cell; keeps the order within a cell.
    pub fn new(records: &[(K, T)]) -> Self {
        let mut sorted = Self { many: Vec::new(), few: Vec::new() };
        let cells = || records.iter().map(|entry| entry.0.into());
        let (Some(low), Some(high)) = (cells().min(), cells().max()) else { return sorted };
        // Counting sort: cell numbers follow space, so a batch spans few cells.
        let mut places = vec![0usize; high - low + 2];
        cells().for_each(|cell| places[cell - low + 1] += 1);
        (1..places.len()).for_each(|at| places[at] += places[at - 1]);
        let mut by_cell = vec![records[0].1; records.len()];
        for &(cell, record) in records {
            let place = &mut places[cell.into() - low];
            by_cell[*place] = record;
            *place += 1;
        }
        let mut start = 0;
        for (cell, &end) in (low..=high).map(K::from).zip(&places) {
            let own = &by_cell[start..end];
            start = end;
            if own.len() < MANY_RECORDS {
                sorted.few.extend(own.iter().map(|&record| (cell, record)));
                continue;
            }
            for records in own.chunks(extent_records_max::<T>()) {
                let mut bytes = Vec::new();
                T::encode(records, &mut bytes);
                sorted.many.push(EncodedBatch { cell, bytes, records: records.len() as u32 });
            }
        }
        sorted
    }
}

/// Writes records by cell.
pub struct BucketWriter<T, K = usize> {
    file: RecordFile,
    pending: Vec<Vec<T>>,
    extents: Vec<Vec<Extent>>,
    bytes: Vec<u8>,
    extent_records: usize,
    count: u64,
    key: PhantomData<K>,
}

impl<T: Record, K: CellKey> BucketWriter<T, K> {
    /// Creates a file for `cell_count` cells.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: &Path, cell_count: usize) -> Result<Self> {
        Ok(Self {
            file: RecordFile::create(path)?,
            pending: vec![Vec::new(); cell_count],
            extents: vec![Vec::new(); cell_count],
            bytes: Vec::new(),
            extent_records: (BUFFERS_BYTES / size_of::<T>() / cell_count.max(1)).clamp(64, extent_records_max::<T>()),
            count: 0,
            key: PhantomData,
        })
    }

    /// Adds a record to a cell.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    #[inline]
    pub fn push(&mut self, cell: K, record: T) -> Result<()> {
        let pending = &mut self.pending[cell.into()];
        pending.push(record);
        if pending.len() >= self.extent_records { self.flush(cell.into()) } else { Ok(()) }
    }

    /// Appends a batch of records to their cells.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn append(&mut self, sorted: Sorted<T, K>) -> Result<()> {
        sorted.few.into_iter().try_for_each(|(cell, record)| self.push(cell, record))?;
        for EncodedBatch { cell, bytes, records } in sorted.many {
            if !self.pending[cell.into()].is_empty() {
                self.flush(cell.into())?;
            }
            self.write(cell.into(), &bytes, records)?;
        }
        Ok(())
    }

    fn flush(&mut self, cell: usize) -> Result<()> {
        let mut bytes = std::mem::take(&mut self.bytes);
        bytes.clear();
        T::encode(&self.pending[cell], &mut bytes);
        self.write(cell, &bytes, self.pending[cell].len() as u32)?;
        self.pending[cell].clear();
        self.bytes = bytes;
        Ok(())
    }

    fn write(&mut self, cell: usize, bytes: &[u8], records: u32) -> Result<()> {
        self.count += u64::from(records);
        let offset_bytes = self.file.put(bytes)?;
        let extent = Extent { offset_bytes, bytes: bytes.len() as u32, records, checksum: xxh3_64(bytes) };
        self.extents[cell].push(extent);
        Ok(())
    }

    /// Writes pending records and opens the file for reading by this process. The file is deleted when the value is
    /// dropped.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish(mut self) -> Result<Buckets<T, K>> {
        self.flush_all()?;
        let path = self.file.scratch()?;
        Ok(Buckets { path, extents: self.extents, is_scratch: true, kinds: PhantomData })
    }

    /// Writes pending records, makes the file durable and opens it for reading.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish_durable(mut self) -> Result<Buckets<T, K>> {
        self.flush_all()?;
        let path = self.file.finish(*b"buckets ", 0, self.count)?;
        Ok(Buckets { path, extents: self.extents, is_scratch: false, kinds: PhantomData })
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

/// Consecutive records of one cell.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Extent {
    /// Offset of its first byte in the file.
    offset_bytes: u64,
    /// Length in bytes.
    bytes: u32,
    records: u32,
    /// XXH3 of its bytes.
    checksum: u64,
}

impl Extent {
    /// Reports whether a writer can have written an extent of this size.
    fn is_sound(&self) -> bool {
        self.bytes as usize <= EXTENT_BYTES_MAX && self.records as usize <= EXTENT_RECORDS_MAX
    }
}

/// Records by cell.
#[derive(Debug, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct Buckets<T, K = usize> {
    #[serde(with = "file_name")]
    path: PathBuf,
    extents: Vec<Vec<Extent>>,
    /// Whether the file is deleted on drop.
    #[serde(skip)]
    is_scratch: bool,
    kinds: PhantomData<(K, T)>,
}

impl<T: Record, K: CellKey> Buckets<T, K> {
    /// Passes the records of a cell to `take`, extent by extent, in the order in which they were added.
    ///
    /// # Errors
    /// On failed reads and damaged files, and those of `take`.
    pub fn read(&self, cell: K, take: impl FnMut(&[T]) -> Result<()>) -> Result<()> {
        self.read_one_in(1, cell, take)
    }

    /// Like [`read`](Buckets::read), for the first of every `step` extents.
    ///
    /// # Errors
    /// As [`read`](Buckets::read).
    pub fn read_one_in(&self, step: usize, cell: K, mut take: impl FnMut(&[T]) -> Result<()>) -> Result<()> {
        let damaged = |message: String| Error::Damaged { path: self.path.clone(), message };
        let file = File::open(&self.path).map_err(|e| Error::io(&self.path, "open", e))?;
        let (mut bytes, mut records) = (Vec::new(), Vec::new());
        for extent in self.extents[cell.into()].iter().step_by(step) {
            if !extent.is_sound() {
                return Err(damaged(format!("an extent of {} records in {} bytes", extent.records, extent.bytes)));
            }
            bytes.resize(extent.bytes as usize, 0);
            read_exact_at(&file, &mut bytes, extent.offset_bytes).map_err(|e| Error::io(&self.path, "read", e))?;
            if xxh3_64(&bytes) != extent.checksum {
                return Err(damaged("the checksum of an extent differs from what was written".into()));
            }
            records.clear();
            T::decode(&bytes, extent.records as usize, &mut records).map_err(damaged)?;
            take(&records)?;
        }
        Ok(())
    }

    /// Returns the records of the first of every `step` extents of a cell.
    ///
    /// # Errors
    /// On failed reads and damaged files.
    pub fn to_vec(&self, step: usize, cell: K) -> Result<Vec<T>> {
        let mut all = Vec::with_capacity(self.len(cell) as usize / step);
        self.read_one_in(step, cell, |records| {
            all.extend_from_slice(records);
            Ok(())
        })?;
        Ok(all)
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Sets the folder of the file of a recalled value.
    pub fn locate(&mut self, folder: &Path) {
        self.path = folder.join(&self.path);
    }

    /// Number of cells.
    pub fn cell_count(&self) -> usize {
        self.extents.len()
    }

    /// Reports whether the extents of a recalled and located value are valid and lie within the file.
    pub fn is_sound(&self) -> bool {
        let extents = || self.extents.iter().flatten();
        extents().all(|extent| extent.is_sound() && extent.records <= extent.bytes)
            && holds(&self.path, extents().map(|extent| (extent.offset_bytes, u64::from(extent.bytes))))
    }

    /// Number of records of a cell.
    pub fn len(&self, cell: K) -> u64 {
        self.extents[cell.into()].iter().map(|extent| u64::from(extent.records)).sum()
    }
}

impl<T, K> Drop for Buckets<T, K> {
    fn drop(&mut self) {
        if self.is_scratch {
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::header::HEADER_BYTES;

    impl Record for [u32; 2] {
        fn encode(records: &[Self], out: &mut Vec<u8>) {
            encode_pairs(records.iter().copied(), out);
        }

        fn decode(bytes: &[u8], count: usize, out: &mut Vec<Self>) -> std::result::Result<(), String> {
            decode_pairs(bytes, count, |pair| out.push(pair))
        }
    }

    /// A record larger than any that the engine writes.
    #[derive(Debug, Clone, Copy, PartialEq, Pod, bytemuck::Zeroable)]
    #[repr(transparent)]
    struct Large([u64; 64]);

    impl Verbatim for Large {}

    #[test]
    fn large_records_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let record = |i: u64| Large([i; 64]);
        let mut writer = BucketWriter::create(&folder.path().join("a.buckets"), 1).unwrap();
        (0..10_000).for_each(|i| writer.push(0, record(i)).unwrap());
        let batch: Vec<(usize, Large)> = (10_000..20_000).map(|i| (0, record(i))).collect();
        writer.append(Sorted::new(&batch)).unwrap();
        let (buckets, mut next) = (writer.finish().unwrap(), 0);
        let check = |records: &[Large]| {
            records.iter().for_each(|found| {
                assert_eq!(*found, record(next));
                next += 1;
            });
            Ok(())
        };
        buckets.read(0, check).unwrap();
        assert_eq!(next, 20_000);
    }

    #[test]
    fn an_extent_that_is_not_what_was_written_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.buckets");
        let mut writer = BucketWriter::create(&path, 2).unwrap();
        (0..1000u32).for_each(|i| writer.push(i as usize % 2, [i, i + 1]).unwrap());
        let buckets: Buckets<[u32; 2]> = writer.finish().unwrap();
        let mut found = Vec::new();
        let mut read = |cell| {
            buckets.read(cell, |records| {
                found.extend_from_slice(records);
                Ok(())
            })
        };
        read(1).unwrap();
        // A write that silently lost a byte: everything after it is shifted.
        let mut bytes = std::fs::read(&path).unwrap();
        bytes.remove(HEADER_BYTES as usize);
        bytes.push(0);
        std::fs::write(&path, bytes).unwrap();
        assert!(matches!(read(0), Err(Error::Damaged { .. })));
        assert!(matches!(read(1), Err(Error::Damaged { .. })));
        assert_eq!(found, (0..500).map(|i| [2 * i + 1, 2 * i + 2]).collect::<Vec<_>>());
    }

    #[test]
    fn extents_beyond_the_file_or_larger_than_any_are_not_sound() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = BucketWriter::create(&folder.path().join("a.buckets"), 2).unwrap();
        (0..1000u32).for_each(|i| writer.push(i as usize % 2, [i, i + 1]).unwrap());
        let mut buckets: Buckets<[u32; 2]> = writer.finish().unwrap();
        assert!(buckets.is_sound());
        let whole = buckets.extents.clone();
        let changes: [fn(&mut Extent); 5] = [
            |extent| extent.records = extent.bytes + 1,
            |extent| extent.records = EXTENT_RECORDS_MAX as u32 + 1,
            |extent| extent.bytes *= 1000,
            |extent| extent.offset_bytes = u64::MAX,
            |extent| extent.offset_bytes += 1 << 20,
        ];
        for change in changes {
            change(&mut buckets.extents[1][0]);
            assert!(!buckets.is_sound());
            buckets.extents.clone_from(&whole);
        }
        // The same extent repeatedly adds up to more than the file has.
        let again = vec![whole[0][0]; 1000];
        buckets.extents[0].extend(again);
        assert!(!buckets.is_sound());
    }
}

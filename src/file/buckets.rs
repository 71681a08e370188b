//! Stores records by cell in one file; the records of a cell lie in extents spread over the file.
//!
//! The checksum of an extent is verified on every read, because ids from it are used as indices into memory.

use std::fs::File;
use std::marker::PhantomData;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use super::record::Record;
use super::record_file::RecordFile;
use crate::base::{Error, Result};
use crate::file::name::{file_name, holds};
use crate::os::system::read_exact_at;

/// Memory of all buffers together, in bytes.
const BUFFERS_BYTES: usize = 12 << 20;
/// Smallest number of records of a cell that are buffered; with more cells, all share the buffers.
const BUFFERED_RECORDS_MIN: usize = 64;
/// Largest number of records in an extent.
const EXTENT_RECORDS_MAX: usize = 32 << 10;
/// Smallest number of records of one cell, in a batch, that are written as an extent of their own.
const MANY_RECORDS: usize = 1024;
/// Records of a run, of which some are read: see [`Buckets::to_vec`].
pub const RUN_RECORDS: usize = 4 << 10;
/// Largest size of an extent in bytes; no writer exceeds it.
const EXTENT_BYTES_MAX: usize = EXTENT_RECORDS_MAX * 64;

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
    /// Sorts records by cell, given the cell of each; keeps the order within a cell.
    pub fn new(cells: &[K], records: &[T]) -> Self {
        let mut sorted = Self { many: Vec::new(), few: Vec::new() };
        let numbers = || cells.iter().map(|&cell| cell.into());
        let (Some(low), Some(high)) = (numbers().min(), numbers().max()) else { return sorted };
        // Counting sort: cell numbers follow space, so a batch spans few cells.
        let mut places = vec![0usize; high - low + 2];
        numbers().for_each(|cell| places[cell - low + 1] += 1);
        (1..places.len()).for_each(|at| places[at] += places[at - 1]);
        let mut by_cell = vec![records[0]; records.len()];
        for (cell, &record) in numbers().zip(records) {
            let place = &mut places[cell - low];
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
    /// Records of all cells that are buffered at most, if the cells are many.
    shared_records: Option<usize>,
    buffered_records: usize,
    count: u64,
    key: PhantomData<K>,
}

impl<T: Record, K: CellKey> BucketWriter<T, K> {
    /// Creates a file for `cell_count` cells.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: &Path, cell_count: usize) -> Result<Self> {
        let own_records = BUFFERS_BYTES / size_of::<T>() / cell_count.max(1);
        // Buffers grow by doubling, so half of the memory may be unused.
        let shared_records = (own_records < BUFFERED_RECORDS_MIN).then_some(BUFFERS_BYTES / size_of::<T>() / 2);
        Ok(Self {
            file: RecordFile::create(path)?,
            pending: vec![Vec::new(); cell_count],
            extents: vec![Vec::new(); cell_count],
            bytes: Vec::new(),
            extent_records: own_records.clamp(BUFFERED_RECORDS_MIN, extent_records_max::<T>()),
            shared_records,
            buffered_records: 0,
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
        self.buffered_records += 1;
        if pending.len() >= self.extent_records {
            self.flush(cell.into())
        } else if self.shared_records.is_some_and(|most| self.buffered_records >= most) {
            self.flush_all()
        } else {
            Ok(())
        }
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
        self.buffered_records -= self.pending[cell].len();
        match self.shared_records {
            Some(_) => self.pending[cell] = Vec::new(),
            None => self.pending[cell].clear(),
        }
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
    pub fn read(&self, cell: K, mut take: impl FnMut(&[T]) -> Result<()>) -> Result<()> {
        let most = self.extents[cell.into()].iter().map(|extent| extent.records as usize).max();
        let mut records = Vec::with_capacity(most.unwrap_or(0).min(EXTENT_RECORDS_MAX));
        let whole_cell = |_: Range<usize>| true;
        self.each_extent(cell, whole_cell, |bytes, places| {
            records.clear();
            T::decode(bytes, places.len(), &mut records).map_err(|message| self.damaged(message))?;
            take(&records)
        })
    }

    /// Passes the bytes of those extents of a cell to `take` whose places among the records of the cell are `wanted`,
    /// with these places.
    fn each_extent(
        &self,
        cell: K,
        wanted: impl Fn(Range<usize>) -> bool,
        mut take: impl FnMut(&[u8], Range<usize>) -> Result<()>,
    ) -> Result<()> {
        let file = File::open(&self.path).map_err(|e| Error::io(&self.path, "open", e))?;
        let mut bytes = Vec::new();
        let mut end = 0;
        for extent in &self.extents[cell.into()] {
            let places = end..end + extent.records as usize;
            end = places.end;
            if !wanted(places.clone()) {
                continue;
            }
            if !extent.is_sound() {
                return Err(self.damaged(format!("an extent of {} records in {} bytes", extent.records, extent.bytes)));
            }
            bytes.resize(extent.bytes as usize, 0);
            read_exact_at(&file, &mut bytes, extent.offset_bytes).map_err(|e| Error::io(&self.path, "read", e))?;
            if xxh3_64(&bytes) != extent.checksum {
                return Err(self.damaged("the checksum of an extent differs from what was written".into()));
            }
            take(&bytes, places)?;
        }
        Ok(())
    }

    fn damaged(&self, message: String) -> Error {
        Error::Damaged { path: self.path.clone(), message }
    }

    /// Returns the records of a cell, or of the first of every `step` runs of [`RUN_RECORDS`] of them. Which ones these
    /// are depends on their order alone, and not on who wrote them.
    ///
    /// # Errors
    /// On failed reads and damaged files.
    pub fn to_vec(&self, step: usize, cell: K) -> Result<Vec<T>> {
        let mut all = Vec::with_capacity(self.len(cell) as usize / step);
        let is_wanted = |places: Range<usize>| chosen_runs(places, step).next().is_some();
        self.each_extent(cell, is_wanted, |bytes, places| {
            let begin = all.len();
            T::decode(bytes, places.len(), &mut all).map_err(|message| self.damaged(message))?;
            if step > 1 {
                let mut end = begin;
                for run in chosen_runs(places.clone(), step) {
                    all.copy_within(begin + run.start - places.start..begin + run.end - places.start, end);
                    end += run.len();
                }
                all.truncate(end);
            }
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

/// The parts of a range of places that lie in the first of every `step` runs.
fn chosen_runs(places: Range<usize>, step: usize) -> impl Iterator<Item = Range<usize>> {
    let cycle = RUN_RECORDS * step;
    let first = places.start - places.start % cycle;
    let cut = move |run: usize| run.max(places.start)..(run + RUN_RECORDS).min(places.end);
    (first..places.end).step_by(cycle).map(cut).filter(|run| !run.is_empty())
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
    use bytemuck::Pod;

    use super::super::record::{Verbatim, decode_pairs, encode_pairs};
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
        let batch: Vec<Large> = (10_000..20_000).map(record).collect();
        writer.append(Sorted::new(&vec![0; batch.len()], &batch)).unwrap();
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
    fn many_cells_share_the_buffers_and_keep_the_order_of_their_records() {
        const CELLS: u32 = 100_000;
        let folder = tempfile::tempdir().unwrap();
        let mut writer = BucketWriter::<[u32; 2]>::create(&folder.path().join("a.buckets"), CELLS as usize).unwrap();
        let mut most = 0;
        // Records come scattered over all cells, then many to each.
        let cells =
            (0..2_000_000u64).map(|i| (i * 7919 % u64::from(CELLS)) as u32).chain((0..500_000).map(|i| i / 100));
        for (number, cell) in (0..).zip(cells) {
            writer.push(cell as usize, [cell, number]).unwrap();
            if number % 100_000 == 0 {
                most = most.max(writer.pending.iter().map(Vec::capacity).sum::<usize>() * size_of::<[u32; 2]>());
            }
        }
        assert!(most <= BUFFERS_BYTES, "{most}");
        let buckets = writer.finish().unwrap();
        for cell in [0, 1, 4_999, 5_000, CELLS - 1] {
            let own = buckets.to_vec(1, cell as usize).unwrap();
            assert_eq!(own.len(), if cell < 5_000 { 120 } else { 20 });
            assert!(own.iter().all(|record| record[0] == cell) && own.is_sorted_by_key(|record| record[1]));
        }
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
    fn which_records_are_sampled_depends_on_their_places_alone() {
        let folder = tempfile::tempdir().unwrap();
        let (cells, records): (Vec<usize>, Vec<[u32; 2]>) = (0..30_000).map(|i| (i as usize % 3 / 2, [i, 0])).unzip();
        let mut sampled = Vec::new();
        for batch in [1, 100, 9_000, 30_000] {
            let mut writer = BucketWriter::create(&folder.path().join("a.buckets"), 2).unwrap();
            for (cells, records) in cells.chunks(batch).zip(records.chunks(batch)) {
                writer.append(Sorted::new(cells, records)).unwrap();
            }
            let buckets = writer.finish().unwrap();
            sampled.push([1, 2, 4].map(|step| [0, 1].map(|cell| buckets.to_vec(step, cell).unwrap())));
        }
        assert!(sampled.iter().all(|found| *found == sampled[0]));
        let is_own = |(cell, record): (&usize, &[u32; 2])| (*cell == 0).then_some(*record);
        let own: Vec<[u32; 2]> = cells.iter().zip(&records).filter_map(is_own).collect();
        assert_eq!(sampled[0][2][0], [&own[..RUN_RECORDS], &own[4 * RUN_RECORDS..]].concat());
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

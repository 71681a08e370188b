//! Stores positions and texture coordinates in compressed blocks: appended in order, read in windows.
//!
//! A block holds up to [`BLOCK_RECORDS`] records and is decoded on its own:
//!
//! ```text
//! records    two bytes
//! decimals   one byte; 255 if the doubles follow uncompressed
//! numbers    per record and coordinate, zigzag varint of its count minus that of the record before
//! ```
//! A count is in units of the last decimal place, see [`decimal`]. Records adjacent in a file are usually adjacent in
//! space: 2 bytes per coordinate instead of 8, in files with three or four decimals.
//!
//! # Memory
//! A writer holds a block; a window holds its records.

use std::fs::File;
use std::marker::PhantomData;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytemuck::Pod;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use super::decimal;
use super::name::{file_name, holds};
use super::record_file::RecordFile;
use super::varint::{self, VARINT_BYTES_MAX, unzigzag, zigzag};
use crate::base::id::{Id, numbers};
use crate::base::{Error, Result};
use crate::os::system::read_exact_at;

/// Largest number of records in a block.
pub const BLOCK_RECORDS: usize = 4096;
/// Bytes of a block before its numbers.
const HEAD_BYTES: usize = 3;
/// Marks a block of uncompressed doubles.
const RAW: u8 = u8::MAX;
/// Number of records for which output is reserved at once.
const ENCODED_AT_ONCE: usize = 256;

/// A record of coordinates.
pub trait Coordinates: Pod {
    /// Number of coordinates.
    const COUNT: usize;
}

impl Coordinates for DVec2 {
    const COUNT: usize = 2;
}

impl Coordinates for DVec3 {
    const COUNT: usize = 3;
}

/// Appends the encoding of records (at most [`BLOCK_RECORDS`]) to `out`. `decimals` are those of the previous block,
/// and are replaced with those of this one.
pub fn encode_block<T: Coordinates>(records: &[T], decimals: &mut u32, out: &mut Vec<u8>) {
    out.extend_from_slice(&(records.len() as u16).to_le_bytes());
    let numbers: &[f64] = bytemuck::cast_slice(records);
    let mut counts = Vec::with_capacity(numbers.len());
    let Some(needed) =
        decimal::counts(numbers, *decimals, &mut counts).or_else(|| decimal::counts(numbers, 0, &mut counts))
    else {
        out.push(RAW);
        out.extend_from_slice(bytemuck::cast_slice(records));
        return;
    };
    *decimals = needed;
    out.push(needed as u8);
    let (mut at, mut last) = (out.len(), [0i64; 3]);
    for counts in counts.chunks(ENCODED_AT_ONCE * T::COUNT) {
        out.resize(at + counts.len() * VARINT_BYTES_MAX, 0);
        for record in counts.chunks_exact(T::COUNT) {
            for (&count, last) in record.iter().zip(&mut last) {
                at = varint::put(out, at, zigzag(count - *last));
                *last = count;
            }
        }
    }
    out.truncate(at);
}

/// Decodes a block of `count` records and appends them to `out`.
///
/// # Errors
/// A description of the fault if the bytes are invalid.
pub fn decode_block<T: Coordinates>(bytes: &[u8], count: usize, out: &mut Vec<T>) -> std::result::Result<(), String> {
    if count > BLOCK_RECORDS {
        return Err(format!("a block of {count} records; at most {BLOCK_RECORDS} are written"));
    }
    let Some((&[low, high, decimals], bytes)) = bytes.split_first_chunk() else {
        return Err("a block ends inside its head".into());
    };
    if usize::from(u16::from_le_bytes([low, high])) != count {
        return Err(format!("a block of {} records, not of {count}", u16::from_le_bytes([low, high])));
    }
    if decimals == RAW {
        if bytes.len() != count * size_of::<T>() {
            return Err(format!("{} bytes for {count} raw records", bytes.len()));
        }
        out.extend(bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned::<T>));
        return Ok(());
    }
    if u32::from(decimals) > decimal::DECIMALS_MAX {
        return Err(format!("{decimals} decimals; at most {} are written", decimal::DECIMALS_MAX));
    }
    out.reserve(count);
    let (mut at, mut last) = (0, [0i64; 3]);
    for _ in 0..count {
        let mut record = T::zeroed();
        let numbers: &mut [f64] = bytemuck::cast_slice_mut(std::slice::from_mut(&mut record));
        for (number, last) in numbers.iter_mut().zip(&mut last) {
            let difference = varint::take(bytes, &mut at).ok_or("a block ends inside a number")?;
            *last = last.wrapping_add(unzigzag(difference));
            *number = decimal::value(*last, u32::from(decimals));
        }
        out.push(record);
    }
    if at == bytes.len() { Ok(()) } else { Err(format!("{} bytes are left after a block", bytes.len() - at)) }
}

/// Location of a block.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Block {
    /// Index of its first record.
    first: u64,
    /// Offset of its first byte in the file.
    offset_bytes: u64,
    /// Length in bytes.
    bytes: u32,
    /// XXH3 of its bytes.
    checksum: u64,
}

/// Bounding box of records; records of two coordinates use the first two axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RecordBounds {
    /// Smallest coordinates; positive infinity for an empty box.
    pub low: [f64; 3],
    /// Largest coordinates; negative infinity for an empty box.
    pub high: [f64; 3],
}

impl Default for RecordBounds {
    fn default() -> Self {
        Self { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] }
    }
}

impl RecordBounds {
    /// Extends the box to include another one.
    pub fn merge(&mut self, other: &Self) {
        self.low.iter_mut().zip(other.low).for_each(|(low, other)| *low = low.min(other));
        self.high.iter_mut().zip(other.high).for_each(|(high, other)| *high = high.max(other));
    }

    fn see<T: Coordinates>(&mut self, records: &[T]) {
        for record in bytemuck::cast_slice::<T, f64>(records).chunks_exact(T::COUNT) {
            for (&number, (low, high)) in record.iter().zip(self.low.iter_mut().zip(&mut self.high)) {
                (*low, *high) = (low.min(number), high.max(number));
            }
        }
    }
}

/// Encoded blocks of records, before they are written to a file.
#[derive(Debug, Default)]
pub struct PackedBlocks {
    bytes: Vec<u8>,
    bounds: RecordBounds,
    blocks: Vec<PackedBlock>,
}

/// An encoded block.
#[derive(Debug)]
struct PackedBlock {
    records: u32,
    bytes: u32,
    checksum: u64,
}

impl PackedBlocks {
    /// Encodes records.
    pub fn new<T: Coordinates>(records: &[T]) -> Self {
        let mut packed = Self::default();
        packed.bounds.see(records);
        let mut decimals = 0;
        for records in records.chunks(BLOCK_RECORDS) {
            let start = packed.bytes.len();
            encode_block(records, &mut decimals, &mut packed.bytes);
            let bytes = &packed.bytes[start..];
            let (count, checksum) = (records.len() as u32, xxh3_64(bytes));
            packed.blocks.push(PackedBlock { records: count, bytes: bytes.len() as u32, checksum });
        }
        packed
    }

    /// Encoded bytes of all blocks.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Number of records.
    pub fn len(&self) -> u64 {
        self.blocks.iter().map(|block| u64::from(block.records)).sum()
    }

    /// Whether there is no record.
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }
}

/// Appends records to a new file.
pub struct PackedWriter<T> {
    file: RecordFile,
    kind: [u8; 8],
    pending: Vec<T>,
    blocks: Vec<Block>,
    bounds: RecordBounds,
    count: u64,
}

impl<T: Coordinates> PackedWriter<T> {
    /// Creates the file `path`; `kind` identifies the records.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: &Path, kind: [u8; 8]) -> Result<Self> {
        Ok(Self {
            file: RecordFile::create(path)?,
            kind,
            pending: Vec::new(),
            blocks: Vec::new(),
            bounds: RecordBounds::default(),
            count: 0,
        })
    }

    /// Number of records so far.
    pub fn len(&self) -> u64 {
        self.count + self.pending.len() as u64
    }

    /// Whether no record was appended yet.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Appends records.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn append(&mut self, mut records: &[T]) -> Result<()> {
        while !records.is_empty() {
            let (now, later) = records.split_at(records.len().min(BLOCK_RECORDS - self.pending.len()));
            self.pending.extend_from_slice(now);
            records = later;
            if self.pending.len() == BLOCK_RECORDS {
                self.flush()?;
            }
        }
        Ok(())
    }

    /// Appends records that are already encoded.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn append_packed(&mut self, packed: &PackedBlocks) -> Result<()> {
        self.flush()?;
        let begin = self.file.put(&packed.bytes)?;
        place(packed, self.count, begin, &mut self.blocks);
        self.bounds.merge(&packed.bounds);
        self.count += packed.len();
        Ok(())
    }

    fn flush(&mut self) -> Result<()> {
        if self.pending.is_empty() {
            return Ok(());
        }
        let packed = PackedBlocks::new(&self.pending);
        self.pending.clear();
        self.append_packed(&packed)
    }

    /// Writes the header, makes the file durable and opens it for reading.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish(mut self) -> Result<PackedColumn<T>> {
        self.flush()?;
        let path = self.file.finish(self.kind, 0, self.count)?;
        let blocks = self.blocks.into();
        Ok(PackedColumn { path: path.into(), blocks, bounds: self.bounds, count: self.count, record: PhantomData })
    }
}

/// Appends the locations of encoded blocks to `out`, given the first record's index and the first byte's offset.
fn place(packed: &PackedBlocks, mut first: u64, mut offset_bytes: u64, out: &mut Vec<Block>) {
    for &PackedBlock { records, bytes, checksum } in &packed.blocks {
        out.push(Block { first, offset_bytes, bytes, checksum });
        first += u64::from(records);
        offset_bytes += u64::from(bytes);
    }
}

/// Records stored in blocks of a file.
#[derive(Debug, Serialize, Deserialize)]
#[serde(bound = "")]
pub struct PackedColumn<T> {
    #[serde(with = "file_name")]
    path: Arc<Path>,
    blocks: Arc<[Block]>,
    bounds: RecordBounds,
    count: u64,
    record: PhantomData<T>,
}

impl<T> Clone for PackedColumn<T> {
    fn clone(&self) -> Self {
        Self { path: self.path.clone(), blocks: self.blocks.clone(), ..*self }
    }
}

impl<T: Coordinates> PackedColumn<T> {
    /// Encoded blocks that begin at an offset of a file.
    pub fn new(path: PathBuf, offset_bytes: u64, packed: &PackedBlocks) -> Self {
        let mut blocks = Vec::with_capacity(packed.blocks.len());
        place(packed, 0, offset_bytes, &mut blocks);
        let (blocks, bounds) = (blocks.into(), packed.bounds);
        Self { path: path.into(), blocks, bounds, count: packed.len(), record: PhantomData }
    }

    /// Bounding box of the records.
    pub fn bounds(&self) -> RecordBounds {
        self.bounds
    }

    /// Number of records.
    pub fn len(&self) -> u64 {
        self.count
    }

    /// Whether there is no record.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Size of the blocks in bytes.
    pub fn bytes(&self) -> u64 {
        self.blocks.iter().map(|block| u64::from(block.bytes)).sum()
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Sets the folder of the file of a recalled value.
    pub fn locate(&mut self, folder: &Path) {
        self.path = folder.join(&self.path).into();
    }

    /// Reports whether the blocks of a recalled and located value are consecutive, and its file exists and is large
    /// enough.
    pub fn is_sound(&self) -> bool {
        let ends = self.blocks.iter().skip(1).map(|block| block.first).chain([self.count]);
        let holds_its_own = |(block, end): (&Block, u64)| {
            let records = end.checked_sub(block.first);
            records.is_some_and(|records| {
                (1..=BLOCK_RECORDS as u64).contains(&records) && records <= u64::from(block.bytes)
            })
        };
        self.blocks.first().map_or(self.count == 0, |first| first.first == 0)
            && self.blocks.iter().zip(ends).all(holds_its_own)
            && holds(&self.path, self.blocks.iter().map(|block| (block.offset_bytes, u64::from(block.bytes))))
    }

    /// Reads a range of the records.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the range exceeds the column or a block does not decode, else [`Error::Io`].
    pub fn window(&self, range: Range<u64>) -> Result<Vec<T>> {
        if range.start > range.end || range.end > self.count {
            return Err(self.damaged(format!("records {range:?} asked for, it holds {}", self.count)));
        }
        let mut out = Vec::new();
        if range.is_empty() {
            return Ok(out);
        }
        let mut reader = self.reader()?;
        let (first, last) = (self.block_of(range.start)?, self.block_of(range.end - 1)?);
        for block in first..=last {
            reader.decode(block, &mut out)?;
        }
        let skipped = (range.start - self.blocks[first].first) as usize;
        if (out.len() as u64) < range.end - self.blocks[first].first {
            return Err(self.damaged(format!("records {range:?} asked for, {} found", out.len())));
        }
        out.truncate(skipped + (range.end - range.start) as usize);
        out.drain(..skipped);
        Ok(out)
    }

    /// Reads the records at ascending ids; reads only blocks that contain one.
    ///
    /// # Errors
    /// As [`window`](PackedColumn::window).
    pub fn gather<I: Id>(&self, ids: &[I]) -> Result<Vec<T>> {
        let ids = numbers(ids);
        let mut out = Vec::with_capacity(ids.len());
        let mut reader = self.reader()?;
        let (mut records, mut at) = (Vec::new(), 0);
        while let Some(&id) = ids.get(at) {
            if u64::from(id) >= self.count {
                return Err(self.damaged(format!("record {id} asked for, it holds {}", self.count)));
            }
            let block = self.block_of(u64::from(id))?;
            records.clear();
            reader.decode(block, &mut records)?;
            let first = self.blocks[block].first;
            let end = at + ids[at..].partition_point(|&id| u64::from(id) < first + records.len() as u64);
            if end == at {
                return Err(self.damaged(format!("record {id} asked for, its block ends before it")));
            }
            out.extend(ids[at..end].iter().map(|&id| records[(u64::from(id) - first) as usize]));
            at = end;
        }
        Ok(out)
    }

    /// Splits the column into ranges of about `records` records, in order; each consists of whole blocks.
    pub fn ranges(&self, records: u64) -> impl Iterator<Item = Range<u64>> + use<T> {
        let (blocks, count, mut at) = (self.blocks.clone(), self.count, 0);
        std::iter::from_fn(move || {
            let start = blocks.get(at)?.first;
            at += blocks[at..].partition_point(|block| block.first < start + records).max(1);
            Some(start..blocks.get(at).map_or(count, |block| block.first))
        })
    }

    fn block_of(&self, record: u64) -> Result<usize> {
        let after = self.blocks.partition_point(|block| block.first <= record);
        after.checked_sub(1).ok_or_else(|| self.damaged(format!("no block holds record {record}")))
    }

    fn reader(&self) -> Result<Reader<'_, T>> {
        let file = File::open(&self.path).map_err(|e| Error::io(&self.path, "open", e))?;
        Ok(Reader { column: self, file, bytes: Vec::new() })
    }

    fn damaged(&self, message: String) -> Error {
        Error::Damaged { path: self.path.to_path_buf(), message }
    }
}

/// Reads blocks of an open column.
struct Reader<'a, T> {
    column: &'a PackedColumn<T>,
    file: File,
    bytes: Vec<u8>,
}

impl<T: Coordinates> Reader<'_, T> {
    /// Decodes a block and appends its records to `out`.
    fn decode(&mut self, block: usize, out: &mut Vec<T>) -> Result<()> {
        let column = self.column;
        let Block { first, offset_bytes, bytes, checksum } = column.blocks[block];
        let end = column.blocks.get(block + 1).map_or(column.count, |next| next.first);
        let count = end.saturating_sub(first) as usize;
        if bytes as usize > HEAD_BYTES + BLOCK_RECORDS * T::COUNT * VARINT_BYTES_MAX {
            return Err(column.damaged(format!("a block of {bytes} bytes")));
        }
        self.bytes.resize(bytes as usize, 0);
        read_exact_at(&self.file, &mut self.bytes, offset_bytes).map_err(|e| Error::io(&column.path, "read", e))?;
        if xxh3_64(&self.bytes) != checksum {
            return Err(
                column.damaged(format!("the checksum of the block of record {first} differs from what was written"))
            );
        }
        decode_block(&self.bytes, count, out).map_err(|message| column.damaged(message))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::id::ids;
    use crate::file::header::checked_header;
    use proptest::prelude::*;

    ids! {
        /// A record.
        PlaceInColumn;
    }

    fn bits(records: &[DVec3]) -> Vec<[u64; 3]> {
        records.iter().map(|record| record.to_array().map(f64::to_bits)).collect()
    }

    proptest! {
        #[test]
        fn any_doubles_come_back_bit_for_bit(raw in prop::collection::vec(any::<[f64; 3]>(), 0..100)) {
            let records: Vec<DVec3> = raw.into_iter().map(DVec3::from_array).collect();
            let (mut bytes, mut back) = (Vec::new(), Vec::new());
            encode_block(&records, &mut 0, &mut bytes);
            decode_block(&bytes, records.len(), &mut back).unwrap();
            prop_assert_eq!(bits(&back), bits(&records));
        }

        #[test]
        fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), count in 0usize..100) {
            let _ = decode_block(&bytes, count, &mut Vec::<DVec2>::new());
        }
    }

    #[test]
    fn a_block_that_is_not_what_it_says_is_refused() {
        let refusal = |bytes: &[u8], count| decode_block(bytes, count, &mut Vec::<DVec2>::new()).unwrap_err();
        let block = |records: &[DVec2]| {
            let mut bytes = Vec::new();
            encode_block(records, &mut 0, &mut bytes);
            bytes
        };
        let (counted, raw) = (block(&[DVec2::new(0.5, 2.0); 3]), block(&[DVec2::new(f64::NAN, 2.0); 3]));
        assert!(raw.len() == HEAD_BYTES + 3 * 16 && counted.len() < raw.len());
        for bytes in [&counted, &raw] {
            assert!(decode_block(bytes, 3, &mut Vec::<DVec2>::new()).is_ok());
            assert!(refusal(bytes, 2).contains("not of 2"));
            let shorter = refusal(&bytes[..bytes.len() - 1], 3);
            assert!(shorter.contains("raw records") || shorter.contains("inside a number"), "{shorter}");
            let longer = refusal(&[&bytes[..], &[0]].concat(), 3);
            assert!(longer.contains("raw records") || longer.contains("are left"), "{longer}");
        }
        assert!(refusal(&counted, BLOCK_RECORDS + 1).contains("at most"));
        assert!(refusal(&counted[..2], 3).contains("head"));
        let mut fine = counted.clone();
        fine[2] = decimal::DECIMALS_MAX as u8 + 1;
        assert!(refusal(&fine, 3).contains("decimals"));
        // A block starts with the decimals of the previous one, so they are searched only once.
        let mut decimals = 0;
        encode_block(&[DVec2::new(0.125, 2.0)], &mut decimals, &mut Vec::new());
        assert_eq!(decimals, 3);
    }

    #[test]
    fn windows_and_single_records_are_those_that_were_appended() {
        let folder = tempfile::tempdir().unwrap();
        let records: Vec<DVec3> = (0..10_000)
            .map(|i| DVec3::new(f64::from(i) * 0.25, (f64::from(i) * 10.0).round() / 1000.0, -7.5))
            .collect();
        let mut writer = PackedWriter::create(&folder.path().join("p"), *b"position").unwrap();
        writer.append(&records[..100]).unwrap();
        writer.append_packed(&PackedBlocks::new(&records[100..9000])).unwrap();
        writer.append(&records[9000..]).unwrap();
        let column = writer.finish().unwrap();
        assert_eq!(column.len(), 10_000);
        assert_eq!(checked_header(&folder.path().join("p")).count, 10_000);
        for range in [0..10_000u64, 50..150, 4095..4300, 9999..10_000, 7..7] {
            assert_eq!(column.window(range.clone()).unwrap(), records[range.start as usize..range.end as usize]);
        }
        let gather = |ids: &[u32]| column.gather::<PlaceInColumn>(bytemuck::cast_slice(ids));
        let ids = [0, 99, 100, 5000, 5001, 9999];
        assert_eq!(gather(&ids).unwrap(), ids.map(|id| records[id as usize]));
        let covered: Vec<_> = column.ranges(4096).collect();
        assert_eq!((covered[0].start, covered.last().unwrap().end), (0, 10_000));
        assert!(covered.windows(2).all(|pair| pair[0].end == pair[1].start));
        assert!(column.window(9_000..10_001).is_err());
        assert!(column.window(Range { start: 9, end: 7 }).is_err());
        assert!(gather(&[10_000]).is_err());
        let mut bytes = std::fs::read(folder.path().join("p")).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        std::fs::write(folder.path().join("p"), bytes).unwrap();
        assert!(matches!(gather(&[9_999]), Err(Error::Damaged { .. })));
        assert!(gather(&[0]).is_ok());
        assert!(std::fs::metadata(folder.path().join("p")).unwrap().len() < 5 * 10_000);
    }

    #[test]
    fn blocks_that_overlap_or_pass_the_end_are_not_sound() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = PackedWriter::create(&folder.path().join("p"), *b"position").unwrap();
        writer.append(&[DVec3::X; 2 * BLOCK_RECORDS + 7]).unwrap();
        let whole: PackedColumn<DVec3> = writer.finish().unwrap();
        assert!(whole.is_sound());
        let changes: [fn(&mut u64, &mut Vec<Block>); 6] = [
            |count, _| *count = 1 << 40,
            |count, _| *count = 0,
            |_, blocks| blocks.clear(),
            |_, blocks| blocks[0].first = 1,
            |_, blocks| blocks[1].first = 0,
            |_, blocks| blocks[2].offset_bytes += 1 << 20,
        ];
        for (i, change) in changes.iter().enumerate() {
            let (mut changed, mut blocks) = (whole.clone(), whole.blocks.to_vec());
            change(&mut changed.count, &mut blocks);
            changed.blocks = blocks.into();
            assert!(!changed.is_sound(), "change {i}");
        }
    }
}

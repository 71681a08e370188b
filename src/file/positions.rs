//! Stores positions in runs of fixed-size records, for access by id; clusters are loaded from it.
//!
//! The records of a run are as short as its extent allows. They contain counts of units in the last decimal place (see
//! [`decimal`]), relative to the smallest counts of the run:
//!
//! ```text
//! bits 0 .. bx        x
//!      bx .. bx+by    y        in as few bytes as x, y and z need: 8 for a cluster of 200 m at four decimals
//!      bx+by ..       z        24 (three uncompressed doubles) if they have no common decimals
//! ```
//!
//! # Memory
//! A mapped window of at most 64 Ki records.

use std::fs::File;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::decimal;
use super::name::{file_name, holds};
use super::record_file::RecordFile;
use crate::base::id::{Id, numbers};
use crate::base::{Error, Result};
use crate::os::mmap;

/// Largest number of records mapped at once.
const WINDOW_RECORDS: usize = 64 << 10;
/// Size of a record of uncompressed doubles, in bytes.
const RAW_BYTES: u8 = 24;
/// Largest size of a record of counts in bytes. As many zeros follow each run, so that every record can be read as a
/// whole 128-bit word.
const COUNTED_BYTES_MAX: usize = 16;
/// Number of records for which output is reserved at once.
const ENCODED_AT_ONCE: usize = 256;

/// Fixed-size records of consecutive ids.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct PositionRun {
    /// Id of its first record.
    first: u32,
    /// Offset of its first byte in the file.
    offset_bytes: u64,
    record_bytes: u8,
    decimals: u8,
    /// Bits of x and of y.
    bits: [u8; 2],
    /// Smallest count of each coordinate.
    least: [i64; 3],
}

/// An encoded run of positions, before it is written to a file.
#[derive(Debug)]
pub struct EncodedRun {
    run: PositionRun,
    count: u32,
    bytes: Vec<u8>,
}

impl EncodedRun {
    /// Encodes positions.
    pub fn new(positions: &[DVec3]) -> Self {
        let mut counts = Vec::with_capacity(3 * positions.len());
        let run = PositionRun::fitting(positions, &mut counts);
        let mut bytes = Vec::with_capacity((positions.len() + 1) * RAW_BYTES as usize);
        if run.record_bytes == RAW_BYTES {
            bytes.extend_from_slice(bytemuck::cast_slice(positions));
        } else {
            let [bx, by] = run.bits.map(u32::from);
            let record_bytes = run.record_bytes as usize;
            let mut at = 0;
            for counts in counts.chunks(3 * ENCODED_AT_ONCE) {
                bytes.resize(at + counts.len() / 3 * record_bytes + COUNTED_BYTES_MAX, 0);
                for &[x, y, z] in counts.as_chunks().0 {
                    let [low_x, low_y, low_z] = run.least;
                    let word = (x - low_x) as u128 | ((y - low_y) as u128) << bx | ((z - low_z) as u128) << (bx + by);
                    // The bytes after the record are zeros, or those of the next record.
                    bytes[at..at + COUNTED_BYTES_MAX].copy_from_slice(&word.to_le_bytes());
                    at += record_bytes;
                }
            }
            bytes.truncate(at);
        }
        bytes.extend_from_slice(&[0; COUNTED_BYTES_MAX]);
        Self { run, count: positions.len() as u32, bytes }
    }
}

impl PositionRun {
    /// Returns the shortest record format for some positions; stores their counts in `counts`.
    fn fitting(positions: &[DVec3], counts: &mut Vec<i64>) -> Self {
        let raw = Self { first: 0, offset_bytes: 0, record_bytes: RAW_BYTES, decimals: 0, bits: [0; 2], least: [0; 3] };
        let Some(decimals) = decimal::counts(bytemuck::cast_slice(positions), 0, counts) else { return raw };
        let (mut least, mut most) = counts.first_chunk().map_or(([0; 3], [0; 3]), |&first| (first, first));
        for count in counts.as_chunks::<3>().0 {
            for axis in 0..3 {
                least[axis] = least[axis].min(count[axis]);
                most[axis] = most[axis].max(count[axis]);
            }
        }
        let bits = [0, 1, 2].map(|axis| (64 - ((most[axis] - least[axis]) as u64).leading_zeros()) as u8);
        let record_bytes = bits.iter().map(|&bits| u32::from(bits)).sum::<u32>().div_ceil(8).max(1) as u8;
        if record_bytes as usize > COUNTED_BYTES_MAX {
            return raw;
        }
        Self { record_bytes, decimals: decimals as u8, bits: [bits[0], bits[1]], least, ..raw }
    }

    /// Reports whether the fields of a recalled run are consistent.
    fn is_sound(&self) -> bool {
        let bytes = self.record_bytes;
        let [bx, by] = self.bits.map(u32::from);
        bytes == RAW_BYTES
            || (1..=COUNTED_BYTES_MAX as u8).contains(&bytes) && bx + by <= 8 * u32::from(bytes) && bx.max(by) < 64
    }

    /// How its records are decoded; `None` if its fields are inconsistent.
    fn form(&self) -> Option<PositionForm> {
        let [bx, by] = self.bits.map(u32::from);
        let z_bits = (u32::from(self.record_bytes) * 8).checked_sub(bx + by)?.min(64);
        Some(PositionForm {
            bytes: self.record_bytes,
            shifts: [bx, bx + by],
            masks: [bx, by, z_bits].map(|bits| u64::MAX.checked_shr(64u32.saturating_sub(bits)).unwrap_or(0)),
            least: self.least,
            decimals: u32::from(self.decimals).min(decimal::DECIMALS_MAX),
        })
    }
}

/// Form of the records of a run.
struct PositionForm {
    bytes: u8,
    /// Places of the lowest bits of y and z.
    shifts: [u32; 2],
    masks: [u64; 3],
    /// Smallest count of each coordinate.
    least: [i64; 3],
    decimals: u32,
}

impl PositionForm {
    /// Decodes the record at an index; `bytes` must contain it and [`COUNTED_BYTES_MAX`] more bytes. `None` if they do
    /// not.
    #[inline]
    fn decode(&self, bytes: &[u8], index: usize) -> Option<DVec3> {
        let at = index * usize::from(self.bytes);
        if self.bytes == RAW_BYTES {
            return bytes.get(at..at + RAW_BYTES as usize).map(bytemuck::pod_read_unaligned);
        }
        let word = u128::from_le_bytes(*bytes.get(at..)?.first_chunk()?);
        let fields = match (self.shifts, word as u64) {
            // Most records are that short, and shifting words of 64 bits is cheaper.
            ([y, z], word) if self.bytes <= 8 => [word, word.wrapping_shr(y), word.wrapping_shr(z)],
            ([y, z], low) => [low, word.wrapping_shr(y) as u64, word.wrapping_shr(z) as u64],
        };
        let value = |axis: usize| {
            let count = (fields[axis] & self.masks[axis]) as i64;
            decimal::value(count.wrapping_add(self.least[axis]), self.decimals)
        };
        Some(DVec3::new(value(0), value(1), value(2)))
    }
}

/// Appends positions to a new file.
pub struct PositionRunWriter {
    file: RecordFile,
    runs: Vec<PositionRun>,
    count: u32,
}

impl PositionRunWriter {
    /// Creates the file `path`.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: &Path) -> Result<Self> {
        Ok(Self { file: RecordFile::create(path)?, runs: Vec::new(), count: 0 })
    }

    /// Number of positions so far.
    pub fn len(&self) -> u32 {
        self.count
    }

    /// Whether no position was appended yet.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Appends a run.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn append(&mut self, encoded: EncodedRun) -> Result<()> {
        if encoded.count == 0 {
            return Ok(());
        }
        let offset_bytes = self.file.put(&encoded.bytes)?;
        self.runs.push(PositionRun { first: self.count, offset_bytes, ..encoded.run });
        self.count += encoded.count;
        Ok(())
    }

    /// Writes the header, makes the file durable and opens it for reading.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish(self) -> Result<PositionRuns> {
        let path = self.file.finish(*b"places  ", 0, u64::from(self.count))?;
        Ok(PositionRuns { path, runs: self.runs, count: self.count })
    }
}

/// Positions by id.
#[derive(Debug, Serialize, Deserialize)]
pub struct PositionRuns {
    #[serde(with = "file_name")]
    path: PathBuf,
    runs: Vec<PositionRun>,
    count: u32,
}

impl PositionRuns {
    /// Number of positions.
    pub fn len(&self) -> u32 {
        self.count
    }

    /// Whether there is no position.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Sets the folder of the file of a recalled value.
    pub fn locate(&mut self, folder: &Path) {
        self.path = folder.join(&self.path);
    }

    /// Reports whether the runs of a recalled and located value are consecutive, and its file exists and is large
    /// enough.
    pub fn is_sound(&self) -> bool {
        let ends = self.runs.iter().skip(1).map(|run| run.first).chain([self.count]);
        let extents = self.runs.iter().zip(ends.clone()).map(|(run, end)| {
            (run.offset_bytes, u64::from(end.saturating_sub(run.first)) * u64::from(run.record_bytes))
        });
        self.runs.first().map_or(self.count == 0, |first| first.first == 0)
            && self.runs.iter().zip(ends).all(|(run, end)| run.is_sound() && run.first < end)
            && holds(&self.path, extents)
    }

    /// Reads the positions at ascending ids.
    ///
    /// # Errors
    /// [`Error::Damaged`] if an id is out of range or the file is too short, else [`Error::Io`].
    pub fn gather<I: Id>(&self, ids: &[I]) -> Result<Vec<DVec3>> {
        let ids = numbers(ids);
        let mut out = Vec::with_capacity(ids.len());
        let file = File::open(&self.path).map_err(|e| Error::io(&self.path, "open", e))?;
        let mut at = 0;
        while let Some(&id) = ids.get(at) {
            let next = self.runs.partition_point(|run| run.first <= id);
            let run = next.checked_sub(1).and_then(|run| self.runs.get(run));
            let run = run.filter(|_| id < self.count).ok_or_else(|| self.lacks(id))?;
            let run_end = self.runs.get(next).map_or(self.count, |next| next.first);
            let end = at + ids[at..].partition_point(|&other| other < run_end && other - id < WINDOW_RECORDS as u32);
            let last = ids[at..end].last().copied().ok_or_else(|| self.lacks(id))?;
            let bytes = (last - id + 1) as usize * run.record_bytes as usize + COUNTED_BYTES_MAX;
            let offset = run.offset_bytes + u64::from(id - run.first) * u64::from(run.record_bytes);
            let window = mmap::map_records::<u8>(&file, offset, bytes).map_err(|e| match e.kind() {
                std::io::ErrorKind::InvalidInput => self.lacks(last),
                _ => Error::io(&self.path, "map", e),
            })?;
            let form = run.form().ok_or_else(|| self.lacks(id))?;
            for &other in &ids[at..end] {
                out.push(form.decode(&window, (other - id) as usize).ok_or_else(|| self.lacks(other))?);
            }
            at = end;
        }
        Ok(out)
    }

    fn lacks(&self, id: u32) -> Error {
        Error::Damaged { path: self.path.clone(), message: format!("position {id} asked for, it holds {}", self.count) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::id::ids;
    use proptest::prelude::*;

    ids! {
        /// A position.
        PlaceInRuns;
    }

    fn come_back(runs: &[Vec<DVec3>]) -> Vec<DVec3> {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = PositionRunWriter::create(&folder.path().join("p")).unwrap();
        runs.iter().for_each(|run| writer.append(EncodedRun::new(run)).unwrap());
        let places = writer.finish().unwrap();
        let count = runs.iter().map(Vec::len).sum::<usize>() as u32;
        assert!(places.gather(&[PlaceInRuns::new(count)]).is_err());
        places.gather(&(0..count).map(PlaceInRuns::new).collect::<Vec<_>>()).unwrap()
    }

    fn bits(positions: &[DVec3]) -> Vec<[u64; 3]> {
        positions.iter().map(|position| position.to_array().map(f64::to_bits)).collect()
    }

    proptest! {
        #[test]
        fn positions_come_back_bit_for_bit(
            raw in prop::collection::vec(any::<[f64; 3]>(), 1..20),
            counted in prop::collection::vec(any::<[i32; 3]>(), 1..50),
            decimals in 0i32..8,
        ) {
            let raw: Vec<DVec3> = raw.into_iter().map(DVec3::from_array).collect();
            let counted: Vec<DVec3> =
                counted.into_iter().map(|c| DVec3::from_array(c.map(|c| f64::from(c) / 10f64.powi(decimals)))).collect();
            let all = [raw.clone(), counted.clone()].concat();
            prop_assert_eq!(bits(&come_back(&[raw, counted])), bits(&all));
        }
    }

    #[test]
    fn a_cluster_of_a_city_takes_eight_bytes_a_position() {
        let positions: Vec<DVec3> = (0..1000)
            .map(|i| DVec3::new(432_100.0, 4_581_200.0, 0.0) + f64::from(i * 7) / 1e3)
            .map(|p| (p * 1e4).round() / 1e4)
            .collect();
        let run = EncodedRun::new(&positions).run;
        assert!(run.record_bytes <= 8, "{run:?}");
        assert_eq!(bits(&come_back(std::slice::from_ref(&positions))), bits(&positions));
    }

    #[test]
    fn runs_that_overlap_or_pass_the_end_are_not_sound() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = PositionRunWriter::create(&folder.path().join("p")).unwrap();
        (0..3).for_each(|_| writer.append(EncodedRun::new(&[DVec3::X, DVec3::Y])).unwrap());
        let mut places = writer.finish().unwrap();
        assert!(places.is_sound());
        let whole = places.runs.clone();
        let changes: [fn(&mut Vec<PositionRun>); 7] = [
            Vec::clear,
            |runs| runs[0].first = 1,
            |runs| runs[1].first = 9,
            |runs| runs[1].record_bytes = 0,
            |runs| runs[1].record_bytes = 17,
            |runs| runs[1].bits = [64, 64],
            |runs| runs[2].offset_bytes = u64::MAX,
        ];
        for (i, change) in changes.iter().enumerate() {
            change(&mut places.runs);
            assert!(!places.is_sound(), "change {i}");
            places.runs.clone_from(&whole);
        }
        places.count = u32::MAX;
        assert!(!places.is_sound());
    }
}

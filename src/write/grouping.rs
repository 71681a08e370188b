//! Stable sort of small records by a key whose counts are known: in memory, or through one file if they exceed it.
//!
//! ```text
//! keys      0 0 0 1 1 2 2 2 2 2 2 2 2 2 3 4 5 5 …      counted in advance
//! buckets   |  0      |  1              |  2    …      consecutive keys that fit in memory, or one larger key
//! file      | region  | region          | region …     one region per bucket, filled through a small buffer
//! ```
//! In: records (32-bit words) with their keys, in any order. Out: the records, key by key, in order of arrival within a
//! key. Since the counts are known, a record goes straight to its slot. A key that exceeds the memory has a region of
//! its own, which is read back in order.
//!
//! # Memory
//! 8 bytes per key and at most `memory_bytes`: the records, or the buffers, or one bucket.
//!
//! # Files
//! One temporary file of key and record, 4 + 4 × `payload_words` bytes each; removed on drop.

use std::fs::{self, File, OpenOptions};
use std::marker::PhantomData;
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::base::id::{Id, TiVec};
use crate::base::{Error, Result};
use crate::os::system::{read_exact_at, write_all_at};

const BUFFER_BYTES_MIN: u64 = 4 << 10;
const BUFFER_BYTES_MAX: u64 = 256 << 10;
/// Bytes read from the file at once.
const READ_BYTES: usize = 256 << 10;

/// Records of one key.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group<'a, K> {
    /// The key.
    pub(super) key: K,
    /// Words of the records.
    pub(super) words: &'a [u32],
}

impl<'a, K: Copy> Group<'a, K> {
    /// The group in parts of at most `words` words.
    pub(super) fn chunks(self, words: usize) -> impl Iterator<Item = Self> + use<'a, K> {
        self.words.chunks(words).map(move |words| Self { words, ..self })
    }
}

/// Records being grouped by key.
#[derive(Debug)]
pub(super) struct Grouping<K> {
    payload_words: usize,
    key: PhantomData<K>,
    /// Slot of the next record of each key.
    next: Vec<u64>,
    place: GroupStorage,
}

#[derive(Debug)]
enum GroupStorage {
    Memory {
        words: Vec<u32>,
    },
    /// `most` records fit in memory.
    Disk {
        spill: Spill,
        buckets: Vec<Bucket>,
        recent: usize,
        most: u64,
    },
}

/// Consecutive keys, their slots, and records not yet written to their region.
#[derive(Debug)]
struct Bucket {
    keys: Range<u32>,
    slots: Range<u64>,
    written: u64,
    buffer: Vec<u32>,
}

impl<K: Id> Grouping<K> {
    /// Prepares for `counts[key]` records of `payload_words` words; `path` is the temporary file to use if needed.
    ///
    /// # Errors
    /// If the file is needed and cannot be created.
    pub(super) fn new(counts: TiVec<K, u64>, payload_words: usize, memory_bytes: u64, path: &Path) -> Result<Self> {
        let mut counts = counts.raw;
        let mut total = 0;
        for count in &mut counts {
            total += *count;
            *count = total - *count;
        }
        let next = counts;
        let payload_bytes = 4 * payload_words as u64;
        let place = if total * payload_bytes <= memory_bytes {
            GroupStorage::Memory { words: vec![0; total as usize * payload_words] }
        } else {
            let most = (memory_bytes / payload_bytes).max(1);
            let mut buckets = bucket_keys(&next, total, most);
            let share = memory_bytes / buckets.len().max(1) as u64;
            let buffer_words = share.clamp(BUFFER_BYTES_MIN, BUFFER_BYTES_MAX) as usize / 4;
            for bucket in &mut buckets {
                // NOTE: the last record must not exceed the capacity, or the buffer would double.
                bucket.buffer = Vec::with_capacity(buffer_words.max(payload_words + 1));
            }
            GroupStorage::Disk { spill: Spill::create(path)?, buckets, recent: 0, most }
        };
        Ok(Self { payload_words, key: PhantomData, next, place })
    }

    /// Adds a record.
    ///
    /// # Errors
    /// On a full disk, or if there are more records than counted.
    pub(super) fn push(&mut self, key: K, payload: &[u32]) -> Result<()> {
        let key = key.number();
        debug_assert_eq!(payload.len(), self.payload_words);
        match &mut self.place {
            GroupStorage::Memory { words } => {
                let slot = &mut self.next[key as usize];
                let start = *slot as usize * self.payload_words;
                let Some(place) = words.get_mut(start..start + self.payload_words) else {
                    return Err(Error::Limit("the mesh's files grew while they were read".into()));
                };
                place.copy_from_slice(payload);
                *slot += 1;
                Ok(())
            }
            GroupStorage::Disk { spill, buckets, recent, .. } => {
                if !buckets[*recent].keys.contains(&key) {
                    *recent = buckets.partition_point(|bucket| bucket.keys.end <= key);
                }
                let bucket = &mut buckets[*recent];
                if bucket.buffer.len() + payload.len() + 1 > bucket.buffer.capacity() {
                    spill.flush(bucket, self.payload_words)?;
                }
                bucket.buffer.push(key);
                bucket.buffer.extend_from_slice(payload);
                Ok(())
            }
        }
    }

    /// Passes the groups to `visit` in order of keys, several at once. A large group may come in several parts.
    ///
    /// # Errors
    /// If the file cannot be read, and those of `visit`.
    pub(super) fn drain(mut self, mut visit: impl FnMut(&[Group<'_, K>]) -> Result<()>) -> Result<()> {
        let payload_words = self.payload_words;
        match self.place {
            GroupStorage::Memory { words } => {
                let keys = 0..self.next.len() as u32;
                visit(&groups(&words, 0, keys, &self.next, payload_words))
            }
            GroupStorage::Disk { mut spill, mut buckets, most, .. } => {
                for bucket in &mut buckets {
                    spill.flush(bucket, payload_words)?;
                    bucket.buffer = Vec::new();
                    if bucket.written != bucket.slots.end - bucket.slots.start {
                        return Err(spill.damaged("fewer records came back than were counted"));
                    }
                }
                let mut words = Vec::new();
                let mut read = Vec::new();
                for bucket in buckets.iter().filter(|bucket| !bucket.slots.is_empty()) {
                    let count = bucket.slots.end - bucket.slots.start;
                    let fits = count <= most;
                    words.clear();
                    if fits {
                        words.resize(count as usize * payload_words, 0);
                    }
                    for slots in pieces_of(&bucket.slots, (READ_BYTES / 4 / (payload_words + 1)) as u64) {
                        spill.read(slots, payload_words, &mut read)?;
                        for record in read.chunks_exact(payload_words + 1) {
                            if fits {
                                let slot = &mut self.next[record[0] as usize];
                                let start = (*slot - bucket.slots.start) as usize * payload_words;
                                words[start..start + payload_words].copy_from_slice(&record[1..]);
                                *slot += 1;
                            } else {
                                words.extend_from_slice(&record[1..]);
                            }
                        }
                        let full = words.len() as u64 > most.saturating_mul(payload_words as u64) / 2;
                        if !fits && full {
                            visit(&[Group { key: K::new(bucket.keys.start), words: &words }])?;
                            words.clear();
                        }
                    }
                    if fits {
                        let first_slot = bucket.slots.start;
                        visit(&groups(&words, first_slot, bucket.keys.clone(), &self.next, payload_words))?;
                    } else if !words.is_empty() {
                        visit(&[Group { key: K::new(bucket.keys.start), words: &words }])?;
                    }
                }
                Ok(())
            }
        }
    }
}

/// Nonempty groups of `keys`; `ends` are the slots after the last one of each key.
fn groups<'a, K: Id>(
    words: &'a [u32],
    first_slot: u64,
    keys: Range<u32>,
    ends: &[u64],
    payload_words: usize,
) -> Vec<Group<'a, K>> {
    let mut start = 0;
    let mut groups = Vec::new();
    for key in keys {
        let end = (ends[key as usize] - first_slot) as usize * payload_words;
        if end > start {
            groups.push(Group { key: K::new(key), words: &words[start..end] });
            start = end;
        }
    }
    groups
}

/// Buckets of consecutive keys with at most `most` records; a larger key has a bucket of its own.
fn bucket_keys(starts: &[u64], total: u64, most: u64) -> Vec<Bucket> {
    let mut buckets: Vec<Bucket> = Vec::new();
    for (key, &start) in starts.iter().enumerate() {
        let end = starts.get(key + 1).copied().unwrap_or(total);
        let key = key as u32;
        match buckets.last_mut().filter(|bucket| end - bucket.slots.start <= most) {
            Some(bucket) => {
                bucket.keys.end = key + 1;
                bucket.slots.end = end;
            }
            None => {
                buckets.push(Bucket { keys: key..key + 1, slots: start..end, written: 0, buffer: Vec::new() });
            }
        }
    }
    buckets
}

fn pieces_of(slots: &Range<u64>, most: u64) -> impl Iterator<Item = Range<u64>> + use<> {
    let (start, end) = (slots.start, slots.end);
    (0..(end - start).div_ceil(most)).map(move |i| start + i * most..(start + (i + 1) * most).min(end))
}

/// The file of records; deleted on drop.
#[derive(Debug)]
struct Spill {
    file: File,
    path: PathBuf,
}

impl Spill {
    fn create(path: &Path) -> Result<Self> {
        // NOTE: a killed run may have left this file; only this program uses the name.
        let _ = fs::remove_file(path);
        let file = OpenOptions::new().read(true).write(true).create_new(true).open(path);
        Ok(Self { file: file.map_err(|e| Error::io(path, "create", e))?, path: path.to_owned() })
    }

    fn flush(&mut self, bucket: &mut Bucket, payload_words: usize) -> Result<()> {
        let records = (bucket.buffer.len() / (payload_words + 1)) as u64;
        if bucket.slots.start + bucket.written + records > bucket.slots.end {
            return Err(self.damaged("more records came than were counted"));
        }
        let offset = (bucket.slots.start + bucket.written) * 4 * (payload_words as u64 + 1);
        let written = write_all_at(&self.file, bytemuck::cast_slice(&bucket.buffer), offset);
        written.map_err(|e| Error::io(&self.path, "write", e))?;
        bucket.written += records;
        bucket.buffer.clear();
        Ok(())
    }

    fn read(&self, slots: Range<u64>, payload_words: usize, words: &mut Vec<u32>) -> Result<()> {
        words.resize((slots.end - slots.start) as usize * (payload_words + 1), 0);
        let offset = slots.start * 4 * (payload_words as u64 + 1);
        let read = read_exact_at(&self.file, bytemuck::cast_slice_mut(words), offset);
        read.map_err(|e| Error::io(&self.path, "read", e))
    }

    fn damaged(&self, message: &str) -> Error {
        Error::Damaged { path: self.path.clone(), message: message.into() }
    }
}

impl Drop for Spill {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::id::SharedVertex;
    use proptest::prelude::*;

    /// Keys and arrivals of records after grouping.
    fn group(keys: &[u32], key_count: usize, memory_bytes: u64) -> Vec<[u32; 2]> {
        let folder = tempfile::tempdir().unwrap();
        let mut counts: TiVec<SharedVertex, u64> = vec![0; key_count].into();
        keys.iter().for_each(|&key| counts[SharedVertex::new(key)] += 1);
        let mut grouping = Grouping::new(counts, 2, memory_bytes, &folder.path().join("spill")).unwrap();
        for (arrival, &key) in keys.iter().enumerate() {
            grouping.push(SharedVertex::new(key), &[arrival as u32, key]).unwrap();
        }
        let mut out = Vec::new();
        let visit = |groups: &[Group<'_, SharedVertex>]| {
            for Group { key, words } in groups {
                out.extend(words.chunks_exact(2).map(|record| [key.number(), record[0]]));
                assert!(words.chunks_exact(2).all(|record| record[1] == key.number()));
            }
            Ok(())
        };
        grouping.drain(visit).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn any_memory_gives_a_stable_sort(
            keys in prop::collection::vec(0u32..50, 0..3000),
            hot in prop::collection::vec(Just(7u32), 0..2000),
            memory_bytes in 0u64..30_000,
        ) {
            let keys: Vec<u32> = keys.into_iter().chain(hot).collect();
            let mut expected: Vec<[u32; 2]> = (0..).zip(&keys).map(|(i, &key)| [key, i]).collect();
            expected.sort();
            prop_assert_eq!(group(&keys, 53, memory_bytes), expected);
        }
    }

    #[test]
    fn no_record_gives_no_group() {
        assert!(group(&[], 0, 0).is_empty() && group(&[], 5, 100).is_empty());
    }
}

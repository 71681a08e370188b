//! The journal of a job: what is finished, in the order in which it was finished.
//!
//! ```text
//! header, 64 bytes │ length u32 │ its XXH3 u32 │ XXH3 u64 │ entry │ length u32 │ its XXH3 u32 │ XXH3 u64 │ entry │ …
//! ```
//! An entry is appended only after the files that it names are written, synced, renamed, and their folder is synced.
//! The header has the checksum of the job's manifest, so that no other job's journal is taken for its own. The checksums of
//! an entry and of its length (the lower half) are seeded with its position, so that it counts in its own place only; an
//! entry that was cut short is known from one whose length was damaged. What follows the first entry that is cut short or
//! damaged is cut off: the work that it told of is done again.
//!
//! An entry is handed to the system at once, so it outlives the process. It is made to outlive the power too within a
//! second, and before anything is removed on its word.

use std::fs::{File, OpenOptions};
use std::io::{BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use super::codec;
use super::header::{HEADER_BYTES, Header};
use super::stamp::Stamp;
use crate::base::{Error, Result};
use crate::os::durable::{DurableFile, no_links, sync_file};

/// Name of the journal in a work folder.
pub(super) const JOURNAL: &str = "journal.bin";

const KIND: [u8; 8] = *b"journal ";
/// Bytes before an entry: its length and the checksums of both.
const FRAME_BYTES: usize = 16;
/// A longer entry is none of ours: a hundred thousand pieces take a tenth of it.
const ENTRY_BYTES_MAX: u32 = 64 << 20;
/// Entries are synced when this much time has passed since the last time.
const SYNC_INTERVAL: Duration = Duration::from_secs(1);

/// A step of a job whose result can be kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Step {
    /// What the input holds beside geometry, and the fingerprints of its content.
    Input,
    /// The columns of the input.
    Scan,
    /// The partition of a pass.
    Cut {
        /// Number of the pass, from 0.
        pass: u32,
    },
    /// How the clusters of a pass stop.
    Plan {
        /// Number of the pass.
        pass: u32,
        /// 0, or 1 where the first plan overshot.
        attempt: u32,
    },
    /// A cluster that was simplified to see what that costs.
    Trial {
        /// Number of the pass.
        pass: u32,
        /// Number of the trial in it.
        trial: u32,
        /// The cluster.
        cluster: u32,
    },
    /// A simplified cluster.
    Cluster {
        /// Number of the pass.
        pass: u32,
        /// The plan's attempt.
        attempt: u32,
        /// The cluster.
        cluster: u32,
    },
    /// The mesh after a pass.
    Pass {
        /// Number of the pass.
        pass: u32,
    },
    /// The result, under its own name.
    Written,
    /// Numbers of the whole mesh that the metric divides by.
    Census,
    /// Where the result waits for its names.
    Output,
    /// What is kept of the input to measure the result by.
    Probes,
}

impl Step {
    /// Name of the file that holds a large value of the step.
    pub fn file_name(&self) -> String {
        self.stem() + ".state"
    }

    /// What the names of the step's own files begin with.
    pub fn stem(&self) -> String {
        match self {
            Step::Input => "scan-input".into(),
            Step::Scan => "scan-mesh".into(),
            Step::Cut { pass } => format!("pass-{pass}-cut"),
            Step::Plan { pass, attempt } => format!("pass-{pass}-plan-{attempt}"),
            Step::Trial { pass, trial, cluster } => format!("pass-{pass}-trial-{trial}-{cluster:06}"),
            Step::Cluster { pass, attempt, cluster } => format!("pass-{pass}-cluster-{attempt}-{cluster:06}"),
            Step::Pass { pass } => format!("pass-{pass}-mesh"),
            Step::Written => "write-result".into(),
            Step::Census => "pass-0-census".into(),
            Step::Output => "write-output".into(),
            Step::Probes => "pass-0-probes".into(),
        }
    }
}

impl Step {
    /// Whether the step is made of what another one has made.
    pub fn follows(&self, other: Step) -> bool {
        self.place() > other.place()
    }

    /// The pass, from 1, and the place in it.
    fn place(&self) -> (u64, u8) {
        match *self {
            Step::Input | Step::Scan | Step::Census => (0, 0),
            Step::Cut { pass } => (u64::from(pass) + 1, 0),
            Step::Plan { pass, .. } | Step::Trial { pass, .. } | Step::Cluster { pass, .. } => (u64::from(pass) + 1, 1),
            Step::Probes => (1, 1),
            Step::Pass { pass } => (u64::from(pass) + 1, 2),
            Step::Output | Step::Written => (u64::MAX, 0),
        }
    }
}

/// A finished step.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Record {
    /// The step.
    pub step: Step,
    /// How much it is: triangles of the input and of a pass, clusters of a partition, faces of a cluster.
    pub amount: u64,
    /// Seconds since 1970.
    pub time: u64,
    /// Its files.
    pub(super) files: Vec<Stamp>,
    pub(super) value: Value,
}

impl Record {
    /// Names of all files of the step that it is the record of.
    pub(super) fn names(&self, step: &Step) -> Vec<String> {
        let own = self.files.iter().map(|stamp| stamp.name().to_owned());
        own.chain([step.file_name()]).collect()
    }
}

/// Where the value of a step lies.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) enum Value {
    Here(Vec<u8>),
    InFile(Stamp),
}

/// A line of the journal.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum Entry {
    /// A process began to work.
    Began {
        /// Seconds since 1970.
        time: u64,
    },
    /// A step is finished.
    Kept(Record),
    /// A process ended early; why, in words.
    Failed {
        /// Seconds since 1970.
        time: u64,
        /// The error.
        message: String,
    },
}

/// The journal of the job at hand, open for appending.
#[derive(Debug)]
pub(super) struct Journal {
    path: PathBuf,
    file: File,
    end: u64,
    synced: Instant,
    is_dirty: bool,
}

impl Journal {
    /// Begins an empty journal for the manifest with this checksum.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(super) fn create(path: &Path, manifest: u64) -> Result<Self> {
        let header = Header { kind: KIND, record_bytes: 0, count: 0, checksum: manifest };
        let mut file = DurableFile::create(path, 64)?;
        file.write(&header.encode())?;
        file.commit()?;
        Ok(Self::open(path, manifest, true)?.0)
    }

    /// Opens a journal and cuts off what is damaged; returns the entries that are whole, the bytes that were cut off, and
    /// whether they are other damage than a kill or a power cut leaves.
    ///
    /// # Errors
    /// [`Error::Damaged`] if it is no journal, or not that of the manifest with this checksum, or, where it `must_be_whole`,
    /// if it has such damage: nothing is cut off then; else if it cannot be read.
    pub(super) fn open(path: &Path, manifest: u64, must_be_whole: bool) -> Result<(Self, Vec<Entry>, u64, bool)> {
        let Reading { entries, end, is_spoilt } = read(path, manifest)?;
        if is_spoilt && must_be_whole {
            let message = format!("the entry at byte {end} is not what was written");
            return Err(Error::Damaged { path: path.to_owned(), message });
        }
        let mut options = OpenOptions::new();
        let file = no_links(options.write(true)).open(path).map_err(|e| Error::io(path, "open", e))?;
        let mut journal = Self { path: path.to_owned(), file, end, synced: Instant::now(), is_dirty: false };
        let length = journal.file.metadata().map_err(|e| Error::io(path, "open", e))?.len();
        journal.cut()?;
        Ok((journal, entries, length.saturating_sub(end), is_spoilt))
    }

    /// Appends an entry.
    ///
    /// # Errors
    /// On a full disk or a failed write; the journal then ends before the entry.
    pub(super) fn append(&mut self, entry: &Entry) -> Result<()> {
        let damaged = |message| Error::Damaged { path: self.path.clone(), message };
        let payload = codec::encode(entry).map_err(damaged)?;
        let length = u32::try_from(payload.len()).ok().filter(|length| *length <= ENTRY_BYTES_MAX);
        let length = length.ok_or_else(|| damaged("an entry of more than 64 MiB".into()))?;
        let mut bytes = Vec::with_capacity(FRAME_BYTES + payload.len());
        bytes.extend_from_slice(&length.to_le_bytes());
        bytes.extend_from_slice(&length_checksum(length, self.end).to_le_bytes());
        bytes.extend_from_slice(&xxh3_64_with_seed(&payload, self.end).to_le_bytes());
        bytes.extend_from_slice(&payload);
        if let Err(error) = self.file.write_all(&bytes) {
            let _ = self.cut();
            return Err(Error::io(&self.path, "write", error));
        }
        self.end += bytes.len() as u64;
        self.is_dirty = true;
        if self.synced.elapsed() > SYNC_INTERVAL { self.sync() } else { Ok(()) }
    }

    /// Makes all entries durable.
    ///
    /// # Errors
    /// The system's.
    pub(super) fn sync(&mut self) -> Result<()> {
        if self.is_dirty {
            sync_file(&self.file, &self.path).map_err(|e| Error::io(&self.path, "sync", e))?;
        }
        (self.is_dirty, self.synced) = (false, Instant::now());
        Ok(())
    }

    /// Whether all entries are on the disk.
    #[cfg(test)]
    pub(super) fn is_durable(&self) -> bool {
        !self.is_dirty
    }

    /// Cuts off what lies behind the last whole entry.
    fn cut(&mut self) -> Result<()> {
        let cut = self.file.set_len(self.end).and_then(|()| self.file.seek(SeekFrom::Start(self.end)));
        cut.map(|_| ()).map_err(|e| Error::io(&self.path, "truncate", e))
    }
}

/// Checksum of an entry's length at an offset.
fn length_checksum(length: u32, at: u64) -> u32 {
    xxh3_64_with_seed(&length.to_le_bytes(), at) as u32
}

/// What a journal holds.
#[derive(Debug)]
pub(super) struct Reading {
    /// The whole entries, up to the first one that is not.
    pub(super) entries: Vec<Entry>,
    /// The offset behind the last of them.
    end: u64,
    /// Whether something else follows than an entry that is cut short, as a kill may leave it, or zeros.
    is_spoilt: bool,
}

/// Reads the journal of the manifest with this checksum; it may be written to meanwhile.
///
/// # Errors
/// [`Error::Damaged`] if it is no journal, or another job's; else if it cannot be read.
pub(super) fn read(path: &Path, manifest: u64) -> Result<Reading> {
    let wrap = |e| Error::io(path, "read", e);
    let mut options = OpenOptions::new();
    let file = no_links(options.read(true)).open(path).map_err(wrap)?;
    let meta = file.metadata().map_err(wrap)?;
    let length = meta.len();
    let mut file = BufReader::new(file);
    let mut header = [0; HEADER_BYTES as usize];
    let damaged = |message: String| Error::Damaged { path: path.to_owned(), message };
    if !meta.is_file() || length < HEADER_BYTES {
        return Err(damaged(format!("{length} bytes are no journal")));
    }
    file.read_exact(&mut header).map_err(wrap)?;
    let header = Header::decode(&header).map_err(damaged)?;
    if header.kind != KIND {
        return Err(damaged("it is no journal".into()));
    }
    if header.checksum != manifest {
        return Err(damaged("it is the journal of another job".into()));
    }
    let (mut entries, mut end, mut is_spoilt) = (Vec::new(), HEADER_BYTES, false);
    let mut payload = Vec::new();
    while length - end >= FRAME_BYTES as u64 {
        let mut frame = [0; FRAME_BYTES];
        file.read_exact(&mut frame).map_err(wrap)?;
        let [a, b, c, d, e, f, g, h, checksum @ ..] = frame;
        let [bytes, bytes_checksum] = [[a, b, c, d], [e, f, g, h]].map(u32::from_le_bytes);
        is_spoilt = bytes > ENTRY_BYTES_MAX || bytes_checksum != length_checksum(bytes, end);
        let rest = length - end - FRAME_BYTES as u64;
        if is_spoilt || u64::from(bytes) > rest {
            break;
        }
        payload.resize(bytes as usize, 0);
        file.read_exact(&mut payload).map_err(wrap)?;
        let is_whole = xxh3_64_with_seed(&payload, end) == u64::from_le_bytes(checksum);
        let Some(entry) = codec::decode(&payload).ok().filter(|_| is_whole) else {
            is_spoilt = true;
            break;
        };
        entries.push(entry);
        end += FRAME_BYTES as u64 + u64::from(bytes);
    }
    if is_spoilt {
        // Nor are zeros, which a power cut leaves where the file grew.
        file.seek(SeekFrom::Start(end)).map_err(wrap)?;
        is_spoilt = !file.bytes().all(|byte| byte.is_ok_and(|byte| byte == 0));
    }
    Ok(Reading { entries, end, is_spoilt })
}

/// Seconds since 1970.
pub(super) fn now() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn failed(message: &str) -> Entry {
        Entry::Failed { time: 7, message: message.into() }
    }

    fn messages(entries: &[Entry]) -> Vec<&str> {
        fn message(entry: &Entry) -> &str {
            match entry {
                Entry::Failed { message, .. } => message.as_str(),
                _ => "",
            }
        }
        entries.iter().map(message).collect()
    }

    #[test]
    fn entries_come_back_up_to_the_first_that_is_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal.bin");
        let mut journal = Journal::create(&path, 5).unwrap();
        for message in ["one", "two", "three"] {
            journal.append(&failed(message)).unwrap();
        }
        drop(journal);
        let whole = std::fs::read(&path).unwrap();
        let entry_bytes = (whole.len() - 64) / 3;
        for at in 64..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x10;
            std::fs::write(&path, bytes).unwrap();
            let Reading { entries, is_spoilt, .. } = read(&path, 5).unwrap();
            assert!(is_spoilt && Journal::open(&path, 5, true).is_err());
            assert!(entries.len() <= 2 && messages(&["one", "two"].map(failed)).starts_with(&messages(&entries)));
        }
        for length in 64..whole.len() {
            std::fs::write(&path, &whole[..length]).unwrap();
            let (mut journal, entries, ..) = Journal::open(&path, 5, true).unwrap();
            assert!(entries.len() <= (length - 64) / entry_bytes);
            journal.append(&failed("new")).unwrap();
            assert_eq!(messages(&read(&path, 5).unwrap().entries), [messages(&entries), vec!["new"]].concat());
        }
    }

    #[test]
    fn an_entry_does_not_count_in_another_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal.bin");
        let mut journal = Journal::create(&path, 5).unwrap();
        journal.append(&failed("old")).unwrap();
        journal.append(&failed("new")).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let half = (bytes.len() - 64) / 2;
        std::fs::write(&path, [&bytes[..64], &bytes[64 + half..], &bytes[64..64 + half]].concat()).unwrap();
        assert!(read(&path, 5).unwrap().entries.is_empty());
    }
}

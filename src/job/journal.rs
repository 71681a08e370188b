//! The journal of a job: its finished steps, in the order in which they finished.
//!
//! ```text
//! header, 64 bytes │ length u32 │ its XXH3 u32 │ XXH3 u64 │ entry │ length u32 │ its XXH3 u32 │ XXH3 u64 │ entry │ …
//! ```
//! An entry is appended only after the files that it names are written, synced and renamed, and their folder is synced.
//! The header contains the checksum of the job's manifest, so that a journal is not mistaken for that of another job.
//! The checksums of an entry and of its length (the lower half) are seeded with its offset, so that an entry is valid
//! only there, and so that a truncated entry is distinguishable from one with a damaged length. Everything from the
//! first truncated or damaged entry on is discarded; that work is recomputed.
//!
//! An entry is passed to the system at once, so it survives a kill. It is synced within a second, and before any file
//! is removed because of it, so it survives a power cut, too.

use std::fs::{File, OpenOptions};
use std::io::{BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64_with_seed;

use super::lease::LeaseFile;
use super::step::StepRecord;
use crate::base::{Error, Result};
use crate::file::codec;
use crate::file::header::{HEADER_BYTES, Header};
use crate::os::durable::{DurableFile, no_links, sync_file};

/// Name of the journal in a work folder.
pub(super) const JOURNAL: &str = "journal.bin";

const KIND: [u8; 8] = *b"journal ";
/// Bytes before an entry: its length, the checksum of the length and that of the entry.
const FRAME_BYTES: usize = 16;
/// Largest valid entry in bytes; a hundred thousand pieces take a tenth of it.
const ENTRY_BYTES_MAX: u32 = 64 << 20;
/// Entries are synced when this much time has passed since the last sync.
const SYNC_INTERVAL: Duration = Duration::from_secs(1);

/// An entry of the journal.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub enum Entry {
    /// A process started to work.
    Began {
        /// Time in seconds since 1970.
        time: u64,
    },
    /// A step is finished.
    Kept(StepRecord),
    /// Of the steps so far, only some are wanted any more: the files of others may be gone.
    Wanted {
        /// Id of the first record that comes after them.
        from: u64,
        /// Ids of their records.
        ids: Vec<u64>,
    },
    /// A process ended early.
    Failed {
        /// Time in seconds since 1970.
        time: u64,
        /// Text of the error.
        message: String,
    },
}

/// The journal of the current job, open for appending.
#[derive(Debug)]
pub(super) struct Journal {
    path: PathBuf,
    file: File,
    end: u64,
    synced: Instant,
    is_dirty: bool,
    /// The lease that must still be held for an entry to be appended.
    lease: Option<Arc<LeaseFile>>,
}

impl Journal {
    /// Creates an empty journal for the manifest with this checksum.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn create(path: &Path, manifest: u64) -> Result<Self> {
        let header = Header { kind: KIND, record_bytes: 0, count: 0, checksum: manifest };
        let mut file = DurableFile::create(path, 64)?;
        file.write(&header.encode())?;
        file.commit()?;
        Ok(Self::open(path, manifest, true)?.0)
    }

    /// Opens a journal and truncates it after the last valid entry. Returns the valid entries, the number of bytes
    /// removed, and whether these show damage that neither a kill nor a power cut causes.
    ///
    /// # Errors
    /// [`Error::Damaged`] if it is no journal or that of another manifest, or, if it `must_be_whole`, if it has such
    /// damage; nothing is truncated then. [`Error::Io`] if it cannot be read.
    pub(super) fn open(path: &Path, manifest: u64, must_be_whole: bool) -> Result<(Self, Vec<Entry>, u64, bool)> {
        let JournalContents { entries, end, is_spoilt } = read(path, manifest)?;
        if is_spoilt && must_be_whole {
            let message = format!("the entry at byte {end} is not what was written");
            return Err(Error::Damaged { path: path.to_owned(), message });
        }
        let mut options = OpenOptions::new();
        let file = no_links(options.write(true)).open(path).map_err(|e| Error::io(path, "open", e))?;
        let mut journal =
            Self { path: path.to_owned(), file, end, synced: Instant::now(), is_dirty: false, lease: None };
        let length = journal.file.metadata().map_err(|e| Error::io(path, "open", e))?.len();
        journal.cut()?;
        Ok((journal, entries, length.saturating_sub(end), is_spoilt))
    }

    /// The journal of a process that holds a lease.
    pub(super) fn under(self, lease: Arc<LeaseFile>) -> Self {
        Self { lease: Some(lease), ..self }
    }

    /// Appends an entry.
    ///
    /// # Errors
    /// Those of [`LeaseFile::confirm`]. On a full disk or a failed write; the partial entry is removed again.
    pub(super) fn append(&mut self, entry: &Entry) -> Result<()> {
        self.lease.iter().try_for_each(|lease| lease.confirm())?;
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
    /// [`Error::Io`] if the sync fails.
    pub(super) fn sync(&mut self) -> Result<()> {
        if self.is_dirty {
            sync_file(&self.file, &self.path).map_err(|e| Error::io(&self.path, "sync", e))?;
        }
        self.is_dirty = false;
        self.synced = Instant::now();
        Ok(())
    }

    /// Reports whether all entries are synced.
    #[cfg(test)]
    pub(super) fn is_durable(&self) -> bool {
        !self.is_dirty
    }

    /// Truncates the file after the last valid entry.
    fn cut(&mut self) -> Result<()> {
        let cut = self.file.set_len(self.end).and_then(|()| self.file.seek(SeekFrom::Start(self.end)));
        cut.map(|_| ()).map_err(|e| Error::io(&self.path, "truncate", e))
    }
}

/// Checksum of the length of an entry at an offset.
fn length_checksum(length: u32, at: u64) -> u32 {
    xxh3_64_with_seed(&length.to_le_bytes(), at) as u32
}

/// Contents of a journal.
#[derive(Debug)]
pub(super) struct JournalContents {
    /// The valid entries before the first invalid one.
    pub(super) entries: Vec<Entry>,
    /// Offset after the last of them.
    end: u64,
    /// Whether it continues with anything but a truncated entry, as a kill may leave it, or zeros.
    is_spoilt: bool,
}

/// Reads the journal of the manifest with this checksum; safe while another process appends to it.
///
/// # Errors
/// [`Error::Damaged`] if it is no journal or that of another job; [`Error::Io`] if it cannot be read.
pub(super) fn read(path: &Path, manifest: u64) -> Result<JournalContents> {
    let wrap = |e| Error::io(path, "read", e);
    let mut options = OpenOptions::new();
    let file = no_links(options.read(true)).open(path).map_err(wrap)?;
    let meta = file.metadata().map_err(wrap)?;
    let length = meta.len();
    let mut file = BufReader::new(file);
    let mut header = [0; HEADER_BYTES as usize];
    let damaged = |message: String| Error::Damaged { path: path.to_owned(), message };
    if !meta.is_file() || length < HEADER_BYTES {
        return Err(damaged(format!("{length} bytes are not a journal")));
    }
    file.read_exact(&mut header).map_err(wrap)?;
    let header = Header::decode(&header).map_err(damaged)?;
    if header.kind != KIND {
        return Err(damaged("it is not a journal".into()));
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
        // Zeros, which a power cut leaves where the file grew, are no damage either.
        file.seek(SeekFrom::Start(end)).map_err(wrap)?;
        is_spoilt = !file.bytes().all(|byte| byte.is_ok_and(|byte| byte == 0));
    }
    Ok(JournalContents { entries, end, is_spoilt })
}

/// Current time in seconds since 1970.
pub(super) fn now() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::os::durable::witness;

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
            let JournalContents { entries, is_spoilt, .. } = read(&path, 5).unwrap();
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

    /// A journal of manifest 5 with one entry, its path and its folder.
    fn with_one_entry() -> (tempfile::TempDir, PathBuf, Journal) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal.bin");
        let mut journal = Journal::create(&path, 5).unwrap();
        journal.append(&failed("one")).unwrap();
        (folder, path, journal)
    }

    #[test]
    fn a_journal_is_known_by_its_header() {
        let (_folder, path, journal) = with_one_entry();
        drop(journal);
        let bytes = std::fs::read(&path).unwrap();
        let (header, entries) = bytes.split_first_chunk().unwrap();
        let header = Header::decode(header).unwrap();
        assert_eq!(header, Header { kind: *b"journal ", record_bytes: 0, count: 0, checksum: 5 });
        let reads_as = |header: Header| {
            std::fs::write(&path, [&header.encode(), entries].concat()).unwrap();
            read(&path, 5).map(|contents| contents.entries.len())
        };
        assert!(matches!(reads_as(header), Ok(1)));
        assert!(matches!(reads_as(Header { kind: *b"journey ", ..header }), Err(Error::Damaged { .. })));
        assert!(matches!(reads_as(Header { checksum: 6, ..header }), Err(Error::Damaged { .. })));
    }

    #[test]
    fn entries_are_synced_when_told_to_or_after_a_second() {
        let (_folder, path, mut journal) = with_one_entry();
        let synced = [("sync", path.clone())];
        witness::take();
        journal.sync().unwrap();
        assert_eq!(witness::take(), synced);
        journal.sync().unwrap();
        assert_eq!(witness::take(), [], "nothing is new");
        journal.synced = Instant::now() - 2 * SYNC_INTERVAL;
        journal.append(&failed("two")).unwrap();
        assert!(journal.is_durable() && witness::take() == synced);
        journal.append(&failed("three")).unwrap();
        assert!(!journal.is_durable() && witness::take().is_empty());
        drop(journal);
        assert!(Journal::open(&path, 5, true).unwrap().0.is_durable());
    }

    #[test]
    fn a_journal_that_takes_no_bytes_tells_so() {
        let (_folder, path, mut journal) = with_one_entry();
        journal.file = File::open(&path).unwrap();
        assert!(journal.append(&failed("two")).is_err() && journal.cut().is_err());
        assert_eq!(messages(&read(&path, 5).unwrap().entries), ["one"]);
    }

    #[test]
    fn what_follows_the_entries_is_damage_unless_it_may_be_the_beginning_of_one() {
        let (_folder, path, journal) = with_one_entry();
        drop(journal);
        let whole = std::fs::read(&path).unwrap();
        let frame = |length: u32| {
            let checksum = length_checksum(length, whole.len() as u64);
            [&length.to_le_bytes()[..], &checksum.to_le_bytes(), &[7; 8]].concat()
        };
        let most = 64 << 20;
        for (rest, is_damage) in [
            (vec![], false),
            (vec![1; 15], false),
            (vec![1; 16], true),
            (vec![0; 40], false),
            (frame(9)[..15].to_vec(), false),
            (frame(9), false),
            (frame(most), false),
            (frame(most + 1), true),
            ([frame(9), vec![1; 8]].concat(), false),
            ([frame(9), vec![1; 9]].concat(), true),
        ] {
            std::fs::write(&path, [&whole[..], &rest].concat()).unwrap();
            let contents = read(&path, 5).unwrap();
            assert_eq!((contents.entries.len(), contents.is_spoilt), (1, is_damage), "{rest:?}");
        }
    }
}

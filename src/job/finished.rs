//! A finished step on its way into the journal.
//!
//! In: the step's value and its files, which are durable. Out: the value, durable too, and then the entry. Holds all that it
//! needs, so that it can be kept on another thread than the one that finished the step.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use serde::Serialize;
use xxhash_rust::xxh3::xxh3_64;

use super::header::Header;
use super::journal::{Entry, Journal, Record, Step, Value, now};
use super::stamp::Stamp;
use super::{codec, lock};
use crate::base::{Error, Result};
use crate::os::durable::DurableFile;

/// A larger value gets a file of its own.
const VALUE_BYTES_HERE: usize = 4 << 10;

/// A finished step on its way into the journal.
pub(super) struct Finished {
    step: Step,
    amount: u64,
    files: Vec<Stamp>,
    /// The value, and where it goes if it gets a file of its own.
    value: Vec<u8>,
    path: PathBuf,
}

impl Finished {
    /// Of files that were committed, in a work folder.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub(super) fn new<'a, T: Serialize>(
        folder: &Path,
        step: Step,
        amount: u64,
        files: impl IntoIterator<Item = &'a Path>,
        value: &T,
    ) -> Result<Self> {
        let path = folder.join(step.file_name());
        let value = codec::encode(value).map_err(|message| Error::Damaged { path: path.clone(), message })?;
        let mut paths: Vec<&Path> = files.into_iter().collect();
        paths.sort_unstable();
        paths.dedup();
        let files = paths.into_iter().map(Stamp::of).collect::<Result<_>>()?;
        Ok(Self { step, amount, files, value, path })
    }

    /// Writes the value, if it gets a file of its own, and the entry.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub(super) fn keep(self, journal: &Mutex<Option<Journal>>) -> Result<()> {
        let Self { step, amount, files, value, path } = self;
        let value = match value.len() <= VALUE_BYTES_HERE {
            true => Value::Here(value),
            false => Value::InFile(write_value(&path, &value)?),
        };
        append(journal, &Entry::Kept(Record { step, amount, time: now(), files, value }))
    }
}

/// Appends an entry to the journal, if there is one.
pub(super) fn append(journal: &Mutex<Option<Journal>>, entry: &Entry) -> Result<()> {
    lock(journal).as_mut().map_or(Ok(()), |journal| journal.append(entry))
}

/// Makes the journal durable, if there is one.
pub(super) fn sync(journal: &Mutex<Option<Journal>>) -> Result<()> {
    lock(journal).as_mut().map_or(Ok(()), Journal::sync)
}

/// Writes a value as a file of its own.
pub(super) fn write_value(path: &Path, bytes: &[u8]) -> Result<Stamp> {
    let header = Header { kind: *b"state   ", record_bytes: 0, count: 1, checksum: xxh3_64(bytes) };
    let mut file = DurableFile::create(path, 64 << 10)?;
    file.write(&header.encode())?;
    file.write(bytes)?;
    file.commit()?;
    Stamp::of(path)
}

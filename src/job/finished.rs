//! A finished step that is about to be recorded in the journal.
//!
//! In: the value of the step and its durable files. Out: the value, made durable, and then the journal entry. Owns all
//! that it needs, so that another thread can record the step.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use serde::Serialize;
use xxhash_rust::xxh3::xxh3_64;

use super::journal::{Entry, Journal, now};
use super::stamp::Stamp;
use super::step::{Step, StepRecord, Value};
use super::steps::RecordedSteps;
use crate::base::pool::{Durability, durability};
use crate::base::{Error, Result, lock};
use crate::file::codec;
use crate::file::header::Header;
use crate::os::durable::DurableFile;

/// Largest value in bytes that is stored in the entry; a larger one gets its own file.
const VALUE_BYTES_HERE: usize = 4 << 10;

/// A finished step that is about to be recorded in the journal.
pub(super) struct Finished {
    record: StepRecord,
    /// The encoded value and the path of its file, if it gets one.
    large_value: Option<(Vec<u8>, PathBuf)>,
}

impl Finished {
    /// Prepares the record of a step; `files` must be committed and lie in `folder`.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub(super) fn new<'a, T: Serialize>(
        folder: &Path,
        step: Step,
        files: impl IntoIterator<Item = &'a Path>,
        value: &T,
        steps: &Mutex<RecordedSteps>,
    ) -> Result<Self> {
        let Step { key, parents, amount, outlasts } = step;
        let path = folder.join(key.file_name());
        let value = codec::encode(value).map_err(|message| Error::Damaged { path: path.clone(), message })?;
        let mut paths: Vec<&Path> = files.into_iter().collect();
        paths.sort_unstable();
        paths.dedup();
        let files = paths.into_iter().map(Stamp::of).collect::<Result<_>>()?;
        let (here, large_value) =
            if value.len() <= VALUE_BYTES_HERE { (value, None) } else { (Vec::new(), Some((value, path))) };
        let mut steps = lock(steps);
        let (id, parents, time) = (steps.take_id(), steps.ids_of(&parents), now());
        let without = StepRecord { key, id, parents, amount, time, outlasts, files, value: Value::Here(Vec::new()) };
        steps.add(without.clone());
        Ok(Self { record: StepRecord { value: Value::Here(here), ..without }, large_value })
    }

    /// Writes the value to its own file if it is large, then appends the entry.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub(super) fn keep(self, journal: &Mutex<Option<Journal>>) -> Result<()> {
        let Self { mut record, large_value } = self;
        if let Some((value, path)) = large_value {
            record.value = Value::InFile(write_value(&path, &value)?);
        }
        append(journal, &Entry::Kept(record))
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

/// Makes the journal durable before files are removed because of it, where the job itself must outlast a power cut:
/// without the entry, steps whose files are gone are redone.
pub(super) fn sync_before_removal(journal: &Mutex<Option<Journal>>) -> Result<()> {
    if durability() == Durability::All { sync(journal) } else { Ok(()) }
}

/// Writes a value to its own file.
pub(super) fn write_value(path: &Path, bytes: &[u8]) -> Result<Stamp> {
    let header = Header { kind: *b"state   ", record_bytes: 0, count: 1, checksum: xxh3_64(bytes) };
    let mut file = DurableFile::create_shared(path, 64 << 10)?;
    file.write(&header.encode())?;
    file.write(bytes)?;
    file.commit()?;
    Stamp::of(path)
}

//! Reads files of one format: workers parse chunks, one committer appends them in order.
//!
//! Who holds what: a worker takes a ticket, then the next chunk from the cutter, so every chunk taken has a ticket and
//! gets parsed. The committer waits only for the oldest chunk. Once that is committed, it returns the ticket, which
//! carries the emptied buffers of the chunk. No worker holds the cutter while it waits for a ticket, so there is no
//! deadlock.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use crossbeam_channel::{Receiver, Sender, bounded, unbounded};

use super::builder::FinishedFile;
use super::parts::Labels;
use super::source::{CHUNK_BYTES, Cut, CutOfInput, Cutter, FileCommit, MeshSource};
use crate::base::threads::{at_least_one, start};
use crate::base::{Error, Findings, Progress, Result, lock};

/// Resources that the scan may use; they do not change the result.
#[derive(Debug, Clone, Copy)]
pub struct ScanOptions {
    /// Parsing threads; at least 1.
    pub threads: usize,
    /// Largest number of chunks that are being parsed or wait for the committer; 2 MiB each; at least 1.
    pub chunks_in_flight: usize,
    /// Memory for the catalogue in bytes; an input that needs more is refused.
    pub catalogue_bytes: u64,
}

impl Default for ScanOptions {
    /// One thread, two chunks in flight and 1 GiB for the catalogue.
    fn default() -> Self {
        Self { threads: 1, chunks_in_flight: 2, catalogue_bytes: 1 << 30 }
    }
}

/// Consecutive input files of one format, and where what they hold goes.
pub(super) struct FormatRun<'a> {
    /// The files.
    pub(super) inputs: &'a [PathBuf],
    /// Index of the first among all inputs.
    pub(super) first_index: usize,
    /// The work folder.
    pub(super) folder: &'a Path,
    /// Resources.
    pub(super) options: &'a ScanOptions,
    /// Size of a chunk.
    pub(super) chunk_bytes: u64,
    /// Receives the progress in bytes.
    pub(super) progress: &'a dyn Progress,
}

/// What a worker made of a chunk.
struct ChunkResult<S: MeshSource> {
    order: u64,
    file_index: usize,
    result: Result<(Cut<S::Chunk>, S::Parsed)>,
}

impl FormatRun<'_> {
    /// Reads the files, and passes each finished one to `keep` in order.
    ///
    /// # Errors
    /// The first fault in the order of the input; those of the file system and of `keep`.
    pub(super) fn read<S: MeshSource>(
        &self,
        labels: &mut Labels,
        findings: &mut Findings,
        keep: impl FnMut(FinishedFile),
    ) -> Result<()> {
        let tickets_in_flight = self.options.chunks_in_flight.max(1);
        let (return_ticket, tickets) = bounded(tickets_in_flight);
        for _ in 0..tickets_in_flight {
            // The channel has room for all tickets, and its other end lives in this scope.
            let _ = return_ticket.send(S::Parsed::default());
        }
        let (send_outcome, outcomes) = unbounded();
        let cutter = Mutex::new(Cutter::<S>::new(self.inputs, self.chunk_bytes));
        std::thread::scope(|scope| {
            let work_beside = |_| {
                let (tickets, send_outcome, cutter) = (tickets.clone(), send_outcome.clone(), &cutter);
                start(scope, move || work::<S>(self.inputs, cutter, &tickets, &send_outcome)).map(drop)
            };
            at_least_one((0..self.options.threads.clamp(1, tickets_in_flight)).map(work_beside))?;
            drop((tickets, send_outcome));
            self.commit_in_order::<S>(labels, findings, keep, outcomes, return_ticket)
        })
    }

    /// Commits outcomes in order. Ends at the first error; the workers then end, too, since no tickets return.
    fn commit_in_order<S: MeshSource>(
        &self,
        labels: &mut Labels,
        findings: &mut Findings,
        mut keep: impl FnMut(FinishedFile),
        outcomes: Receiver<ChunkResult<S>>,
        return_ticket: Sender<S::Parsed>,
    ) -> Result<()> {
        let mut file: Option<S::Commit<'_>> = None;
        let mut waiting: BTreeMap<u64, ChunkResult<S>> = BTreeMap::new();
        let (mut next_order, mut finished_count) = (0, 0);
        while finished_count < self.inputs.len() {
            let Ok(outcome) = outcomes.recv() else {
                return Err(Error::Limit("a worker of the scan ended early".into()));
            };
            waiting.insert(outcome.order, outcome);
            while let Some(ChunkResult { file_index, result, .. }) = waiting.remove(&next_order) {
                next_order += 1;
                let (cut, mut parsed) = result?;
                let current = match &mut file {
                    Some(file) => file,
                    None => {
                        let path = &self.inputs[file_index];
                        labels.begin_file(path);
                        file.insert(S::Commit::begin(path, self.folder, self.first_index + file_index)?)
                    }
                };
                current.append(&cut, &mut parsed, labels)?;
                self.progress.advance(cut.bytes);
                self.progress.check_stopped()?;
                if let Some(done) = file.take_if(|_| cut.is_last) {
                    keep(done.finish(labels, findings)?);
                    finished_count += 1;
                }
                S::clear(&mut parsed);
                // Fails once no worker is left, after the last chunk was taken.
                let _ = return_ticket.send(parsed);
            }
        }
        Ok(())
    }
}

/// Parses chunks until none is left or the committer has stopped.
fn work<S: MeshSource>(
    inputs: &[PathBuf],
    cutter: &Mutex<Cutter<'_, S>>,
    tickets: &Receiver<S::Parsed>,
    outcomes: &Sender<ChunkResult<S>>,
) {
    let mut text = Vec::new();
    while let Ok(mut parsed) = tickets.recv() {
        let next = lock(cutter).next();
        let Some((order, (file_index, cut))) = next else { return };
        let alarm = Alarm { order, file_index, outcomes };
        let result = parse_cut::<S>(inputs, (file_index, cut), &mut parsed, &mut text).map(|cut| (cut, parsed));
        drop(alarm);
        if outcomes.send(ChunkResult { order, file_index, result }).is_err() {
            return;
        }
        if text.capacity() > 2 * CHUNK_BYTES as usize {
            text = Vec::new();
        }
    }
}

fn parse_cut<S: MeshSource>(
    inputs: &[PathBuf],
    (file_index, cut): CutOfInput<S>,
    parsed: &mut S::Parsed,
    text: &mut Vec<u8>,
) -> Result<Cut<S::Chunk>> {
    let mut cut = cut?;
    S::parse(&inputs[file_index], &mut cut.chunk, parsed, text)?;
    Ok(cut)
}

/// Wakes the committer if a worker panics, so that the panic ends the run instead of leaving the committer waiting.
struct Alarm<'a, S: MeshSource> {
    order: u64,
    file_index: usize,
    outcomes: &'a Sender<ChunkResult<S>>,
}

impl<S: MeshSource> Drop for Alarm<'_, S> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let result = Err(Error::Limit("a worker of the scan panicked".into()));
            let _ = self.outcomes.send(ChunkResult { order: self.order, file_index: self.file_index, result });
        }
    }
}

//! Reads files of one format: workers parse chunks, the calling thread appends them in order.
//!
//! The buffers of a chunk are used again once it is appended.
//!
//! # Memory
//! Each chunk holds a permit for what it takes while it is parsed and appended: its length decides, so that chunks of
//! long lines wait for each other. They share their memory with names and materials.

use std::path::{Path, PathBuf};

use super::arrays::ArraySource;
use super::builder::FinishedFile;
use super::moved::{MovePositions, move_positions};
use super::obj::ObjSource;
use super::parts::Labels;
use super::ply::PlySource;
use super::source::{
    CHUNK_BYTES, Cut, CutOfInput, Cutter, FileCommit, MeshFormat, MeshSource, PARSED_GROWTH, TEXT_BYTES_KEPT,
};
use crate::base::error::escape_path;
use crate::base::ordered::map_in_order;
use crate::base::recycled::Recycled;
use crate::base::{Error, Findings, Permit, Permits, Progress, Result, bytes};

/// Memory that an ordinary chunk takes while it is parsed and appended, in bytes.
pub const ORDINARY_BYTES: u64 = PARSED_GROWTH * CHUNK_BYTES;

/// Resources that the scan may use; they do not change the result.
#[derive(Debug, Clone, Copy)]
pub struct ScanOptions {
    /// Parsing threads; at least 1.
    pub threads: usize,
    /// Largest number of chunks that are being parsed or wait for the committer; 2 MiB each; at least 1.
    pub chunks_in_flight: usize,
    /// Memory in bytes for the catalogue, and for chunks beyond the ordinary ones in flight; an input that needs more is
    /// refused.
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
    /// Moves the positions.
    pub(super) mover: Option<&'a dyn MovePositions>,
    /// Size of a chunk.
    pub(super) chunk_bytes: u64,
    /// Receives the progress in bytes.
    pub(super) progress: &'a dyn Progress,
}

impl FormatRun<'_> {
    /// Reads the files, which are of a format, and passes each finished one to `keep` in order.
    ///
    /// # Errors
    /// The first fault in the order of the input; those of the file system.
    pub(super) fn read_as(
        &self,
        format: MeshFormat,
        labels: &mut Labels,
        findings: &mut Findings,
        keep: impl FnMut(FinishedFile),
    ) -> Result<()> {
        match format {
            MeshFormat::Obj => self.read::<ObjSource>(labels, findings, keep),
            MeshFormat::Ply => self.read::<PlySource>(labels, findings, keep),
            MeshFormat::Arrays => self.read::<ArraySource>(labels, findings, keep),
        }
    }

    fn read<S: MeshSource>(
        &self,
        labels: &mut Labels,
        findings: &mut Findings,
        mut keep: impl FnMut(FinishedFile),
    ) -> Result<()> {
        let (buffers, texts) = (Recycled::<S::Parsed>::default(), Recycled::<Vec<u8>>::default());
        let mut file: Option<S::Commit<'_>> = None;
        let in_flight = self.options.chunks_in_flight.max(1);
        let usual_bytes = in_flight as u64 * ORDINARY_BYTES;
        let permits = Permits::new(self.options.catalogue_bytes + usual_bytes);
        map_in_order(
            Cutter::<S>::new(self.inputs, self.chunk_bytes).map(|cut| PermittedCut::<S>::new(cut, &permits)),
            self.options.threads.clamp(1, in_flight),
            in_flight,
            |PermittedCut { file_index, cut, permit }| {
                let path = &self.inputs[file_index];
                check_memory(path, &permits, permit.as_ref())?;
                let (mut cut, mut parsed, mut text) = (cut?, buffers.take(), texts.take());
                S::parse(path, &mut cut.chunk, &mut parsed, &mut text)?;
                let records = S::records(&mut parsed);
                if let Some(mover) = self.mover {
                    move_positions(records, mover, path)?;
                }
                records.pack();
                if text.capacity() <= TEXT_BYTES_KEPT {
                    texts.give_back(text);
                }
                Ok((file_index, cut, parsed, permit))
            },
            |(file_index, cut, mut parsed, permit)| {
                let current = match &mut file {
                    Some(file) => file,
                    None => {
                        let path = &self.inputs[file_index];
                        labels.begin_file(path);
                        file.insert(S::Commit::begin(path, self.folder, self.first_index + file_index)?)
                    }
                };
                labels.lend(permit.as_ref().map_or(0, Permit::bytes).saturating_sub(usual_bytes));
                current.append(&cut, &mut parsed, labels)?;
                self.progress.advance(cut.bytes);
                self.progress.check_stopped()?;
                if let Some(done) = file.take_if(|_| cut.is_last) {
                    keep(done.finish(labels, findings)?);
                }
                permits.keep(labels.taken());
                S::clear(&mut parsed);
                buffers.give_back(parsed);
                Ok(())
            },
        )
    }
}

/// A chunk with the memory that it takes.
pub(super) struct PermittedCut<'a, S: MeshSource> {
    /// Index of its file.
    pub(super) file_index: usize,
    /// The chunk.
    pub(super) cut: Result<Cut<S::Chunk>>,
    /// Dropped once the chunk is done with.
    pub(super) permit: Option<Permit<'a>>,
}

impl<'a, S: MeshSource> PermittedCut<'a, S> {
    /// Waits until there is memory for a chunk.
    pub(super) fn new((file_index, cut): CutOfInput<S>, permits: &'a Permits) -> Self {
        let permit = cut.as_ref().ok().map(|cut| permits.take(S::work_bytes(cut)));
        Self { file_index, cut, permit }
    }
}

/// Refuses a chunk that does not fit the memory beside the catalogue, even alone.
fn check_memory(path: &Path, permits: &Permits, permit: Option<&Permit<'_>>) -> Result<()> {
    let own = permit.map_or(0, Permit::bytes);
    let lacking = permits.lacking(own);
    if lacking == 0 {
        return Ok(());
    }
    let message = format!(
        "{}: a long line or record, which takes {} while it is read, does not fit beside names and materials; {} more \
         are needed",
        escape_path(path),
        bytes::display(own),
        bytes::display(lacking),
    );
    Err(Error::Budget { needed: None, message })
}

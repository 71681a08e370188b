//! Scans OBJ and MTL text into records, as a stream.
//!
//! ```text
//! files ── split into chunks ──▶ workers parse ──▶ in order ──▶ one committer appends ──▶ columns, catalogue
//!             ▲                                                          │
//!             └────────────────── a ticket per chunk in flight ◀─────────┘
//! ```
//! In: OBJ files. Out: one [`StoredPiece`](crate::model::StoredPiece) per file, and the [`Catalogue`] of everything
//! that is not geometry. Invariant: chunks depend on the files alone and are committed in order, so the result and the
//! text of any error are the same for any number of threads.
//!
//! Who holds what: a worker takes a ticket, then the next chunk from the cutter, so every chunk taken has a ticket and
//! gets parsed. The committer waits only for the oldest chunk. Once that is committed, it returns the ticket, which
//! carries the emptied buffers of the chunk. No worker holds the cutter while it waits for a ticket, so there is no
//! deadlock.
//!
//! # Memory
//! `threads` × 512 KiB of text and `chunks_in_flight` × 1.5 MiB of parsed chunks, plus the length of a line longer than
//! a chunk. No allocation is sized by a number read from a file.
//!
//! # Files
//! Those of `commit.rs`, in the work folder.

mod chunk;
mod commit;
mod count;
mod fast;
pub mod fingerprint;
mod inputs;
mod line;
mod mtl;
mod number;
mod obj;
mod parsed;
mod parts;
mod twins;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use crossbeam_channel::{Receiver, Sender, bounded, unbounded};
use xxhash_rust::xxh3::xxh3_64;

use self::chunk::{Chunk, Cutter, LINE_BYTES_MAX};
use self::commit::FileCommit;
use self::obj::LineError;
use self::parsed::ParsedChunk;
use self::parts::Labels;
use crate::base::threads::{at_least_one, start};
use crate::base::{Allowance, Error, Findings, Progress, Result};
use crate::model::{Catalogue, StoredMesh};

pub use self::chunk::CHUNK_BYTES;
pub use self::count::{Counts, count};
pub use self::inputs::{InputChoice, find_inputs, find_inputs_and_idle};
pub use self::twins::note_twin_boxes;

/// Buffers of a parsed chunk larger than this, in bytes, are freed instead of reused.
const KEPT_BYTES_MAX: usize = 4 << 20;

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

/// Result of a scan.
#[derive(Debug)]
pub struct Scan {
    /// The mesh, one piece per input file.
    pub mesh: StoredMesh,
    /// Everything that is not geometry.
    pub catalogue: Catalogue,
    /// Triangles of the input: n - 2 for each polygon of n corners, including degenerate ones.
    pub triangles: u64,
    /// What was ignored or repaired.
    pub findings: Findings,
    /// Bytes of OBJ text.
    pub input_bytes: u64,
    /// Hash of each OBJ file: XXH3 chained over the hashes of its chunks.
    pub content_hashes: Vec<u64>,
    /// Material libraries that the OBJ files name, whether they exist or not.
    pub libraries: Vec<PathBuf>,
}

/// Reads OBJ files and the MTL files that they name into columns in `folder`, which must exist.
///
/// # Errors
/// [`Error::Input`] with the first damaged line, [`Error::Limit`] if a file has more than 2³² - 2 vertices,
/// [`Error::Budget`] if names and materials exceed their memory, [`Error::Io`] or [`Error::NoSpace`] if the system
/// reports an error.
pub fn scan(inputs: &[PathBuf], folder: &Path, options: &ScanOptions, progress: &dyn Progress) -> Result<Scan> {
    scan_in_chunks(inputs, folder, options, progress, CHUNK_BYTES)
}

fn scan_in_chunks(
    inputs: &[PathBuf],
    folder: &Path,
    options: &ScanOptions,
    progress: &dyn Progress,
    chunk_bytes: u64,
) -> Result<Scan> {
    let mut input_bytes = 0;
    for path in inputs {
        input_bytes += path.metadata().map_err(|e| Error::io(path, "open", e))?.len();
    }
    progress.begin("scan", input_bytes, "B");
    let tickets_in_flight = options.chunks_in_flight.max(1);
    let (return_ticket, tickets) = bounded(tickets_in_flight);
    for _ in 0..tickets_in_flight {
        // The channel has room for all tickets, and its other end lives in this scope.
        let _ = return_ticket.send(ParsedChunk::default());
    }
    let (send_outcome, outcomes) = unbounded();
    let cutter = Mutex::new(Cutter::new(inputs, chunk_bytes));
    std::thread::scope(|scope| {
        let work_beside = |_| {
            let (tickets, send_outcome, cutter) = (tickets.clone(), send_outcome.clone(), &cutter);
            start(scope, move || work(inputs, cutter, &tickets, &send_outcome)).map(drop)
        };
        at_least_one((0..options.threads.clamp(1, tickets_in_flight)).map(work_beside))?;
        drop((tickets, send_outcome));
        let labels = Labels::new(Allowance::new(options.catalogue_bytes));
        commit_in_order(inputs, folder, labels, outcomes, return_ticket, progress)
    })
}

/// Result of a worker for one chunk.
struct ChunkResult {
    order: u64,
    result: Result<Parsed>,
}

struct Parsed {
    chunk: Chunk,
    hash: u64,
    statements: std::result::Result<ParsedChunk, LineError>,
}

/// Parses chunks until none is left or the committer has stopped.
fn work(inputs: &[PathBuf], cutter: &Mutex<Cutter>, tickets: &Receiver<ParsedChunk>, outcomes: &Sender<ChunkResult>) {
    let mut text = Vec::new();
    while let Ok(memory) = tickets.recv() {
        let next = cutter.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).next();
        let Some((order, chunk)) = next else { return };
        let alarm = Alarm { order, outcomes };
        let result = chunk.and_then(|chunk| parse_chunk(inputs, chunk, memory, &mut text));
        drop(alarm);
        if outcomes.send(ChunkResult { order, result }).is_err() {
            return;
        }
        if text.capacity() > 2 * CHUNK_BYTES as usize {
            text = Vec::new();
        }
    }
}

/// Wakes the committer if a worker panics, so that the panic ends the run instead of leaving the committer waiting.
struct Alarm<'a> {
    order: u64,
    outcomes: &'a Sender<ChunkResult>,
}

impl Drop for Alarm<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let result = Err(Error::Limit("a worker of the scan panicked".into()));
            let _ = self.outcomes.send(ChunkResult { order: self.order, result });
        }
    }
}

fn parse_chunk(inputs: &[PathBuf], chunk: Chunk, mut memory: ParsedChunk, text: &mut Vec<u8>) -> Result<Parsed> {
    let path = &inputs[chunk.file_index];
    chunk.read(path, text)?;
    let hash = xxh3_64(text);
    let is_first = chunk.start == 0;
    if let Some(format) = foreign_format(text).filter(|_| is_first) {
        return Err(Error::input(path, 1, format!("expected OBJ text, found {format}")));
    }
    let statements = if chunk.line_is_too_long {
        let line = line::count_line_ends(text) + 1;
        let message =
            format!("expected a line end within {} MiB; the file is damaged, or no OBJ", LINE_BYTES_MAX >> 20);
        Err(LineError { line, message })
    } else {
        let skipped = if is_first && text.starts_with(obj::BYTE_ORDER_MARK) { obj::BYTE_ORDER_MARK.len() } else { 0 };
        obj::parse(&text[skipped..], &mut memory).map(|()| {
            memory.pack();
            memory
        })
    };
    Ok(Parsed { chunk, hash, statements })
}

/// Returns the name of another file format if the first bytes identify one, else `None`.
fn foreign_format(text: &[u8]) -> Option<&'static str> {
    const FORMATS: &[(&[u8], &str)] = &[
        (b"\x1f\x8b", "gzip data; decompress it first"),
        (b"BZh", "bzip2 data; decompress it first"),
        (b"\xfd7zXZ", "xz data; decompress it first"),
        (b"\x28\xb5\x2f\xfd", "zstd data; decompress it first"),
        (b"PK\x03\x04", "a zip archive; extract it first"),
        (b"\xff\xfe", "UTF-16 text; convert it to UTF-8 first"),
        (b"\xfe\xff", "UTF-16 text; convert it to UTF-8 first"),
        (b"ply\n", "a PLY file"),
        (b"ply\r", "a PLY file"),
        (b"solid ", "an STL file"),
        (b"glTF", "a binary glTF file"),
        (b"Kaydara FBX", "an FBX file"),
        (b"OFF\n", "an OFF file"),
        (b"version https://git-lfs", "a Git LFS pointer; fetch the file itself first"),
    ];
    FORMATS.iter().find(|(magic, _)| text.starts_with(magic)).map(|(_, name)| *name)
}

/// Commits outcomes in order. Ends at the first error; the workers then end, too, since no tickets return.
fn commit_in_order(
    inputs: &[PathBuf],
    folder: &Path,
    mut labels: Labels,
    outcomes: Receiver<ChunkResult>,
    return_ticket: Sender<ParsedChunk>,
    progress: &dyn Progress,
) -> Result<Scan> {
    let mut mesh = StoredMesh::default();
    let mut findings = Findings::default();
    let (mut triangles, mut input_bytes, mut libraries) = (0, 0, Vec::new());
    let mut content_hashes = vec![0; inputs.len()];
    let mut file: Option<FileCommit> = None;
    let mut waiting: BTreeMap<u64, Result<Parsed>> = BTreeMap::new();
    let mut next_order = 0;
    while mesh.pieces.len() < inputs.len() {
        let Ok(ChunkResult { order, result }) = outcomes.recv() else {
            return Err(Error::Limit("a worker of the scan ended early".into()));
        };
        waiting.insert(order, result);
        while let Some(result) = waiting.remove(&next_order) {
            next_order += 1;
            let Parsed { chunk, hash, statements } = result?;
            let path = &inputs[chunk.file_index];
            let current = match &mut file {
                Some(file) => file,
                None => {
                    labels.begin_file(path);
                    file.insert(FileCommit::begin(path, folder, chunk.file_index)?)
                }
            };
            let mut parsed = statements.map_err(|error| current.error_at(error))?;
            current.append(&chunk, &mut parsed, &mut labels)?;
            let chunk_bytes = chunk.end - chunk.start;
            fingerprint::chain(&mut content_hashes[chunk.file_index], chunk_bytes, hash);
            input_bytes += chunk_bytes;
            progress.advance(chunk_bytes);
            progress.check_stopped()?;
            if let Some(done) = file.take_if(|_| chunk.is_last) {
                chunk.check_unchanged(path)?;
                let (piece, file_triangles) = done.finish(&mut labels, &mut findings, &mut libraries)?;
                mesh.pieces.push(piece);
                triangles += file_triangles;
            }
            recycle(parsed, &return_ticket);
        }
    }
    twins::note_twins(inputs, &content_hashes, &mesh, &mut findings);
    Ok(Scan { mesh, catalogue: labels.finish(), triangles, findings, input_bytes, content_hashes, libraries })
}

fn recycle(mut parsed: ParsedChunk, return_ticket: &Sender<ParsedChunk>) {
    if parsed.capacity_bytes() > KEPT_BYTES_MAX {
        parsed = ParsedChunk::default();
    }
    parsed.clear();
    // Fails once no worker is left, after the last chunk was taken.
    let _ = return_ticket.send(parsed);
}

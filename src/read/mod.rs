//! Reads meshes into records, as a stream.
//!
//! ```text
//! files ── cut into chunks ──▶ workers parse ──▶ in order ──▶ one committer appends ──▶ columns, catalogue
//!             ▲                                                          │
//!             └────────────────── a ticket per chunk in flight ◀─────────┘
//! ```
//! In: mesh files, OBJ, PLY or arrays ([`MeshFormat`]). Out: one [`StoredPiece`](crate::model::StoredPiece) per file, and the
//! [`Catalogue`] of everything that is not geometry. Invariant: chunks depend on the files alone and are committed in
//! order, so the result and the text of any error are the same for any number of threads.
//!
//! A format is a `MeshSource`: it cuts a file, parses a chunk, and appends what was parsed to the
//! columns through the `MeshBuilder` that the formats share.
//!
//! # Memory
//! `threads` × 512 KiB of text and `chunks_in_flight` × 1.5 MiB of parsed chunks; a record longer than a chunk takes a
//! permit for all that it needs. No allocation is sized by a number read from a file.
//!
//! # Files
//! Those of `builder.rs`, in the work folder.

mod alone;
mod arrays;
mod builder;
mod count;
mod file;
pub mod fingerprint;
mod flow;
mod inputs;
mod line;
mod moved;
mod number;
mod obj;
mod parts;
mod ply;
mod records;
mod source;
mod texture_sample;
mod twins;

use std::path::{Path, PathBuf};

use self::builder::FinishedFile;
use self::flow::FormatRun;
use self::parts::Labels;
use crate::base::{Allowance, Error, Findings, Progress, Result};
use crate::job::StepKey;
use crate::model::{Catalogue, StoredMesh};

pub use self::alone::{COUNT_LIMIT, ScannedFile, join};
pub use self::count::count;
pub use self::flow::{ORDINARY_BYTES, ScanOptions};
pub use self::inputs::{InputChoice, find_inputs, find_inputs_and_idle};
pub use self::moved::{MovePositions, typical_position};
pub use self::source::{CHUNK_BYTES, Counts, MeshFormat};
pub use self::texture_sample::{ShownTexture, TextureSample};
pub use self::twins::note_twin_boxes;

/// Step that records the input except its geometry, and the fingerprints of its content.
pub const INPUT: StepKey = StepKey::fixed("scan-input");
/// Step that records the columns of the input.
pub const SCAN: StepKey = StepKey::fixed("scan-mesh");

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
    /// Bytes of the input files.
    pub input_bytes: u64,
    /// Hash of each input file: XXH3 chained over the hashes of its chunks.
    pub content_hashes: Vec<u64>,
    /// Material libraries that the input files name, whether they exist or not.
    pub libraries: Vec<PathBuf>,
}

/// Reads mesh files, and the files that they name, into columns in `folder`, which must exist.
///
/// # Errors
/// [`Error::Input`] with the first fault of a file, [`Error::Limit`] if a file has more than 2³² - 2 vertices,
/// [`Error::Budget`] if names and materials exceed their memory, [`Error::Io`] or [`Error::NoSpace`] if the system
/// reports an error.
pub fn scan(inputs: &[PathBuf], folder: &Path, options: &ScanOptions, progress: &dyn Progress) -> Result<Scan> {
    scan_in_chunks(inputs, folder, options, None, progress, CHUNK_BYTES)
}

/// As [`scan`], and moves each position.
///
/// # Errors
/// Those of [`scan`]; [`Error::Input`] with the first position that has no other.
pub fn scan_moved(
    inputs: &[PathBuf],
    folder: &Path,
    options: &ScanOptions,
    mover: &dyn MovePositions,
    progress: &dyn Progress,
) -> Result<Scan> {
    scan_in_chunks(inputs, folder, options, Some(mover), progress, CHUNK_BYTES)
}

fn scan_in_chunks(
    inputs: &[PathBuf],
    folder: &Path,
    options: &ScanOptions,
    mover: Option<&dyn MovePositions>,
    progress: &dyn Progress,
    chunk_bytes: u64,
) -> Result<Scan> {
    let mut total_bytes = 0;
    for path in inputs {
        total_bytes += path.metadata().map_err(|e| Error::io(path, "open", e))?.len();
    }
    progress.begin("scan", total_bytes, "B");
    let mut labels = Labels::new(Allowance::new(options.catalogue_bytes));
    let (mut scanned, mut findings) = (Scanned::default(), Findings::default());
    for (format, range) in MeshFormat::runs(inputs)? {
        let (first_index, inputs) = (range.start, &inputs[range]);
        let run = FormatRun { inputs, first_index, folder, options, mover, chunk_bytes, progress };
        run.read_as(format, &mut labels, &mut findings, |file| scanned.keep(file))?;
    }
    scanned.findings = findings;
    Ok(scanned.finish(inputs, labels))
}

/// The files so far.
#[derive(Default)]
struct Scanned {
    mesh: StoredMesh,
    triangles: u64,
    findings: Findings,
    bytes: u64,
    content_hashes: Vec<u64>,
    libraries: Vec<PathBuf>,
}

impl Scanned {
    fn keep(&mut self, file: FinishedFile) {
        self.mesh.pieces.push(file.piece);
        self.triangles += file.triangles;
        self.bytes += file.bytes;
        self.content_hashes.push(file.content_hash);
        self.libraries.extend(file.libraries);
    }

    fn finish(self, inputs: &[PathBuf], labels: Labels) -> Scan {
        let Self { mesh, triangles, mut findings, bytes: input_bytes, content_hashes, libraries } = self;
        twins::note_twins(inputs, &content_hashes, &mesh, &mut findings);
        Scan { mesh, catalogue: labels.finish(), triangles, findings, input_bytes, content_hashes, libraries }
    }
}

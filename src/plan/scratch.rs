//! Disk space that a run needs in its work folder, from the sizes of the records that it writes.
//!
//! ```text
//! after the scan        columns: 5 B a vertex, 4.5 B a texcoord, 12 B a colour, 9.5 B a face
//! while numbering       columns + vertices by cell 6 B (18 B with colours) + positions 6 B a vertex
//! after the partition   columns + positions + faces by cell 9.5 B a face
//! at the end of pass 1  texcoords + positions + faces by cell + pieces 16 B a face that is left
//! in a later pass       pieces before + positions + faces by cell + pieces after
//! besides               the sample of a pass, 30 B a face, at most 30,000 faces
//! ```
//! Bytes were measured on 2026-11-21 on synthetic cities of 1.0 and 4.3 million triangles with four decimals and seams
//! on a fifth of the vertices: 26.9 and 27.9 bytes a triangle in all at 10 %. Positions kept as doubles take 24 bytes;
//! those of a shuffled file about 10, and 12 more for each face.

use std::path::{Path, PathBuf};

use super::memory::Sizes;
use super::passes::{self, PassForecast};
use crate::base::{Error, MemoryBudget, Result, bytes};
use crate::os::system;
use crate::partition::numbering::fit_one_window;
use crate::read::Counts;

/// Least scratch space for each byte of a mesh file, before anything has been read; measured on OBJ files, which are the
/// longest.
const SCRATCH_PER_INPUT: f64 = 0.3;
/// Bytes of a face in the scan's blocks, and in the buckets of the cells.
pub const FACE_BYTES: f64 = 9.5;
/// Bytes of a position in a column if it has four decimals, of each further decimal, and of a position kept as doubles.
const POSITION_BYTES: f64 = 5.0;
const DECIMAL_BYTES: f64 = 1.42;
const DOUBLES_BYTES: f64 = 24.0;
/// Bytes that a position takes beyond those in a column, where it is numbered and where it is stored for the clusters.
const NUMBERED_BYTES: f64 = 1.0;
/// Bytes of a texture coordinate.
const TEXCOORD_BYTES: f64 = 4.5;
/// Bytes of a colour.
pub const COLOUR_BYTES: f64 = 12.0;
/// Bytes of a rank that is looked up window by window.
pub const RANK_BYTES: f64 = 2.0;
/// Bytes of a piece for each of its faces: half a position of four decimals, two thirds of a texcoord, and the
/// face.
const PIECE_FACE_BYTES: f64 = 16.0;
/// Factor by which the pieces of a remeshed mesh are larger: its positions lie anywhere.
const REMESHED: f64 = 1.5;

/// Bytes of a face of the sample, and maximum number of its faces before the first pass.
const SAMPLE_FACE_BYTES: f64 = 30.0;
const SAMPLE_FACES: f64 = 30_000.0;

/// Sizes that the disk space of the first pass depends on.
#[derive(Debug, Clone, Copy)]
pub struct FirstPass {
    /// Bytes of the scan's columns and blocks.
    pub columns: f64,
    /// Bytes of the texture coordinates among them.
    pub texcoords: f64,
    /// Number of vertices.
    pub vertices: f64,
    /// Bytes of a position in a column.
    pub position_bytes: f64,
    /// Bytes of a colour; 0 without colours.
    pub colour_bytes: f64,
    /// Number of faces.
    pub faces: f64,
    /// Number of faces left after the pass.
    pub faces_out: f64,
    /// Bytes of the records that are looked up window by window.
    pub looked_up: f64,
}

impl FirstPass {
    /// Largest size of the work folder until the pass ends, in bytes.
    pub fn peak(&self) -> f64 {
        let places = (self.position_bytes + NUMBERED_BYTES + self.colour_bytes) * self.vertices;
        let buckets = FACE_BYTES * self.faces;
        let numbering = self.columns + 2.0 * places + self.looked_up;
        let partition = self.columns + places + buckets + self.looked_up;
        let clusters =
            self.texcoords + places + buckets + piece_bytes(self.position_bytes, self.colour_bytes) * self.faces_out;
        numbering.max(partition).max(clusters) + SAMPLE_FACE_BYTES * self.faces.min(SAMPLE_FACES)
    }
}

/// Largest size of the work folder in a later pass, in bytes, from its numbers of faces before and after and the bytes
/// of a position and of a colour.
pub fn later_pass(faces_in: f64, faces_out: f64, position_bytes: f64, colour_bytes: f64) -> f64 {
    // There is half a vertex for each face.
    let piece = piece_bytes(position_bytes, colour_bytes);
    let places = 0.5 * (position_bytes + NUMBERED_BYTES + colour_bytes);
    (piece + places + FACE_BYTES) * faces_in + piece * faces_out
}

/// Bytes of a piece for each of its faces.
fn piece_bytes(position_bytes: f64, colour_bytes: f64) -> f64 {
    PIECE_FACE_BYTES + 0.5 * (position_bytes - POSITION_BYTES + colour_bytes)
}

/// Bytes of a position with `decimals` decimals.
fn position_bytes(decimals: u32) -> f64 {
    (POSITION_BYTES + DECIMAL_BYTES * (f64::from(decimals) - 4.0)).clamp(0.5 * POSITION_BYTES, DOUBLES_BYTES)
}

/// Scratch space of a run of `passes` passes, in bytes.
pub fn forecast(counts: &Counts, sizes: &Sizes, passes: usize, budget: MemoryBudget) -> u64 {
    let passes = passes::forecast(sizes, passes);
    // Faces, weighted by the size of their pieces.
    let left = |pass: &PassForecast| pass.faces_out as f64 * if pass.is_remesh { REMESHED } else { 1.0 };
    let first_pass = passes.first().map_or(0.0, left);
    // A numbering that exceeds its share of the memory is looked up window by window.
    let windows = !fit_one_window(sizes.vertices, budget.for_work());
    let colour_bytes = if counts.has_colours { COLOUR_BYTES } else { 0.0 };
    let position = position_bytes(counts.decimals);
    let later = passes.windows(2).map(|pair| later_pass(left(&pair[0]), left(&pair[1]), position, colour_bytes));
    after_first_pass(counts, first_pass, windows).max(later.fold(0.0, f64::max) as u64)
}

/// Scratch space in bytes if the first pass leaves `faces_out` faces.
fn after_first_pass(counts: &Counts, faces_out: f64, windows: bool) -> u64 {
    let (vertices, faces) = (counts.vertices as f64, counts.triangles as f64);
    let colour_bytes = if counts.has_colours { COLOUR_BYTES } else { 0.0 };
    let texcoords = TEXCOORD_BYTES * counts.texcoords as f64;
    let position_bytes = position_bytes(counts.decimals);
    let columns = (position_bytes + colour_bytes) * vertices + texcoords + FACE_BYTES * faces;
    let looked_up = if windows { RANK_BYTES * vertices } else { 0.0 };
    let first = FirstPass { columns, texcoords, vertices, position_bytes, colour_bytes, faces, faces_out, looked_up };
    first.peak() as u64
}

/// The nearest existing folder that will contain `path`.
pub fn existing_folder(path: &Path) -> PathBuf {
    let ancestors = path.ancestors().filter(|folder| !folder.as_os_str().is_empty());
    ancestors.into_iter().find(|folder| folder.is_dir()).unwrap_or(Path::new(".")).to_owned()
}

/// Refuses, from the files' sizes alone, a job for which the work folder's disk is too small; the folder has `held`
/// bytes already.
///
/// # Errors
/// [`Error::NoSpace`] with the space needed, the space free and the way out.
pub fn refuse_small_disk(input_bytes: u64, held: u64, work: &Path) -> Result<()> {
    let needed = (input_bytes as f64 * SCRATCH_PER_INPUT) as u64;
    refuse_less_than(needed.saturating_sub(held), work)
}

/// Refuses a work folder on a disk with fewer than `needed` bytes free.
///
/// # Errors
/// As [`refuse_small_disk`].
pub fn refuse_less_than(needed: u64, work: &Path) -> Result<()> {
    let folder = existing_folder(work);
    let Ok(free) = system::free_disk_bytes(&folder) else { return Ok(()) };
    refuse_disk(&folder, needed, free)
}

/// Refuses a disk with fewer bytes `free` than `needed`.
///
/// # Errors
/// As [`refuse_small_disk`].
pub fn refuse_disk(folder: &Path, needed: u64, free: u64) -> Result<()> {
    if free >= needed {
        return Ok(());
    }
    let (needed, free) = (bytes::display(needed), bytes::display(free));
    let message = format!("about {needed} of scratch space are needed, {free} are free; `work` takes another disk");
    Err(Error::NoSpace { path: folder.to_owned(), message })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_forecast_is_what_was_measured_on_a_city() {
        let counts =
            Counts { vertices: 497_406, texcoords: 606_761, triangles: 993_860, decimals: 4, ..Counts::default() };
        let measured = 26_711_313.0;
        let predicted = after_first_pass(&counts, 467_976.0, false) as f64;
        assert!((predicted / measured - 1.0).abs() < 0.05, "{predicted}");
    }

    #[test]
    fn a_disk_without_room_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let refused = refuse_less_than(1 << 60, &folder.path().join("a/b"));
        assert!(matches!(refused, Err(Error::NoSpace { .. })));
        refuse_less_than(1, folder.path()).unwrap();
    }
}

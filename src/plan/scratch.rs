//! How much disk space a run needs in its work folder, from the bytes of the records that it writes.
//!
//! ```text
//! after the scan        columns: 24 B a vertex, 16 B a texcoord, 12 B a colour, 9.5 B a face
//! while numbering       + vertices by cell 28 B (40 B with colours) + positions in cell order 24 B a vertex
//! at the end of pass 1  + positions in cell order 24 B a vertex, faces by cell 9.4 B a face,
//!                         pieces 33.3 B a face that is left
//! ```
//! Bytes of faces and pieces were measured on 2026-11-21 on synthetic cities of 1.0 and 4.3 million triangles with
//! seams on a fifth of the vertices: 67.8 and 67.4 bytes a triangle in all at 10 %. A shuffled file takes more.

use std::path::{Path, PathBuf};

use super::memory::Sizes;
use super::passes;
use crate::base::{Error, MemoryBudget, Result, bytes};
use crate::os::system;
use crate::partition::numbering::{COLOURED_RECORD_BYTES, PLAIN_RECORD_BYTES, window_bytes};
use crate::scan::Counts;

/// Scratch space for each byte of OBJ text, before anything has been read; measured on photogrammetry.
const SCRATCH_PER_INPUT: f64 = 1.6;
/// Bytes of a face in the scan's blocks, and in the buckets of the cells.
const FACE_BYTES: f64 = 9.5;
/// Bytes of a piece for each of its faces: half a position, two thirds of a texcoord, and the face.
const PIECE_FACE_BYTES: f64 = 33.3;

/// Scratch space in bytes of a run of so many passes.
pub fn forecast(counts: &Counts, sizes: &Sizes, passes: usize, budget: MemoryBudget) -> u64 {
    let passes = passes::forecast(sizes, passes);
    let first_pass = passes.first().map_or(0, |pass| pass.faces_out);
    // A numbering that is larger than its share of the memory is looked up window by window.
    let windows = 4 * sizes.vertices > window_bytes(budget.for_work());
    after_first_pass(counts, first_pass, windows)
}

/// Scratch space in bytes if the first pass leaves so many faces.
fn after_first_pass(counts: &Counts, first_pass: u64, windows: bool) -> u64 {
    let (vertices, faces) = (counts.vertices, counts.triangles as f64);
    let colour = if counts.has_colours { 12 * vertices } else { 0 };
    let columns = 24 * vertices + 16 * counts.texcoords + colour + (FACE_BYTES * faces) as u64;
    let ordered = 24 * vertices + colour;
    let looked_up = if windows { 12 * counts.triangles + 8 * vertices } else { 0 };
    let record = if counts.has_colours { COLOURED_RECORD_BYTES } else { PLAIN_RECORD_BYTES };
    let numbering = record * vertices;
    let clusters = (FACE_BYTES * faces + PIECE_FACE_BYTES * first_pass as f64) as u64;
    columns + ordered + looked_up + numbering.max(clusters)
}

/// The folder that exists already and will hold `path`.
pub fn existing_folder(path: &Path) -> PathBuf {
    let ancestors = path.ancestors().filter(|folder| !folder.as_os_str().is_empty());
    ancestors.into_iter().find(|folder| folder.is_dir()).unwrap_or(Path::new(".")).to_owned()
}

/// Refuses, from the files' sizes alone, a job for which the work folder's disk is too small; the folder holds `held`
/// bytes already.
///
/// # Errors
/// [`Error::NoSpace`] saying what is needed, what is free and the way out.
pub fn refuse_small_disk(input_bytes: u64, held: u64, work: &Path) -> Result<()> {
    let needed = (input_bytes as f64 * SCRATCH_PER_INPUT) as u64;
    refuse_less_than(needed.saturating_sub(held), work)
}

/// Refuses a work folder on a disk with less than `needed` bytes.
///
/// # Errors
/// As [`refuse_small_disk`].
pub fn refuse_less_than(needed: u64, work: &Path) -> Result<()> {
    let folder = existing_folder(work);
    let Ok(free) = system::free_disk_bytes(&folder) else { return Ok(()) };
    refuse_disk(&folder, needed, free)
}

/// Refuses a disk on which fewer bytes are free than needed.
///
/// # Errors
/// As [`refuse_small_disk`].
pub fn refuse_disk(folder: &Path, needed: u64, free: u64) -> Result<()> {
    if free >= needed {
        return Ok(());
    }
    let (needed, free) = (bytes::display(needed), bytes::display(free));
    let message = format!("about {needed} of scratch space are needed, {free} are free; --work DIR takes another disk");
    Err(Error::NoSpace { path: folder.to_owned(), message })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_forecast_is_what_was_measured_on_a_city() {
        let counts = Counts { vertices: 497_406, texcoords: 606_761, triangles: 993_860, ..Counts::default() };
        let measured = 67_383_670.0;
        let predicted = after_first_pass(&counts, 450_574, false) as f64;
        assert!((predicted / measured - 1.0).abs() < 0.03, "{predicted}");
    }

    #[test]
    fn a_disk_without_room_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let refused = refuse_less_than(1 << 60, &folder.path().join("a/b"));
        assert!(matches!(refused, Err(Error::NoSpace { .. })));
        refuse_less_than(1, folder.path()).unwrap();
    }
}

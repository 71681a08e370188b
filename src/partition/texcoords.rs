//! Copies texture coordinates to the cells, if those of a cell are scattered over the file.
//!
//! ```text
//! each cell     ids that its faces refer to, ascending      ──▶ questions, by window of ids
//! each window   its texture coordinates, its questions      ──▶ answers, by cell, in the order of the ids
//! ```
//! Every file is read and written sequentially. If the file is in the order of an exporter, each cluster reads its few
//! stretches from the mesh instead, which is faster and has the same result.
//!
//! # Memory
//! The ids of a cell in each thread, one window ([`window_bytes`], as for the ranks of vertices), and 24 MiB of
//! buffers.
//!
//! # Files
//! `<name>-questions.buckets` (2 to 4 bytes per id of each cell) until they are answered, `<name>-texcoords.buckets` (5
//! bytes each) until the partition is removed.

use std::ops::Range;

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::faces::CellFaces;
use super::file_names::FileNames;
use super::numbering::window_bytes;
use super::options::PartitionOptions;
use super::texcoord_ids::texcoord_ids;
use crate::base::Result;
use crate::base::ordered::map_in_order;
use crate::file::buckets::{BucketWriter, Buckets};
use crate::model::StoredMesh;

/// Bytes of a texture coordinate.
const TEXCOORD_BYTES: u64 = 16;
/// Texture coordinates decoded at once.
const STEP: u64 = 1 << 16;

/// Texture coordinates of each cell, in order of their ids.
#[derive(Debug, Serialize, Deserialize)]
pub struct CellTexcoords {
    pub(super) answers: Buckets<DVec2>,
}

impl CellTexcoords {
    /// Returns the texture coordinates of a cell.
    ///
    /// # Errors
    /// On failed reads.
    pub fn read(&self, cell: usize) -> Result<Vec<DVec2>> {
        let mut texcoords = Vec::with_capacity(self.answers.len(cell) as usize);
        self.answers.read(cell, |answers| {
            texcoords.extend_from_slice(answers);
            Ok(())
        })?;
        Ok(texcoords)
    }
}

/// Copies the texture coordinates to the cells.
///
/// # Errors
/// On a full disk, failed reads and writes.
pub(super) fn bring(
    mesh: &StoredMesh,
    faces: &CellFaces,
    names: FileNames<'_>,
    options: &PartitionOptions,
) -> Result<CellTexcoords> {
    let cell_count = faces.foreign_corners.len();
    let count = mesh.texcoord_count();
    let window_len = (window_bytes(options.work_bytes) / TEXCOORD_BYTES).max(1 << 16) as u32;
    let windows = count.div_ceil(u64::from(window_len)).max(1) as usize;
    let mut questions = BucketWriter::create(&names.path("questions.buckets"), windows)?;
    map_in_order(
        0..cell_count,
        options.threads,
        options.threads + 1,
        |cell| Ok((cell as u32, texcoord_ids(&faces.by_cell.to_vec(1, cell)?))),
        |(cell, ids)| ids.into_iter().try_for_each(|id| questions.push(id / window_len, [cell, id])),
    )?;
    let questions: Buckets<[u32; 2]> = questions.finish()?;
    let mut answers = BucketWriter::create(&names.path("texcoords.buckets"), cell_count)?;
    for window in 0..windows {
        let start = window as u32 * window_len;
        let texcoords = texcoords_in(mesh, u64::from(start)..(u64::from(start) + u64::from(window_len)).min(count))?;
        questions.read(window, |questions| {
            let answer = |&[cell, id]: &[u32; 2]| (cell, texcoords[(id - start) as usize]);
            questions.iter().map(answer).try_for_each(|(cell, uv)| answers.push(cell, uv))
        })?;
    }
    Ok(CellTexcoords { answers: answers.finish_durable()? })
}

/// Returns the texture coordinates of a range of ids.
fn texcoords_in(mesh: &StoredMesh, ids: Range<u64>) -> Result<Vec<DVec2>> {
    let mut texcoords = Vec::with_capacity((ids.end - ids.start) as usize);
    let mut base = 0;
    for piece in &mesh.pieces {
        let end = base + piece.texcoords.len();
        let (mut at, last) = (ids.start.max(base), ids.end.min(end));
        while at < last {
            let next = (at + STEP).min(last);
            texcoords.append(&mut piece.texcoords.window(at - base..next - base)?);
            at = next;
        }
        base = end;
    }
    Ok(texcoords)
}

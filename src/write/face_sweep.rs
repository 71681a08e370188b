//! Reads the faces of a mesh block by block, on all threads.

use crate::base::Result;
use crate::base::ordered::map_within;
use crate::model::corners::FaceReader;
use crate::model::id::PieceVertex;
use crate::model::stored_mesh::PieceNumbering;
use crate::model::{Face, StoredMesh, StoredPiece};

/// Faces of a piece that follow one another.
pub(super) struct FaceRun<'a> {
    /// The piece.
    pub(super) piece: &'a StoredPiece,
    /// Its ids in the mesh.
    pub(super) ids: &'a PieceNumbering,
    /// The faces, at most [`BLOCK_FACES`](crate::model::face::BLOCK_FACES).
    pub(super) faces: &'a [Face<PieceVertex>],
}

/// Maps the faces of a mesh, block by block; `commit` gets the results in order. A result takes `result_bytes` of memory;
/// all together take at most `memory_bytes`.
///
/// # Errors
/// If a file cannot be read, and those of `work` and `commit`.
pub(super) fn map_faces<R: Send>(
    mesh: &StoredMesh,
    numbering: &[PieceNumbering],
    memory_bytes: u64,
    result_bytes: u64,
    work: impl Fn(FaceRun<'_>) -> Result<R> + Sync,
    commit: impl FnMut(R) -> Result<()>,
) -> Result<()> {
    let blocks = mesh.pieces.iter().zip(numbering);
    let blocks = blocks.flat_map(|(piece, ids)| piece.faces.blocks().iter().map(move |block| (piece, ids, block)));
    map_within(
        memory_bytes,
        |_| FaceReader::MEMORY_BYTES + result_bytes,
        blocks,
        |(piece, ids, block)| {
            let (mut bytes, mut faces) = (Vec::new(), Vec::new());
            piece.faces.read_block(&piece.faces.open()?, block, &mut bytes, &mut faces)?;
            work(FaceRun { piece, ids, faces: &faces })
        },
        commit,
    )
}

//! The faces of a piece in memory: block by block, or all of them with the positions of their corners.
//!
//! # Memory
//! A block: [`FaceReader::MEMORY_BYTES`]. A piece: 12 bytes a face and 24 an own vertex.

use glam::DVec3;

use super::face::{BLOCK_FACES, Face};
use super::mesh::{StoredMesh, StoredPiece};
use crate::base::Result;

/// Reads the faces of pieces, block by block, with scratch space that is kept.
#[derive(Debug, Default)]
pub struct FaceReader {
    bytes: Vec<u8>,
    faces: Vec<Face>,
}

impl FaceReader {
    /// Bytes of one reader: a block of faces, decoded and encoded.
    pub const MEMORY_BYTES: u64 = (BLOCK_FACES * (size_of::<Face>() + 12)) as u64;

    /// Hands the faces of a piece to `visit`, a block at a time and in order.
    ///
    /// # Errors
    /// If the file cannot be read, and those of `visit`.
    pub fn each_block(&mut self, piece: &StoredPiece, mut visit: impl FnMut(&[Face]) -> Result<()>) -> Result<()> {
        if piece.faces.is_empty() {
            return Ok(());
        }
        let file = piece.faces.open()?;
        for block in piece.faces.blocks() {
            piece.faces.read_block(&file, block, &mut self.bytes, &mut self.faces)?;
            visit(&self.faces)?;
        }
        Ok(())
    }
}

/// The vertices of a piece's faces, with the positions that they need.
#[derive(Debug)]
pub struct PieceCorners {
    /// Number of the piece's own vertices.
    pub own: u32,
    /// The vertex of each corner, by the piece's ids.
    pub vertices: Vec<u32>,
    own_positions: Vec<DVec3>,
    /// The shared vertices that occur, in order of their ids.
    pub shared: Vec<u32>,
    shared_positions: Vec<DVec3>,
}

impl PieceCorners {
    /// Reads a piece: all its faces, or only those with a shared vertex.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn read(mesh: &StoredMesh, piece: &StoredPiece, only_at_shared: bool) -> Result<Self> {
        let own = piece.positions.len() as u32;
        let mut vertices = Vec::with_capacity(if only_at_shared { 0 } else { 3 * piece.faces.len() as usize });
        let mut shared = Vec::new();
        FaceReader::default().each_block(piece, |faces| {
            for face in faces {
                let before = shared.len();
                shared.extend(face.vertices.into_iter().filter(|&v| v >= own).map(|v| v - own));
                if !only_at_shared || shared.len() > before {
                    vertices.extend_from_slice(&face.vertices);
                }
            }
            Ok(())
        })?;
        shared.sort_unstable();
        shared.dedup();
        let mut shared_positions = Vec::new();
        if let Some(column) = &mesh.shared_positions {
            shared_positions = column.gather(&shared)?;
        }
        let own_positions = piece.positions.window(0..piece.positions.len())?;
        Ok(Self { own, vertices, own_positions, shared, shared_positions })
    }

    /// Where a vertex lies.
    pub fn position(&self, vertex: u32) -> DVec3 {
        match vertex.checked_sub(self.own) {
            None => self.own_positions[vertex as usize],
            Some(shared) => self.shared_positions[self.shared.partition_point(|&v| v < shared)],
        }
    }
}

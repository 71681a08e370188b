//! Reads the faces of a piece: block by block, or all of them with the positions of their corners.
//!
//! # Memory
//! A block: [`FaceReader::MEMORY_BYTES`]. A piece: 12 bytes per face and 24 per own vertex.

use glam::DVec3;

use super::face::{BLOCK_FACES, Face};
use super::id::{PieceVertex, SharedVertex};
use super::stored_mesh::{StoredMesh, StoredPiece};
use crate::base::Result;
use crate::base::id::TiVec;

/// Reads the faces of pieces block by block, with reused scratch buffers.
#[derive(Debug, Default)]
pub struct FaceReader {
    bytes: Vec<u8>,
    faces: Vec<Face<PieceVertex>>,
}

impl FaceReader {
    /// Memory of a reader in bytes: a block of faces, decoded and encoded.
    pub const MEMORY_BYTES: u64 = (BLOCK_FACES * (size_of::<Face<PieceVertex>>() + 12)) as u64;

    /// Passes the faces of a piece to `visit`, block by block, in order.
    ///
    /// # Errors
    /// If the file cannot be read, and those of `visit`.
    pub fn each_block(
        &mut self,
        piece: &StoredPiece,
        mut visit: impl FnMut(&[Face<PieceVertex>]) -> Result<()>,
    ) -> Result<()> {
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

/// Vertices of the faces of a piece, with their positions.
#[derive(Debug)]
pub struct PieceCorners {
    /// Number of own vertices of the piece.
    pub own: u32,
    /// Vertices of each face.
    pub faces: Vec<[PieceVertex; 3]>,
    own_positions: TiVec<PieceVertex, DVec3>,
    /// Shared vertices that occur, ascending.
    pub shared: Vec<SharedVertex>,
    shared_positions: Vec<DVec3>,
}

impl PieceCorners {
    /// Reads all faces of a piece, or only those with a shared vertex.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn read(mesh: &StoredMesh, piece: &StoredPiece, only_at_shared: bool) -> Result<Self> {
        let own = piece.positions.len() as u32;
        let mut faces = Vec::with_capacity(if only_at_shared { 0 } else { piece.faces.len() as usize });
        let mut shared = Vec::new();
        FaceReader::default().each_block(piece, |block| {
            for face in block {
                let before = shared.len();
                shared.extend(face.vertices.into_iter().filter_map(|vertex| vertex.shared(own)));
                if !only_at_shared || shared.len() > before {
                    faces.push(face.vertices);
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
        let own_positions = piece.positions.window(0..piece.positions.len())?.into();
        Ok(Self { own, faces, own_positions, shared, shared_positions })
    }

    /// Position of a vertex.
    pub fn position(&self, vertex: PieceVertex) -> DVec3 {
        match vertex.shared(self.own) {
            None => self.own_positions[vertex],
            Some(shared) => self.shared_positions[self.place(shared)],
        }
    }

    /// Place in [`shared`](PieceCorners::shared) of a vertex that occurs.
    pub fn place(&self, vertex: SharedVertex) -> usize {
        self.shared.partition_point(|&other| other < vertex)
    }
}

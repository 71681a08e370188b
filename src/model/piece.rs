//! Stores pieces of a mesh in a file: positions, colours, texture coordinates and faces of each after one header.
//!
//! ```text
//! 0        64            96
//! | header | four counts | colours 12 B | positions, in blocks | texcoords, in blocks | faces, in blocks | next piece …
//! ```
//! A piece begins at a multiple of 64 bytes. The count in the header is the number of faces; its checksum covers
//! everything after it.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};

use super::face::{BLOCK_FACES, Face, encode_block};
use super::face_blocks::FaceBlocks;
use super::id::PieceVertex;
use super::stored_mesh::StoredPiece;
use crate::base::Result;
use crate::file::RecordFile;
use crate::file::column::Segment;
use crate::file::packed::{PackedBlocks, PackedColumn};
use crate::os::durable::DurableFile;

/// Pieces begin at multiples of this number of bytes.
const PIECE_ALIGNMENT: u64 = 64;

/// A piece that is written but not durable yet.
#[derive(Debug)]
pub struct PendingPiece {
    file: DurableFile,
    piece: StoredPiece,
}

impl PendingPiece {
    /// Makes the file durable, renames it to its final name and opens it. Blocks on the disk.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn commit(self) -> Result<StoredPiece> {
        self.file.commit()?;
        Ok(self.piece)
    }
}

/// Writes a file of one piece; [`commit`](PendingPiece::commit) makes it durable.
///
/// # Errors
/// On a full disk or a failed write.
pub fn write_piece(
    path: &Path,
    positions: &[DVec3],
    texcoords: &[DVec2],
    colours: Option<&[[f32; 3]]>,
    faces: &[Face<PieceVertex>],
) -> Result<PendingPiece> {
    let mut file = PieceFile { file: RecordFile::create(path)?, path: path.to_owned(), faces: 0 };
    let piece = file.put(positions, texcoords, colours, faces)?;
    Ok(PendingPiece { file: file.seal()?, piece })
}

/// A file of pieces, being written.
pub struct PieceFile {
    file: RecordFile,
    /// Where the pieces are read.
    path: PathBuf,
    faces: u64,
}

impl PieceFile {
    /// Begins a file at `place`, whose pieces will be read at `path`.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(place: &Path, path: PathBuf) -> Result<Self> {
        Ok(Self { file: RecordFile::create(place)?, path, faces: 0 })
    }

    /// Appends a piece.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn put(
        &mut self,
        positions: &[DVec3],
        texcoords: &[DVec2],
        colours: Option<&[[f32; 3]]>,
        faces: &[Face<PieceVertex>],
    ) -> Result<StoredPiece> {
        let Self { file, path, .. } = self;
        let end = file.put(&[])?;
        file.put(&[0; PIECE_ALIGNMENT as usize][..(end.next_multiple_of(PIECE_ALIGNMENT) - end) as usize])?;
        let piece = put_piece(file, path, positions, texcoords, colours, faces)?;
        self.faces += faces.len() as u64;
        Ok(piece)
    }

    /// Writes the header; committing the file gives it its name.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn seal(self) -> Result<DurableFile> {
        self.file.seal(*b"piece   ", 0, self.faces)
    }
}

fn put_piece(
    file: &mut RecordFile,
    path: &Path,
    positions: &[DVec3],
    texcoords: &[DVec2],
    colours: Option<&[[f32; 3]]>,
    faces: &[Face<PieceVertex>],
) -> Result<StoredPiece> {
    let colour_slice = colours.unwrap_or(&[]);
    let counts = [positions.len(), texcoords.len(), colour_slice.len(), faces.len()].map(|n| n as u64);
    file.put(bytemuck::cast_slice(&counts))?;
    let colours_at = file.put(bytemuck::cast_slice(colour_slice))?;
    let (positions, texcoords) = (PackedBlocks::new(positions), PackedBlocks::new(texcoords));
    let positions_at = file.put(positions.bytes())?;
    let texcoords_at = file.put(texcoords.bytes())?;
    let mut blocks = Vec::new();
    let mut bytes = Vec::new();
    for chunk in faces.chunks(BLOCK_FACES) {
        bytes.clear();
        let mut block = encode_block(chunk, &mut bytes);
        block.offset_bytes = file.put(&bytes)?;
        blocks.push(block);
    }
    Ok(StoredPiece {
        positions: PackedColumn::new(path.to_owned(), positions_at, &positions),
        colours: colours.map(|_| Segment::new(path.to_owned(), colours_at, counts[2])),
        texcoords: PackedColumn::new(path.to_owned(), texcoords_at, &texcoords),
        faces: FaceBlocks::new(path.to_owned(), blocks),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::header::HEADER_BYTES;
    use crate::file::header::checked_header;
    use crate::model::id::{PartId, PieceTexcoord};

    #[test]
    fn a_piece_comes_back_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let positions = [DVec3::new(1.0, 2.0, 3.0), DVec3::X, DVec3::Y];
        let texcoords = [DVec2::new(0.5, 0.25)];
        let colours = [[0.1, 0.2, 0.3]; 3];
        let (first, none) = (PieceTexcoord::new(0), PieceTexcoord::NONE);
        let vertices = [0, 1, 2].map(PieceVertex::new);
        let face = Face { vertices, texcoords: [first, none, first], part: PartId::new(7), ..Face::default() };
        let path = folder.path().join("a.piece");
        let piece = write_piece(&path, &positions, &texcoords, Some(&colours), &[face]).unwrap().commit().unwrap();
        assert_eq!(&*piece.positions.window(0..3).unwrap(), &positions);
        assert_eq!(&*piece.texcoords.window(0..1).unwrap(), &texcoords);
        assert_eq!(&*piece.colours.unwrap().window(0..3).unwrap(), &colours);
        let mut faces = Vec::new();
        let file = piece.faces.open().unwrap();
        piece.faces.read_block(&file, &piece.faces.blocks()[0], &mut Vec::new(), &mut faces).unwrap();
        assert_eq!(faces, [face]);
        assert_eq!(checked_header(&path).count, 1);
        // The counts come first, so that an empty section is distinguishable from the next one.
        let counts = &std::fs::read(&path).unwrap()[HEADER_BYTES as usize..][..32];
        assert_eq!(bytemuck::pod_collect_to_vec::<u8, u64>(counts), [3, 1, 3, 1]);
    }
}

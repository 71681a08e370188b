//! Stores faces in a file of blocks. A block holds up to [`BLOCK_FACES`] faces and is decoded on its own.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::face::{BLOCK_FACES, FACE_BYTES_MAX, Face, FaceBlock, encode_block};
use super::id::PieceVertex;
use crate::base::{Error, Result};
use crate::file::RecordFile;
use crate::file::name::{file_name, holds};
use crate::os::system::read_exact_at;

/// Faces of a file, block by block.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FaceBlocks {
    #[serde(with = "file_name")]
    path: Arc<Path>,
    blocks: Vec<FaceBlock>,
    count: u64,
    /// Part that the file calls 0.
    first_part: u32,
}

impl FaceBlocks {
    /// Creates the value from the blocks of a file, with their offsets in it.
    pub fn new(path: PathBuf, blocks: Vec<FaceBlock>) -> Self {
        let count = blocks.iter().map(|block| u64::from(block.faces)).sum();
        Self { path: path.into(), blocks, count, first_part: 0 }
    }

    /// From now on, the parts of the faces are by this number higher than in the file.
    pub fn raise_parts(&mut self, first_part: u32) {
        self.first_part = first_part;
    }

    /// Number of faces.
    pub fn len(&self) -> u64 {
        self.count
    }

    /// Whether there is no face.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Sets the folder of the file of a recalled value.
    pub fn locate(&mut self, folder: &Path) {
        self.path = folder.join(&self.path).into();
    }

    /// Reports whether the blocks of a recalled and located value add up, and its file exists and is large enough.
    pub fn is_sound(&self) -> bool {
        self.blocks.iter().all(|block| block.faces <= block.bytes && block.faces as usize <= BLOCK_FACES)
            && self.blocks.iter().map(|block| u64::from(block.faces)).sum::<u64>() == self.count
            && holds(&self.path, self.blocks.iter().map(|block| (block.offset_bytes, u64::from(block.bytes))))
    }

    /// Locations of the blocks, in order.
    pub fn blocks(&self) -> &[FaceBlock] {
        &self.blocks
    }

    /// Opens the file for [`read_block`](FaceBlocks::read_block).
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be opened.
    pub fn open(&self) -> Result<File> {
        File::open(&self.path).map_err(|e| Error::io(&self.path, "open", e))
    }

    /// Replaces `out` with the faces of a block; `bytes` is scratch space.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the block does not decode, else [`Error::Io`].
    pub fn read_block(
        &self,
        file: &File,
        block: &FaceBlock,
        bytes: &mut Vec<u8>,
        out: &mut Vec<Face<PieceVertex>>,
    ) -> Result<()> {
        if block.bytes as usize > BLOCK_FACES * FACE_BYTES_MAX {
            return Err(self.damaged(format!("a block of {} bytes", block.bytes)));
        }
        bytes.resize(block.bytes as usize, 0);
        read_exact_at(file, bytes, block.offset_bytes).map_err(|e| Error::io(&self.path, "read", e))?;
        out.clear();
        block.decode(bytes, out).map_err(|message| self.damaged(message))?;
        if self.first_part > 0 {
            out.iter_mut().for_each(|face| face.part = face.part.plus(self.first_part));
        }
        Ok(())
    }

    fn damaged(&self, message: String) -> Error {
        Error::Damaged { path: self.path.to_path_buf(), message }
    }
}

/// Appends faces to a new file of blocks.
pub struct FaceWriter {
    file: RecordFile,
    pending: Vec<Face<PieceVertex>>,
    blocks: Vec<FaceBlock>,
    bytes: Vec<u8>,
    count: u64,
}

impl FaceWriter {
    /// Creates the file `path`.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn create(path: &Path) -> Result<Self> {
        Ok(Self {
            file: RecordFile::create(path)?,
            pending: Vec::with_capacity(BLOCK_FACES),
            blocks: Vec::new(),
            bytes: Vec::new(),
            count: 0,
        })
    }

    /// Number of faces so far.
    pub fn len(&self) -> u64 {
        self.count
    }

    /// Whether no face was appended yet.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Appends faces.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn append(&mut self, mut faces: &[Face<PieceVertex>]) -> Result<()> {
        self.count += faces.len() as u64;
        while let Some(first) = faces.first() {
            if self.pending.len() == BLOCK_FACES {
                self.flush(first.continues_polygon)?;
            }
            let (now, later) = faces.split_at(faces.len().min(BLOCK_FACES - self.pending.len()));
            self.pending.extend_from_slice(now);
            faces = later;
        }
        Ok(())
    }

    /// Writes a block. A polygon that continues beyond it moves to the next block, so that a reader of a block sees
    /// where its polygons begin.
    fn flush(&mut self, polygon_goes_on: bool) -> Result<()> {
        let begins = self.pending.iter().rposition(|face| !face.continues_polygon).unwrap_or(0);
        let cut = if polygon_goes_on && begins > 0 { begins } else { self.pending.len() };
        let rest = self.pending.split_off(cut);
        self.bytes.clear();
        let mut block = encode_block(&self.pending, &mut self.bytes);
        block.offset_bytes = self.file.put(&self.bytes)?;
        self.blocks.push(block);
        self.pending = rest;
        Ok(())
    }

    /// Writes the header, makes the file durable and opens it for reading.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish(mut self) -> Result<FaceBlocks> {
        if !self.pending.is_empty() {
            self.flush(false)?;
        }
        let path = self.file.finish(*b"faces   ", 0, self.count)?;
        Ok(FaceBlocks::new(path, self.blocks))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::header::checked_header;

    #[test]
    fn a_polygon_never_begins_at_the_last_face_of_a_block() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = FaceWriter::create(&folder.path().join("f")).unwrap();
        let vertices = [0, 1, 2].map(PieceVertex::new);
        let face = |continues_polygon| Face { vertices, continues_polygon, ..Face::default() };
        writer.append(&vec![face(false); BLOCK_FACES]).unwrap();
        writer.append(&vec![face(true); BLOCK_FACES + 5]).unwrap();
        let faces = writer.finish().unwrap();
        let counts: Vec<_> = faces.blocks().iter().map(|block| block.faces as usize).collect();
        assert_eq!(counts, [BLOCK_FACES - 1, BLOCK_FACES, 6]);
        assert_eq!(checked_header(&folder.path().join("f")).count, 2 * BLOCK_FACES as u64 + 5);
        let empty = FaceWriter::create(&folder.path().join("e")).unwrap().finish().unwrap();
        assert!(empty.blocks().is_empty() && checked_header(&folder.path().join("e")).count == 0);
    }

    #[test]
    fn blocks_that_do_not_add_up_or_pass_the_end_are_not_sound() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = FaceWriter::create(&folder.path().join("f")).unwrap();
        writer.append(&[Face { vertices: [0, 1, 2].map(PieceVertex::new), ..Face::default() }; 100]).unwrap();
        let whole = writer.finish().unwrap();
        assert!(whole.is_sound());
        let changes: [fn(&mut FaceBlocks); 5] = [
            |faces| faces.count = 1 << 61,
            |faces| faces.blocks.clear(),
            |faces| faces.blocks[0].faces = 0,
            |faces| faces.blocks[0].bytes += 1,
            |faces| faces.blocks[0].offset_bytes = u64::MAX,
        ];
        for (i, change) in changes.iter().enumerate() {
            let mut changed = whole.clone();
            change(&mut changed);
            assert!(!changed.is_sound(), "change {i}");
        }
    }
}

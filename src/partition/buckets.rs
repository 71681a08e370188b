//! Faces by cell, in one file: each cell's faces lie in blocks that are spread over the file.

use std::fs::File;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::Xxh3;

use crate::base::{Error, Result};
use crate::job::header::{HEADER_BYTES, Header};
use crate::os::durable::DurableFile;
use crate::os::system::read_exact_at;
use crate::store::Face;
use crate::store::column::file_name;
use crate::store::face::{BLOCK_FACES, FaceBlock, encode_block};

/// Bytes of all buffers together.
const BUFFERS_BYTES: usize = 16 << 20;

/// Faces on their way to a cell.
#[derive(Debug)]
pub struct EncodedFaces {
    bytes: Vec<u8>,
    block: FaceBlock,
}

impl EncodedFaces {
    /// Encodes at most [`BLOCK_FACES`] faces.
    pub fn new(faces: &[Face]) -> Self {
        let mut bytes = Vec::new();
        let block = encode_block(faces, &mut bytes);
        Self { bytes, block }
    }
}

/// Collects faces by cell.
pub struct BucketWriter {
    file: DurableFile,
    pending: Vec<Vec<Face>>,
    blocks: Vec<Vec<FaceBlock>>,
    block_faces: usize,
    bytes: Vec<u8>,
    offset_bytes: u64,
    count: u64,
    hash: Xxh3,
}

impl BucketWriter {
    /// Begins a file for `cell_count` cells.
    ///
    /// # Errors
    /// If the file cannot be made.
    pub fn create(path: &Path, cell_count: usize) -> Result<Self> {
        let mut file = DurableFile::create(path, 256 << 10)?;
        file.write(&[0; HEADER_BYTES as usize])?;
        let block_faces = (BUFFERS_BYTES / size_of::<Face>() / cell_count.max(1)).clamp(64, BLOCK_FACES);
        Ok(Self {
            file,
            pending: vec![Vec::new(); cell_count],
            blocks: vec![Vec::new(); cell_count],
            block_faces,
            bytes: Vec::new(),
            offset_bytes: HEADER_BYTES,
            count: 0,
            hash: Xxh3::new(),
        })
    }

    /// Adds a face to a cell.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    #[inline]
    pub fn push(&mut self, cell: u32, face: Face) -> Result<()> {
        let pending = &mut self.pending[cell as usize];
        pending.push(face);
        if pending.len() >= self.block_faces { self.flush(cell as usize) } else { Ok(()) }
    }

    /// Adds faces that were encoded elsewhere to a cell, behind those that are there.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn append(&mut self, cell: u32, encoded: EncodedFaces) -> Result<()> {
        if !self.pending[cell as usize].is_empty() {
            self.flush(cell as usize)?;
        }
        self.write(cell as usize, &encoded.bytes, encoded.block)
    }

    fn flush(&mut self, cell: usize) -> Result<()> {
        let mut bytes = std::mem::take(&mut self.bytes);
        bytes.clear();
        let block = encode_block(&self.pending[cell], &mut bytes);
        self.pending[cell].clear();
        self.write(cell, &bytes, block)?;
        self.bytes = bytes;
        Ok(())
    }

    fn write(&mut self, cell: usize, bytes: &[u8], block: FaceBlock) -> Result<()> {
        self.count += u64::from(block.faces);
        self.blocks[cell].push(FaceBlock { offset_bytes: self.offset_bytes, ..block });
        self.offset_bytes += bytes.len() as u64;
        self.hash.update(bytes);
        self.file.write(bytes)
    }

    /// Writes what is pending, makes the file durable and opens it for reading.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish(mut self) -> Result<Buckets> {
        for cell in 0..self.pending.len() {
            if !self.pending[cell].is_empty() {
                self.flush(cell)?;
            }
        }
        let header = Header { kind: *b"buckets ", record_bytes: 0, count: self.count, checksum: self.hash.digest() };
        self.file.write_at(0, &header.encode())?;
        let path = self.file.target().to_owned();
        self.file.commit()?;
        Ok(Buckets { path, blocks: self.blocks })
    }
}

/// Faces by cell.
#[derive(Debug, Serialize, Deserialize)]
pub struct Buckets {
    #[serde(with = "file_name")]
    path: PathBuf,
    blocks: Vec<Vec<FaceBlock>>,
}

impl Buckets {
    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Says in which folder the file lies, after the value was read back.
    pub fn locate(&mut self, folder: &Path) {
        self.path = folder.join(&self.path);
    }

    /// Number of faces of a cell.
    pub fn len(&self, cell: usize) -> u64 {
        self.blocks[cell].iter().map(|block| u64::from(block.faces)).sum()
    }

    /// All faces of a cell, in the order in which they were pushed.
    ///
    /// # Errors
    /// On failed reads and damaged blocks.
    pub fn read(&self, cell: usize) -> Result<Vec<Face>> {
        self.read_one_in(1, cell)
    }

    /// The faces of the first block of each `step` blocks of a cell.
    ///
    /// # Errors
    /// On failed reads and damaged blocks.
    pub fn read_one_in(&self, step: usize, cell: usize) -> Result<Vec<Face>> {
        let blocks = || self.blocks[cell].iter().step_by(step);
        let mut faces = Vec::with_capacity(blocks().map(|block| block.faces as usize).sum());
        self.read_each(blocks(), |block| {
            faces.extend_from_slice(block);
            Ok(true)
        })?;
        Ok(faces)
    }

    /// Hands the faces of a cell to `take`, block after block, in the order in which they were pushed, until `take`
    /// has enough and says `false`.
    ///
    /// # Errors
    /// On failed reads and damaged blocks, and what `take` returns.
    pub fn read_blocks(&self, cell: usize, take: impl FnMut(&[Face]) -> Result<bool>) -> Result<()> {
        self.read_each(self.blocks[cell].iter(), take)
    }

    fn read_each<'a>(
        &self,
        blocks: impl Iterator<Item = &'a FaceBlock>,
        mut take: impl FnMut(&[Face]) -> Result<bool>,
    ) -> Result<()> {
        let file = File::open(&self.path).map_err(|e| Error::io(&self.path, "open", e))?;
        let (mut bytes, mut faces) = (Vec::new(), Vec::new());
        for block in blocks {
            bytes.resize(block.bytes as usize, 0);
            read_exact_at(&file, &mut bytes, block.offset_bytes).map_err(|e| Error::io(&self.path, "read", e))?;
            faces.clear();
            block.decode(&bytes, &mut faces).map_err(|message| Error::Damaged { path: self.path.clone(), message })?;
            if !take(&faces)? {
                break;
            }
        }
        Ok(())
    }
}

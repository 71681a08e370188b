//! Faces in compressed blocks: differences of ids as variable-length integers.
//!
//! A block holds up to [`BLOCK_FACES`] faces and stands alone. Each face is a tag byte and up to seven varints:
//!
//! ```text
//! tag bit 0  the part differs from the previous face's: zigzag(part - previous part) follows
//!     bit 1  the face continues the polygon of the previous face
//!     bit 2  no corner has a texture coordinate (else 3 values follow the vertices)
//!     bit 3  the face deviates from the input: its deviation (32-bit float) follows at the end
//! vertices   zigzag(v0 - previous v0), zigzag(v1 - v0), zigzag(v2 - v1)
//! texcoords  the same of id + 1, so that 0 stands for "none"
//! ```
//! An exporter's order takes 8-11 bytes a face instead of 28; a shuffled one about as many as raw ids.

use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

use super::column::file_name;
use super::varint::{self, unzigzag, zigzag};
use crate::base::{Error, Result};
use crate::job::header::{HEADER_BYTES, Header};
use crate::os::durable::DurableFile;
use crate::os::system::read_exact_at;

/// Stands for a corner without texture coordinate.
pub const NO_TEXCOORD: u32 = u32::MAX;
/// Faces of a block, at most; a polygon may cross blocks.
pub const BLOCK_FACES: usize = 16 << 10;
/// Faces for which room is made at once while encoding.
const ENCODED_AT_ONCE: usize = 256;
/// Bytes of a face in the worst case: a tag, seven varints of up to 5 bytes and a float.
const FACE_BYTES_MAX: usize = 1 + 7 * 5 + 4;

/// A triangle by ids; corners counter-clockwise as in the input.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Face {
    /// Vertex of each corner.
    pub vertices: [u32; 3],
    /// Texture coordinate of each corner, or [`NO_TEXCOORD`].
    pub texcoords: [u32; 3],
    /// Index of the part (file, object, group, material) in the catalogue.
    pub part: u32,
    /// Whether this is a further fan triangle of the same polygon as the face before it.
    ///
    /// A polygon c0 c1 … cn-1 is stored as the fan (c0 c1 c2), (c0 c2 c3), … until its positions are at hand and it
    /// can be triangulated properly.
    pub continues_polygon: bool,
    /// Bound on the distance between this face and what it stands for in the input, in units of length; kept only
    /// where the error is bounded.
    pub deviation: f32,
}

/// Where a block of faces lies, and which ids it names.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FaceBlock {
    /// Position of its first byte in the file.
    pub offset_bytes: u64,
    /// Length in bytes.
    pub bytes: u32,
    /// Number of faces.
    pub faces: u32,
    /// Vertex ids that occur lie in this range.
    pub vertices: Range<u32>,
    /// Texture coordinate ids that occur lie in this range; empty if there are none.
    pub texcoords: Range<u32>,
    /// XXH3 of its bytes.
    pub checksum: u64,
}

impl FaceBlock {
    /// Decodes the block's bytes to the end of `out`, if they are those that were written: their ids choose places in
    /// memory.
    ///
    /// # Errors
    /// Says in words what is wrong.
    pub fn decode(&self, bytes: &[u8], out: &mut Vec<Face>) -> std::result::Result<(), String> {
        match xxh3_64(bytes) == self.checksum {
            true => decode_block(bytes, self.faces as usize, out),
            false => Err("the checksum of a block of faces differs from what was written".into()),
        }
    }
}

/// Encodes faces (at most [`BLOCK_FACES`]) at the end of `out`; the block's offset is left at 0.
pub fn encode_block(faces: &[Face], out: &mut Vec<u8>) -> FaceBlock {
    let start = out.len();
    let mut at = start;
    let mut ids = IdRanges::default();
    let (mut last_vertex, mut last_texcoord, mut last_part) = (0u32, 0u32, 0u32);
    for chunk in faces.chunks(ENCODED_AT_ONCE) {
        out.resize(at + chunk.len() * FACE_BYTES_MAX, 0);
        for face in chunk {
            ids.see(face);
            let bare = face.texcoords == [NO_TEXCOORD; 3];
            let part_differs = face.part != last_part;
            let deviates = face.deviation != 0.0;
            let shape = u8::from(face.continues_polygon) << 1 | u8::from(bare) << 2;
            out[at] = u8::from(part_differs) | shape | u8::from(deviates) << 3;
            at += 1;
            if part_differs {
                at = put_difference(out, at, face.part, last_part);
                last_part = face.part;
            }
            let [v0, v1, v2] = face.vertices;
            at = put_difference(out, at, v0, last_vertex);
            at = put_difference(out, at, v1, v0);
            at = put_difference(out, at, v2, v1);
            last_vertex = v0;
            if !bare {
                let [t0, t1, t2] = face.texcoords.map(|t| t.wrapping_add(1));
                at = put_difference(out, at, t0, last_texcoord);
                at = put_difference(out, at, t1, t0);
                at = put_difference(out, at, t2, t1);
                last_texcoord = t0;
            }
            if deviates {
                out[at..at + 4].copy_from_slice(&face.deviation.to_le_bytes());
                at += 4;
            }
        }
    }
    out.truncate(at);
    FaceBlock {
        offset_bytes: 0,
        bytes: (at - start) as u32,
        faces: faces.len() as u32,
        vertices: ids.vertices(),
        texcoords: ids.texcoords(),
        checksum: xxh3_64(&out[start..at]),
    }
}

/// Decodes a block of `count` faces to the end of `out`.
///
/// # Errors
/// Says in words where the bytes make no sense.
fn decode_block(bytes: &[u8], count: usize, out: &mut Vec<Face>) -> std::result::Result<(), String> {
    if count > BLOCK_FACES {
        return Err(format!("a block of {count} faces; at most {BLOCK_FACES} are written"));
    }
    out.reserve(count);
    let mut at = 0;
    let (mut last_vertex, mut last_texcoord, mut part) = (0u32, 0u32, 0u32);
    for _ in 0..count {
        let tag = *bytes.get(at).ok_or("a block of faces ends early")?;
        at += 1;
        if tag & 1 != 0 {
            part = get_difference(bytes, &mut at, part)?;
        }
        let v0 = get_difference(bytes, &mut at, last_vertex)?;
        let v1 = get_difference(bytes, &mut at, v0)?;
        let v2 = get_difference(bytes, &mut at, v1)?;
        last_vertex = v0;
        let mut texcoords = [NO_TEXCOORD; 3];
        if tag & 4 == 0 {
            let t0 = get_difference(bytes, &mut at, last_texcoord)?;
            let t1 = get_difference(bytes, &mut at, t0)?;
            let t2 = get_difference(bytes, &mut at, t1)?;
            last_texcoord = t0;
            texcoords = [t0, t1, t2].map(|t| t.wrapping_sub(1));
        }
        let mut deviation = 0.0;
        if tag & 8 != 0 {
            let float = bytes.get(at..).and_then(|rest| rest.first_chunk());
            deviation = f32::from_le_bytes(*float.ok_or("a block of faces ends inside a deviation")?);
            at += 4;
        }
        out.push(Face { vertices: [v0, v1, v2], texcoords, part, continues_polygon: tag & 2 != 0, deviation });
    }
    if at == bytes.len() { Ok(()) } else { Err(format!("{} bytes are left after a block of faces", bytes.len() - at)) }
}

/// Writes the difference of two ids, by the shorter way round.
#[inline]
fn put_difference(out: &mut [u8], at: usize, value: u32, from: u32) -> usize {
    let difference = value.wrapping_sub(from) as i32;
    varint::put(out, at, zigzag(i64::from(difference)))
}

#[inline]
fn get_difference(bytes: &[u8], at: &mut usize, from: u32) -> std::result::Result<u32, &'static str> {
    let number = varint::take(bytes, at).ok_or("a block of faces ends inside a number")?;
    let number = u32::try_from(number).map_err(|_| "a number in a block of faces is too large")?;
    Ok(from.wrapping_add(unzigzag(u64::from(number)) as u32))
}

#[derive(Debug)]
struct IdRanges {
    vertex: (u32, u32),
    texcoord: (u32, u32),
}

impl Default for IdRanges {
    fn default() -> Self {
        Self { vertex: (u32::MAX, 0), texcoord: (u32::MAX, 0) }
    }
}

impl IdRanges {
    fn see(&mut self, face: &Face) {
        for v in face.vertices {
            self.vertex = (self.vertex.0.min(v), self.vertex.1.max(v));
        }
        for t in face.texcoords.into_iter().filter(|&t| t != NO_TEXCOORD) {
            self.texcoord = (self.texcoord.0.min(t), self.texcoord.1.max(t));
        }
    }

    fn vertices(&self) -> Range<u32> {
        range_of(self.vertex)
    }

    fn texcoords(&self) -> Range<u32> {
        range_of(self.texcoord)
    }
}

fn range_of((low, high): (u32, u32)) -> Range<u32> {
    if low > high { 0..0 } else { low..high.saturating_add(1) }
}

/// Faces of a file, block by block.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FaceBlocks {
    #[serde(with = "file_name")]
    path: Arc<Path>,
    blocks: Vec<FaceBlock>,
    count: u64,
}

impl FaceBlocks {
    /// The blocks of a file, whose offsets are those in the file.
    pub fn new(path: PathBuf, blocks: Vec<FaceBlock>) -> Self {
        let count = blocks.iter().map(|block| u64::from(block.faces)).sum();
        Self { path: path.into(), blocks, count }
    }

    /// Number of faces.
    pub fn len(&self) -> u64 {
        self.count
    }

    /// Whether there is no face.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Says in which folder the file lies, after the value was read back.
    pub fn locate(&mut self, folder: &Path) {
        self.path = folder.join(&self.path).into();
    }

    /// Where the blocks lie, in order.
    pub fn blocks(&self) -> &[FaceBlock] {
        &self.blocks
    }

    /// Opens the file for [`read_block`](FaceBlocks::read_block).
    ///
    /// # Errors
    /// The system's.
    pub fn open(&self) -> Result<File> {
        File::open(&self.path).map_err(|e| Error::io(&self.path, "open", e))
    }

    /// Replaces `out` by the faces of a block; `bytes` is scratch space.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the block does not decode, else [`Error::Io`].
    pub fn read_block(&self, file: &File, block: &FaceBlock, bytes: &mut Vec<u8>, out: &mut Vec<Face>) -> Result<()> {
        if block.bytes as usize > BLOCK_FACES * FACE_BYTES_MAX {
            return Err(self.damaged(format!("a block of {} bytes", block.bytes)));
        }
        bytes.resize(block.bytes as usize, 0);
        read_exact_at(file, bytes, block.offset_bytes).map_err(|e| Error::io(&self.path, "read", e))?;
        out.clear();
        block.decode(bytes, out).map_err(|message| self.damaged(message))
    }

    fn damaged(&self, message: String) -> Error {
        Error::Damaged { path: self.path.to_path_buf(), message }
    }
}

/// Appends faces to a new file of blocks.
pub struct FaceWriter {
    file: DurableFile,
    pending: Vec<Face>,
    blocks: Vec<FaceBlock>,
    bytes: Vec<u8>,
    offset_bytes: u64,
    count: u64,
    hash: Xxh3,
}

impl FaceWriter {
    /// Begins the file `path`.
    ///
    /// # Errors
    /// If the file cannot be made.
    pub fn create(path: &Path) -> Result<Self> {
        let mut file = DurableFile::create(path, 256 << 10)?;
        file.write(&[0; HEADER_BYTES as usize])?;
        Ok(Self {
            file,
            pending: Vec::with_capacity(BLOCK_FACES),
            blocks: Vec::new(),
            bytes: Vec::new(),
            offset_bytes: HEADER_BYTES,
            count: 0,
            hash: Xxh3::new(),
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
    pub fn append(&mut self, mut faces: &[Face]) -> Result<()> {
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

    /// Writes a block. A polygon that goes on beyond it begins a block of its own, so that whoever reads a face also
    /// sees whether it begins a polygon.
    fn flush(&mut self, polygon_goes_on: bool) -> Result<()> {
        let begins = self.pending.iter().rposition(|face| !face.continues_polygon).unwrap_or(0);
        let cut = if polygon_goes_on && begins > 0 { begins } else { self.pending.len() };
        let rest = self.pending.split_off(cut);
        self.bytes.clear();
        let mut block = encode_block(&self.pending, &mut self.bytes);
        block.offset_bytes = self.offset_bytes;
        self.offset_bytes += u64::from(block.bytes);
        self.blocks.push(block);
        self.pending = rest;
        self.hash.update(&self.bytes);
        self.file.write(&self.bytes)
    }

    /// Writes the header, makes the file durable and opens it for reading.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish(mut self) -> Result<FaceBlocks> {
        if !self.pending.is_empty() {
            self.flush(false)?;
        }
        let header = Header { kind: *b"faces   ", record_bytes: 0, count: self.count, checksum: self.hash.digest() };
        self.file.write_at(0, &header.encode())?;
        let path = self.file.target().to_owned();
        self.file.commit()?;
        Ok(FaceBlocks::new(path, self.blocks))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn faces_come_back_as_they_were(raw in prop::collection::vec(any::<([u32; 3], [u32; 3], u32, bool, bool, u16)>(), 0..200)) {
            let faces: Vec<Face> = raw
                .into_iter()
                .map(|(vertices, texcoords, part, continues_polygon, bare, deviation)| Face {
                    vertices,
                    texcoords: if bare { [NO_TEXCOORD; 3] } else { texcoords },
                    part,
                    continues_polygon,
                    deviation: f32::from(deviation % 3),
                })
                .collect();
            let mut bytes = Vec::new();
            encode_block(&faces, &mut bytes);
            let mut back = Vec::new();
            decode_block(&bytes, faces.len(), &mut back).unwrap();
            prop_assert_eq!(back, faces);
        }

        #[test]
        fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), count in 0usize..100) {
            let _ = decode_block(&bytes, count, &mut Vec::new());
        }
    }

    #[test]
    fn a_polygon_never_begins_at_the_last_face_of_a_block() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = FaceWriter::create(&folder.path().join("f")).unwrap();
        let face =
            |continues_polygon| Face { vertices: [0, 1, 2], texcoords: [3; 3], continues_polygon, ..Face::default() };
        writer.append(&vec![face(false); BLOCK_FACES]).unwrap();
        writer.append(&vec![face(true); BLOCK_FACES + 5]).unwrap();
        let faces = writer.finish().unwrap();
        let counts: Vec<_> = faces.blocks().iter().map(|block| block.faces as usize).collect();
        assert_eq!(counts, [BLOCK_FACES - 1, BLOCK_FACES, 6]);
    }

    #[test]
    fn an_exporters_order_takes_few_bytes() {
        let faces: Vec<Face> = (0..1000)
            .map(|i| Face { vertices: [i, i + 1, i + 40], texcoords: [i, i + 1, i + 45], part: 3, ..Face::default() })
            .collect();
        let mut bytes = Vec::new();
        let block = encode_block(&faces, &mut bytes);
        assert!(bytes.len() < 9 * faces.len());
        assert_eq!((block.vertices, block.texcoords), (0..1039 + 1, 0..1044 + 1));
    }
}

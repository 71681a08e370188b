//! Faces, and their encoding in blocks: differences of ids in one to four bytes each, preceded by a tag with their
//! sizes.
//!
//! ```text
//! tag        16 bits, little-endian
//!     bit 0  the part differs from the previous face's: its index (4 bytes) follows
//!     bit 1  the face continues the polygon of the previous face
//!     bit 2  no corner has a texture coordinate (else 3 values follow the vertices)
//!     bit 3  the face deviates from the input: its deviation (32-bit float) follows at the end
//!     bits 4-15  bytes of each of the six values, less one: two bits each, those of the first value lowest
//! vertices   zigzag(v0 - previous v0), zigzag(v1 - v0), zigzag(v2 - v1)
//! texcoords  the same of id + 1, so that 0 stands for "none"
//! ```
//! In the order of an exporter a face takes 8-11 bytes instead of 28; in a shuffled order about as many as raw ids.
//! Since sizes are known in advance, a value is decoded without a branch: a face is read in a third of the time that
//! bytes with a continuation bit take.
//!
//! # Source
//! Sizes are stored apart from values as in Lemire, Kurz, Rupp 2018 ("Stream VByte"), but per face, so that blocks are
//! written in one sweep.

use std::ops::Range;

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use super::id::{FaceVertex, PartId, PieceTexcoord, PieceVertex};
use crate::base::id::Id;
use crate::file::record::Record;

/// Polygons with more corners are split into triangles on reading, because triangulation needs a whole polygon in
/// memory.
pub const POLYGON_CORNERS_MAX: usize = 512;
/// Largest number of faces in a block; a polygon may cross blocks.
pub const BLOCK_FACES: usize = 16 << 10;

/// A triangle by ids; corners counter-clockwise as in the input.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Face<V: FaceVertex> {
    /// Vertex of each corner.
    pub vertices: [V; 3],
    /// Texture coordinate of each corner, or [`Id::NONE`].
    pub texcoords: [V::Texcoord; 3],
    /// Its part of the catalogue.
    pub part: PartId,
    /// Whether this is a further fan triangle of the polygon of the face before it.
    ///
    /// A polygon c0 c1 … cn-1 is stored as the fan (c0 c1 c2), (c0 c2 c3), … until its positions are loaded and it can
    /// be triangulated.
    pub continues_polygon: bool,
    /// Upper bound on the distance between this face and the input surface that it replaces, in units of length; only
    /// maintained if the error is bounded.
    pub deviation: f32,
}

impl<V: FaceVertex> Face<V> {
    /// The face with each vertex in another numbering, which has the same texture coordinates.
    #[inline]
    pub fn renumbered<W: FaceVertex<Texcoord = V::Texcoord>>(self, mut new_id: impl FnMut(V) -> W) -> Face<W> {
        let [a, b, c] = self.vertices;
        self.with_vertices([new_id(a), new_id(b), new_id(c)])
    }

    /// The face with each vertex and texture coordinate in another numbering; corners without one stay without.
    #[inline]
    pub fn translated<W: FaceVertex>(
        self,
        new_vertex: impl FnMut(V) -> W,
        mut new_texcoord: impl FnMut(V::Texcoord) -> W::Texcoord,
    ) -> Face<W> {
        let Self { vertices, texcoords, part, continues_polygon, deviation } = self;
        let texcoords = texcoords.map(|id| if id == Id::NONE { Id::NONE } else { new_texcoord(id) });
        Face { vertices: vertices.map(new_vertex), texcoords, part, continues_polygon, deviation }
    }

    /// The face with these vertices of another numbering, which has the same texture coordinates.
    #[inline]
    pub fn with_vertices<W: FaceVertex<Texcoord = V::Texcoord>>(self, vertices: [W; 3]) -> Face<W> {
        let Self { texcoords, part, continues_polygon, deviation, .. } = self;
        Face { vertices, texcoords, part, continues_polygon, deviation }
    }

    /// Texture coordinates of the corners that have one.
    #[inline]
    pub fn named_texcoords(self) -> impl Iterator<Item = V::Texcoord> {
        self.texcoords.into_iter().filter(|&texcoord| texcoord != Id::NONE)
    }
}

/// Reports whether a triangle uses a vertex twice.
pub fn repeats_vertex<V: PartialEq>([a, b, c]: [V; 3]) -> bool {
    a == b || b == c || c == a
}

/// Location of a block of faces, and the ids that it uses.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FaceBlock {
    /// Offset of its first byte in the file.
    pub offset_bytes: u64,
    /// Length in bytes.
    pub bytes: u32,
    /// Number of faces.
    pub faces: u32,
    /// Range that contains all its vertices.
    pub vertices: Range<PieceVertex>,
    /// Range that contains all its texture coordinates; empty if there are none.
    pub texcoords: Range<PieceTexcoord>,
    /// XXH3 of its bytes.
    pub checksum: u64,
}

impl FaceBlock {
    /// Appends the decoded faces to `out`, after verifying the checksum: ids are used as indices into memory.
    ///
    /// # Errors
    /// A description of the fault.
    pub fn decode(&self, bytes: &[u8], out: &mut Vec<Face<PieceVertex>>) -> Result<(), String> {
        match self.faces as usize {
            count if count > BLOCK_FACES => Err(format!("a block of {count} faces; at most {BLOCK_FACES} are written")),
            count if xxh3_64(bytes) == self.checksum => decode(bytes, count, out),
            _ => Err("the checksum of a block of faces differs from what was written".into()),
        }
    }
}

/// Largest size of an encoded face in bytes: a tag, seven values of 4 bytes and a float.
pub(super) const FACE_BYTES_MAX: usize = 2 + 7 * 4 + 4;
/// Bytes accessed to decode or encode a face; the last value may be read four bytes wide.
const WINDOW_BYTES: usize = 40;
/// No word of a face begins at this offset or later.
const OFFSETS_END: usize = 32;
/// Masks of values of one to four bytes.
const VALUE_MASKS: [u32; 4] = [0xff, 0xffff, 0x00ff_ffff, u32::MAX];
/// Number of faces for which output is reserved at once.
const ENCODED_AT_ONCE: usize = 256;

const PART_DIFFERS: u16 = 1;
const CONTINUES: u16 = 2;
const BARE: u16 = 4;
const DEVIATES: u16 = 8;
const SIZES_SHIFT: u32 = 4;
const TEXCOORD_SIZES_SHIFT: u32 = 6;

/// Values of the previous face, from which differences are taken.
#[derive(Debug, Default)]
struct Before {
    vertex: u32,
    /// Id + 1.
    texcoord: u32,
    part: u32,
}

/// Appends the encoding of faces (at most [`BLOCK_FACES`]) to `out`; leaves the offset of the block at 0.
pub fn encode_block(faces: &[Face<PieceVertex>], out: &mut Vec<u8>) -> FaceBlock {
    let start = out.len();
    encode(faces, out);
    let (mut vertices, mut texcoords) = (IdSpan::default(), IdSpan::default());
    for face in faces {
        face.vertices.into_iter().for_each(|id| vertices.see(id));
        face.texcoords.into_iter().for_each(|id| texcoords.see(id));
    }
    FaceBlock {
        offset_bytes: 0,
        bytes: (out.len() - start) as u32,
        faces: faces.len() as u32,
        vertices: vertices.range(),
        texcoords: texcoords.range(),
        checksum: xxh3_64(&out[start..]),
    }
}

/// Appends the encoding of faces to `out`.
pub fn encode<V: FaceVertex>(faces: &[Face<V>], out: &mut Vec<u8>) {
    let mut at = out.len();
    let mut before = Before::default();
    for chunk in faces.chunks(ENCODED_AT_ONCE) {
        out.resize(at + chunk.len() * FACE_BYTES_MAX + WINDOW_BYTES, 0);
        for face in chunk {
            if let Some(window) = out.get_mut(at..).and_then(|rest| rest.first_chunk_mut()) {
                at += put_face(window, face, &mut before);
            }
        }
    }
    out.truncate(at);
}

/// Decodes `count` faces and appends them to `out`.
///
/// # Errors
/// A description of the fault if the bytes are invalid.
pub fn decode<V: FaceVertex>(bytes: &[u8], count: usize, out: &mut Vec<Face<V>>) -> Result<(), String> {
    let mut before = Before::default();
    let mut at = 0;
    let next = |_| {
        let rest = bytes.get(at..).unwrap_or(&[]);
        let (face, taken) = match rest.first_chunk() {
            Some(window) => take_face(window, &mut before),
            None => {
                let mut window = [0; WINDOW_BYTES];
                window[..rest.len()].copy_from_slice(rest);
                take_face(&window, &mut before)
            }
        };
        at += taken;
        face
    };
    out.extend((0..count).map(next));
    match bytes.len().checked_sub(at) {
        Some(0) => Ok(()),
        Some(left) => Err(format!("{left} bytes are left after the faces")),
        None => Err("faces end early".to_owned()),
    }
}

/// Encodes a face; returns its size in bytes.
#[inline(always)]
fn put_face<V: FaceVertex>(window: &mut [u8; WINDOW_BYTES], face: &Face<V>, before: &mut Before) -> usize {
    let bare = face.texcoords == [Id::NONE; 3];
    let part_differs = face.part.number() != before.part;
    let deviates = face.deviation != 0.0;
    let mut at = 2;
    if part_differs {
        before.part = face.part.number();
        put_word(window, at, before.part);
        at += 4;
    }
    let mut sizes = put_ids(window, &mut at, before.vertex, face.vertices.map(V::number));
    before.vertex = face.vertices[0].number();
    if !bare {
        let texcoords = face.texcoords.map(|t| t.number().wrapping_add(1));
        sizes |= put_ids(window, &mut at, before.texcoord, texcoords) << TEXCOORD_SIZES_SHIFT;
        before.texcoord = texcoords[0];
    }
    if deviates {
        put_word(window, at, face.deviation.to_bits());
        at += 4;
    }
    let flag = |holds: bool, bit: u16| if holds { bit } else { 0 };
    let flags = flag(part_differs, PART_DIFFERS)
        | flag(face.continues_polygon, CONTINUES)
        | flag(bare, BARE)
        | flag(deviates, DEVIATES);
    window[..2].copy_from_slice(&(flags | (sizes as u16) << SIZES_SHIFT).to_le_bytes());
    at
}

/// Decodes a face; returns it with its size in bytes.
#[inline(always)]
fn take_face<V: FaceVertex>(window: &[u8; WINDOW_BYTES], before: &mut Before) -> (Face<V>, usize) {
    let tag = u16::from_le_bytes([window[0], window[1]]);
    let sizes = u32::from(tag) >> SIZES_SHIFT;
    let mut at = 2;
    if tag & PART_DIFFERS != 0 {
        before.part = word_at(window, at);
        at += 4;
    }
    let vertices = take_ids(window, &mut at, before.vertex, sizes);
    before.vertex = vertices[0];
    let mut texcoords = [Id::NONE; 3];
    if tag & BARE == 0 {
        let ids = take_ids(window, &mut at, before.texcoord, sizes >> TEXCOORD_SIZES_SHIFT);
        before.texcoord = ids[0];
        texcoords = ids.map(|t| Id::new(t.wrapping_sub(1)));
    }
    let mut deviation = 0.0;
    if tag & DEVIATES != 0 {
        deviation = f32::from_bits(word_at(window, at));
        at += 4;
    }
    (
        Face {
            vertices: vertices.map(V::new),
            texcoords,
            part: PartId::new(before.part),
            continues_polygon: tag & CONTINUES != 0,
            deviation,
        },
        at,
    )
}

/// Encodes each of three ids as the difference from the one before, modulo 2³², folded to an unsigned number: 0, -1, 1,
/// -2, 2, … Returns the sizes of these numbers in bytes, less one, two bits each.
#[inline(always)]
fn put_ids(window: &mut [u8; WINDOW_BYTES], at: &mut usize, mut before: u32, ids: [u32; 3]) -> u32 {
    let mut sizes = 0;
    for (place, id) in (0..).zip(ids) {
        let difference = id.wrapping_sub(before);
        let value = difference << 1 ^ ((difference as i32) >> 31) as u32;
        let more = (31 - (value | 1).leading_zeros()) / 8;
        put_word(window, *at, value);
        *at += more as usize + 1;
        sizes |= more << (2 * place);
        before = id;
    }
    sizes
}

/// Decodes three ids, given the sizes of their differences.
#[inline(always)]
fn take_ids(window: &[u8; WINDOW_BYTES], at: &mut usize, before: u32, sizes: u32) -> [u32; 3] {
    let mut take = |place: u32| {
        let more = (sizes >> (2 * place)) as usize % VALUE_MASKS.len();
        let value = word_at(window, *at) & VALUE_MASKS[more];
        *at += more + 1;
        value >> 1 ^ (value & 1).wrapping_neg()
    };
    let first = before.wrapping_add(take(0));
    let second = first.wrapping_add(take(1));
    [first, second, second.wrapping_add(take(2))]
}

/// The word at an offset. The remainder is the offset itself, and tells the compiler that the word lies in the window.
#[inline(always)]
fn word_at(window: &[u8; WINDOW_BYTES], at: usize) -> u32 {
    window[at % OFFSETS_END..].first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes))
}

#[inline(always)]
fn put_word(window: &mut [u8; WINDOW_BYTES], at: usize, word: u32) {
    if let Some(bytes) = window[at % OFFSETS_END..].first_chunk_mut() {
        *bytes = word.to_le_bytes();
    }
}

/// The smallest range that contains some ids.
#[derive(Debug)]
struct IdSpan {
    low: u32,
    end: u32,
}

impl Default for IdSpan {
    fn default() -> Self {
        Self { low: u32::MAX, end: 0 }
    }
}

impl IdSpan {
    /// Includes an id, unless it is [`Id::NONE`]: the number after that is 0.
    fn see(&mut self, id: impl Id) {
        self.low = self.low.min(id.number());
        self.end = self.end.max(id.number().wrapping_add(1));
    }

    fn range<I: Id>(&self) -> Range<I> {
        I::new(self.low.min(self.end))..I::new(self.end)
    }
}

impl<V: FaceVertex> Record for Face<V> {
    fn encode(records: &[Self], out: &mut Vec<u8>) {
        encode(records, out);
    }

    fn decode(bytes: &[u8], count: usize, out: &mut Vec<Self>) -> Result<(), String> {
        decode(bytes, count, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn face(vertices: [u32; 3], texcoords: [u32; 3], part: u32) -> Face<PieceVertex> {
        let (vertices, texcoords) = (vertices.map(PieceVertex::new), texcoords.map(PieceTexcoord::new));
        Face { vertices, texcoords, part: PartId::new(part), ..Face::default() }
    }

    proptest! {
        #[test]
        fn faces_come_back_as_they_were(raw in prop::collection::vec(any::<([u32; 3], [u32; 3], u32, bool, bool, u16)>(), 0..200)) {
            let faces: Vec<Face<PieceVertex>> = raw
                .into_iter()
                .map(|(vertices, texcoords, part, continues_polygon, bare, deviation)| Face {
                    vertices: vertices.map(PieceVertex::new),
                    texcoords: if bare { [PieceTexcoord::NONE; 3] } else { texcoords.map(PieceTexcoord::new) },
                    part: PartId::new(part),
                    continues_polygon,
                    deviation: f32::from(deviation % 3),
                })
                .collect();
            let mut bytes = Vec::new();
            encode(&faces, &mut bytes);
            let mut back = Vec::new();
            decode(&bytes, faces.len(), &mut back).unwrap();
            prop_assert_eq!(back, faces);
        }

        #[test]
        fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), count in 0usize..100) {
            let _ = decode::<PieceVertex>(&bytes, count, &mut Vec::new());
        }
    }

    #[test]
    fn what_is_cut_off_is_refused() {
        let mut bytes = Vec::new();
        let face = face([5, 70_000, 3], [1 << 30, 0, 7], 9);
        encode(&[face; 3], &mut bytes);
        for length in 0..bytes.len() {
            assert!(decode::<PieceVertex>(&bytes[..length], 3, &mut Vec::new()).is_err(), "{length}");
        }
        assert!(decode::<PieceVertex>(&[bytes, vec![0]].concat(), 3, &mut Vec::new()).is_err());
    }

    #[test]
    fn an_exporters_order_takes_few_bytes() {
        let faces: Vec<_> = (0..1000).map(|i| face([i, i + 1, i + 40], [i, i + 1, i + 45], 3)).collect();
        let mut bytes = Vec::new();
        let block = encode_block(&faces, &mut bytes);
        assert!(bytes.len() < 9 * faces.len());
        assert_eq!(block.vertices, PieceVertex::new(0)..PieceVertex::new(1039 + 1));
        assert_eq!(block.texcoords, PieceTexcoord::new(0)..PieceTexcoord::new(1044 + 1));
    }
}

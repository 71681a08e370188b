//! Where the parts of a GLB lie in its binary chunk.
//!
//! ```text
//! vertices   a record for each, primitive by primitive: x y z [nx ny nz] [u v] [r g b a]
//! indices    16 or 32 bits each, primitive by primitive
//! images     the files
//! ```
//! Each part begins at a multiple of 4 bytes.

use glam::Vec3;

use super::images::GlbImages;
use super::primitives::PrimitiveId;
use crate::base::id::TiVec;
use crate::write::glb_format::padded;

/// What the record of a vertex has.
#[derive(Debug, Clone, Copy)]
pub(super) struct RecordForm {
    pub normals: bool,
    pub texcoords: bool,
    pub colours: bool,
}

impl RecordForm {
    /// Words of a record.
    pub fn words(self) -> usize {
        self.before_colour() + 2 * usize::from(self.colours)
    }

    /// Words before the texture coordinate.
    pub fn before_texcoord(self) -> usize {
        3 + 3 * usize::from(self.normals)
    }

    /// Words before the colour.
    pub fn before_colour(self) -> usize {
        self.before_texcoord() + 2 * usize::from(self.texcoords)
    }
}

/// What a primitive has.
#[derive(Debug, Clone, Copy)]
pub(super) struct PrimitiveSize {
    pub vertices: u64,
    pub faces: u64,
    /// The box of its positions.
    pub low: Vec3,
    pub high: Vec3,
}

impl Default for PrimitiveSize {
    fn default() -> Self {
        Self { vertices: 0, faces: 0, low: Vec3::INFINITY, high: Vec3::NEG_INFINITY }
    }
}

impl PrimitiveSize {
    /// Bytes of an index: the largest number of a format stands for no vertex.
    pub fn index_bytes(&self) -> u64 {
        if self.vertices <= u64::from(u16::MAX) { 2 } else { 4 }
    }

    /// Bytes of its indices, with those that fill the last word.
    pub fn indices_bytes(&self) -> u64 {
        padded(3 * self.faces * self.index_bytes())
    }
}

/// The parts of the binary chunk.
#[derive(Debug)]
pub(super) struct ChunkLayout {
    pub form: RecordForm,
    pub primitives: TiVec<PrimitiveId, PrimitiveSize>,
    /// Bytes of all vertices, all indices, and each image.
    pub vertex_bytes: u64,
    pub index_bytes: u64,
    pub image_bytes: Vec<u64>,
}

impl ChunkLayout {
    /// Lays the parts out.
    pub fn new(form: RecordForm, primitives: TiVec<PrimitiveId, PrimitiveSize>, images: &GlbImages) -> Self {
        let vertices: u64 = primitives.iter().map(|primitive| primitive.vertices).sum();
        Self {
            form,
            vertex_bytes: vertices * 4 * form.words() as u64,
            index_bytes: primitives.iter().map(PrimitiveSize::indices_bytes).sum(),
            image_bytes: images.files.iter().map(|image| image.content.bytes).collect(),
            primitives,
        }
    }

    /// Bytes of the chunk.
    pub fn bytes(&self) -> u64 {
        self.vertex_bytes + self.index_bytes + self.image_bytes.iter().map(|&bytes| padded(bytes)).sum::<u64>()
    }
}

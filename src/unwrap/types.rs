//! What is unwrapped, and how.

use glam::{DVec2, DVec3};

use super::image_size::ImageSize;
use crate::base::id::TiSlice;
use crate::mesh::id::{FaceId, LocalVertex};

/// The triangles of a patch.
#[derive(Debug, Clone, Copy)]
pub struct Triangles<'a> {
    /// Position of each vertex.
    pub positions: &'a TiSlice<LocalVertex, DVec3>,
    /// Vertices of each triangle, counter-clockwise.
    pub vertices: &'a TiSlice<FaceId, [LocalVertex; 3]>,
}

impl Triangles<'_> {
    /// Corners of a triangle.
    #[inline]
    pub fn corners(&self, face: FaceId) -> [DVec3; 3] {
        self.vertices[face].map(|vertex| self.positions[vertex])
    }
}

/// How to unwrap.
#[derive(Debug, Clone, Copy)]
pub struct UnwrapSettings<'a> {
    /// Length of a texel's side on each triangle, in the mesh's unit of length; those of a chart get their mean.
    pub texels: &'a TiSlice<FaceId, f64>,
    /// Largest side of an image, in texels; at least 64.
    pub side: u32,
}

/// A chart in its image.
#[derive(Debug, Clone)]
pub struct PlacedChart {
    /// Number of the image.
    pub image: u32,
    /// Its triangles, each with the places of its corners in texels from the upper left corner of the image, downwards.
    pub faces: Vec<(FaceId, [DVec2; 3])>,
}

/// Charts in their images.
#[derive(Debug, Clone, Default)]
pub struct Unwrapped {
    /// The charts.
    pub charts: Vec<PlacedChart>,
    /// Size of each image.
    pub images: Vec<ImageSize>,
    /// Charts that were made smaller, because they would not fit an image.
    pub shrunk: u64,
}

//! Texture of two surfaces at a point and at its closest point.

use bytemuck::{Pod, Zeroable};

use crate::model::id::ImageId;

/// Which of the two points of a pair lies on the original.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OriginalSide {
    /// The point itself.
    Own,
    /// The closest point.
    Other,
}

/// The texture at a point and at its closest point.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct TexturePair {
    /// The closest point.
    pub closest: [f64; 3],
    /// Texture image at the point, of the mesh that it lies on.
    pub image: ImageId,
    /// Texture image at the closest point, of the other mesh.
    pub other_image: ImageId,
    /// Texture coordinate at the point.
    pub texcoord: [f32; 2],
    /// Texture coordinate at the closest point.
    pub other_texcoord: [f32; 2],
    /// Length in texture space per length in space, at the closest point.
    pub other_density: f32,
    pub(super) zero: u32,
}

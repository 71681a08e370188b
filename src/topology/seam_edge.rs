//! Edges of texture seams, with the texture on both sides.

use bytemuck::{Pod, Zeroable};

use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::Wedge;
use crate::model::id::ImageId;

/// Texture of a face along one of its edges.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct EdgeTexture {
    /// Texture image of the mesh, or none.
    pub image: ImageId,
    /// Texture coordinates at both ends, shifted by whole numbers so that the least lie between 0 and 1.
    pub texcoords: [[f32; 2]; 2],
}

impl EdgeTexture {
    /// Texture along the edge between two wedges of a face that shows `image`.
    pub(super) fn of(mesh: &ClusterMesh, wedges: [Wedge; 2], image: ImageId) -> Self {
        let [from, to] = wedges.map(|wedge| mesh.wedge_uv[wedge]);
        let low = from.min(to).floor();
        if image == ImageId::NONE || !(from + to).is_finite() {
            return Self { image: ImageId::NONE, texcoords: [[0.0; 2]; 2] };
        }
        Self { image, texcoords: [from, to].map(|uv| (uv - low).as_vec2().to_array()) }
    }

    /// The same edge from its other end.
    pub fn reversed(self) -> Self {
        let [from, to] = self.texcoords;
        Self { texcoords: [to, from], ..self }
    }
}

/// An edge of a seam.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct SeamEdge {
    /// Length in space.
    pub length: f64,
    /// Texture of the two faces, from the same end on.
    pub sides: [EdgeTexture; 2],
}

impl SeamEdge {
    /// The edge of two faces; `None` unless both show a texture image.
    pub fn between(length: f64, sides: [EdgeTexture; 2]) -> Option<Self> {
        let is_shown = sides.iter().all(|side| side.image != ImageId::NONE) && length > 0.0 && length.is_finite();
        is_shown.then_some(Self { length, sides })
    }
}

//! The mesh of a tile: its triangles, joined at their corners.

use std::collections::HashMap;

use foldhash::fast::FixedState;
use glam::{DVec3, IVec3};

use super::cut::TileTriangle;
use super::lattice::Lattice;
use crate::base::id::TiVec;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::model::id::ImageId;

/// The mesh of a tile.
#[derive(Debug, Default)]
pub struct TileMesh {
    /// Places of its vertices on the lattice of the level.
    pub places: TiVec<LocalVertex, IVec3>,
    /// Positions of its vertices, relative to the place [`middle`](TileMesh::middle).
    pub positions: TiVec<LocalVertex, DVec3>,
    /// Vertices of each face.
    pub faces: TiVec<FaceId, [LocalVertex; 3]>,
    /// What each face shows.
    pub shown: TiVec<FaceId, FaceTexture>,
    /// Edges along the border of the tile, each in the direction of its face.
    pub border: Vec<BorderEdge>,
    /// The place in the middle of the tile.
    pub middle: IVec3,
}

/// What a face shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaceTexture {
    /// The image; none in a level that does not keep its texels.
    pub image: ImageId,
    /// Texture coordinates of its corners.
    pub texcoords: [[f32; 2]; 3],
}

/// An edge along the border of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BorderEdge {
    /// Its face.
    pub face: FaceId,
    /// Its first corner in the face.
    pub corner: usize,
    /// Axis that is normal to the border.
    pub axis: usize,
}

impl TileMesh {
    /// Joins the triangles of a tile.
    pub fn join(triangles: &[TileTriangle], lattice: Lattice) -> Self {
        let mut mesh = Self::default();
        let mut known: HashMap<[i32; 3], LocalVertex, FixedState> = HashMap::default();
        for triangle in triangles {
            let vertices = triangle.corners.map(|corner| {
                *known.entry(corner).or_insert_with(|| mesh.places.push_and_get_key(IVec3::from(corner)))
            });
            let face = mesh.faces.push_and_get_key(vertices);
            mesh.shown.push(FaceTexture { image: triangle.image, texcoords: triangle.texcoords });
            mesh.border.extend((0..3).filter_map(|corner| {
                let axis = (triangle.border >> (2 * corner) & 3).checked_sub(1)? as usize;
                Some(BorderEdge { face, corner, axis })
            }));
        }
        let [low, high] = mesh.extent();
        mesh.middle = low + (high - low) / 2;
        let middle = mesh.middle;
        mesh.positions = mesh.places.iter().map(|&place| lattice.position(place - middle)).collect();
        mesh
    }

    /// The lowest and the highest places.
    pub fn extent(&self) -> [IVec3; 2] {
        let low = self.places.iter().copied().reduce(IVec3::min).unwrap_or_default();
        [low, self.places.iter().copied().reduce(IVec3::max).unwrap_or_default()]
    }

    /// Corners of a face.
    pub fn corners(&self, face: FaceId) -> [DVec3; 3] {
        self.faces[face].map(|vertex| self.positions[vertex])
    }
}

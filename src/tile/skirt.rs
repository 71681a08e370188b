//! Skirts: strips of triangles along the border of a tile that close the gap to a neighbour of another level.
//!
//! ```text
//!   this tile │ neighbour
//!   ──────────┐
//!   skirt     │────────────    A strip lies in the plane of the border and leads against the normal of the surface, so
//!             ▼                that whoever looks through the gap from outside sees the strip.
//! ```

use std::collections::HashMap;

use foldhash::fast::FixedState;
use glam::{DVec3, IVec3};

use super::lattice::Lattice;
use super::mesh::{BorderEdge, TileMesh};
use crate::base::id::TiVec;
use crate::mesh::id::LocalVertex;

/// A strip along an edge: the places below its ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Strip {
    /// The edge.
    pub edge: BorderEdge,
    /// The places below its first and its second end.
    pub feet: [IVec3; 2],
}

/// The strips of a tile, `length` long.
pub fn strips(mesh: &TileMesh, lattice: Lattice, length: f64) -> Vec<Strip> {
    let normals = border_normals(mesh);
    let mut feet: HashMap<(LocalVertex, usize), IVec3, FixedState> = HashMap::default();
    let mut foot = |vertex: LocalVertex, axis: usize| {
        *feet.entry((vertex, axis)).or_insert_with(|| {
            let mut downwards = -normals[vertex];
            downwards[axis] = 0.0;
            mesh.places[vertex] + lattice.place(downwards.normalize_or_zero() * length)
        })
    };
    let strip = |&edge: &BorderEdge| {
        let ends = [edge.corner, (edge.corner + 1) % 3].map(|corner| mesh.faces[edge.face][corner]);
        Strip { edge, feet: ends.map(|end| foot(end, edge.axis)) }
    };
    mesh.border.iter().map(strip).collect()
}

/// Sum of the normals of the faces at each vertex of the border, by area; zero elsewhere.
fn border_normals(mesh: &TileMesh) -> TiVec<LocalVertex, DVec3> {
    let mut is_border: TiVec<LocalVertex, bool> = vec![false; mesh.places.len()].into();
    for edge in &mesh.border {
        for end in [edge.corner, (edge.corner + 1) % 3] {
            is_border[mesh.faces[edge.face][end]] = true;
        }
    }
    let mut sums: TiVec<LocalVertex, DVec3> = vec![DVec3::ZERO; mesh.places.len()].into();
    for (face, vertices) in mesh.faces.iter_enumerated() {
        let [a, b, c] = mesh.corners(face);
        for &vertex in vertices {
            if is_border[vertex] {
                sums[vertex] += (b - a).cross(c - a);
            }
        }
    }
    sums
}

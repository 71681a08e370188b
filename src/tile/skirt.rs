//! Skirts: strips of triangles along the border of a tile that close the gap to a neighbour of another level.
//!
//! ```text
//!   this tile │ neighbour
//!   ──────────┐
//!   skirt     │────────────    A strip lies in the plane of the border and leads against the normal of the surface, so
//!             ▼                that whoever looks through the gap from outside sees the strip.
//! ```
//! A strip is as long as the other levels, up to [`LEVELS_APART`] apart, are away at its ends.

use std::collections::HashMap;

use foldhash::fast::FixedState;
use glam::{DVec3, IVec3};

use super::lattice::Lattice;
use super::mesh::{BorderEdge, TileMesh};
use crate::base::Result;
use crate::base::id::TiVec;
use crate::measure::compare::distances_to;
use crate::mesh::id::LocalVertex;
use crate::surface::cells::SurfaceCells;

/// Levels whose tiles may be neighbours lie this far apart at most.
pub const LEVELS_APART: u32 = 2;
/// What a strip is longer than the distance of the other levels, in texels.
const MORE_TEXELS: f64 = 0.5;
/// Largest factor by which a strip is longer because the surface leans against its plane.
const LEAN_MAX: f64 = 3.0;

/// What shapes the skirts of a level.
pub struct SkirtShape<'a> {
    /// The lattice of the level.
    pub lattice: Lattice,
    /// Length of a texel's side.
    pub texel: f64,
    /// Largest length of a strip.
    pub longest: f64,
    /// Origin of the scene, in the coordinates of the input.
    pub scene_origin: DVec3,
    /// The surfaces of the levels that may be neighbours.
    pub others: Vec<&'a SurfaceCells>,
}

/// A strip along an edge: the places below its ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Strip {
    /// The edge.
    pub edge: BorderEdge,
    /// The places below its first and its second end.
    pub feet: [IVec3; 2],
}

impl SkirtShape<'_> {
    /// The strips of a tile; none if there is no other level.
    ///
    /// # Errors
    /// On failed reads.
    pub fn strips(&self, mesh: &TileMesh) -> Result<Vec<Strip>> {
        if self.others.is_empty() {
            return Ok(Vec::new());
        }
        let normals = border_normals(mesh);
        let reach = self.reach(mesh, &normals)?;
        let mut feet: HashMap<(LocalVertex, usize), IVec3, FixedState> = HashMap::default();
        let mut foot = |vertex: LocalVertex, axis: usize| {
            *feet.entry((vertex, axis)).or_insert_with(|| {
                let mut downwards = -normals[vertex];
                downwards[axis] = 0.0;
                let lean = (1.0 / downwards.length()).min(LEAN_MAX);
                let length = (reach[vertex] * lean).min(self.longest);
                mesh.places[vertex] + self.lattice.place(downwards.normalize_or_zero() * length)
            })
        };
        let strip = |&edge: &BorderEdge| {
            let ends = [edge.corner, (edge.corner + 1) % 3].map(|corner| mesh.faces[edge.face][corner]);
            Strip { edge, feet: ends.map(|end| foot(end, edge.axis)) }
        };
        Ok(mesh.border.iter().map(strip).collect())
    }

    /// How far from each vertex of the border the other levels lie at most, and a little more.
    fn reach(&self, mesh: &TileMesh, normals: &TiVec<LocalVertex, DVec3>) -> Result<TiVec<LocalVertex, f64>> {
        let vertices: Vec<LocalVertex> = normals.keys().filter(|&vertex| normals[vertex] != DVec3::ZERO).collect();
        let middle = self.scene_origin + self.lattice.position(mesh.middle);
        let points: Vec<DVec3> = vertices.iter().map(|&vertex| middle + mesh.positions[vertex]).collect();
        let mut reach: TiVec<LocalVertex, f64> = vec![MORE_TEXELS * self.texel; mesh.places.len()].into();
        for other in &self.others {
            for (&vertex, distance) in vertices.iter().zip(distances_to(other, &points)?) {
                reach[vertex] = reach[vertex].max(distance + MORE_TEXELS * self.texel);
            }
        }
        Ok(reach)
    }
}

/// Unit normal of the surface at each vertex of the border, by area; zero elsewhere.
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
    sums.iter().map(|sum| sum.normalize_or_zero()).collect()
}

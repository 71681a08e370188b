//! Skirts: strips of triangles along the border of a tile that close the gap to a neighbour of another level.
//!
//! ```text
//!   this tile │ neighbour
//!   ──────────┐
//!   skirt     │────────────    A strip lies in the plane of the border and leads against the normal of the surface, so
//!             ▼                that whoever looks through the gap from outside sees the strip.
//! ```
//! A strip is as long as the other levels, up to [`LEVELS_APART`] apart, are away at its ends.

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
/// What a strip is longer than the distance of the other levels, in texels of the coarsest of them: its border is on
/// another lattice, and who looks along the plane looks in between.
const MORE_TEXELS: f64 = 0.5;
/// Largest length of a strip, in texels of the coarsest level that may be a neighbour.
const TEXELS_MAX: f64 = 2.0;
/// Parts of an edge at whose ends the other levels are looked for at most.
const PARTS_MAX: f64 = 8.0;
/// Length from which a direction is that of all planes of a vertex.
const ACROSS: f64 = 0.7;
/// A direction shorter than this, of a normal without its part across the plane, is none.
const FLAT: f64 = 0.1;
/// Largest factor by which a strip is longer because the surface leans against its plane.
const LEAN_MAX: f64 = 3.0;

/// What shapes the skirts of a level.
pub struct SkirtShape<'a> {
    /// The lattice of the level.
    pub lattice: Lattice,
    /// Length of a texel's side.
    pub texel: f64,
    /// The same of the coarsest level that may be a neighbour.
    pub coarsest_texel: f64,
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
        let directions = Directions::new(mesh);
        let reach = self.reach(mesh)?;
        let foot = |vertex: LocalVertex, axis: usize| {
            let downwards = directions.downwards(vertex, axis);
            let lean = (1.0 / downwards.length()).min(LEAN_MAX);
            let length = (reach[vertex] * lean).min(TEXELS_MAX * self.coarsest_texel);
            mesh.places[vertex] + self.lattice.place(downwards.normalize_or_zero() * length)
        };
        let strip = |&edge: &BorderEdge| Strip { edge, feet: mesh.ends(edge).map(|end| foot(end, edge.axis)) };
        Ok(mesh.border.iter().map(strip).collect())
    }

    /// How far from the border at each vertex the other levels lie at most, and a little more.
    fn reach(&self, mesh: &TileMesh) -> Result<TiVec<LocalVertex, f64>> {
        let middle = self.scene_origin + self.lattice.position(mesh.middle);
        // Points along the border, each with the vertices whose feet have to be as far away.
        let (mut points, mut owners) = (Vec::new(), Vec::new());
        for &edge in &mesh.border {
            let ends = mesh.ends(edge);
            let [from, to] = ends.map(|end| middle + mesh.positions[end]);
            let parts = (from.distance(to) / self.texel).ceil().clamp(1.0, PARTS_MAX) as u32;
            for part in 0..=parts {
                points.push(from.lerp(to, f64::from(part) / f64::from(parts)));
                owners.push(ends);
            }
        }
        let mut reach: TiVec<LocalVertex, f64> = vec![0.0; mesh.places.len()].into();
        for other in &self.others {
            for (ends, distance) in owners.iter().zip(distances_to(other, &points)?) {
                ends.iter().for_each(|&end| reach[end] = reach[end].max(distance));
            }
        }
        reach.iter_mut().for_each(|reach| *reach += MORE_TEXELS * self.coarsest_texel);
        Ok(reach)
    }
}

/// Where strips may lead.
struct Directions {
    /// Against the normal of the surface by area, at each vertex of the border; zero elsewhere.
    own: TiVec<LocalVertex, DVec3>,
    /// The sum of those at the other ends of its edges.
    around: TiVec<LocalVertex, DVec3>,
    /// The sum of all.
    whole: DVec3,
    /// Of each vertex, 1 for each axis along all planes that it lies on, and 0 for the others.
    free: TiVec<LocalVertex, DVec3>,
}

impl Directions {
    fn new(mesh: &TileMesh) -> Self {
        let mut free: TiVec<LocalVertex, DVec3> = vec![DVec3::ONE; mesh.places.len()].into();
        for &edge in &mesh.border {
            mesh.ends(edge).iter().for_each(|&end| free[end][edge.axis] = 0.0);
        }
        let mut own: TiVec<LocalVertex, DVec3> = vec![DVec3::ZERO; mesh.places.len()].into();
        for (face, vertices) in mesh.faces.iter_enumerated() {
            let [a, b, c] = mesh.corners(face);
            for &vertex in vertices {
                if free[vertex] != DVec3::ONE {
                    own[vertex] -= (b - a).cross(c - a);
                }
            }
        }
        own.iter_mut().for_each(|sum| *sum = sum.normalize_or_zero());
        let (mut around, mut whole) = (TiVec::from(vec![DVec3::ZERO; mesh.places.len()]), DVec3::ZERO);
        for &edge in &mesh.border {
            let [from, to] = mesh.ends(edge);
            around[from] += own[to];
            around[to] += own[from];
            whole += own[from] + own[to];
        }
        Self { own, around, whole, free }
    }

    /// The direction of a strip at a vertex in a plane normal to an axis: shorter where the surface leans.
    fn downwards(&self, vertex: LocalVertex, axis: usize) -> DVec3 {
        // Where two planes meet, strips of both share their feet, if the surface lies across both.
        let shared = self.own[vertex] * self.free[vertex];
        if shared.length() >= ACROSS {
            return shared;
        }
        // A surface that faces along the plane gives no direction: then that of the neighbours counts, or of all.
        let wanted = [self.own[vertex], self.around[vertex], self.whole];
        let mut in_plane = wanted.into_iter().map(|wanted| {
            let mut direction = wanted.normalize_or_zero();
            direction[axis] = 0.0;
            direction
        });
        in_plane.find(|direction| direction.length() > FLAT).unwrap_or_default()
    }
}

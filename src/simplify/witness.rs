//! Estimates how far a stage moved the surface: distances from sampled vertices before it to the mesh after it.
//!
//! One vertex in `SAMPLED` is a witness. It follows the collapses to the vertex that it merged into, and measures its
//! distance to the faces around that vertex:
//!
//! ```text
//!   before   --w-----.-----.--          after   ----.---------.--    d² weighted by the area around w
//!                                                w  | d
//! ```

use glam::DVec3;

use crate::geometry::distance_sq;
use crate::geometry::triangle::area;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::LocalVertex;
use crate::mesh::ring::Rings;

/// One vertex in this many is a witness.
const SAMPLED: u32 = 16;
/// Mean squared distance over a surface, relative to that at its vertices: 1/2 if those are independent, 1 if they are
/// all equal.
const SURFACE_SHARE: f64 = 0.5;

/// Some of the vertices before a stage.
#[derive(Debug, Default)]
pub struct Witnesses {
    witnesses: Vec<Witness>,
}

/// A vertex before a stage.
#[derive(Debug)]
struct Witness {
    vertex: LocalVertex,
    /// Area around it.
    area: f64,
    position: DVec3,
}

impl Witnesses {
    /// Records the positions of the sampled vertices and the area around each.
    pub fn gather(&mut self, mesh: &ClusterMesh, rings: &Rings) {
        self.witnesses.clear();
        let is_sampled =
            |vertex: &LocalVertex| (vertex.number().wrapping_mul(0x9e37_79b9) >> 16).is_multiple_of(SAMPLED);
        for vertex in mesh.vertex_ids().filter(is_sampled) {
            let area = area_around(mesh, rings, vertex);
            if area > 0.0 {
                self.witnesses.push(Witness { vertex, area, position: mesh.positions[vertex] });
            }
        }
    }

    /// Mean squared distance from the witnesses to the current mesh, in units of length²; 0 without witnesses.
    /// `went_to` returns the vertex that a vertex collapsed onto, if it did.
    pub fn mean_sq(
        &self,
        mesh: &ClusterMesh,
        rings: &Rings,
        went_to: impl Fn(LocalVertex) -> Option<LocalVertex>,
    ) -> f64 {
        let (mut sum, mut total) = (0.0, 0.0);
        for &Witness { mut vertex, area, position } in &self.witnesses {
            while let Some(next) = went_to(vertex) {
                vertex = next;
            }
            let to_face_sq = |face| distance_sq(position, mesh.triangle(face));
            let nearest_sq = rings.faces(mesh, vertex).map(to_face_sq).fold(f64::INFINITY, f64::min);
            if nearest_sq.is_finite() {
                sum += area * nearest_sq;
                total += area;
            }
        }
        if total > 0.0 { SURFACE_SHARE * sum / total } else { 0.0 }
    }
}

/// Area of the faces around a vertex.
pub(super) fn area_around(mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex) -> f64 {
    rings.faces(mesh, vertex).map(|face| area(mesh.triangle(face))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;

    #[test]
    fn a_lifted_mesh_is_as_far_as_it_was_lifted() {
        let mut mesh = samples::grid(20, 0.0);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let mut witnesses = Witnesses::default();
        witnesses.gather(&mesh, &rings);
        assert!(witnesses.witnesses.len() > 10);
        assert_eq!(witnesses.mean_sq(&mesh, &rings, |_| None), 0.0);
        mesh.positions.iter_mut().for_each(|p| p.z += 0.5);
        assert!((witnesses.mean_sq(&mesh, &rings, |_| None) - SURFACE_SHARE * 0.25).abs() < 1e-12);
    }

    #[test]
    fn a_witness_follows_the_vertex_that_it_went_into() {
        let mesh = samples::grid(20, 0.0);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let mut witnesses = Witnesses::default();
        witnesses.gather(&mesh, &rings);
        let far = witnesses.mean_sq(&mesh, &rings, |vertex| vertex.number().checked_sub(1).map(LocalVertex::new));
        assert!(far > 10.0, "{far}");
    }
}

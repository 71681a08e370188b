//! How far the surface retreats from a vertex that collapses.
//!
//! Quadrics measure how far the remaining vertex is from the planes around the vanishing one. The tip of a mast lies in
//! all the planes of the mast, wherever it slides: it would vanish step by step at no cost.
//!
//! ```text
//!        from                             A·d²: d from `from` to the new surface, A the area around `from`
//!     .--*--.            ┬
//!     |  |  |            | d
//!     |  * to ──▶  .--*--.
//!     |  |  |      |  |  |
//! ```

use crate::geometry::distance_sq;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::LocalVertex;
use crate::mesh::ring::Rings;
use crate::simplify::edge_star::is_hub;
use crate::simplify::witness::area_around;

/// Squared distance, relative to the squared length of the edge, below which the surface counts as flat.
const FLAT_SQ: f64 = 1e-12;

/// The surface around a vertex that is to vanish.
#[derive(Debug)]
pub struct Retreat<'a> {
    mesh: &'a ClusterMesh,
    rings: &'a Rings,
    from: LocalVertex,
    /// Area of the faces around it.
    area: f64,
}

impl<'a> Retreat<'a> {
    /// The surface around `from`.
    pub fn of(mesh: &'a ClusterMesh, rings: &'a Rings, from: LocalVertex) -> Self {
        Self { mesh, rings, from, area: area_around(mesh, rings, from) }
    }

    /// The cost of a collapse onto `to`, which stays where it is: `cost`, or the area around the vanishing vertex × the
    /// squared distance from it to the new surface, if that is more. Just `cost` if `to` is a hub: that collapse will be
    /// refused.
    pub fn cost_onto(&self, to: LocalVertex, cost: f32) -> f32 {
        let &Self { mesh, rings, from, area } = self;
        if is_hub(mesh, rings, to) {
            return cost;
        }
        let (vanishing, remaining) = (mesh.positions[from], mesh.positions[to]);
        let mut nearest_sq = vanishing.distance_squared(remaining);
        let near_sq = (f64::from(cost) / area).max(FLAT_SQ * nearest_sq);
        for [vertex, other] in [[from, to], [to, from]] {
            for &corner in rings.of(vertex) {
                if nearest_sq <= near_sq {
                    return cost;
                }
                let [a, b] = mesh.others_of(corner);
                if (a == other) | (b == other) | mesh.is_dead(corner.face()) {
                    continue;
                }
                let triangle = [remaining, mesh.positions[a], mesh.positions[b]];
                nearest_sq = nearest_sq.min(distance_sq(vanishing, triangle));
            }
        }
        if nearest_sq <= near_sq { cost } else { cost.max((area * nearest_sq) as f32) }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};

    use super::*;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::v;

    fn cost_of(mesh: &ClusterMesh, from: u32, to: u32, cost: f32) -> f32 {
        let mut rings = Rings::default();
        rings.build(mesh);
        Retreat::of(mesh, &rings, v(from)).cost_onto(v(to), cost)
    }

    #[test]
    fn a_plane_does_not_retreat() {
        let mesh = samples::grid(6, 0.0);
        for to in [23, 25, 17, 31] {
            assert_eq!(cost_of(&mesh, 24, to, 0.0), 0.0);
        }
    }

    #[test]
    fn a_tip_retreats_by_the_length_of_the_edge() {
        // A pyramid without a base: its tip collapses onto a corner; what is left is a flat square.
        let base = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
        let tip = DVec3::new(0.5, 0.5, 3.0);
        let vertices = base.into_iter().chain([tip]).map(|position| (position, DVec2::ZERO));
        let mesh = samples::mesh_of(vertices, &[[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]);
        let area = 4.0 * 0.5 * (3.0f32 * 3.0 + 0.25).sqrt();
        let expected = area * 9.0;
        let priced = cost_of(&mesh, 4, 0, 0.0);
        assert!((priced - expected).abs() < 1e-4 * expected);
        assert_eq!(cost_of(&mesh, 4, 0, 0.99 * expected), priced);
        assert_eq!(cost_of(&mesh, 4, 0, 1.01 * expected), 1.01 * expected);
        // Tried again at this cost, it stands.
        assert_eq!(cost_of(&mesh, 4, 0, priced), priced);
    }
}

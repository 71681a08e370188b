//! Cost of removing the last face of a connected component: its area times the squared distance to the remaining
//! surface.
//!
//! A quadric measures distances to planes, and a face may lie in the plane of faces that are far away. Faces are priced
//! at the start of a stage; a component that becomes a single face later waits for the next stage.

use glam::DVec3;

use crate::geometry::boxtree::{Bounds, BoxTree};
use crate::geometry::distance_sq;
use crate::mesh::ClusterMesh;

use super::witness::area_of;

/// Factor on area × squared distance. It is high because the face stands for its whole component, and the surface near
/// it may vanish, too.
const PRICE: f64 = 32.0;

/// Vertices of isolated faces, with the price of the face.
#[derive(Debug, Default)]
pub struct Loners {
    /// Sorted by vertex.
    prices: Vec<Price>,
}

impl Loners {
    /// Prices isolated faces, given as (vertex, face) sorted by vertex; the mesh must have no dead faces. Builds a tree
    /// over all faces, if there are any to price: O(n log n).
    pub fn price(&mut self, mesh: &ClusterMesh, faces: Vec<(u32, u32)>) {
        self.prices.clear();
        if faces.is_empty() {
            return;
        }
        let tree = BoxTree::new(mesh.corners.len(), |face| Bounds::around(mesh.triangle(face)));
        let mut loners: Vec<u32> = faces.iter().map(|&(_, face)| face).collect();
        loners.sort_unstable();
        let size_of = |face: u32| (area_of(mesh.triangle(face)), face);
        self.prices.extend(faces.into_iter().filter_map(|(vertex, face)| {
            let triangle = mesh.triangle(face);
            let stays_longer = |other: u32| loners.binary_search(&other).is_err() || size_of(other) > size_of(face);
            let middle = triangle.into_iter().sum::<DVec3>() / 3.0;
            let mut nearest = (f64::INFINITY, face);
            tree.nearest_sq(middle, f64::INFINITY, |other| {
                let corners = mesh.triangle(other);
                // Cheap test first: the boxes of most faces are too far away.
                if Bounds::around(corners).distance_sq(middle) > nearest.0 || !stays_longer(other) {
                    return f64::INFINITY;
                }
                let away_sq = distance_sq(middle, corners);
                if (away_sq, other) < nearest {
                    nearest = (away_sq, other);
                }
                away_sq
            });
            let (away_sq, other) = nearest;
            let price = (PRICE * area_of(triangle) * away_sq) as f32;
            price.is_finite().then(|| Price { vertex, price, neighbour: mesh.vertices(other)[0] })
        }));
    }

    fn find(&self, vertex: u32) -> Option<Price> {
        if self.prices.is_empty() {
            return None;
        }
        let at = self.prices.binary_search_by_key(&vertex, |price| price.vertex).ok()?;
        Some(self.prices[at])
    }

    /// Cost of removing the face of a vertex; `None` if the face has no price.
    pub fn price_of(&self, vertex: u32) -> Option<f32> {
        self.find(vertex).map(|found| found.price)
    }

    /// A vertex of the face nearest to the isolated face of a vertex: if that face vanishes, the price is invalid.
    pub fn neighbour_of(&self, vertex: u32) -> Option<u32> {
        self.find(vertex).map(|found| found.neighbour)
    }
}

/// The price of the face of a vertex.
#[derive(Debug, Clone, Copy)]
struct Price {
    vertex: u32,
    price: f32,
    neighbour: u32,
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::mesh::cluster::samples;

    #[test]
    fn a_face_costs_its_area_times_the_squared_distance_to_what_is_left() {
        let mut mesh = samples::grid(4, 0.0);
        let corners = [[1.0, 1.0], [2.0, 1.0], [1.0, 2.0]].map(|[x, y]| {
            let vertex = mesh.push_vertex(DVec3::new(x, y, 3.0), 0);
            mesh.push_wedge(vertex, DVec2::NAN)
        });
        mesh.push_face(corners, 0);
        let (vertex, face) = (mesh.positions.len() as u32 - 3, mesh.corners.len() as u32 - 1);
        let mut loners = Loners::default();
        loners.price(&mesh, vec![(vertex, face)]);
        assert_eq!(loners.price_of(vertex), Some((PRICE * 0.5 * 9.0) as f32));
        assert_eq!(loners.price_of(0), None);
        // The only face of a mesh has no price: no surface would remain.
        let mut single = ClusterMesh::default();
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[x, y]| {
            let vertex = single.push_vertex(DVec3::new(x, y, 0.0), 0);
            single.push_wedge(vertex, DVec2::NAN)
        });
        single.push_face(corners, 0);
        loners.price(&single, vec![(0, 0)]);
        assert_eq!(loners.price_of(0), None);
    }
}

//! Cost of removing the last face of a connected component: its area times the squared distance to the remaining
//! surface.
//!
//! A quadric measures distances to planes, and a face may lie in the plane of faces that are far away. Faces are priced
//! at the start of a stage; a component that becomes a single face later waits for the next stage.

use glam::DVec3;

use crate::geometry::boxtree::{Bounds, BoxTree};
use crate::geometry::distance_sq;
use crate::geometry::triangle::area;
use crate::mesh::{ClusterMesh, FaceId, LocalVertex};

/// Factor on area × squared distance. It is high because the face stands for its whole component, and the surface near
/// it may vanish, too.
const PRICE: f64 = 32.0;

/// An isolated face, found at one of its vertices.
#[derive(Debug, Clone, Copy)]
pub struct Loner {
    /// The vertex.
    pub vertex: LocalVertex,
    /// The face.
    pub face: FaceId,
}

/// Vertices of isolated faces, with the price of the face.
#[derive(Debug, Default)]
pub struct Loners {
    /// Sorted by vertex.
    prices: Vec<Price>,
}

impl Loners {
    /// Prices isolated faces, sorted by vertex; the mesh must have no dead faces. Builds a tree
    /// over all faces, if there are any to price: O(n log n).
    pub fn price(&mut self, mesh: &ClusterMesh, faces: Vec<Loner>) {
        self.prices.clear();
        if faces.is_empty() {
            return;
        }
        let tree = BoxTree::new(mesh.corners.len(), |face| Bounds::around(mesh.triangle(FaceId::new(face))));
        let mut loners: Vec<FaceId> = faces.iter().map(|loner| loner.face).collect();
        loners.sort_unstable();
        loners.dedup();
        let priced: Vec<Option<PricedFace>> =
            loners.iter().map(|&face| price_face(mesh, &tree, &loners, face)).collect();
        self.prices.extend(faces.into_iter().filter_map(|Loner { vertex, face }| {
            let PricedFace { price, neighbour } = priced[loners.binary_search(&face).ok()?]?;
            Some(Price { vertex, price, neighbour })
        }));
    }

    fn find(&self, vertex: LocalVertex) -> Option<Price> {
        if self.prices.is_empty() {
            return None;
        }
        let at = self.prices.binary_search_by_key(&vertex, |price| price.vertex).ok()?;
        Some(self.prices[at])
    }

    /// Cost of removing the face of a vertex; `None` if the face has no price.
    pub fn price_of(&self, vertex: LocalVertex) -> Option<f32> {
        self.find(vertex).map(|found| found.price)
    }

    /// A vertex of the face nearest to the isolated face of a vertex: if that face vanishes, the price is invalid.
    pub fn neighbour_of(&self, vertex: LocalVertex) -> Option<LocalVertex> {
        self.find(vertex).map(|found| found.neighbour)
    }
}

/// The price of an isolated face.
#[derive(Debug, Clone, Copy)]
struct PricedFace {
    price: f32,
    /// A vertex of the nearest face that stays longer.
    neighbour: LocalVertex,
}

/// Prices one of some isolated faces, which are sorted; `None` if no other face stays longer.
fn price_face(mesh: &ClusterMesh, tree: &BoxTree, loners: &[FaceId], face: FaceId) -> Option<PricedFace> {
    let size_of = |face: FaceId| (area(mesh.triangle(face)), face);
    let stays_longer = |other: FaceId| loners.binary_search(&other).is_err() || size_of(other) > size_of(face);
    let triangle = mesh.triangle(face);
    let middle = triangle.into_iter().sum::<DVec3>() / 3.0;
    let mut nearest = (f64::INFINITY, face);
    tree.nearest_sq(middle, f64::INFINITY, |other| {
        let other = FaceId::new(other);
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
    let price = (PRICE * area(triangle) * away_sq) as f32;
    price.is_finite().then(|| PricedFace { price, neighbour: mesh.vertices(other)[0] })
}

/// The price of the face of a vertex.
#[derive(Debug, Clone, Copy)]
struct Price {
    vertex: LocalVertex,
    price: f32,
    neighbour: LocalVertex,
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::{f, v};
    use crate::model::id::PartId;

    #[test]
    fn a_face_costs_its_area_times_the_squared_distance_to_what_is_left() {
        let mut mesh = samples::grid(4, 0.0);
        let corners = [[1.0, 1.0], [2.0, 1.0], [1.0, 2.0]].map(|[x, y]| {
            let vertex = mesh.push_vertex(DVec3::new(x, y, 3.0), 0);
            mesh.push_wedge(vertex, DVec2::NAN)
        });
        let (vertex, face) = (mesh.wedge_vertex[corners[0]], mesh.push_face(corners, PartId::new(0)));
        let mut loners = Loners::default();
        loners.price(&mesh, vec![Loner { vertex, face }]);
        assert_eq!(loners.price_of(vertex), Some((PRICE * 0.5 * 9.0) as f32));
        assert_eq!(loners.price_of(v(0)), None);
        // The only face of a mesh has no price: no surface would remain.
        let single = samples::mesh_of([DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| (p, DVec2::NAN)), &[[0, 1, 2]]);
        loners.price(&single, vec![Loner { vertex: v(0), face: f(0) }]);
        assert_eq!(loners.price_of(v(0)), None);
    }
}

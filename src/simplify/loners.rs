//! Cost of removing the last face of a connected component: its area times the squared distance to the remaining
//! surface.
//!
//! A quadric measures distances to planes, and a face may lie in the plane of faces that are far away. Faces are priced
//! at the start of a stage; a component that becomes a single face later waits for the next stage.

use glam::DVec3;

use crate::geometry::boxtree::{Bounds, BoxTree, END_OF_SEARCH};
use crate::geometry::distance_sq;
use crate::geometry::triangle::area;
use crate::mesh::{ClusterMesh, FaceId, LocalVertex};

/// Factor on area × squared distance. It is high because the face stands for its whole component, and the surface near
/// it may vanish, too.
const PRICE: f64 = 32.0;

/// Faces that a search for the nearest one looks at: where thousands lie across each other, a tree does not help.
const LOOKS_MAX: u32 = 1024;

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
        let areas: Vec<f64> = loners.iter().map(|&face| area(mesh.triangle(face))).collect();
        let sizes = areas.iter().zip(&loners).max_by(|a, b| a.0.total_cmp(b.0).then(a.1.cmp(b.1)));
        let Some((_, &longest)) = sizes else { return };
        let loners = SizedFaces { faces: loners, areas, longest };
        let price = |&face: &FaceId| price_face(mesh, &tree, &loners, face);
        let priced: Vec<Option<PricedFace>> = loners.faces.iter().map(price).collect();
        self.prices.extend(faces.into_iter().filter_map(|Loner { vertex, face }| {
            let PricedFace { price, neighbour } = priced[loners.faces.binary_search(&face).ok()?]?;
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

/// Isolated faces and their areas.
#[derive(Debug)]
struct SizedFaces {
    /// Ascending.
    faces: Vec<FaceId>,
    areas: Vec<f64>,
    /// The face that stays longest.
    longest: FaceId,
}

impl SizedFaces {
    /// The area of one of the faces, and the face: those with the least vanish first. `None` for another face.
    fn size_of(&self, face: FaceId) -> Option<(f64, FaceId)> {
        self.faces.binary_search(&face).ok().map(|at| (self.areas[at], face))
    }
}

/// The price of an isolated face.
#[derive(Debug, Clone, Copy)]
struct PricedFace {
    price: f32,
    /// A vertex of the nearest face that stays longer.
    neighbour: LocalVertex,
}

/// Prices one of the isolated faces; `None` if no other face stays longer. Of very many faces around its middle, the
/// first ones count, or if it outlasts them all, the isolated face that stays longest.
fn price_face(mesh: &ClusterMesh, tree: &BoxTree, loners: &SizedFaces, face: FaceId) -> Option<PricedFace> {
    let own = loners.size_of(face);
    let stays_longer = |other: FaceId| loners.size_of(other).is_none_or(|size| Some(size) > own);
    let triangle = mesh.triangle(face);
    let middle = triangle.into_iter().sum::<DVec3>() / 3.0;
    let (mut nearest, mut looks) = ((f64::INFINITY, face), 0);
    tree.nearest_sq(middle, f64::INFINITY, |other| {
        looks += 1;
        if looks > LOOKS_MAX {
            return END_OF_SEARCH;
        }
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
    if nearest.1 == face && looks > LOOKS_MAX && loners.longest != face {
        nearest = (distance_sq(middle, mesh.triangle(loners.longest)), loners.longest);
    }
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

    // The faces lie in one place; those with higher ids stay longer.
    #[test]
    fn a_face_among_very_many_is_priced_by_the_one_that_stays_longest() {
        let count = 4 * LOOKS_MAX;
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|corner| (corner, DVec2::NAN));
        let vertices = (0..count).flat_map(|_| corners);
        let faces: Vec<_> = (0..count).map(|at| [3 * at, 3 * at + 1, 3 * at + 2]).collect();
        let mesh = samples::mesh_of(vertices, &faces);
        let mut loners = Loners::default();
        loners.price(&mesh, (0..count).map(|at| Loner { vertex: v(3 * at), face: f(at) }).collect());
        assert!((0..count).all(|at| loners.price_of(v(3 * at)).is_some() == (at + 1 < count)));
        assert_eq!(loners.neighbour_of(v(6 * LOOKS_MAX)), Some(v(3 * (count - 1))));
    }
}

//! The faces around a vertex, in order, with angles, areas and normals.

use glam::DVec3;

use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::mesh::ring::{Rings, VALENCE_MAX};

/// One face around a vertex.
#[derive(Debug, Clone, Copy)]
pub struct FanFace {
    /// The face.
    pub face: FaceId,
    /// The vertex after the centre in the face, counter-clockwise.
    pub next: LocalVertex,
    /// The vertex before the centre in the face.
    pub previous: LocalVertex,
    /// Unit normal; zero for a face without area.
    pub normal: DVec3,
    /// Area.
    pub area: f64,
    /// Angle at the centre, in radians.
    pub angle: f64,
}

/// The faces around a vertex.
#[derive(Debug, Clone, Default)]
pub struct Fan {
    /// Counter-clockwise, starting at the border if there is one. Unordered where the faces do not form a single fan.
    pub spokes: Vec<FanFace>,
    /// Whether the fan is closed: the last face shares an edge with the first.
    pub is_closed: bool,
}

impl Fan {
    /// Collects and orders the faces around a vertex, including those without area.
    pub fn gather(&mut self, mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex) {
        self.collect(mesh, rings, vertex);
        self.sort();
    }

    /// Collects the faces around a vertex, ordered by id; does not set `is_closed`.
    pub fn collect(&mut self, mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex) {
        self.spokes.clear();
        self.spokes.extend(rings.living(mesh, vertex).map(|corner| {
            let [next, previous] = mesh.others_of(corner);
            let [to_next, to_previous] = [next, previous].map(|end| mesh.positions[end] - mesh.positions[vertex]);
            let across = to_next.cross(to_previous);
            let double_area = across.length();
            let angle = libm::atan2(double_area, to_next.dot(to_previous));
            let normal = if double_area > 0.0 { across / double_area } else { DVec3::ZERO };
            FanFace { face: corner.face(), next, previous, normal, area: 0.5 * double_area, angle }
        }));
    }

    /// Orders the faces so that each begins with the last edge of the previous one.
    fn sort(&mut self) {
        if self.spokes.len() > VALENCE_MAX {
            return self.sort_many();
        }
        let spokes = &mut self.spokes;
        let start = (0..spokes.len()).find(|&i| !spokes.iter().any(|s| s.previous == spokes[i].next));
        self.is_closed = start.is_none() && !spokes.is_empty();
        if let Some(start) = start {
            spokes.swap(0, start);
        }
        for i in 1..spokes.len() {
            let Some(k) = (i..spokes.len()).find(|&k| spokes[k].next == spokes[i - 1].previous) else {
                self.is_closed = false;
                return;
            };
            spokes.swap(i, k);
        }
        self.is_closed &= spokes.last().is_some_and(|last| last.previous == spokes[0].next);
    }

    /// The same for very many faces, in O(n log n): looks edges up instead of comparing all pairs of faces. Faces that do
    /// not form a single fan stay as they are.
    fn sort_many(&mut self) {
        self.is_closed = false;
        let mut begins: Vec<(LocalVertex, usize)> =
            self.spokes.iter().enumerate().map(|(at, spoke)| (spoke.next, at)).collect();
        let mut ends: Vec<LocalVertex> = self.spokes.iter().map(|spoke| spoke.previous).collect();
        begins.sort_unstable();
        ends.sort_unstable();
        if begins.windows(2).any(|pair| pair[0].0 == pair[1].0) || ends.windows(2).any(|pair| pair[0] == pair[1]) {
            return;
        }
        let beginning_at = |end: LocalVertex| begins.binary_search_by_key(&end, |&(next, _)| next).ok();
        let first = self.spokes.iter().position(|spoke| ends.binary_search(&spoke.next).is_err());
        let mut sorted = Vec::with_capacity(self.spokes.len());
        let mut at = Some(first.unwrap_or(0));
        while let Some(spoke) = at.filter(|_| sorted.len() < begins.len()).map(|at| self.spokes[at]) {
            sorted.push(spoke);
            at = beginning_at(spoke.previous).map(|found| begins[found].1).filter(|&at| at != first.unwrap_or(0));
        }
        if sorted.len() == begins.len() {
            self.is_closed = first.is_none();
            self.spokes = sorted;
        }
    }

    /// Each pair of consecutive faces that share an edge at the centre, and the other end of this edge.
    pub fn joints(&self) -> impl Iterator<Item = (&FanFace, &FanFace, LocalVertex)> {
        let count = self.spokes.len();
        let pairs = (0..count).map(move |i| (&self.spokes[i], &self.spokes[(i + 1) % count]));
        pairs.filter(|(a, b)| a.face != b.face && a.previous == b.next).map(|(a, b)| (a, b, a.previous))
    }

    /// Total area of the faces.
    pub fn area(&self) -> f64 {
        self.spokes.iter().map(|spoke| spoke.area).sum()
    }
}

/// Angle between two unit vectors, in radians.
pub fn angle_between(a: DVec3, b: DVec3) -> f64 {
    libm::atan2(a.cross(b).length(), a.dot(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::v;

    fn fan(mesh: &ClusterMesh, vertex: LocalVertex) -> Fan {
        let (mut rings, mut fan) = (Rings::default(), Fan::default());
        rings.build(mesh);
        fan.gather(mesh, &rings, vertex);
        fan
    }

    #[test]
    fn the_fan_inside_a_grid_closes_and_that_on_its_rim_does_not() {
        let mesh = samples::grid(2, 0.0);
        let inside = fan(&mesh, v(4));
        assert!(inside.is_closed);
        assert_eq!(inside.joints().count(), 6);
        assert!((inside.area() - 3.0).abs() < 1e-12);
        assert!((inside.spokes.iter().map(|s| s.angle).sum::<f64>() - std::f64::consts::TAU).abs() < 1e-12);
        let rim = fan(&mesh, v(1));
        assert!(!rim.is_closed);
        assert_eq!(rim.joints().count(), rim.spokes.len() - 1);
    }

    /// The mesh with its faces in another order.
    fn shuffled(mut mesh: ClusterMesh) -> ClusterMesh {
        mesh.corner_vertices.raw.sort_by_key(|face| face[1].number().wrapping_mul(0x9e37_79b9));
        mesh.corners.raw.sort_by_key(|face| face[1].number().wrapping_mul(0x9e37_79b9));
        mesh
    }

    // All pairs of 200,000 faces would take minutes.
    #[test]
    fn a_fan_of_very_many_faces_is_ordered_as_one_of_few() {
        for count in [100, 300, 200_000] {
            let mut mesh = shuffled(samples::disc(count));
            let closed = fan(&mesh, v(0));
            assert!(closed.is_closed);
            assert_eq!(closed.joints().count(), count as usize);
            mesh.kill(FaceId::new(7));
            let open = fan(&mesh, v(0));
            assert!(!open.is_closed);
            assert_eq!(open.joints().count(), count as usize - 2);
        }
    }

    #[test]
    fn a_fan_of_very_many_faces_with_two_at_one_place_stays_unordered() {
        let mut mesh = samples::disc(300);
        samples::add_faces(&mut mesh, &[[0, 9, 10]]);
        let fan = fan(&mesh, v(0));
        assert!(!fan.is_closed && fan.spokes.is_sorted_by_key(|spoke| spoke.face));
    }
}

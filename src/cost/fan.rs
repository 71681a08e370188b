//! The faces around a vertex, in order, with angles, areas and normals.

use glam::DVec3;

use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::mesh::ring::Rings;

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
}

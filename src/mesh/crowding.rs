//! How crowded with seams a mesh will be once it has fewer faces.

use std::ops::AddAssign;

use super::cluster::ClusterMesh;

/// Length of the seams, area and faces of a mesh, or of samples of it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SeamTally {
    length: f64,
    area: f64,
    faces: u64,
}

impl SeamTally {
    /// Measures a mesh without dead faces; an edge on its rim is no seam. O(faces × log faces).
    pub fn of(mesh: &ClusterMesh) -> Self {
        let faces = 0..mesh.corners.len() as u32;
        let mut edges: Vec<[u32; 4]> = faces.clone().flat_map(|face| edges_of(mesh, face)).collect();
        edges.sort_unstable();
        let mut length = 0.0;
        for edge in edges.chunk_by(|a, b| a[..2] == b[..2]) {
            if edge.iter().any(|side| side[2..] != edge[0][2..]) {
                let [a, b] = [edge[0][0], edge[0][1]].map(|vertex| mesh.positions[vertex as usize]);
                length += a.distance(b);
            }
        }
        let area = faces.map(|face| {
            let [a, b, c] = mesh.triangle(face);
            0.5 * (b - a).cross(c - a).length()
        });
        Self { length, area: area.sum(), faces: mesh.corners.len() as u64 }
    }

    /// Share of the vertices that would lie on seams if `kept` of the faces were left and all their edges were equally
    /// long; above 1 where the seams have bends for which there are not vertices enough.
    ///
    /// n equilateral faces of area A have edges of √(4 A / √3 n) and n / 2 vertices; seams of length L so have ⁴√3 L / √(A n) of them.
    pub fn crowding(&self, kept: f64) -> f64 {
        match self.length > 0.0 {
            true => 3f64.sqrt().sqrt() * self.length / (self.area * self.faces as f64 * kept).sqrt(),
            false => 0.0,
        }
    }
}

impl AddAssign for SeamTally {
    fn add_assign(&mut self, other: Self) {
        self.length += other.length;
        self.area += other.area;
        self.faces += other.faces;
    }
}

/// The edges of a face: both vertices, the smaller first, and their wedges.
fn edges_of(mesh: &ClusterMesh, face: u32) -> [[u32; 4]; 3] {
    let (vertices, wedges) = (mesh.vertices(face), mesh.corners[face as usize]);
    [(0, 1), (1, 2), (2, 0)].map(|(i, j)| match vertices[i] < vertices[j] {
        true => [vertices[i], vertices[j], wedges[i], wedges[j]],
        false => [vertices[j], vertices[i], wedges[j], wedges[i]],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;

    #[test]
    fn seams_are_measured_and_rims_are_not() {
        assert_eq!(SeamTally::of(&samples::grid(4, 0.0)).crowding(0.1), 0.0);
        let tally = SeamTally::of(&samples::two_charts(4));
        assert_eq!((tally.length, tally.area, tally.faces), (4.0, 16.0, 32));
        assert_eq!(SeamTally::default().crowding(0.1), 0.0);
    }

    #[test]
    fn a_seam_of_as_many_vertices_as_there_are_crowds_everything() {
        // 100 faces of area 1 that lose nothing: an edge is 1.52 long, and 50 vertices are on 76 of length.
        let tally = SeamTally { length: 75.98, area: 100.0, faces: 100 };
        assert!((tally.crowding(1.0) - 1.0).abs() < 1e-3, "{}", tally.crowding(1.0));
        assert!((tally.crowding(0.25) - 2.0).abs() < 1e-3);
        assert_eq!(tally.crowding(0.0), f64::INFINITY);
    }
}

//! The corners around each vertex, as compressed sparse rows.

use super::cluster::{ClusterMesh, DEAD};

/// Corners (3 × face + place) at each vertex; rows of vertices that a collapse joined are stale until the next build.
#[derive(Debug, Clone, Default)]
pub struct Rings {
    offsets: Vec<u32>,
    corners: Vec<u32>,
}

impl Rings {
    /// Builds the rows for all living faces. O(faces).
    pub fn build(&mut self, mesh: &ClusterMesh) {
        self.offsets.clear();
        self.offsets.resize(mesh.positions.len() + 1, 0);
        let is_living = |corners: &[u32; 3]| corners[0] != DEAD;
        for (_, vertices) in mesh.corners.iter().zip(&mesh.corner_vertices).filter(|(corners, _)| is_living(corners)) {
            for &vertex in vertices {
                self.offsets[vertex as usize] += 1;
            }
        }
        let mut total = 0;
        for offset in &mut self.offsets {
            total += *offset;
            *offset = total;
        }
        self.corners.clear();
        self.corners.resize(total as usize, 0);
        for face in (0..mesh.corners.len()).rev().filter(|&face| is_living(&mesh.corners[face])) {
            for k in (0..3).rev() {
                let offset = &mut self.offsets[mesh.corner_vertices[face][k] as usize];
                *offset -= 1;
                self.corners[*offset as usize] = (3 * face + k) as u32;
            }
        }
    }

    /// Corners at a vertex, ascending; the faces of some may have died since the build.
    #[inline]
    pub fn of(&self, vertex: u32) -> &[u32] {
        &self.corners[self.offsets[vertex as usize] as usize..self.offsets[vertex as usize + 1] as usize]
    }

    /// Living faces around a vertex, ascending.
    #[inline]
    pub fn faces<'a>(&'a self, mesh: &'a ClusterMesh, vertex: u32) -> impl Iterator<Item = u32> + Clone + 'a {
        self.of(vertex).iter().map(|corner| corner / 3).filter(|&face| !mesh.is_dead(face))
    }
}

#[cfg(test)]
mod tests {
    use super::super::cluster::samples;
    use super::*;

    #[test]
    fn an_inner_grid_vertex_has_six_faces() {
        let mesh = samples::grid(3, 0.0);
        let mut rings = Rings::default();
        rings.build(&mesh);
        assert_eq!(rings.of(5).len(), 6);
        assert_eq!(rings.of(0), &[0, 3]);
        assert!(rings.of(5).is_sorted());
        assert!(rings.of(5).iter().all(|&corner| mesh.vertex_of(corner) == 5));
    }
}

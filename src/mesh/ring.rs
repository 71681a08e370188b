//! The faces around each vertex, as compressed sparse rows.

use super::cluster::{ClusterMesh, DEAD};

/// Faces around each vertex; rows of vertices that a collapse joined are stale until the next build.
#[derive(Debug, Clone, Default)]
pub struct Rings {
    offsets: Vec<u32>,
    faces: Vec<u32>,
}

impl Rings {
    /// Builds the rows for all living faces. O(faces).
    pub fn build(&mut self, mesh: &ClusterMesh) {
        self.offsets.clear();
        self.offsets.resize(mesh.positions.len() + 1, 0);
        for corners in mesh.corners.iter().filter(|corners| corners[0] != DEAD) {
            for &wedge in corners {
                self.offsets[mesh.wedge_vertex[wedge as usize] as usize] += 1;
            }
        }
        let mut total = 0;
        for offset in &mut self.offsets {
            total += *offset;
            *offset = total;
        }
        self.faces.clear();
        self.faces.resize(total as usize, 0);
        for (face, corners) in mesh.corners.iter().enumerate().rev().filter(|(_, corners)| corners[0] != DEAD) {
            for &wedge in corners {
                let offset = &mut self.offsets[mesh.wedge_vertex[wedge as usize] as usize];
                *offset -= 1;
                self.faces[*offset as usize] = face as u32;
            }
        }
    }

    /// Faces around a vertex, in order of their ids; some may have died since the build.
    #[inline]
    pub fn of(&self, vertex: u32) -> &[u32] {
        &self.faces[self.offsets[vertex as usize] as usize..self.offsets[vertex as usize + 1] as usize]
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
        assert_eq!(rings.of(0), &[0, 1]);
        assert!(rings.of(5).is_sorted());
    }
}

//! The vertices around those that a round of collapses changed.
//!
//! # Memory
//! 4 bytes a vertex.

use crate::mesh::cluster::ClusterMesh;
use crate::mesh::ring::Rings;

/// Finds neighbourhoods; remembers which vertices the search under way has met.
#[derive(Debug, Default)]
pub struct Around {
    /// Search that last met each vertex.
    met: Vec<u32>,
    search: u32,
}

impl Around {
    /// Makes room for the vertices of a mesh.
    pub fn resize(&mut self, vertex_count: usize) {
        self.met.resize(vertex_count, 0);
    }

    /// Appends the vertices of all faces around some vertices, each once.
    pub fn collect(&mut self, mesh: &ClusterMesh, rings: &Rings, vertices: &[u32], out: &mut Vec<u32>) {
        self.search += 1;
        for &centre in vertices {
            for vertex in rings.faces(mesh, centre).flat_map(|face| mesh.vertices(face)) {
                if std::mem::replace(&mut self.met[vertex as usize], self.search) != self.search {
                    out.push(vertex);
                }
            }
        }
    }
}

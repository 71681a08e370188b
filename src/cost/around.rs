//! Collects the one-rings of the vertices that a round of collapses changed.

use crate::mesh::cluster::ClusterMesh;
use crate::mesh::ring::Rings;

/// Collects one-rings without duplicates.
#[derive(Debug, Default)]
pub struct Around {
    /// Number of the search that last met each vertex.
    met: Vec<u32>,
    search: u32,
}

impl Around {
    /// Sets the number of vertices of the mesh.
    pub fn resize(&mut self, vertex_count: usize) {
        self.met.resize(vertex_count, 0);
    }

    /// Appends all vertices of the faces around `vertices` to `out`, each once.
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

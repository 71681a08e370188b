//! Collects the one-rings of the vertices that a round of collapses changed.

use crate::base::id::TiVec;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::LocalVertex;
use crate::mesh::ring::Rings;

/// Collects one-rings without duplicates.
#[derive(Debug, Default)]
pub struct Around {
    /// Number of the search that last met each vertex.
    met: TiVec<LocalVertex, u32>,
    search: u32,
}

impl Around {
    /// Sets the number of vertices of the mesh.
    pub fn resize(&mut self, vertex_count: usize) {
        self.met.resize(vertex_count, 0);
    }

    /// Appends all vertices of the faces around `vertices` to `out`, each once.
    pub fn collect(&mut self, mesh: &ClusterMesh, rings: &Rings, vertices: &[LocalVertex], out: &mut Vec<LocalVertex>) {
        self.search += 1;
        for &centre in vertices {
            for vertex in rings.faces(mesh, centre).flat_map(|face| mesh.vertices(face)) {
                if std::mem::replace(&mut self.met[vertex], self.search) != self.search {
                    out.push(vertex);
                }
            }
        }
    }
}

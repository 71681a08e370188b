//! Rebuilds a mesh from the faces that are left of it.

use std::collections::HashMap;

use glam::DVec2;

use super::cluster::ClusterMesh;

/// A mesh without unused vertices and wedges, and where its vertices and wedges come from.
#[derive(Debug)]
pub struct Compacted {
    /// The mesh, with linked wedges. Wedges of a vertex with the same texture coordinate and label are one.
    pub mesh: ClusterMesh,
    /// Vertex of the old mesh for each vertex.
    pub vertices: Vec<u32>,
    /// Wedge of the old mesh for each wedge.
    pub wedges: Vec<u32>,
}

/// Rebuilds a mesh without dead faces. `label_of` returns the label of a part, which wedges do not share.
pub fn compact(mesh: &ClusterMesh, label_of: impl Fn(u32) -> u32) -> Compacted {
    let mut compacted = Compacted { mesh: ClusterMesh::default(), vertices: Vec::new(), wedges: Vec::new() };
    let mut vertex_of = vec![u32::MAX; mesh.positions.len()];
    let mut wedge_of = vec![u32::MAX; mesh.wedge_vertex.len()];
    let mut known: HashMap<(u32, u32, [u64; 2]), u32> = HashMap::new();
    for (face, corners) in mesh.corners.iter().enumerate() {
        let label = label_of(mesh.parts[face]);
        let corners = corners.map(|wedge| {
            let vertex = mesh.wedge_vertex[wedge as usize];
            if vertex_of[vertex as usize] == u32::MAX {
                let position = mesh.positions[vertex as usize];
                vertex_of[vertex as usize] = compacted.mesh.push_vertex(position, 0);
                compacted.vertices.push(vertex);
            }
            if wedge_of[wedge as usize] == u32::MAX {
                let (vertex, uv) = (vertex_of[vertex as usize], mesh.wedge_uv[wedge as usize]);
                wedge_of[wedge as usize] = *known.entry((vertex, label, bits_of(uv))).or_insert_with(|| {
                    compacted.wedges.push(wedge);
                    compacted.mesh.push_wedge(vertex, uv)
                });
            }
            wedge_of[wedge as usize]
        });
        compacted.mesh.push_face(corners, mesh.parts[face]);
        compacted.mesh.deviations[face] = mesh.deviations[face];
    }
    compacted.mesh.link_wedges();
    compacted
}

fn bits_of(uv: DVec2) -> [u64; 2] {
    uv.to_array().map(f64::to_bits)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;

    #[test]
    fn what_no_face_uses_goes_and_the_rest_stays() {
        let mut mesh = samples::two_charts(4);
        let faces = mesh.corners.len();
        for face in 0..faces as u32 / 2 {
            mesh.kill(face);
        }
        mesh.compact_faces();
        let Compacted { mesh: small, vertices, wedges } = compact(&mesh, |part| part);
        assert_eq!(small.corners.len(), faces - faces / 2);
        assert!(small.positions.len() < mesh.positions.len());
        for face in 0..small.corners.len() as u32 {
            assert_eq!(small.triangle(face), mesh.triangle(face));
            assert_eq!(small.uv_triangle(face), mesh.uv_triangle(face));
        }
        assert!(vertices.iter().zip(&small.positions).all(|(&old, &at)| mesh.positions[old as usize] == at));
        assert!(wedges.iter().zip(&small.wedge_uv).all(|(&old, &uv)| mesh.wedge_uv[old as usize] == uv));
    }

    #[test]
    fn wedges_that_came_to_one_place_are_one() {
        let mut mesh = samples::two_charts(3);
        mesh.wedge_uv.fill(DVec2::ONE);
        let compacted = compact(&mesh, |_| 0);
        assert_eq!(compacted.mesh.wedge_vertex.len(), compacted.mesh.positions.len());
        let apart = compact(&mesh, |part| part);
        assert!(apart.mesh.wedge_vertex.len() >= compacted.mesh.wedge_vertex.len());
    }
}

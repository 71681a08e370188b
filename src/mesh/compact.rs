//! Rebuilds a mesh from the faces that are left of it.

use std::collections::HashMap;
use std::hash::Hash;

use foldhash::fast::RandomState;
use glam::DVec2;

use super::cluster::ClusterMesh;
use super::id::{LocalVertex, Wedge};
use crate::base::id::TiVec;
use crate::model::id::PartId;

/// A mesh without unused vertices and wedges, and where its vertices and wedges come from.
#[derive(Debug)]
pub struct Compacted {
    /// The mesh, with linked wedges. Wedges of a vertex with the same texture coordinate and label are one.
    pub mesh: ClusterMesh,
    /// Vertex of the old mesh for each vertex.
    pub vertices: TiVec<LocalVertex, LocalVertex>,
    /// Wedge of the old mesh for each wedge.
    pub wedges: TiVec<Wedge, Wedge>,
}

/// Rebuilds a mesh without dead faces. `label_of` returns the label of a part, which wedges do not share.
pub fn compact<L: Copy + Eq + Hash>(mesh: &ClusterMesh, label_of: impl Fn(PartId) -> L) -> Compacted {
    let mut compacted = Compacted { mesh: ClusterMesh::default(), vertices: TiVec::new(), wedges: TiVec::new() };
    let mut vertex_of = mesh.per_vertex(LocalVertex::NONE);
    let mut wedge_of = mesh.per_wedge(Wedge::NONE);
    let mut known: HashMap<(LocalVertex, L, [u64; 2]), Wedge, RandomState> = HashMap::default();
    for face in mesh.face_ids() {
        let (part, label) = (mesh.parts[face], label_of(mesh.parts[face]));
        let corners = mesh.corners[face].map(|wedge| {
            let vertex = mesh.wedge_vertex[wedge];
            if vertex_of[vertex] == LocalVertex::NONE {
                vertex_of[vertex] = compacted.mesh.push_vertex(mesh.positions[vertex], 0);
                compacted.vertices.push(vertex);
            }
            if wedge_of[wedge] == Wedge::NONE {
                let (vertex, uv) = (vertex_of[vertex], mesh.wedge_uv[wedge]);
                wedge_of[wedge] = *known.entry((vertex, label, bits_of(uv))).or_insert_with(|| {
                    compacted.wedges.push(wedge);
                    compacted.mesh.push_wedge(vertex, uv)
                });
            }
            wedge_of[wedge]
        });
        let copy = compacted.mesh.push_face(corners, part);
        compacted.mesh.deviations[copy] = mesh.deviations[face];
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
        mesh.face_ids().take(faces / 2).for_each(|face| mesh.kill(face));
        mesh.compact_faces();
        let Compacted { mesh: small, vertices, wedges } = compact(&mesh, |part| part);
        assert_eq!(small.corners.len(), faces - faces / 2);
        assert!(small.positions.len() < mesh.positions.len());
        for face in small.face_ids() {
            assert_eq!(small.triangle(face), mesh.triangle(face));
            assert_eq!(small.uv_triangle(face), mesh.uv_triangle(face));
        }
        assert!(vertices.iter().zip(&small.positions).all(|(&old, &at)| mesh.positions[old] == at));
        assert!(wedges.iter().zip(&small.wedge_uv).all(|(&old, &uv)| mesh.wedge_uv[old] == uv));
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

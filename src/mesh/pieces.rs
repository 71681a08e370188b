//! Removes connected components that are smaller than the error of the result.

use std::collections::BTreeMap;

use glam::DVec3;

use super::cluster::ClusterMesh;
use super::forest::DisjointSets;
use super::id::{FaceId, LocalVertex};

/// Removes connected components (faces connected through vertices) whose bounding box has a diagonal below `diagonal`,
/// in units of length. Removes the smallest first, and at most `faces_max` faces in total. A component that another
/// cluster shares stays. Returns the number of components and of faces removed.
pub fn drop_small(mesh: &mut ClusterMesh, diagonal: f64, faces_max: u64) -> (u64, u64) {
    let mut sets = DisjointSets::<LocalVertex>::new(mesh.positions.len());
    for &[a, b, c] in &mesh.corner_vertices {
        sets.join(a, b);
        sets.join(b, c);
    }
    let mut boxes = mesh.per_vertex((DVec3::INFINITY, DVec3::NEG_INFINITY));
    let mut is_shared = mesh.per_vertex(false);
    for (v, &position) in mesh.positions.iter_enumerated() {
        let piece = sets.root(v);
        let (low, high) = boxes[piece];
        boxes[piece] = (low.min(position), high.max(position));
        is_shared[piece] |= mesh.is_shared(v);
    }
    let size_of = |piece: LocalVertex| boxes[piece].0.distance(boxes[piece].1);
    let mut pieces = BTreeMap::<LocalVertex, Vec<FaceId>>::new();
    for face in mesh.face_ids() {
        let piece = sets.root(mesh.vertices(face)[0]);
        if !is_shared[piece] && size_of(piece) < diagonal {
            pieces.entry(piece).or_default().push(face);
        }
    }
    let mut pieces: Vec<(LocalVertex, Vec<FaceId>)> = pieces.into_iter().collect();
    pieces.sort_by(|a, b| size_of(a.0).total_cmp(&size_of(b.0)));
    let (mut dropped, mut faces_dropped) = (0, 0);
    for (_, faces) in pieces {
        if faces_dropped + faces.len() as u64 > faces_max {
            break;
        }
        dropped += 1;
        faces_dropped += faces.len() as u64;
        faces.into_iter().for_each(|face| mesh.kill(face));
    }
    mesh.compact_faces();
    (dropped, faces_dropped)
}

#[cfg(test)]
mod tests {
    use super::super::cluster::samples;
    use super::*;
    use crate::model::id::PartId;
    use glam::DVec2;

    //  a grid of 4 × 4 and, beside it, a triangle of size 0.1
    #[test]
    fn a_small_piece_goes_and_the_rest_stays() {
        let mut mesh = samples::grid(4, 0.0);
        let small = [[9.0, 9.0], [9.1, 9.0], [9.0, 9.1]].map(|[x, y]| {
            let vertex = mesh.push_vertex(DVec3::new(x, y, 0.0), 0);
            mesh.push_wedge(vertex, DVec2::ZERO)
        });
        mesh.push_face(small, PartId::new(0));
        mesh.link_wedges();
        assert_eq!(drop_small(&mut mesh.clone(), 0.05, 99), (0, 0));
        assert_eq!(drop_small(&mut mesh.clone(), 0.5, 0), (0, 0));
        assert_eq!(drop_small(&mut mesh, 0.5, 1), (1, 1));
        assert_eq!(mesh.face_count, 32);
    }
}

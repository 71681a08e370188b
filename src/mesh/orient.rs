//! Turns over faces that disagree with their neighbours while a cluster is processed.
//!
//! ```text
//!      c           Both faces run from b to c: one of them is turned over. Classes, one-rings and chains depend on the
//!     /|\          direction of faces, so the faces of a surface must agree during processing; afterwards each face
//!    a-|-d         gets its input direction back. A one-sided surface (a Möbius strip) keeps some edges where faces
//!     \|/          disagree.
//!      b
//! ```
//! A collapse merges the two surviving edges of a dying face into one. Its faces agree if they agreed at both edges or
//! at neither, so the number of edges where faces disagree never grows.

use super::cluster::ClusterMesh;

const NONE: u32 = u32::MAX;

/// Turns faces over so that the two faces of each edge run along it in opposite directions, wherever that is possible.
/// Edges of three faces or more do not count; the first face of each surface stays. No face may be dead. O(n), plus
/// sorting at each vertex; 24 bytes a face and 4 a vertex.
pub fn orient(mesh: &mut ClusterMesh) {
    let twins = twins(mesh);
    let mut is_known = vec![false; mesh.corners.len()];
    let mut front = Vec::new();
    for first in 0..mesh.corners.len() as u32 {
        if std::mem::replace(&mut is_known[first as usize], true) {
            continue;
        }
        front.push(first);
        while let Some(face) = front.pop() {
            for half in 3 * face..3 * face + 3 {
                let twin = twins[half as usize];
                if twin == NONE || std::mem::replace(&mut is_known[twin as usize / 3], true) {
                    continue;
                }
                // Corners are swapped only at the end: both half-edges still have their input direction.
                let runs_alike = mesh.vertex_of(half) == mesh.vertex_of(twin);
                mesh.is_turned[twin as usize / 3] = mesh.is_turned[face as usize] != runs_alike;
                front.push(twin / 3);
            }
        }
    }
    swap_turned(mesh);
}

/// Restores the input direction of every face.
pub fn restore(mesh: &mut ClusterMesh) {
    swap_turned(mesh);
    mesh.is_turned.fill(false);
}

fn swap_turned(mesh: &mut ClusterMesh) {
    for face in (0..mesh.corners.len()).filter(|&face| mesh.is_turned[face]) {
        mesh.corners[face].swap(1, 2);
        mesh.corner_vertices[face].swap(1, 2);
    }
}

/// The twin of each half-edge, or [`NONE`] if its edge does not have exactly two faces. A half-edge is named by the
/// corner at which it begins.
fn twins(mesh: &ClusterMesh) -> Vec<u32> {
    let count = 3 * mesh.corners.len() as u32;
    let ends = |half: u32| {
        let (a, b) = (mesh.vertex_of(half), mesh.vertex_of(ClusterMesh::following(half)[0]));
        [a.min(b), a.max(b)]
    };
    // Buckets the half-edges by their lower end; `places` holds the bucket starts, and after the loop the bucket ends.
    let mut places = vec![0u32; mesh.positions.len() + 1];
    (0..count).for_each(|half| places[ends(half)[0] as usize + 1] += 1);
    (1..places.len()).for_each(|vertex| places[vertex] += places[vertex - 1]);
    let mut halves = vec![0; count as usize];
    for half in 0..count {
        let place = &mut places[ends(half)[0] as usize];
        halves[*place as usize] = half;
        *place += 1;
    }
    let (mut twins, mut start) = (vec![NONE; count as usize], 0);
    let mut spokes: Vec<(u32, u32)> = Vec::new();
    for &end in &places[..mesh.positions.len()] {
        spokes.clear();
        spokes.extend(halves[start..end as usize].iter().map(|&half| (ends(half)[1], half)));
        spokes.sort_unstable();
        for edge in spokes.chunk_by(|a, b| a.0 == b.0) {
            if let &[(_, a), (_, b)] = edge {
                (twins[a as usize], twins[b as usize]) = (b, a);
            }
        }
        start = end as usize;
    }
    twins
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;
    use crate::mesh::{Class, Rings, class};

    fn classes(mesh: &ClusterMesh) -> (bool, Vec<Class>) {
        let (mut rings, mut classes) = (Rings::default(), Vec::new());
        rings.build(mesh);
        (class::classify(mesh, &rings, &mut classes), classes)
    }

    fn turn(mesh: &mut ClusterMesh, face: usize) {
        mesh.corners[face].swap(1, 2);
        mesh.corner_vertices[face].swap(1, 2);
    }

    #[test]
    fn a_surface_with_faces_that_show_their_backs_has_the_classes_of_one_without() {
        let whole = samples::two_charts(6);
        let mut torn = whole.clone();
        (0..72).filter(|face| face % 5 == 3 || face % 7 == 1).for_each(|face| turn(&mut torn, face));
        let came = torn.corners.clone();
        assert!(classes(&torn).0);
        assert_ne!(classes(&torn).1, classes(&whole).1);
        orient(&mut torn);
        assert!(!classes(&torn).0);
        assert_eq!(classes(&torn).1, classes(&whole).1);
        restore(&mut torn);
        assert_eq!(torn.corners, came);
        assert!(!torn.is_turned.contains(&true));
    }

    #[test]
    fn faces_keep_what_they_are_when_others_die() {
        let mut mesh = samples::grid(2, 0.0);
        turn(&mut mesh, 5);
        let came = mesh.corners[5];
        orient(&mut mesh);
        mesh.kill(2);
        mesh.compact_faces();
        restore(&mut mesh);
        assert_eq!(mesh.corners[4], came);
    }

    //  0-2-4-(1)    a Möbius strip of five faces
    //  |/|/|/
    //  1-3-(0)
    #[test]
    fn a_surface_with_one_side_keeps_an_edge_where_it_shows_its_back() {
        let mut mesh = ClusterMesh::default();
        for i in 0..5 {
            let vertex = mesh.push_vertex(glam::DVec3::new(f64::from(i), f64::from(i * i), 1.0), 0);
            mesh.push_wedge(vertex, glam::DVec2::NAN);
        }
        for i in 0..5 {
            mesh.push_face([i, (i + 1) % 5, (i + 2) % 5], 0);
        }
        mesh.link_wedges();
        orient(&mut mesh);
        assert!(classes(&mesh).0);
    }
}

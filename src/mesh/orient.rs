//! Faces that run against their neighbours are turned over for as long as a cluster is worked on.
//!
//! ```text
//!      c           Both faces run from b to c: one of them shows its back. Classes, rings and chains ask which
//!     /|\          way a face runs, so all of a surface must run one way there; each face is given back as it
//!    a-|-d         came. Where a surface has one side only (a Möbius strip), some edge remains as it is.
//!     \|/
//!      b
//! ```
//! A collapse joins two edges of a face that dies into one. Its faces run one way if both edges did or neither: edges
//! along which faces run the same way never become more.

use super::cluster::ClusterMesh;

const NONE: u32 = u32::MAX;

/// Turns faces over until two that share an edge, which no third one has, run along it in opposite directions, wherever
/// there is such a choice; the first face of each surface stays. No face may be dead. O(n) but for hubs,
/// 24 bytes a face and 4 a vertex.
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
                // Faces are only marked so far: half-edges lie as they came.
                let runs_alike = mesh.vertex_of(half) == mesh.vertex_of(twin);
                mesh.is_turned[twin as usize / 3] = mesh.is_turned[face as usize] != runs_alike;
                front.push(twin / 3);
            }
        }
    }
    swap_turned(mesh);
}

/// Gives every face back as it came.
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

/// The other half-edge of each edge of two faces; a half-edge is named by the corner where it begins.
fn twins(mesh: &ClusterMesh) -> Vec<u32> {
    let count = 3 * mesh.corners.len() as u32;
    let ends = |half: u32| {
        let (a, b) = (mesh.vertex_of(half), mesh.vertex_of(ClusterMesh::following(half)[0]));
        [a.min(b), a.max(b)]
    };
    // The half-edges of each vertex that is the lower end, vertex after vertex; each vertex's begin where the one before ends.
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

    //  0-2-4-(1)    a strip of five faces whose end is joined to its beginning the wrong way round
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

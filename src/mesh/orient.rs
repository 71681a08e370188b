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
use super::id::{Corner, LocalVertex};
use super::ring::Rings;
use crate::base::id::TiVec;

/// Turns faces over so that the two faces of each edge run along it in opposite directions, wherever that is possible.
/// Edges of three faces or more do not count; the first face of each surface stays. No face may be dead. Returns the
/// vertices of the faces that were turned over, ascending; their rings are outdated. O(n); 17 bytes a face and 13 a
/// vertex.
pub fn orient(mesh: &mut ClusterMesh, rings: &Rings) -> Vec<LocalVertex> {
    let twins = twins(mesh, rings);
    let mut is_known = mesh.per_face(false);
    let mut front = Vec::new();
    for first in mesh.face_ids() {
        if std::mem::replace(&mut is_known[first], true) {
            continue;
        }
        front.push(first);
        while let Some(face) = front.pop() {
            for half in face.corners() {
                let Some(twin) = twins[half].some() else { continue };
                let other = twin.face();
                if std::mem::replace(&mut is_known[other], true) {
                    continue;
                }
                // Corners are swapped only at the end: both half-edges still have their input direction.
                let runs_alike = mesh.vertex_of(half) == mesh.vertex_of(twin);
                mesh.is_turned[other] = mesh.is_turned[face] != runs_alike;
                front.push(other);
            }
        }
    }
    swap_turned(mesh);
    let mut is_of_turned = mesh.per_vertex(false);
    for face in mesh.face_ids().filter(|&face| mesh.is_turned[face]) {
        mesh.vertices(face).into_iter().for_each(|vertex| is_of_turned[vertex] = true);
    }
    mesh.vertex_ids().filter(|&vertex| is_of_turned[vertex]).collect()
}

/// Restores the input direction of every face.
pub fn restore(mesh: &mut ClusterMesh) {
    swap_turned(mesh);
    mesh.is_turned.fill(false);
}

fn swap_turned(mesh: &mut ClusterMesh) {
    for face in mesh.face_ids().filter(|&face| mesh.is_turned[face]) {
        mesh.corners[face].swap(1, 2);
        mesh.corner_vertices[face].swap(1, 2);
    }
}

/// The half-edges seen so far between a vertex and one after it.
#[derive(Debug, Clone, Copy)]
struct SeenEdge {
    /// The lower vertex.
    from: LocalVertex,
    first: Corner,
    count: u32,
}

/// The twin of each half-edge, or [`Corner::NONE`] if its edge does not have exactly two faces. A half-edge is named by the
/// corner at which it begins.
fn twins(mesh: &ClusterMesh, rings: &Rings) -> TiVec<Corner, Corner> {
    let mut twins: TiVec<Corner, Corner> = vec![Corner::NONE; 4 * mesh.corners.len()].into();
    let mut seen = mesh.per_vertex(SeenEdge { from: LocalVertex::NONE, first: Corner::NONE, count: 0 });
    for vertex in mesh.vertex_ids() {
        for &corner in rings.of(vertex) {
            for (end, half) in mesh.others_of(corner).into_iter().zip([corner, corner.previous()]) {
                if end <= vertex {
                    continue;
                }
                let edge = &mut seen[end];
                if edge.from != vertex {
                    *edge = SeenEdge { from: vertex, first: half, count: 0 };
                }
                edge.count += 1;
                let first = edge.first;
                match edge.count {
                    1 => {}
                    2 => (twins[first], twins[half]) = (half, first),
                    _ => {
                        let second = std::mem::replace(&mut twins[first], Corner::NONE);
                        second.some().into_iter().for_each(|second| twins[second] = Corner::NONE);
                    }
                }
            }
        }
    }
    twins
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::FaceId;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::f;
    use crate::mesh::{Class, Rings, class};
    use glam::{DVec2, DVec3};
    use proptest::prelude::*;

    fn classes(mesh: &ClusterMesh) -> (bool, TiVec<LocalVertex, Class>) {
        let (mut rings, mut classes) = (Rings::default(), TiVec::new());
        rings.build(mesh);
        (class::classify(mesh, &rings, &mut classes), classes)
    }

    fn orient_alone(mesh: &mut ClusterMesh) -> Vec<LocalVertex> {
        let mut rings = Rings::default();
        rings.build(mesh);
        orient(mesh, &rings)
    }

    fn turn(mesh: &mut ClusterMesh, face: FaceId) {
        mesh.corners[face].swap(1, 2);
        mesh.corner_vertices[face].swap(1, 2);
    }

    #[test]
    fn a_surface_with_faces_that_show_their_backs_has_the_classes_of_one_without() {
        let whole = samples::two_charts(6);
        let mut torn = whole.clone();
        (0..72).filter(|face| face % 5 == 3 || face % 7 == 1).for_each(|face| turn(&mut torn, f(face)));
        let came = torn.corners.clone();
        assert!(classes(&torn).0);
        assert_ne!(classes(&torn).1, classes(&whole).1);
        orient_alone(&mut torn);
        assert!(!classes(&torn).0);
        assert_eq!(classes(&torn).1, classes(&whole).1);
        restore(&mut torn);
        assert_eq!(torn.corners, came);
        assert!(!torn.is_turned.contains(&true));
    }

    proptest! {
        #[test]
        fn only_vertices_of_turned_faces_change_their_class(
            has_seam in any::<bool>(),
            turned in prop::collection::vec(any::<bool>(), 400),
            is_mostly_whole in any::<bool>(),
        ) {
            let mut mesh = if has_seam { samples::two_charts(6) } else { samples::grid(8, 0.2) };
            // Each face by chance, or one in sixteen.
            let run_len = if is_mostly_whole { 4 } else { 1 };
            let is_turned = |face: FaceId| turned[face.index()..][..run_len].iter().all(|&is_turned| is_turned);
            mesh.face_ids().filter(|&face| is_turned(face)).for_each(|face| turn(&mut mesh, face));
            let mut updated = classes(&mesh).1;
            let changed = orient_alone(&mut mesh);
            let mut rings = Rings::default();
            rings.build(&mesh);
            class::reclassify(&mesh, &rings, &mut updated, &changed);
            prop_assert_eq!(updated, classes(&mesh).1);
        }
    }

    #[test]
    fn faces_keep_what_they_are_when_others_die() {
        let mut mesh = samples::grid(2, 0.0);
        turn(&mut mesh, f(5));
        let came = mesh.corners[f(5)];
        orient_alone(&mut mesh);
        mesh.kill(f(2));
        mesh.compact_faces();
        restore(&mut mesh);
        assert_eq!(mesh.corners[f(4)], came);
    }

    //  0-2-4-(1)    a Möbius strip of five faces
    //  |/|/|/
    //  1-3-(0)
    #[test]
    fn a_surface_with_one_side_keeps_an_edge_where_it_shows_its_back() {
        let faces = [0, 1, 2, 3, 4].map(|i| [i, (i + 1) % 5, (i + 2) % 5]);
        let mut mesh = samples::mesh_of([(DVec3::ZERO, DVec2::NAN); 5], &faces);
        orient_alone(&mut mesh);
        assert!(classes(&mesh).0);
    }
}

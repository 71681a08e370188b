//! Edges of a mesh with the faces around them, by sorting instead of hashing.
//!
//! ```text
//!        c            half-edge 3 f + k of face f runs from corner k to corner k + 1:
//!       / \           0: a → b,  1: b → c,  2: c → a
//!      2   1
//!     /     \         two half-edges lie on one edge if they join the same two vertices, in either direction
//!    a - 0 - b
//! ```
//!
//! # Memory
//! 36 bytes a face.

use rayon::prelude::*;

use crate::base::id::{Id, TiSlice};
use crate::base::pool::in_parallel;
use crate::mesh::id::FaceId;
use crate::model::face::repeats_vertex;

/// A side of a face.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HalfEdge<V> {
    ends: [V; 2],
    /// 3 × its face + the corner where it begins.
    corner: u32,
}

impl<V: Id> HalfEdge<V> {
    /// Its ends, the smaller id first.
    pub fn ends(self) -> [V; 2] {
        self.ends
    }

    /// Its face.
    pub fn face(self) -> FaceId {
        FaceId::new(self.corner / 3)
    }

    /// Index (0, 1, 2) of the corner where it begins.
    pub fn corner(self) -> usize {
        self.corner as usize % 3
    }

    /// Whether its face runs along it from the smaller id to the larger one.
    pub fn runs_up(self, faces: &TiSlice<FaceId, [V; 3]>) -> bool {
        faces[self.face()][self.corner()] == self.ends[0]
    }

    /// Indices (0, 1, 2) of its face's corners at its [ends](Self::ends).
    pub fn corners(self, faces: &TiSlice<FaceId, [V; 3]>) -> [usize; 2] {
        let (begin, end) = (self.corner(), (self.corner() + 1) % 3);
        if self.runs_up(faces) { [begin, end] } else { [end, begin] }
    }

    /// The third vertex of its face.
    pub fn opposite(self, faces: &TiSlice<FaceId, [V; 3]>) -> V {
        faces[self.face()][(self.corner() + 2) % 3]
    }

    fn edge(self) -> u64 {
        let [low, high] = self.ends.map(|end| u64::from(end.number()));
        low << 32 | high
    }
}

/// All half-edges of a mesh, grouped by edge.
#[derive(Debug)]
pub struct EdgeTable<V> {
    half_edges: Vec<HalfEdge<V>>,
}

impl<V: Id> EdgeTable<V> {
    /// Sorts the half-edges of the faces that do not repeat a vertex; O(n log n).
    ///
    /// # Panics
    /// With more than 2³² / 3 faces.
    pub fn new(faces: &TiSlice<FaceId, [V; 3]>) -> Self {
        let mut half_edges = half_edges(faces);
        half_edges.sort_unstable_by_key(|half| (half.edge(), half.corner));
        Self { half_edges }
    }

    /// As [`new`](Self::new), for a mesh that is worked on alone: all threads sort.
    ///
    /// # Panics
    /// As [`new`](Self::new).
    pub fn of_whole(faces: &TiSlice<FaceId, [V; 3]>) -> Self {
        let mut half_edges = half_edges(faces);
        in_parallel(|| half_edges.par_sort_unstable_by_key(|half| (half.edge(), half.corner)));
        Self { half_edges }
    }

    /// The edges in the order of their vertices; each is the non-empty slice of its half-edges in the order of faces.
    pub fn iter(&self) -> impl Iterator<Item = &[HalfEdge<V>]> {
        self.half_edges.chunk_by(|a, b| a.ends == b.ends)
    }

    /// The two vertices of every edge with exactly one face, in the order of vertices.
    pub fn boundary(&self) -> Vec<[V; 2]> {
        self.iter().filter(|edge| edge.len() == 1).map(|edge| edge[0].ends).collect()
    }
}

fn half_edges<V: Id>(faces: &TiSlice<FaceId, [V; 3]>) -> Vec<HalfEdge<V>> {
    assert!(faces.len() < u32::MAX as usize / 3, "more than 2^32 / 3 faces cannot be measured in memory");
    let mut half_edges = Vec::with_capacity(faces.len() * 3);
    for (face, vertices) in faces.iter_enumerated().filter(|(_, vertices)| !repeats_vertex(**vertices)) {
        for corner in 0..3 {
            let (from, to) = (vertices[corner], vertices[(corner + 1) % 3]);
            half_edges.push(HalfEdge { ends: [from.min(to), from.max(to)], corner: face.number() * 3 + corner as u32 });
        }
    }
    half_edges
}

/// The vertices of some edges, each once, in the order of ids.
pub fn vertices_of<V: Id>(edges: &[[V; 2]]) -> Vec<V> {
    let mut vertices: Vec<V> = edges.iter().flatten().copied().collect();
    in_parallel(|| vertices.par_sort_unstable());
    vertices.dedup();
    vertices
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::id::TiVec;
    use crate::mesh::id::LocalVertex;
    use crate::mesh::id::short::v;

    #[test]
    fn two_faces_meet_at_an_edge_in_opposite_directions() {
        // 2 - 3
        // | \ |
        // 0 - 1
        let faces: TiVec<FaceId, _> = vec![[0, 1, 2].map(v), [2, 1, 3].map(v)].into();
        let table = EdgeTable::new(&faces);
        let edges: Vec<_> = table.iter().collect();
        let counts = edges.iter().map(|edge| (edge[0].ends.map(LocalVertex::number), edge.len()));
        assert_eq!(counts.collect::<Vec<_>>(), [([0, 1], 1), ([0, 2], 1), ([1, 2], 2), ([1, 3], 1), ([2, 3], 1)]);
        let diagonal = edges[2];
        assert!(diagonal[0].runs_up(&faces) && !diagonal[1].runs_up(&faces));
        assert_eq!(diagonal[1].corners(&faces), [1, 0]);
        assert_eq!(diagonal[1].opposite(&faces), v(3));
        assert_eq!(vertices_of(&table.boundary()), [0, 1, 2, 3].map(v));
        assert_eq!(EdgeTable::of_whole(&faces).half_edges, table.half_edges);
    }

    #[test]
    fn a_face_that_repeats_a_vertex_has_no_edges() {
        let faces: TiVec<FaceId, _> = vec![[0, 1, 1].map(v)].into();
        assert_eq!(EdgeTable::new(&faces).iter().count(), 0);
    }
}

//! Edges of a surface with the faces around them, by sorting instead of hashing.
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
//! 48 bytes a face.

use rayon::prelude::*;

use crate::base::pool::in_parallel;

/// A side of a face.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct HalfEdge {
    key: u64,
    id: u32,
}

impl HalfEdge {
    /// The end with the smaller id.
    pub fn low(self) -> u32 {
        (self.key >> 32) as u32
    }

    /// The end with the larger id.
    pub fn high(self) -> u32 {
        self.key as u32
    }

    /// Index of its face.
    pub fn face(self) -> usize {
        self.id as usize / 3
    }

    /// Index (0, 1, 2) of the corner where it begins.
    pub fn corner(self) -> usize {
        self.id as usize % 3
    }

    /// Whether its face runs along it from the smaller id to the larger one.
    pub fn runs_up(self, faces: &[[u32; 3]]) -> bool {
        faces[self.face()][self.corner()] == self.low()
    }

    /// Indices (0, 1, 2) of its face's corners at the [`low`](Self::low) and at the [`high`](Self::high) end.
    pub fn corners(self, faces: &[[u32; 3]]) -> [usize; 2] {
        let (begin, end) = (self.corner(), (self.corner() + 1) % 3);
        if self.runs_up(faces) { [begin, end] } else { [end, begin] }
    }
}

/// Whether a face repeats a vertex; such a face has no edges here.
pub fn repeats_vertex([a, b, c]: [u32; 3]) -> bool {
    a == b || b == c || c == a
}

/// All half-edges of a surface, grouped by edge.
#[derive(Debug)]
pub struct EdgeTable {
    half_edges: Vec<HalfEdge>,
}

impl EdgeTable {
    /// Sorts the half-edges of the faces that do not repeat a vertex; O(n log n).
    ///
    /// # Panics
    /// With more than 2³² / 3 faces.
    pub fn new(faces: &[[u32; 3]]) -> Self {
        assert!(faces.len() < u32::MAX as usize / 3, "more than 2^32 / 3 faces cannot be measured in memory");
        let mut half_edges = Vec::with_capacity(faces.len() * 3);
        for (face, &vertices) in faces.iter().enumerate().filter(|&(_, &vertices)| !repeats_vertex(vertices)) {
            for corner in 0..3 {
                let (from, to) = (vertices[corner], vertices[(corner + 1) % 3]);
                let key = u64::from(from.min(to)) << 32 | u64::from(from.max(to));
                half_edges.push(HalfEdge { key, id: (face * 3 + corner) as u32 });
            }
        }
        in_parallel(|| half_edges.par_sort_unstable());
        Self { half_edges }
    }

    /// The edges in the order of their vertices; each is the non-empty slice of its half-edges in the order of faces.
    pub fn iter(&self) -> impl Iterator<Item = &[HalfEdge]> {
        self.half_edges.chunk_by(|a, b| a.key == b.key)
    }

    /// The two vertices of every edge with exactly one face, in the order of vertices.
    pub fn boundary(&self) -> Vec<[u32; 2]> {
        self.iter().filter(|edge| edge.len() == 1).map(|edge| [edge[0].low(), edge[0].high()]).collect()
    }
}

/// The vertices of some edges, each once, in the order of ids.
pub fn vertices_of(edges: &[[u32; 2]]) -> Vec<u32> {
    let mut vertices: Vec<u32> = edges.iter().flatten().copied().collect();
    in_parallel(|| vertices.par_sort_unstable());
    vertices.dedup();
    vertices
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_faces_meet_at_an_edge_in_opposite_directions() {
        // 2 - 3
        // | \ |
        // 0 - 1
        let faces = [[0, 1, 2], [2, 1, 3]];
        let table = EdgeTable::new(&faces);
        let edges: Vec<_> = table.iter().collect();
        assert_eq!(
            edges.iter().map(|e| (e[0].low(), e[0].high(), e.len())).collect::<Vec<_>>(),
            [(0, 1, 1), (0, 2, 1), (1, 2, 2), (1, 3, 1), (2, 3, 1)]
        );
        let diagonal = edges[2];
        assert!(diagonal[0].runs_up(&faces) && !diagonal[1].runs_up(&faces));
        assert_eq!(diagonal[1].corners(&faces), [1, 0]);
        assert_eq!(vertices_of(&table.boundary()), [0, 1, 2, 3]);
    }

    #[test]
    fn a_face_that_repeats_a_vertex_has_no_edges() {
        assert_eq!(EdgeTable::new(&[[0, 1, 1]]).iter().count(), 0);
    }
}

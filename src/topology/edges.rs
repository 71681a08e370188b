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

use std::ops::Range;

use rayon::prelude::*;

use crate::base::Result;
use crate::base::id::{Id, TiSlice};
use crate::base::pool::{BLOCK_ITEMS, blocks_until_stopped, check_stopped, in_parallel};
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
        let mut half_edges = room_for(faces);
        add_half_edges(faces, 0..faces.len(), &mut half_edges);
        half_edges.sort_unstable_by_key(|half| (half.edge(), half.corner));
        Self { half_edges }
    }

    /// As [`new`](Self::new), for a mesh that is worked on alone: all threads sort.
    ///
    /// # Errors
    /// [`Error::Stopped`](crate::base::Error::Stopped).
    ///
    /// # Panics
    /// As [`new`](Self::new).
    pub fn of_whole(faces: &TiSlice<FaceId, [V; 3]>) -> Result<Self> {
        let mut half_edges = room_for(faces);
        for block in blocks_until_stopped(faces.len()) {
            add_half_edges(faces, block?, &mut half_edges);
        }
        check_stopped()?;
        in_parallel(|| half_edges.par_sort_unstable_by_key(|half| (half.edge(), half.corner)));
        Ok(Self { half_edges })
    }

    /// The edges in the order of their vertices; each is the non-empty slice of its half-edges in the order of faces.
    pub fn iter(&self) -> impl Iterator<Item = &[HalfEdge<V>]> {
        edges_of(&self.half_edges)
    }

    /// As [`iter`](Self::iter), for a mesh of any size: looks once a block whether the job is to stop.
    ///
    /// # Errors
    /// [`Error::Stopped`](crate::base::Error::Stopped).
    pub fn try_for_each(&self, mut work: impl FnMut(&[HalfEdge<V>])) -> Result<()> {
        let mut left = &self.half_edges[..];
        while !left.is_empty() {
            check_stopped()?;
            let at_least = left.len().min(BLOCK_ITEMS);
            // A block ends with an edge.
            let last = left[at_least - 1].ends;
            let more = left[at_least..].iter().take_while(|half| half.ends == last).count();
            let (block, rest) = left.split_at(at_least + more);
            edges_of(block).for_each(&mut work);
            left = rest;
        }
        Ok(())
    }

    /// The two vertices of every edge with exactly one face, in the order of vertices.
    pub fn boundary(&self) -> Vec<[V; 2]> {
        self.iter().filter(|edge| edge.len() == 1).map(|edge| edge[0].ends).collect()
    }
}

fn edges_of<V: Id>(half_edges: &[HalfEdge<V>]) -> impl Iterator<Item = &[HalfEdge<V>]> {
    half_edges.chunk_by(|a, b| a.ends == b.ends)
}

fn room_for<V>(faces: &TiSlice<FaceId, [V; 3]>) -> Vec<HalfEdge<V>> {
    assert!(faces.len() < u32::MAX as usize / 3, "more than 2^32 / 3 faces cannot be measured in memory");
    Vec::with_capacity(faces.len() * 3)
}

fn add_half_edges<V: Id>(faces: &TiSlice<FaceId, [V; 3]>, range: Range<usize>, out: &mut Vec<HalfEdge<V>>) {
    let numbered = range.clone().zip(&faces.raw[range]);
    for (face, vertices) in numbered.filter(|(_, vertices)| !repeats_vertex(**vertices)) {
        for corner in 0..3 {
            let (from, to) = (vertices[corner], vertices[(corner + 1) % 3]);
            out.push(HalfEdge { ends: [from.min(to), from.max(to)], corner: (face * 3 + corner) as u32 });
        }
    }
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
        assert_eq!(EdgeTable::of_whole(&faces).unwrap().half_edges, table.half_edges);
    }

    #[test]
    fn blocks_of_edges_are_cut_between_edges() {
        // a strip of triangles: all inner edges have two faces, also those where a block ends
        let faces: TiVec<FaceId, _> = (0..70_000).map(|i| [i, i + 1, i + 2].map(v)).collect();
        let table = EdgeTable::new(&faces);
        let mut found = Vec::new();
        table.try_for_each(|edge| found.push(edge.to_vec())).unwrap();
        assert!(table.half_edges.len() > 3 * BLOCK_ITEMS);
        assert!(table.iter().eq(found.iter().map(|edge| &edge[..])));
    }

    #[test]
    fn a_face_that_repeats_a_vertex_has_no_edges() {
        let faces: TiVec<FaceId, _> = vec![[0, 1, 1].map(v)].into();
        assert_eq!(EdgeTable::new(&faces).iter().count(), 0);
    }
}

//! The corners around each vertex, as compressed sparse rows.
//!
//! A collapse drops two rows and appends their union. Rows are rebuilt once more than half of the entries are unused:
//!
//! ```text
//! built     | row 0 | row 1 | row 2 | …        after 2 went into 0    | ····· | row 1 | ····· | … | row 0 |
//! ```

use std::ops::Range;

use super::cluster::ClusterMesh;
use super::id::{Corner, FaceId, LocalVertex, Wedge, WedgePair};
use crate::base::cache::prefetch;
use crate::base::id::TiVec;

/// Largest valence of a vertex that may move or vanish. A larger fan waits until collapses on its rim have shrunk it.
pub const VALENCE_MAX: usize = 128;

/// Corners at each vertex.
#[derive(Debug, Clone, Default)]
pub struct Rings {
    rows: TiVec<LocalVertex, RingRow>,
    corners: Vec<Corner>,
}

/// The place of a row in [`Rings::corners`].
#[derive(Debug, Clone, Copy, Default)]
struct RingRow {
    start: u32,
    length: u32,
}

impl RingRow {
    #[inline(always)]
    fn range(self) -> Range<usize> {
        self.start as usize..(self.start + self.length) as usize
    }
}

impl Rings {
    /// Builds the rows for all living faces. O(faces).
    pub fn build(&mut self, mesh: &ClusterMesh) {
        self.rows.clear();
        self.rows.resize(mesh.positions.len(), RingRow::default());
        for face in mesh.living_faces() {
            for &vertex in &mesh.corner_vertices[face] {
                self.rows[vertex].length += 1;
            }
        }
        let mut total = 0;
        for row in &mut self.rows {
            row.start = total;
            total += std::mem::take(&mut row.length);
        }
        self.corners.clear();
        // Capacity for the rows that collapses append.
        self.corners.reserve_exact(2 * total as usize);
        self.corners.resize(total as usize, Corner::new(0));
        for face in mesh.living_faces() {
            for (k, &vertex) in mesh.corner_vertices[face].iter().enumerate() {
                let row = &mut self.rows[vertex];
                self.corners[(row.start + row.length) as usize] = Corner::at(face, k);
                row.length += 1;
            }
        }
    }

    /// Updates the rows after the mesh has collapsed `from` onto `to`: `to` gets the living corners of both, ascending.
    pub fn join(&mut self, mesh: &ClusterMesh, from: LocalVertex, to: LocalVertex) {
        let start = self.corners.len();
        let [one, other] = [from, to].map(|vertex| self.rows[vertex].range());
        self.corners.resize(start + one.len() + other.len(), Corner::new(0));
        let (rows, joined) = self.corners.split_at_mut(start);
        let [mut one, mut other] = [&rows[one], &rows[other]];
        let mut length = 0;
        // No branch depends on which row is ahead, or on which faces live: neither can be predicted.
        let mut put = |corner: Corner| {
            joined[length] = corner;
            length += usize::from(mesh.living(corner).is_some());
        };
        while let (Some(&first), Some(&second)) = (one.first(), other.first()) {
            let takes_one = first < second;
            put(if takes_one { first } else { second });
            one = &one[usize::from(takes_one)..];
            other = &other[usize::from(!takes_one)..];
        }
        one.iter().chain(other).for_each(|&corner| put(corner));
        self.corners.truncate(start + length);
        self.rows[from] = RingRow::default();
        self.rows[to] = RingRow { start: start as u32, length: length as u32 };
    }

    /// Whether more than half of the entries are unused, so that the rows should be rebuilt.
    pub fn is_scattered(&self, mesh: &ClusterMesh) -> bool {
        self.corners.len() > 6 * mesh.face_count.max(64)
    }

    /// Corners at a vertex, ascending; includes corners of faces that died since the row was written.
    #[inline]
    pub fn of(&self, vertex: LocalVertex) -> &[Corner] {
        &self.corners[self.rows[vertex].range()]
    }

    /// Both ends of an edge, first the one whose corners are to be searched for its faces: the end with fewer corners,
    /// if the first has very many.
    #[inline(always)]
    pub fn search_order(&self, [a, b]: [LocalVertex; 2]) -> [LocalVertex; 2] {
        let count = self.of(a).len();
        if count > VALENCE_MAX && self.of(b).len() < count { [b, a] } else { [a, b] }
    }

    /// Asks for the memory that tells where the corners at a vertex are.
    #[inline(always)]
    pub fn prefetch_row(&self, vertex: LocalVertex) {
        prefetch(&self.rows[vertex]);
    }

    /// Asks for the memory of the corners at a vertex.
    #[inline(always)]
    pub fn prefetch(&self, vertex: LocalVertex) {
        self.of(vertex).first().into_iter().for_each(prefetch);
    }

    /// Corners of living faces at a vertex, ascending.
    #[inline]
    pub fn living<'a>(
        &'a self,
        mesh: &'a ClusterMesh,
        vertex: LocalVertex,
    ) -> impl Iterator<Item = Corner> + Clone + 'a {
        self.of(vertex).iter().copied().filter(|&corner| mesh.living(corner).is_some())
    }

    /// The edges of the link of a vertex: the other two vertices of each living face, counter-clockwise. Around an inner
    /// vertex every neighbour comes first once, together with the vertex that follows it.
    pub fn link_edges<'a>(
        &'a self,
        mesh: &'a ClusterMesh,
        vertex: LocalVertex,
    ) -> impl Iterator<Item = [LocalVertex; 2]> + 'a {
        self.living(mesh, vertex).map(|corner| mesh.others_of(corner))
    }

    /// Living faces around a vertex, ascending.
    #[inline]
    pub fn faces<'a>(
        &'a self,
        mesh: &'a ClusterMesh,
        vertex: LocalVertex,
    ) -> impl Iterator<Item = FaceId> + Clone + 'a {
        self.of(vertex).iter().map(|corner| corner.face()).filter(|&face| !mesh.is_dead(face))
    }
}

/// One face around a vertex, the centre: wedges of its corners and the other two vertices.
#[derive(Debug, Clone, Copy)]
pub struct Spoke {
    /// Wedge of the centre.
    pub wedge: Wedge,
    /// The vertex after the centre in the face, counter-clockwise.
    pub next: LocalVertex,
    /// Wedge of `next`.
    pub next_wedge: Wedge,
    /// The vertex before the centre.
    pub previous: LocalVertex,
    /// Wedge of `previous`.
    pub previous_wedge: Wedge,
}

impl Spoke {
    /// The spoke of a corner, whose face must not be dead.
    #[inline(always)]
    pub fn of(mesh: &ClusterMesh, corner: Corner) -> Self {
        let [next, previous] = corner.others();
        Self {
            wedge: mesh.wedge_of(corner),
            next: mesh.vertex_of(next),
            next_wedge: mesh.wedge_of(next),
            previous: mesh.vertex_of(previous),
            previous_wedge: mesh.wedge_of(previous),
        }
    }

    /// Wedges of the edge to `next`.
    #[inline(always)]
    pub fn pair_to_next(&self) -> WedgePair {
        WedgePair { from: self.wedge, to: self.next_wedge }
    }

    /// Wedges of the edge from the centre to `other` in this face; `None` if `other` is not one of its vertices.
    #[inline(always)]
    pub fn edge_to(&self, other: LocalVertex) -> Option<WedgePair> {
        match other {
            _ if self.next == other => Some(self.pair_to_next()),
            _ if self.previous == other => Some(WedgePair { from: self.wedge, to: self.previous_wedge }),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::cluster::samples;
    use super::*;
    use crate::mesh::id::short::v;

    #[test]
    fn an_inner_grid_vertex_has_six_faces() {
        let mesh = samples::grid(3, 0.0);
        let mut rings = Rings::default();
        rings.build(&mesh);
        assert_eq!(rings.of(v(5)).len(), 6);
        assert_eq!(rings.of(v(0)), [0, 4].map(Corner::new));
        assert!(rings.of(v(5)).is_sorted());
        assert!(rings.of(v(5)).iter().all(|&corner| mesh.vertex_of(corner) == v(5)));
    }
}

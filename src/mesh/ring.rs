//! The corners around each vertex, as compressed sparse rows.
//!
//! A collapse drops two rows and appends their union. Rows are rebuilt once more than half of the entries are unused:
//!
//! ```text
//! built     | row 0 | row 1 | row 2 | …        after 2 went into 0    | ····· | row 1 | ····· | … | row 0 |
//! ```

use super::cluster::{ClusterMesh, DEAD};

/// Corners (3 × face + index in the face) at each vertex.
#[derive(Debug, Clone, Default)]
pub struct Rings {
    /// Start and length of each row in `corners`.
    rows: Vec<(u32, u32)>,
    corners: Vec<u32>,
}

impl Rings {
    /// Builds the rows for all living faces. O(faces).
    pub fn build(&mut self, mesh: &ClusterMesh) {
        self.rows.clear();
        self.rows.resize(mesh.positions.len(), (0, 0));
        let is_living = |corners: &[u32; 3]| corners[0] != DEAD;
        for (_, vertices) in mesh.corners.iter().zip(&mesh.corner_vertices).filter(|(corners, _)| is_living(corners)) {
            for &vertex in vertices {
                self.rows[vertex as usize].1 += 1;
            }
        }
        let mut total = 0;
        for (start, length) in &mut self.rows {
            *start = total;
            total += std::mem::take(length);
        }
        self.corners.clear();
        // Capacity for the rows that collapses append.
        self.corners.reserve_exact(2 * total as usize);
        self.corners.resize(total as usize, 0);
        let living = mesh.corners.iter().zip(&mesh.corner_vertices).enumerate();
        for (face, (_, vertices)) in living.filter(|(_, (corners, _))| is_living(corners)) {
            for (k, &vertex) in vertices.iter().enumerate() {
                let (start, length) = &mut self.rows[vertex as usize];
                self.corners[(*start + *length) as usize] = (3 * face + k) as u32;
                *length += 1;
            }
        }
    }

    /// Updates the rows after the mesh has collapsed `from` onto `to`: `to` gets the living corners of both, ascending.
    pub fn join(&mut self, mesh: &ClusterMesh, from: u32, to: u32) {
        let rows = [from, to].map(|vertex| {
            let (start, length) = self.rows[vertex as usize];
            start as usize..(start + length) as usize
        });
        let (start, [mut one, mut other]) = (self.corners.len(), rows);
        while !one.is_empty() || !other.is_empty() {
            let takes_one =
                other.is_empty() || (!one.is_empty() && self.corners[one.start] < self.corners[other.start]);
            let row = if takes_one { &mut one } else { &mut other };
            let corner = self.corners[row.start];
            row.start += 1;
            if mesh.living(corner).is_some() {
                self.corners.push(corner);
            }
        }
        self.rows[from as usize] = (0, 0);
        self.rows[to as usize] = (start as u32, (self.corners.len() - start) as u32);
    }

    /// Whether more than half of the entries are unused, so that the rows should be rebuilt.
    pub fn is_scattered(&self, mesh: &ClusterMesh) -> bool {
        self.corners.len() > 6 * mesh.face_count.max(64)
    }

    /// Corners at a vertex, ascending; includes corners of faces that died since the row was written.
    #[inline]
    pub fn of(&self, vertex: u32) -> &[u32] {
        let (start, length) = self.rows[vertex as usize];
        &self.corners[start as usize..(start + length) as usize]
    }

    /// Living faces around a vertex, ascending.
    #[inline]
    pub fn faces<'a>(&'a self, mesh: &'a ClusterMesh, vertex: u32) -> impl Iterator<Item = u32> + Clone + 'a {
        self.of(vertex).iter().map(|corner| corner / 3).filter(|&face| !mesh.is_dead(face))
    }
}

/// One face around a vertex, the centre: wedges of its corners and the other two vertices.
#[derive(Debug, Clone, Copy)]
pub struct Spoke {
    /// Wedge of the centre.
    pub wedge: u32,
    /// The vertex after the centre in the face, counter-clockwise.
    pub next: u32,
    /// Wedge of `next`.
    pub next_wedge: u32,
    /// The vertex before the centre.
    pub previous: u32,
    /// Wedge of `previous`.
    pub previous_wedge: u32,
}

impl Spoke {
    /// The spoke of a corner, whose face must not be dead.
    #[inline(always)]
    pub fn of(mesh: &ClusterMesh, corner: u32) -> Self {
        let [next, previous] = ClusterMesh::following(corner);
        Self {
            wedge: mesh.wedge_of(corner),
            next: mesh.vertex_of(next),
            next_wedge: mesh.wedge_of(next),
            previous: mesh.vertex_of(previous),
            previous_wedge: mesh.wedge_of(previous),
        }
    }

    /// Wedges of the centre and of `other` in this face; `None` if `other` is not one of its vertices.
    #[inline(always)]
    pub fn edge_to(&self, other: u32) -> Option<(u32, u32)> {
        match other {
            _ if self.next == other => Some((self.wedge, self.next_wedge)),
            _ if self.previous == other => Some((self.wedge, self.previous_wedge)),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::cluster::samples;
    use super::*;

    #[test]
    fn an_inner_grid_vertex_has_six_faces() {
        let mesh = samples::grid(3, 0.0);
        let mut rings = Rings::default();
        rings.build(&mesh);
        assert_eq!(rings.of(5).len(), 6);
        assert_eq!(rings.of(0), &[0, 3]);
        assert!(rings.of(5).is_sorted());
        assert!(rings.of(5).iter().all(|&corner| mesh.vertex_of(corner) == 5));
    }
}

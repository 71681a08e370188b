//! The mesh of one cluster, as structure of arrays with cluster-local 32-bit ids.
//!
//! ```text
//!   vertex 7 ── wedge 9 (uv .1 .2, roof) ── wedge 10 (uv .8 .3, wall) ── back to 9
//!   face f: corners 9, 4, 12 (wedges); a face of DEAD corners is gone
//! ```
//!
//! The id of a corner is 3 × its face + its index in the face, as in [`Rings`](super::Rings).
//!
//! # Memory
//! A face takes 33 bytes, a vertex 25, a wedge 25: about 60 bytes a triangle of an ordinary textured mesh.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// Corner value of a face that was removed.
pub const DEAD: u32 = u32::MAX;

/// Bits of [`ClusterMesh::flags`](super::ClusterMesh::flags).
pub mod flag {
    /// The vertex neither moves nor vanishes: another cluster uses it, or an option locks it.
    pub const LOCKED: u8 = 1;
    /// Another cluster uses the vertex, so its one-ring is incomplete here.
    pub const SHARED: u8 = 2;
    /// The vertex has left its initial position.
    pub const MOVED: u8 = 4;
}

/// The smallest `f32` that is not below `value`: bounds on deviations are stored rounded up.
pub fn rounded_up(value: f64) -> f32 {
    let near = value as f32;
    if f64::from(near) < value { near.next_up() } else { near }
}

/// The triangle mesh of one cluster.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct ClusterMesh {
    /// Position of each vertex relative to the cluster's origin, in the mesh's unit of length.
    #[serde(with = "crate::base::records")]
    pub positions: Vec<DVec3>,
    /// Bits of [`flag`] for each vertex.
    #[serde(with = "crate::base::records")]
    pub flags: Vec<u8>,
    /// Vertex of each wedge.
    #[serde(with = "crate::base::records")]
    pub wedge_vertex: Vec<u32>,
    /// Texture coordinate of each wedge times the scale of its material, in units of length; NaN where it has none.
    #[serde(with = "crate::base::records")]
    pub wedge_uv: Vec<DVec2>,
    /// Next wedge of the same vertex, cyclic.
    #[serde(with = "crate::base::records")]
    pub wedge_next: Vec<u32>,
    /// Whether the wedge has left its initial texture coordinate.
    pub wedge_moved: Vec<bool>,
    /// Wedges of each face's corners, counter-clockwise.
    #[serde(with = "crate::base::records")]
    pub corners: Vec<[u32; 3]>,
    /// Vertices of each face's corners: `wedge_vertex` of `corners`, cached.
    #[serde(with = "crate::base::records")]
    pub corner_vertices: Vec<[u32; 3]>,
    /// Part (label) of each face.
    #[serde(with = "crate::base::records")]
    pub parts: Vec<u32>,
    /// Bound on the distance of each face from the input, in units of length; kept only where the error is bounded.
    #[serde(with = "crate::base::records")]
    pub deviations: Vec<f32>,
    /// Whether each face was turned over by [`orient`](super::orient).
    pub is_turned: Vec<bool>,
    /// For each of the last vertices, which are copies, the vertex that it copies; that one is no copy itself.
    #[serde(skip)]
    pub copied_from: Vec<u32>,
    /// Number of faces that are not dead.
    pub face_count: usize,
}

impl ClusterMesh {
    /// Whether all ids are in range and all arrays have matching lengths. For a mesh that was read back, without dead
    /// faces and with unlinked wedges.
    pub fn is_sound(&self) -> bool {
        let (vertices, wedges, faces) = (self.positions.len(), self.wedge_vertex.len(), self.corners.len());
        let vertex_of = |wedge: u32| self.wedge_vertex.get(wedge as usize).copied();
        self.flags.len() == vertices
            && self.wedge_uv.len() == wedges
            && (self.wedge_next.is_empty() && self.wedge_moved.is_empty())
            && [self.corner_vertices.len(), self.parts.len(), self.deviations.len(), self.is_turned.len()] == [faces; 4]
            && self.face_count == faces
            && self.wedge_vertex.iter().all(|&vertex| (vertex as usize) < vertices)
            && self.corners.iter().zip(&self.corner_vertices).all(|(c, v)| c.map(vertex_of) == v.map(Some))
    }

    /// Vertices of a face's corners; the face must not be dead.
    #[inline]
    pub fn vertices(&self, face: u32) -> [u32; 3] {
        self.corner_vertices[face as usize]
    }

    /// Wedge of a corner; `None` if its face was removed.
    #[inline]
    pub fn living(&self, corner: u32) -> Option<u32> {
        let wedge = self.corners.as_flattened()[corner as usize];
        (wedge != DEAD).then_some(wedge)
    }

    /// The next and the previous corner in the face, counter-clockwise.
    #[inline(always)]
    pub fn following(corner: u32) -> [u32; 2] {
        // A table lookup, because a branch on the corner's index would be unpredictable.
        const STEPS: [[u32; 2]; 3] = [[1, 2], [1, 1u32.wrapping_neg()], [2u32.wrapping_neg(), 1u32.wrapping_neg()]];
        STEPS[corner as usize % 3].map(|step| corner.wrapping_add(step))
    }

    /// Wedge of a corner, whose face must not be dead.
    #[inline]
    pub fn wedge_of(&self, corner: u32) -> u32 {
        self.corners.as_flattened()[corner as usize]
    }

    /// Vertex of a corner, whose face must not be dead.
    #[inline]
    pub fn vertex_of(&self, corner: u32) -> u32 {
        self.corner_vertices.as_flattened()[corner as usize]
    }

    /// Whether the face was removed.
    #[inline]
    pub fn is_dead(&self, face: u32) -> bool {
        self.corners[face as usize][0] == DEAD
    }

    /// The wedge of `vertex` in a face; `None` if the vertex is not one of its corners.
    #[inline]
    pub fn wedge_at(&self, face: u32, vertex: u32) -> Option<u32> {
        let at = self.corner_vertices[face as usize].into_iter().position(|v| v == vertex)?;
        Some(self.corners[face as usize][at])
    }

    /// Whether the vertex may neither move nor vanish.
    #[inline]
    pub fn is_locked(&self, vertex: u32) -> bool {
        self.flags[vertex as usize] & flag::LOCKED != 0
    }

    /// Whether another cluster uses the vertex.
    #[inline]
    pub fn is_shared(&self, vertex: u32) -> bool {
        self.flags[vertex as usize] & flag::SHARED != 0
    }

    /// Positions of a face's corners.
    #[inline]
    pub fn triangle(&self, face: u32) -> [DVec3; 3] {
        self.vertices(face).map(|v| self.positions[v as usize])
    }

    /// Scaled texture coordinates of a face's corners; NaN where there are none.
    #[inline]
    pub fn uv_triangle(&self, face: u32) -> [DVec2; 3] {
        self.corners[face as usize].map(|w| self.wedge_uv[w as usize])
    }

    /// Adds a vertex and returns its id.
    pub fn push_vertex(&mut self, position: DVec3, flags: u8) -> u32 {
        self.positions.push(position);
        self.flags.push(flags);
        (self.positions.len() - 1) as u32
    }

    /// Adds a wedge and returns its id; [`link_wedges`](ClusterMesh::link_wedges) must follow.
    pub fn push_wedge(&mut self, vertex: u32, uv: DVec2) -> u32 {
        self.wedge_vertex.push(vertex);
        self.wedge_uv.push(uv);
        (self.wedge_vertex.len() - 1) as u32
    }

    /// Adds a face with a deviation of 0.
    pub fn push_face(&mut self, corners: [u32; 3], part: u32) {
        self.corners.push(corners);
        self.corner_vertices.push(corners.map(|w| self.wedge_vertex[w as usize]));
        self.parts.push(part);
        self.deviations.push(0.0);
        self.is_turned.push(false);
        self.face_count += 1;
    }

    /// Links the wedges of each vertex into a cycle, in order of their ids, and marks all wedges as not moved.
    pub fn link_wedges(&mut self) {
        let mut first = vec![DEAD; self.positions.len()];
        let mut last = vec![DEAD; self.positions.len()];
        self.wedge_moved = vec![false; self.wedge_vertex.len()];
        self.wedge_next = vec![DEAD; self.wedge_vertex.len()];
        for (wedge, &vertex) in self.wedge_vertex.iter().enumerate() {
            let (first, last) = (&mut first[vertex as usize], &mut last[vertex as usize]);
            if *first == DEAD {
                *first = wedge as u32;
            } else {
                self.wedge_next[*last as usize] = wedge as u32;
            }
            *last = wedge as u32;
            self.wedge_next[wedge] = *first;
        }
    }

    /// Moves a wedge to the vertex of the wedge `beside`, and links it into that vertex's cycle.
    pub fn bring_wedge(&mut self, wedge: u32, beside: u32) {
        self.wedge_vertex[wedge as usize] = self.wedge_vertex[beside as usize];
        self.wedge_next[wedge as usize] = self.wedge_next[beside as usize];
        self.wedge_next[beside as usize] = wedge;
    }

    /// Marks a face as removed.
    pub fn kill(&mut self, face: u32) {
        self.corners[face as usize] = [DEAD; 3];
        self.face_count -= 1;
    }

    /// Removes the dead faces.
    pub fn compact_faces(&mut self) {
        let mut kept = 0;
        for face in 0..self.corners.len() {
            if self.corners[face][0] != DEAD {
                self.corners[kept] = self.corners[face];
                self.corner_vertices[kept] = self.corner_vertices[face];
                self.parts[kept] = self.parts[face];
                self.deviations[kept] = self.deviations[face];
                self.is_turned[kept] = self.is_turned[face];
                kept += 1;
            }
        }
        self.corners.truncate(kept);
        self.corner_vertices.truncate(kept);
        self.parts.truncate(kept);
        self.deviations.truncate(kept);
        self.is_turned.truncate(kept);
    }

    /// Unlinks the wedges that no face uses from the cycles of those in use.
    ///
    /// The cycle of a vertex without any wedge in use stays as it is.
    pub fn unlink_unused_wedges(&mut self) {
        let mut used = vec![false; self.wedge_vertex.len()];
        for &wedge in self.corners.iter().filter(|corners| corners[0] != DEAD).flatten() {
            used[wedge as usize] = true;
        }
        for wedge in 0..self.wedge_next.len() {
            if used[wedge] {
                let mut next = self.wedge_next[wedge];
                while !used[next as usize] {
                    next = self.wedge_next[next as usize];
                }
                self.wedge_next[wedge] = next;
            }
        }
    }
}

#[cfg(test)]
pub(crate) mod samples {
    //! Small meshes for tests.

    use super::*;

    /// A grid of n × n unit squares, two triangles each, with uv = 0.1 × position and pseudo-random bumps of height 0
    /// to `bump`.
    pub fn grid(n: u32, bump: f64) -> ClusterMesh {
        let mut mesh = ClusterMesh::default();
        for y in 0..=n {
            for x in 0..=n {
                let z = bump * f64::from((x * 7919 + y * 104_729) % 17) / 17.0;
                let vertex = mesh.push_vertex(DVec3::new(f64::from(x), f64::from(y), z), 0);
                mesh.push_wedge(vertex, DVec2::new(f64::from(x), f64::from(y)) * 0.1);
            }
        }
        for y in 0..n {
            for x in 0..n {
                let v = y * (n + 1) + x;
                mesh.push_face([v, v + 1, v + n + 2], 0);
                mesh.push_face([v, v + n + 2, v + n + 1], 0);
            }
        }
        mesh.link_wedges();
        mesh
    }

    /// The grid cut into two charts along x = n / 2: vertices on that line have two wedges; u is 6.4 more on the right.
    pub fn two_charts(n: u32) -> ClusterMesh {
        let mut mesh = grid(n, 0.0);
        let middle = n / 2;
        let mut right = std::collections::BTreeMap::new();
        for y in 0..=n {
            let vertex = y * (n + 1) + middle;
            let uv = mesh.wedge_uv[vertex as usize] + DVec2::new(6.4, 0.0);
            right.insert(vertex, mesh.push_wedge(vertex, uv));
            for x in middle + 1..=n {
                mesh.wedge_uv[(y * (n + 1) + x) as usize].x += 6.4;
            }
        }
        for face in 0..mesh.corners.len() as u32 {
            let triangle = mesh.triangle(face);
            let centre = (triangle[0].x + triangle[1].x + triangle[2].x) / 3.0;
            if centre > f64::from(middle) {
                let corners = mesh.vertices(face).map(|v| right.get(&v).copied().unwrap_or(v));
                mesh.corners[face as usize] = corners;
            }
        }
        mesh.link_wedges();
        mesh
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wedges_of_a_vertex_form_a_cycle_of_those_in_use() {
        let mut mesh = samples::two_charts(4);
        let seam_vertex = 2u32;
        assert_eq!(mesh.wedge_next[mesh.wedge_next[seam_vertex as usize] as usize], seam_vertex);
        assert_ne!(mesh.wedge_next[seam_vertex as usize], seam_vertex);
        for face in 0..mesh.corners.len() as u32 {
            if mesh.corners[face as usize].iter().any(|&w| w >= 25) {
                mesh.corners[face as usize] = [DEAD; 3];
            }
        }
        mesh.unlink_unused_wedges();
        assert_eq!(mesh.wedge_next[seam_vertex as usize], seam_vertex);
    }

    #[test]
    fn bounds_are_rounded_up() {
        for value in [0.1, 0.3, 1e-30, 0.25] {
            assert!(f64::from(rounded_up(value)) >= value);
        }
        assert_eq!(rounded_up(0.25), 0.25);
    }

    #[test]
    fn a_mesh_that_names_what_is_not_there_is_not_sound() {
        let mut whole = samples::grid(2, 0.0);
        (whole.wedge_next, whole.wedge_moved) = (Vec::new(), Vec::new());
        assert!(whole.is_sound() && ClusterMesh::default().is_sound());
        let changes: [fn(&mut ClusterMesh); 9] = [
            |mesh| mesh.corners[3][1] = 9,
            |mesh| mesh.corner_vertices[3][1] += 1,
            |mesh| mesh.wedge_vertex[8] = 9,
            |mesh| mesh.flags.truncate(8),
            |mesh| mesh.wedge_uv.truncate(8),
            |mesh| mesh.parts.truncate(7),
            |mesh| mesh.deviations.push(0.0),
            |mesh| mesh.kill(0),
            |mesh| mesh.link_wedges(),
        ];
        for (i, change) in changes.iter().enumerate() {
            let mut changed = whole.clone();
            change(&mut changed);
            assert!(!changed.is_sound(), "change {i}");
        }
    }
}

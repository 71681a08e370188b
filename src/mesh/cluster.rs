//! The mesh of one cluster, as structure of arrays that are indexed by [ids](super::id).
//!
//! ```text
//!   vertex 7 ── wedge 9 (uv .1 .2, roof) ── wedge 10 (uv .8 .3, wall) ── back to 9
//!   face f: corners 9, 4, 12 (wedges); a face of DEAD corners is gone
//! ```
//!
//! # Memory
//! A face takes 33 bytes, a vertex 25, a wedge 25: about 60 bytes a triangle of an ordinary textured mesh.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::id::{Corner, End, FaceId, LocalVertex, Wedge};
use crate::base::cache::prefetch;
use crate::base::id::TiVec;
use crate::model::id::PartId;

/// Corner value of a face that was removed.
pub const DEAD: Wedge = Wedge::NONE;

/// Bits of [`ClusterMesh::flags`](super::ClusterMesh::flags).
pub mod flag {
    /// The vertex neither moves nor vanishes: another cluster uses it, or an option locks it.
    pub const LOCKED: u8 = 1;
    /// Another cluster uses the vertex, so its one-ring is incomplete here.
    pub const SHARED: u8 = 2;
    /// The vertex has left its initial position.
    pub const MOVED: u8 = 4;
    /// The vertex belongs to two faces that are close to folded onto each other.
    pub const FOLDS: u8 = 8;
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
    pub positions: TiVec<LocalVertex, DVec3>,
    /// Bits of [`flag`] for each vertex.
    #[serde(with = "crate::base::records")]
    pub flags: TiVec<LocalVertex, u8>,
    /// Vertex of each wedge.
    #[serde(with = "crate::base::records")]
    pub wedge_vertex: TiVec<Wedge, LocalVertex>,
    /// Texture coordinate of each wedge times the scale of its material, in units of length; NaN where it has none.
    #[serde(with = "crate::base::records")]
    pub wedge_uv: TiVec<Wedge, DVec2>,
    /// Next wedge of the same vertex, cyclic.
    #[serde(with = "crate::base::records")]
    pub wedge_next: TiVec<Wedge, Wedge>,
    /// Whether the wedge has left its initial texture coordinate.
    pub wedge_moved: TiVec<Wedge, bool>,
    /// Wedges of each face's corners, counter-clockwise.
    #[serde(with = "crate::base::records")]
    pub corners: TiVec<FaceId, [Wedge; 3]>,
    /// Vertices of each face's corners: `wedge_vertex` of `corners`, cached.
    #[serde(with = "crate::base::records")]
    pub corner_vertices: TiVec<FaceId, [LocalVertex; 3]>,
    /// Part (label) of each face.
    #[serde(with = "crate::base::records")]
    pub parts: TiVec<FaceId, PartId>,
    /// Bound on the distance of each face from the input, in units of length; kept only where the error is bounded.
    #[serde(with = "crate::base::records")]
    pub deviations: TiVec<FaceId, f32>,
    /// Whether each face was turned over by [`orient`](super::orient).
    pub is_turned: TiVec<FaceId, bool>,
    /// For each of the last vertices, which are copies, the vertex that it copies; that one is no copy itself.
    #[serde(skip)]
    pub copied_from: Vec<LocalVertex>,
    /// Number of faces that are not dead.
    pub face_count: usize,
}

impl ClusterMesh {
    /// Whether all ids are in range and all arrays have matching lengths. For a mesh that was read back, without dead
    /// faces and with unlinked wedges.
    pub fn is_sound(&self) -> bool {
        let (vertices, wedges, faces) = (self.positions.len(), self.wedge_vertex.len(), self.corners.len());
        self.flags.len() == vertices
            && self.wedge_uv.len() == wedges
            && (self.wedge_next.is_empty() && self.wedge_moved.is_empty())
            && [self.corner_vertices.len(), self.parts.len(), self.deviations.len(), self.is_turned.len()] == [faces; 4]
            && self.face_count == faces
            && self.wedge_vertex.iter().all(|&vertex| vertex.index() < vertices)
            && self.has_matching_corners()
    }

    /// Whether each corner has the vertex of its wedge. No face may be dead.
    pub fn has_matching_corners(&self) -> bool {
        let vertex_of = |wedge: Wedge| self.wedge_vertex.get(wedge).copied();
        self.corners.iter().zip(&self.corner_vertices).all(|(c, v)| c.map(vertex_of) == v.map(Some))
    }

    /// All vertices.
    #[inline]
    pub fn vertex_ids(&self) -> impl DoubleEndedIterator<Item = LocalVertex> + ExactSizeIterator + Clone + use<> {
        LocalVertex::first(self.positions.len())
    }

    /// All faces, also those that are dead.
    #[inline]
    pub fn face_ids(&self) -> impl DoubleEndedIterator<Item = FaceId> + ExactSizeIterator + Clone + use<> {
        FaceId::first(self.corners.len())
    }

    /// All faces that are not dead.
    #[inline]
    pub fn living_faces(&self) -> impl Iterator<Item = FaceId> + Clone + '_ {
        self.face_ids().filter(|&face| !self.is_dead(face))
    }

    /// The same value for each vertex.
    pub fn per_vertex<T: Clone>(&self, value: T) -> TiVec<LocalVertex, T> {
        vec![value; self.positions.len()].into()
    }

    /// The same value for each wedge.
    pub fn per_wedge<T: Clone>(&self, value: T) -> TiVec<Wedge, T> {
        vec![value; self.wedge_vertex.len()].into()
    }

    /// The same value for each face.
    pub fn per_face<T: Clone>(&self, value: T) -> TiVec<FaceId, T> {
        vec![value; self.corners.len()].into()
    }

    /// The vertex that a vertex copies, or itself.
    pub fn origin_of(&self, vertex: LocalVertex) -> LocalVertex {
        let first_copy = self.positions.len() - self.copied_from.len();
        vertex.index().checked_sub(first_copy).map_or(vertex, |copy| self.copied_from[copy])
    }

    /// Vertices of a face's corners; the face must not be dead.
    #[inline]
    pub fn vertices(&self, face: FaceId) -> [LocalVertex; 3] {
        self.corner_vertices[face]
    }

    /// Wedge of a corner; `None` if its face was removed.
    #[inline]
    pub fn living(&self, corner: Corner) -> Option<Wedge> {
        self.wedge_of(corner).some()
    }

    /// Wedge of a corner, whose face must not be dead.
    #[inline]
    pub fn wedge_of(&self, corner: Corner) -> Wedge {
        self.corners.raw.as_flattened()[corner.place()]
    }

    /// Vertex of a corner, whose face must not be dead.
    #[inline]
    pub fn vertex_of(&self, corner: Corner) -> LocalVertex {
        self.corner_vertices.raw.as_flattened()[corner.place()]
    }

    /// The next and the previous vertex in the face of a corner, counter-clockwise; the face must not be dead.
    #[inline(always)]
    pub fn others_of(&self, corner: Corner) -> [LocalVertex; 2] {
        let [next, previous] = corner.others();
        [self.vertex_of(next), self.vertex_of(previous)]
    }

    /// Vertex and wedge of a corner, whose face must not be dead.
    #[inline(always)]
    pub fn end_of(&self, corner: Corner) -> End {
        End { vertex: self.vertex_of(corner), wedge: self.wedge_of(corner) }
    }

    /// Sets the wedge of a corner.
    #[inline]
    pub fn set_wedge(&mut self, corner: Corner, wedge: Wedge) {
        self.corners.raw.as_flattened_mut()[corner.place()] = wedge;
    }

    /// Sets the vertex of a corner.
    #[inline]
    pub fn set_vertex(&mut self, corner: Corner, vertex: LocalVertex) {
        self.corner_vertices.raw.as_flattened_mut()[corner.place()] = vertex;
    }

    /// Whether the face was removed.
    #[inline]
    pub fn is_dead(&self, face: FaceId) -> bool {
        self.corners[face][0] == DEAD
    }

    /// The wedge of `vertex` in a face; `None` if the vertex is not one of its corners.
    #[inline]
    pub fn wedge_at(&self, face: FaceId, vertex: LocalVertex) -> Option<Wedge> {
        let at = self.vertices(face).into_iter().position(|v| v == vertex)?;
        Some(self.corners[face][at])
    }

    /// Asks for the memory of the faces of some corners.
    #[inline(always)]
    pub fn prefetch_faces(&self, corners: &[Corner]) {
        for corner in corners {
            prefetch(&self.corners[corner.face()]);
            prefetch(&self.corner_vertices[corner.face()]);
        }
    }

    /// Asks for the memory of the vertices after some corners.
    #[inline(always)]
    pub fn prefetch_ends(&self, corners: &[Corner]) {
        for corner in corners {
            let next = corner.next();
            prefetch(&self.positions[self.vertex_of(next)]);
            self.wedge_uv.get(self.wedge_of(next)).into_iter().for_each(prefetch);
        }
    }

    /// Whether the vertex may neither move nor vanish.
    #[inline]
    pub fn is_locked(&self, vertex: LocalVertex) -> bool {
        self.flags[vertex] & flag::LOCKED != 0
    }

    /// Whether another cluster uses the vertex.
    #[inline]
    pub fn is_shared(&self, vertex: LocalVertex) -> bool {
        self.flags[vertex] & flag::SHARED != 0
    }

    /// Whether the vertex belongs to two faces that are close to folded onto each other.
    #[inline]
    pub fn is_near_fold(&self, vertex: LocalVertex) -> bool {
        self.flags[vertex] & flag::FOLDS != 0
    }

    /// Positions of a face's corners.
    #[inline]
    pub fn triangle(&self, face: FaceId) -> [DVec3; 3] {
        // One by one: `map` would copy them once more.
        let [a, b, c] = self.vertices(face);
        [self.positions[a], self.positions[b], self.positions[c]]
    }

    /// Scaled texture coordinates of a face's corners; NaN where there are none.
    #[inline]
    pub fn uv_triangle(&self, face: FaceId) -> [DVec2; 3] {
        let [a, b, c] = self.corners[face];
        [self.wedge_uv[a], self.wedge_uv[b], self.wedge_uv[c]]
    }

    /// Reserves memory for more vertices, wedges and faces.
    pub fn reserve(&mut self, vertices: usize, wedges: usize, faces: usize) {
        self.positions.reserve(vertices);
        self.flags.reserve(vertices);
        self.wedge_vertex.reserve(wedges);
        self.wedge_uv.reserve(wedges);
        self.corners.reserve(faces);
        self.corner_vertices.reserve(faces);
        self.parts.reserve(faces);
        self.deviations.reserve(faces);
        self.is_turned.reserve(faces);
    }

    /// Adds a vertex and returns its id.
    pub fn push_vertex(&mut self, position: DVec3, flags: u8) -> LocalVertex {
        self.flags.push(flags);
        self.positions.push_and_get_key(position)
    }

    /// Adds a wedge and returns its id; [`link_wedges`](ClusterMesh::link_wedges) must follow.
    pub fn push_wedge(&mut self, vertex: LocalVertex, uv: DVec2) -> Wedge {
        self.wedge_uv.push(uv);
        self.wedge_vertex.push_and_get_key(vertex)
    }

    /// Adds a face with a deviation of 0 and returns its id.
    pub fn push_face(&mut self, corners: [Wedge; 3], part: PartId) -> FaceId {
        self.corner_vertices.push(corners.map(|wedge| self.wedge_vertex[wedge]));
        self.parts.push(part);
        self.deviations.push(0.0);
        self.is_turned.push(false);
        self.face_count += 1;
        self.corners.push_and_get_key(corners)
    }

    /// Links the wedges of each vertex into a cycle, in order of their ids, and marks all wedges as not moved.
    pub fn link_wedges(&mut self) {
        let mut first = self.per_vertex(Wedge::NONE);
        let mut last = self.per_vertex(Wedge::NONE);
        self.wedge_moved = self.per_wedge(false);
        self.wedge_next = self.per_wedge(Wedge::NONE);
        for (wedge, &vertex) in self.wedge_vertex.iter_enumerated() {
            match last[vertex].some() {
                None => first[vertex] = wedge,
                Some(last) => self.wedge_next[last] = wedge,
            }
            last[vertex] = wedge;
            self.wedge_next[wedge] = first[vertex];
        }
    }

    /// Moves a wedge to the vertex of the wedge `beside`, and links it into that vertex's cycle.
    pub fn bring_wedge(&mut self, wedge: Wedge, beside: Wedge) {
        self.wedge_vertex[wedge] = self.wedge_vertex[beside];
        self.wedge_next[wedge] = self.wedge_next[beside];
        self.wedge_next[beside] = wedge;
    }

    /// Marks a face as removed.
    pub fn kill(&mut self, face: FaceId) {
        self.corners[face] = [DEAD; 3];
        self.face_count -= 1;
    }

    /// Removes the dead faces.
    pub fn compact_faces(&mut self) {
        let mut kept = 0;
        for face in self.face_ids() {
            if !self.is_dead(face) {
                let place = FaceId::from(kept);
                self.corners[place] = self.corners[face];
                self.corner_vertices[place] = self.corner_vertices[face];
                self.parts[place] = self.parts[face];
                self.deviations[place] = self.deviations[face];
                self.is_turned[place] = self.is_turned[face];
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
        let mut used = self.per_wedge(false);
        for face in self.living_faces() {
            self.corners[face].iter().for_each(|&wedge| used[wedge] = true);
        }
        for wedge in Wedge::first(self.wedge_next.len()).filter(|&wedge| used[wedge]) {
            let mut next = self.wedge_next[wedge];
            while !used[next] {
                next = self.wedge_next[next];
            }
            self.wedge_next[wedge] = next;
        }
    }
}

#[cfg(test)]
pub(crate) mod samples {
    //! Small meshes for tests.

    use super::*;
    use crate::mesh::id::short::w;

    /// Adds faces with these wedges.
    pub fn add_faces(mesh: &mut ClusterMesh, faces: &[[u32; 3]]) {
        for face in faces {
            mesh.push_face(face.map(w), PartId::new(0));
        }
    }

    /// A mesh whose vertices have one wedge each, with the same number.
    pub fn mesh_of(vertices: impl IntoIterator<Item = (DVec3, DVec2)>, faces: &[[u32; 3]]) -> ClusterMesh {
        let mut mesh = ClusterMesh::default();
        for (position, uv) in vertices {
            let vertex = mesh.push_vertex(position, 0);
            mesh.push_wedge(vertex, uv);
        }
        add_faces(&mut mesh, faces);
        mesh.link_wedges();
        mesh
    }

    /// A flat disc of `count` faces around vertex 0.
    pub fn disc(count: u32) -> ClusterMesh {
        let angle = |at: u32| f64::from(at) / f64::from(count) * std::f64::consts::TAU;
        let rim = (0..count).map(|at| DVec3::new(angle(at).cos(), angle(at).sin(), 0.0));
        let vertices = std::iter::once(DVec3::ZERO).chain(rim).map(|place| (place, place.truncate()));
        mesh_of(vertices, &(0..count).map(|at| [0, 1 + at, 1 + (at + 1) % count]).collect::<Vec<_>>())
    }

    /// A grid of n × n unit squares, two triangles each, with uv = 0.1 × position and pseudo-random bumps of height 0
    /// to `bump`.
    pub fn grid(n: u32, bump: f64) -> ClusterMesh {
        let places = (0..=n).flat_map(|y| (0..=n).map(move |x| (x, y)));
        let vertices = places.map(|(x, y)| {
            let z = bump * f64::from((x * 7919 + y * 104_729) % 17) / 17.0;
            let position = DVec3::new(f64::from(x), f64::from(y), z);
            (position, position.truncate() * 0.1)
        });
        let squares = (0..n).flat_map(|y| (0..n).map(move |x| y * (n + 1) + x));
        let faces: Vec<_> = squares.flat_map(|v| [[v, v + 1, v + n + 2], [v, v + n + 2, v + n + 1]]).collect();
        mesh_of(vertices, &faces)
    }

    /// Whether a vertex of a grid of n × n squares lies on its rim.
    pub fn is_on_rim(n: u32, vertex: LocalVertex) -> bool {
        let (x, y) = (vertex.number() % (n + 1), vertex.number() / (n + 1));
        [0, n].contains(&x) || [0, n].contains(&y)
    }

    /// The grid cut into two charts along x = n / 2: vertices on that line have two wedges; u is 6.4 more on the right.
    pub fn two_charts(n: u32) -> ClusterMesh {
        let mut mesh = grid(n, 0.0);
        let middle = n / 2;
        let mut right = std::collections::BTreeMap::new();
        for y in 0..=n {
            let wedge = w(y * (n + 1) + middle);
            let uv = mesh.wedge_uv[wedge] + DVec2::new(6.4, 0.0);
            right.insert(wedge, mesh.push_wedge(mesh.wedge_vertex[wedge], uv));
            for x in middle + 1..=n {
                mesh.wedge_uv[w(y * (n + 1) + x)].x += 6.4;
            }
        }
        for face in mesh.face_ids() {
            let triangle = mesh.triangle(face);
            let centre = (triangle[0].x + triangle[1].x + triangle[2].x) / 3.0;
            if centre > f64::from(middle) {
                mesh.corners[face] = mesh.corners[face].map(|wedge| right.get(&wedge).copied().unwrap_or(wedge));
            }
        }
        mesh.link_wedges();
        mesh
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::id::short::{f, v, w};

    #[test]
    fn wedges_of_a_vertex_form_a_cycle_of_those_in_use() {
        let mut mesh = samples::two_charts(4);
        let on_seam = w(2);
        assert_eq!(mesh.wedge_next[mesh.wedge_next[on_seam]], on_seam);
        assert_ne!(mesh.wedge_next[on_seam], on_seam);
        for face in mesh.face_ids() {
            if mesh.corners[face].iter().any(|&wedge| wedge >= w(25)) {
                mesh.corners[face] = [DEAD; 3];
            }
        }
        mesh.unlink_unused_wedges();
        assert_eq!(mesh.wedge_next[on_seam], on_seam);
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
        (whole.wedge_next, whole.wedge_moved) = (TiVec::new(), TiVec::new());
        assert!(whole.is_sound() && ClusterMesh::default().is_sound());
        let changes: [fn(&mut ClusterMesh); 9] = [
            |mesh| mesh.corners[f(3)][1] = w(9),
            |mesh| mesh.corner_vertices[f(3)][1] = v(6),
            |mesh| mesh.wedge_vertex[w(8)] = v(9),
            |mesh| mesh.flags.truncate(8),
            |mesh| mesh.wedge_uv.truncate(8),
            |mesh| mesh.parts.truncate(7),
            |mesh| mesh.deviations.push(0.0),
            |mesh| mesh.kill(f(0)),
            |mesh| mesh.link_wedges(),
        ];
        for (i, change) in changes.iter().enumerate() {
            let mut changed = whole.clone();
            change(&mut changed);
            assert!(!changed.is_sound(), "change {i}");
        }
    }
}

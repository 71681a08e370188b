//! Cuts handles and necks: closed paths of three edges around which the surface is a tube.
//!
//! ```text
//!        \   |   /              \   |   /
//!         \  |  /                \__|__/      one triangle closes each side; the vertices of the path
//!     a....b....c....a   ──▶     ‾‾‾‾‾‾‾      are duplicated
//!         /  |  \                /  |  \
//!        /   |   \              /   |   \
//! ```
//! No edge of such a path may collapse, because its two sides would meet in one edge of four faces. After the cut both
//! sides are as closed as before, and can be simplified separately.

use glam::{DVec2, DVec3};

use crate::base::id::TiVec;
use crate::geometry::triangle::is_line;
use crate::mesh::class::{Class, Classes};
use crate::mesh::cluster::{ClusterMesh, flag};
use crate::mesh::fold::are_nearly_folded;
use crate::mesh::id::{Corner, LocalVertex, Wedge, WedgePair};
use crate::mesh::ring::{Rings, Spoke};

/// Distance in texture space of a closing face's third corner beyond the side that its texture is taken from, relative
/// to that side.
const LEAN: f64 = 0.05;

/// A vertex inside the surface has two faces at each of its edges, and two edges of each handle that it is on.
const SHORT_SIDES_MIN: u8 = 4;

/// Three vertices, joined pairwise by edges, that are not the corners of a face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Handle {
    /// Squared length of the longest edge.
    pub length_sq: f64,
    /// The vertices, ascending.
    pub vertices: [LocalVertex; 3],
}

/// Handles over free vertices inside the surface whose squared edge lengths are at most `most_sq`, shortest first.
/// `classes` says which vertices are inside.
pub fn find(
    mesh: &ClusterMesh,
    rings: &Rings,
    classes: &Classes,
    is_free: impl Fn(LocalVertex) -> bool,
    most_sq: f64,
) -> Vec<Handle> {
    let is_inside = |v: LocalVertex| matches!(classes[v], Class::Smooth | Class::Seam | Class::Corner) && is_free(v);
    let length_sq = |a: LocalVertex, b: LocalVertex| mesh.positions[a].distance_squared(mesh.positions[b]);
    // For each neighbour of the current vertex `a`: `a`, and the vertex that follows the neighbour in the one-ring.
    let mut around = mesh.per_vertex([LocalVertex::NONE; 2]);
    let (mut found, mut ends) = (Vec::new(), Vec::new());
    let short_sides = count_short_sides(mesh, most_sq);
    for a in mesh.vertex_ids().filter(|&v| short_sides[v] >= SHORT_SIDES_MIN && is_inside(v)) {
        // Each path is found from its lowest vertex.
        ends.clear();
        for [b, follower] in rings.link_edges(mesh, a) {
            if b > a && length_sq(a, b) <= most_sq && is_inside(b) {
                ends.push(b);
                around[b] = [a, follower];
            }
        }
        if ends.len() < 2 {
            continue;
        }
        for &b in &ends {
            for [c, _] in rings.link_edges(mesh, b) {
                let is_face = || around[b][1] == c || around[c][1] == b;
                if c > b && around[c][0] == a && !is_face() {
                    let longest = length_sq(a, b).max(length_sq(b, c)).max(length_sq(c, a));
                    if longest <= most_sq {
                        found.push(Handle { length_sq: longest, vertices: [a, b, c] });
                    }
                }
            }
        }
    }
    found.sort_by(|a, b| a.length_sq.total_cmp(&b.length_sq).then(a.vertices.cmp(&b.vertices)));
    found
}

/// For each vertex how many sides of faces around it are short enough for a handle; many count as `u8::MAX`.
fn count_short_sides(mesh: &ClusterMesh, most_sq: f64) -> TiVec<LocalVertex, u8> {
    let mut counts = mesh.per_vertex(0u8);
    for face in mesh.living_faces() {
        let vertices = mesh.vertices(face);
        for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (vertices[i], vertices[j])) {
            let is_short = u8::from(mesh.positions[a].distance_squared(mesh.positions[b]) <= most_sq);
            for end in [a, b] {
                counts[end] = counts[end].saturating_add(is_short);
            }
        }
    }
    counts
}

/// Cuts handles, except those that share a vertex with one cut before. Returns the vertices whose classes have changed;
/// the rings must be rebuilt.
pub fn cut(mesh: &mut ClusterMesh, rings: &Rings, handles: &[Handle]) -> Vec<LocalVertex> {
    let mut is_used = mesh.per_vertex(false);
    let mut changed = Vec::new();
    for Handle { vertices, .. } in handles {
        if vertices.iter().any(|&v| is_used[v]) {
            continue;
        }
        let Some(sides) = Sides::of(mesh, rings, *vertices) else { continue };
        // From here on the rings are outdated at these vertices.
        vertices.iter().for_each(|&v| is_used[v] = true);
        sides.part(mesh);
        changed.extend_from_slice(vertices);
    }
    changed
}

/// The faces on both sides of a handle, at each of its vertices.
struct Sides {
    vertices: [LocalVertex; 3],
    /// Corners at each vertex whose faces lie to the right of the path from the first vertex to the second.
    right: [Vec<Corner>; 3],
    /// Corners at the first vertex, of the face to the left of the first edge and of the face to the right of it.
    beside_first: [Corner; 2],
    /// Corner at the third vertex of a face to the left.
    left_at_third: Corner,
}

impl Sides {
    fn of(mesh: &ClusterMesh, rings: &Rings, vertices: [LocalVertex; 3]) -> Option<Self> {
        let mut right: [Vec<Corner>; 3] = Default::default();
        for k in 0..3 {
            let (vertex, next, before) = (vertices[k], vertices[(k + 1) % 3], vertices[(k + 2) % 3]);
            let corners: Vec<Corner> = rings.living(mesh, vertex).collect();
            let starting_at =
                |v: LocalVertex| corners.iter().copied().find(|&corner| Spoke::of(mesh, corner).next == v);
            // The faces to the right: from the edge to the previous vertex of the path up to the edge to the next.
            let mut at = starting_at(before)?;
            loop {
                right[k].push(at);
                let previous = Spoke::of(mesh, at).previous;
                if previous == next {
                    break;
                }
                if right[k].len() >= corners.len() {
                    return None;
                }
                at = starting_at(previous)?;
            }
            if right[k].len() == corners.len() {
                return None;
            }
        }
        let [a, b, _] = vertices;
        let at_first =
            |wanted: fn(&Spoke) -> LocalVertex| rings.living(mesh, a).find(|&c| wanted(&Spoke::of(mesh, c)) == b);
        let beside_first = [at_first(|spoke| spoke.next)?, at_first(|spoke| spoke.previous)?];
        let left_at_third = rings.living(mesh, vertices[2]).find(|corner| !right[2].contains(corner))?;
        // The triangle that closes a side must have an area, and not fold onto a face beside it.
        let place = |v: LocalVertex| mesh.positions[v];
        let folds = (0..3).any(|k| {
            let (vertex, next, before) = (vertices[k], vertices[(k + 1) % 3], vertices[(k + 2) % 3]);
            let beside = rings.faces(mesh, vertex).map(|face| mesh.vertices(face)).filter(|face| face.contains(&next));
            let thirds = beside.filter_map(|face| face.into_iter().find(|&v| v != vertex && v != next));
            let mut thirds = thirds.map(place);
            thirds.any(|third| are_nearly_folded([vertex, next].map(place), [third, place(before)]))
        });
        let is_sound = !folds && !is_line(vertices.map(place));
        is_sound.then_some(Self { vertices, right, beside_first, left_at_third })
    }

    /// Gives the right side copies of the vertices, and closes both sides.
    fn part(self, mesh: &mut ClusterMesh) {
        let [left_part, right_part] = self.beside_first.map(|corner| mesh.parts[corner.face()]);
        let [left_turned, right_turned] = self.beside_first.map(|corner| mesh.is_turned[corner.face()]);
        let wedge_at = |mesh: &ClusterMesh, corner: Corner, vertex: LocalVertex| {
            let corners = mesh.corners[corner.face()];
            corners.into_iter().find(|&wedge| mesh.wedge_vertex[wedge] == vertex)
        };
        let [a, b, _] = self.vertices;
        let beyond = self.beside_first.map(|corner| {
            let corners = corner.others().map(|other| mesh.wedge_of(other));
            if mesh.wedge_vertex[corners[0]] == b { corners[1] } else { corners[0] }
        });
        let left = [a, b].map(|v| wedge_at(mesh, self.beside_first[0], v));
        let mut copies = self.vertices;
        for (k, corners) in self.right.iter().enumerate() {
            let vertex = self.vertices[k];
            copies[k] = mesh.copy_vertex(vertex);
            // From old wedges to new ones.
            let mut wedges: Vec<WedgePair> = Vec::new();
            for &corner in corners {
                let old = mesh.wedge_of(corner);
                let new = match wedges.iter().find(|pair| pair.from == old) {
                    Some(pair) => pair.to,
                    None => {
                        let beside = wedges.first().map(|pair| pair.to);
                        let new = mesh.add_wedge(copies[k], mesh.wedge_uv[old], beside);
                        wedges.push(WedgePair { from: old, to: new });
                        new
                    }
                };
                mesh.set_wedge(corner, new);
                mesh.set_vertex(corner, copies[k]);
            }
        }
        let thirds = [self.left_at_third, self.right[2][0]].map(|corner| mesh.wedge_of(corner));
        let [copy_a, copy_b, _] = copies;
        let right = [copy_a, copy_b].map(|v| wedge_at(mesh, self.beside_first[1], v));
        if let [Some(wa), Some(wb)] = left {
            let wc = mesh.closing_wedge([wa, wb], beyond[0], thirds[0]);
            let face = mesh.push_face([wa, wc, wb], left_part);
            mesh.is_turned[face] = left_turned;
        }
        if let [Some(wa), Some(wb)] = right {
            let wc = mesh.closing_wedge([wa, wb], beyond[1], thirds[1]);
            let face = mesh.push_face([wa, wb, wc], right_part);
            mesh.is_turned[face] = right_turned;
        }
    }
}

impl ClusterMesh {
    /// Adds a copy of a vertex at the same position; returns its id.
    fn copy_vertex(&mut self, vertex: LocalVertex) -> LocalVertex {
        let origin = self.origin_of(vertex);
        let copy = self.push_vertex(self.positions[vertex], flag::MOVED);
        self.copied_from.push(origin);
        copy
    }

    /// Adds a wedge and returns its id. It is linked to `beside`, another wedge of its vertex, if there is one.
    pub(super) fn add_wedge(&mut self, vertex: LocalVertex, uv: DVec2, beside: Option<Wedge>) -> Wedge {
        let wedge = self.push_wedge(vertex, uv);
        self.wedge_moved.push(true);
        self.wedge_next.push(wedge);
        beside.into_iter().for_each(|beside| self.bring_wedge(wedge, beside));
        wedge
    }

    /// The wedge for the third corner of a new face beyond a side. `side` holds the wedges of the side, `beyond` is the
    /// third wedge of the existing face there, and `own` a wedge of the vertex at the new corner. Without texture this
    /// is `own`; otherwise a new wedge next to the side in texture space, so that the face shows a line of the texture
    /// and is not mirrored.
    pub(super) fn closing_wedge(&mut self, side: [Wedge; 2], beyond: Wedge, own: Wedge) -> Wedge {
        let vertex = self.wedge_vertex[own];
        let uv = uv_beside(self, side, self.wedge_uv[beyond], self.positions[vertex]);
        if uv.is_nan() { own } else { self.add_wedge(vertex, uv, Some(own)) }
    }
}

/// The texture coordinate for a point beyond a side: near that of the closest point of the side. `beyond` is the third
/// texture coordinate of the side's own face.
fn uv_beside(mesh: &ClusterMesh, side: [Wedge; 2], beyond: DVec2, point: DVec3) -> DVec2 {
    let [from, to] = side.map(|wedge| mesh.positions[mesh.wedge_vertex[wedge]]);
    let [uv_from, uv_to] = side.map(|wedge| mesh.wedge_uv[wedge]);
    let (along, uv_along) = (to - from, uv_to - uv_from);
    let share = ((point - from).dot(along) / along.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    let is_left = uv_along.perp_dot(beyond - uv_from) > 0.0;
    let outwards = if is_left { -uv_along.perp() } else { uv_along.perp() };
    uv_from.lerp(uv_to, share) + LEAN * outwards
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::base::id::TiVec;
    use crate::mesh::class::classify;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::v;

    //  2 ──── 5 ──── 8      three corners a level, closed at both ends; the path 3-4-5 around it is no face
    //  │ ╲    │ ╲    │
    //  0-1 ── 3-4 ── 6-7
    fn tube(levels: u32, uv: DVec2) -> ClusterMesh {
        let at_level = |level: u32| {
            [(0.0, 0.0), (1.0, 0.0), (0.5, 0.9)].map(|(x, y)| (DVec3::new(x, y, 2.0 * f64::from(level)), uv))
        };
        let mut faces = Vec::new();
        for base in (0..levels - 1).map(|level| 3 * level) {
            for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (base + a, base + b)) {
                faces.extend([[a, b, b + 3], [a, b + 3, a + 3]]);
            }
        }
        let top = 3 * (levels - 1);
        faces.extend([[2, 1, 0], [top, top + 1, top + 2]]);
        samples::mesh_of((0..levels).flat_map(at_level), &faces)
    }

    fn found(mesh: &ClusterMesh, most_sq: f64) -> (Rings, Vec<Handle>) {
        let (mut rings, mut classes) = (Rings::default(), TiVec::new());
        rings.build(mesh);
        classify(mesh, &rings, &mut classes);
        let handles = find(mesh, &rings, &classes, |vertex| !mesh.is_locked(vertex), most_sq);
        (rings, handles)
    }

    /// Number of uses of every edge, in either direction.
    fn edges(mesh: &ClusterMesh) -> BTreeMap<[LocalVertex; 2], [u32; 2]> {
        let mut uses: BTreeMap<_, [u32; 2]> = BTreeMap::new();
        for face in &mesh.corner_vertices {
            for (a, b) in [(face[0], face[1]), (face[1], face[2]), (face[2], face[0])] {
                uses.entry([a.min(b), a.max(b)]).or_default()[usize::from(a > b)] += 1;
            }
        }
        uses
    }

    #[test]
    fn ways_around_a_tube_are_its_handles_and_its_ends_are_not() {
        let mesh = tube(4, DVec2::NAN);
        let ways: Vec<[LocalVertex; 3]> = found(&mesh, 1.5).1.iter().map(|handle| handle.vertices).collect();
        assert_eq!(ways, [[3, 4, 5], [6, 7, 8]].map(|way| way.map(v)));
        assert_eq!(found(&mesh, 0.9).1, []);
    }

    #[test]
    fn a_tube_that_is_cut_is_two_closed_ones_each_the_same_way_round() {
        for uv in [DVec2::NAN, DVec2::ONE] {
            let mut mesh = tube(3, uv);
            mesh.is_turned.iter_mut().for_each(|is_turned| *is_turned = uv == DVec2::ONE);
            let (rings, handles) = found(&mesh, f64::INFINITY);
            assert_eq!(cut(&mut mesh, &rings, &handles), [3, 4, 5].map(v));
            assert!(mesh.is_turned.iter().all(|&is_turned| is_turned == (uv == DVec2::ONE)));
            assert_eq!((mesh.corners.len(), mesh.face_count, mesh.positions.len()), (16, 16, 12));
            assert_eq!(mesh.copied_from, [3, 4, 5].map(v));
            assert!(edges(&mesh).values().all(|uses| *uses == [1, 1]), "{:?}", edges(&mesh));
            let is_below = |face: &&[LocalVertex; 3]| face.iter().any(|&vertex| vertex < v(3));
            assert!(mesh.corner_vertices.iter().filter(is_below).flatten().all(|at| !(6..9).contains(&at.number())));
            let vertex_of = |wedge: Wedge| mesh.wedge_vertex[wedge];
            assert!(mesh.corners.iter().zip(&mesh.corner_vertices).all(|(w, v)| w.map(vertex_of) == *v));
            // Wedges are still linked to those of the same vertex.
            assert!(mesh.wedge_next.iter_enumerated().all(|(wedge, &next)| vertex_of(next) == vertex_of(wedge)));
        }
    }

    #[test]
    fn a_handle_of_no_area_is_not_cut() {
        let mut mesh = tube(3, DVec2::NAN);
        mesh.positions[v(5)] = mesh.positions[v(3)].midpoint(mesh.positions[v(4)]);
        let (rings, handles) = found(&mesh, f64::INFINITY);
        assert_eq!(handles.len(), 1);
        assert!(cut(&mut mesh, &rings, &handles).is_empty());
        assert_eq!(mesh.corners.len(), 14);
    }

    #[test]
    fn handles_with_a_vertex_in_common_are_not_cut_at_once() {
        let mut mesh = tube(3, DVec2::NAN);
        let (rings, handles) = found(&mesh, f64::INFINITY);
        assert_eq!(cut(&mut mesh, &rings, &[handles[0], handles[0]]).len(), 3);
    }
}

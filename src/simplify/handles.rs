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

use crate::mesh::class::Class;
use crate::mesh::cluster::{ClusterMesh, flag};
use crate::mesh::fold::are_nearly_folded;
use crate::mesh::ring::{Rings, Spoke};

/// Distance in texture space of a closing face's third corner beyond the side that its texture is taken from, relative
/// to that side.
const LEAN: f64 = 0.05;

/// Three vertices, joined pairwise by edges, that are not the corners of a face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Handle {
    /// Squared length of the longest edge.
    pub length_sq: f64,
    /// The vertices, ascending.
    pub vertices: [u32; 3],
}

/// Handles over free vertices inside the surface whose squared edge lengths are at most `most_sq`, shortest first.
/// `classes` says which vertices are inside.
pub fn find(
    mesh: &ClusterMesh,
    rings: &Rings,
    classes: &[Class],
    is_free: impl Fn(u32) -> bool,
    most_sq: f64,
) -> Vec<Handle> {
    let is_inside = |v: u32| matches!(classes[v as usize], Class::Smooth | Class::Seam | Class::Corner) && is_free(v);
    let length_sq = |a: u32, b: u32| mesh.positions[a as usize].distance_squared(mesh.positions[b as usize]);
    // For each neighbour of the current vertex `a`: `a`, and the vertex that follows the neighbour in the one-ring.
    let mut around = vec![[u32::MAX; 2]; mesh.positions.len()];
    let (mut found, mut ends) = (Vec::new(), Vec::new());
    for a in (0..mesh.positions.len() as u32).filter(|&v| is_inside(v)) {
        // Each path is found from its lowest vertex.
        ends.clear();
        for [b, follower] in edges_at(mesh, rings, a) {
            if b > a && length_sq(a, b) <= most_sq && is_inside(b) {
                ends.push(b);
                around[b as usize] = [a, follower];
            }
        }
        if ends.len() < 2 {
            continue;
        }
        for &b in &ends {
            for [c, _] in edges_at(mesh, rings, b) {
                let is_face = || around[b as usize][1] == c || around[c as usize][1] == b;
                if c > b && around[c as usize][0] == a && !is_face() {
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

/// The other two vertices of each face around a vertex, counter-clockwise. Around an inner vertex every neighbour comes
/// first once, together with the vertex that follows it.
fn edges_at<'a>(mesh: &'a ClusterMesh, rings: &'a Rings, vertex: u32) -> impl Iterator<Item = [u32; 2]> + 'a {
    let living = rings.of(vertex).iter().filter(|&&corner| mesh.living(corner).is_some());
    living.map(|&corner| ClusterMesh::following(corner).map(|corner| mesh.vertex_of(corner)))
}

/// Cuts handles, except those that share a vertex with one cut before. Returns the vertices whose classes have changed;
/// the rings must be rebuilt.
pub fn cut(mesh: &mut ClusterMesh, rings: &Rings, handles: &[Handle]) -> Vec<u32> {
    let mut is_used = vec![false; mesh.positions.len()];
    let mut changed = Vec::new();
    for Handle { vertices, .. } in handles {
        if vertices.iter().any(|&v| is_used[v as usize]) {
            continue;
        }
        let Some(sides) = Sides::of(mesh, rings, *vertices) else { continue };
        // From here on the rings are outdated at these vertices.
        vertices.iter().for_each(|&v| is_used[v as usize] = true);
        sides.part(mesh);
        changed.extend_from_slice(vertices);
    }
    changed
}

/// The faces on both sides of a handle, at each of its vertices.
struct Sides {
    vertices: [u32; 3],
    /// Corners at each vertex whose faces lie to the right of the path from the first vertex to the second.
    right: [Vec<u32>; 3],
    /// Corners at the first vertex, of the face to the left of the first edge and of the face to the right of it.
    beside_first: [u32; 2],
    /// Corner at the third vertex of a face to the left.
    left_at_third: u32,
}

impl Sides {
    fn of(mesh: &ClusterMesh, rings: &Rings, vertices: [u32; 3]) -> Option<Self> {
        let mut right: [Vec<u32>; 3] = Default::default();
        for k in 0..3 {
            let (vertex, next, before) = (vertices[k], vertices[(k + 1) % 3], vertices[(k + 2) % 3]);
            let corners: Vec<u32> =
                rings.of(vertex).iter().copied().filter(|&corner| mesh.living(corner).is_some()).collect();
            let starting_at = |v: u32| corners.iter().copied().find(|&corner| Spoke::of(mesh, corner).next == v);
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
        let at_first = |wanted: fn(&Spoke) -> u32| {
            rings.of(a).iter().copied().find(|&c| mesh.living(c).is_some() && wanted(&Spoke::of(mesh, c)) == b)
        };
        let beside_first = [at_first(|spoke| spoke.next)?, at_first(|spoke| spoke.previous)?];
        let is_left = |corner: &u32| mesh.living(*corner).is_some() && !right[2].contains(corner);
        let left_at_third = rings.of(vertices[2]).iter().copied().find(is_left)?;
        // The triangle that closes a side must not fold onto a face beside it.
        let place = |v: u32| mesh.positions[v as usize];
        let folds = (0..3).any(|k| {
            let (vertex, next, before) = (vertices[k], vertices[(k + 1) % 3], vertices[(k + 2) % 3]);
            let beside = rings.faces(mesh, vertex).map(|face| mesh.vertices(face)).filter(|face| face.contains(&next));
            let thirds = beside.filter_map(|face| face.into_iter().find(|&v| v != vertex && v != next));
            let mut thirds = thirds.map(place);
            thirds.any(|third| are_nearly_folded([vertex, next].map(place), [third, place(before)]))
        });
        (!folds).then_some(Self { vertices, right, beside_first, left_at_third })
    }

    /// Gives the right side copies of the vertices, and closes both sides.
    fn part(self, mesh: &mut ClusterMesh) {
        let [left_part, right_part] = self.beside_first.map(|corner| mesh.parts[corner as usize / 3]);
        let wedge_at = |mesh: &ClusterMesh, corner: u32, vertex: u32| {
            let corners = mesh.corners[corner as usize / 3];
            corners.into_iter().find(|&wedge| mesh.wedge_vertex[wedge as usize] == vertex)
        };
        let [a, b, _] = self.vertices;
        let beyond = self.beside_first.map(|corner| {
            let corners = ClusterMesh::following(corner).map(|c| mesh.wedge_of(c));
            if mesh.wedge_vertex[corners[0] as usize] == b { corners[1] } else { corners[0] }
        });
        let left = [a, b].map(|v| wedge_at(mesh, self.beside_first[0], v));
        let mut copies = [0; 3];
        for (k, corners) in self.right.iter().enumerate() {
            let vertex = self.vertices[k];
            copies[k] = mesh.copy_vertex(vertex);
            let mut wedges: Vec<(u32, u32)> = Vec::new();
            for &corner in corners {
                let old = mesh.wedge_of(corner);
                let new = match wedges.iter().find(|pair| pair.0 == old) {
                    Some(pair) => pair.1,
                    None => {
                        let beside = wedges.first().map(|pair: &(u32, u32)| pair.1);
                        let new = mesh.add_wedge(copies[k], mesh.wedge_uv[old as usize], beside);
                        wedges.push((old, new));
                        new
                    }
                };
                mesh.corners.as_flattened_mut()[corner as usize] = new;
                mesh.corner_vertices.as_flattened_mut()[corner as usize] = copies[k];
            }
        }
        let thirds = [self.left_at_third, self.right[2][0]].map(|corner| mesh.wedge_of(corner));
        let [copy_a, copy_b, _] = copies;
        let right = [copy_a, copy_b].map(|v| wedge_at(mesh, self.beside_first[1], v));
        if let [Some(wa), Some(wb)] = left {
            let wc = mesh.closing_wedge([wa, wb], beyond[0], thirds[0]);
            mesh.push_face([wa, wc, wb], left_part);
        }
        if let [Some(wa), Some(wb)] = right {
            let wc = mesh.closing_wedge([wa, wb], beyond[1], thirds[1]);
            mesh.push_face([wa, wb, wc], right_part);
        }
    }
}

impl ClusterMesh {
    /// Adds a copy of a vertex at the same position; returns its id.
    fn copy_vertex(&mut self, vertex: u32) -> u32 {
        let first = (self.positions.len() - self.copied_from.len()) as u32;
        let origin = if vertex < first { vertex } else { self.copied_from[(vertex - first) as usize] };
        let copy = self.push_vertex(self.positions[vertex as usize], flag::MOVED);
        self.copied_from.push(origin);
        copy
    }

    /// Adds a wedge and returns its id. It is linked to `beside`, another wedge of its vertex, if there is one.
    pub(super) fn add_wedge(&mut self, vertex: u32, uv: DVec2, beside: Option<u32>) -> u32 {
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
    pub(super) fn closing_wedge(&mut self, side: [u32; 2], beyond: u32, own: u32) -> u32 {
        let vertex = self.wedge_vertex[own as usize];
        let uv = uv_beside(self, side, self.wedge_uv[beyond as usize], self.positions[vertex as usize]);
        if uv.is_nan() { own } else { self.add_wedge(vertex, uv, Some(own)) }
    }
}

/// The texture coordinate for a point beyond a side: near that of the closest point of the side. `beyond` is the third
/// texture coordinate of the side's own face.
fn uv_beside(mesh: &ClusterMesh, side: [u32; 2], beyond: DVec2, point: DVec3) -> DVec2 {
    let [from, to] = side.map(|wedge| mesh.positions[mesh.wedge_vertex[wedge as usize] as usize]);
    let [uv_from, uv_to] = side.map(|wedge| mesh.wedge_uv[wedge as usize]);
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
    use crate::mesh::class::classify;

    //  2 ──── 5 ──── 8      three corners a level, closed at both ends; the path 3-4-5 around it is no face
    //  │ ╲    │ ╲    │
    //  0-1 ── 3-4 ── 6-7
    fn tube(levels: u32, uv: DVec2) -> ClusterMesh {
        let mut mesh = ClusterMesh::default();
        for level in 0..levels {
            for (x, y) in [(0.0, 0.0), (1.0, 0.0), (0.5, 0.9)] {
                let vertex = mesh.push_vertex(DVec3::new(x, y, 2.0 * f64::from(level)), 0);
                mesh.push_wedge(vertex, uv);
            }
        }
        for base in (0..levels - 1).map(|level| 3 * level) {
            for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (base + a, base + b)) {
                mesh.push_face([a, b, b + 3], 0);
                mesh.push_face([a, b + 3, a + 3], 0);
            }
        }
        let top = 3 * (levels - 1);
        mesh.push_face([2, 1, 0], 0);
        mesh.push_face([top, top + 1, top + 2], 0);
        mesh.link_wedges();
        mesh
    }

    fn found(mesh: &ClusterMesh, most_sq: f64) -> (Rings, Vec<Handle>) {
        let (mut rings, mut classes) = (Rings::default(), Vec::new());
        rings.build(mesh);
        classify(mesh, &rings, &mut classes);
        let handles = find(mesh, &rings, &classes, |vertex| !mesh.is_locked(vertex), most_sq);
        (rings, handles)
    }

    /// Number of uses of every edge, in either direction.
    fn edges(mesh: &ClusterMesh) -> BTreeMap<(u32, u32), [u32; 2]> {
        let mut uses: BTreeMap<_, [u32; 2]> = BTreeMap::new();
        for face in &mesh.corner_vertices {
            for (a, b) in [(face[0], face[1]), (face[1], face[2]), (face[2], face[0])] {
                uses.entry((a.min(b), a.max(b))).or_default()[usize::from(a > b)] += 1;
            }
        }
        uses
    }

    #[test]
    fn ways_around_a_tube_are_its_handles_and_its_ends_are_not() {
        let mesh = tube(4, DVec2::NAN);
        let ways: Vec<[u32; 3]> = found(&mesh, 1.5).1.iter().map(|handle| handle.vertices).collect();
        assert_eq!(ways, [[3, 4, 5], [6, 7, 8]]);
        assert_eq!(found(&mesh, 0.9).1, []);
    }

    #[test]
    fn a_tube_that_is_cut_is_two_closed_ones_each_the_same_way_round() {
        for uv in [DVec2::NAN, DVec2::ONE] {
            let mut mesh = tube(3, uv);
            let (rings, handles) = found(&mesh, f64::INFINITY);
            assert_eq!(cut(&mut mesh, &rings, &handles), [3, 4, 5]);
            assert_eq!((mesh.corners.len(), mesh.face_count, mesh.positions.len()), (16, 16, 12));
            assert_eq!(mesh.copied_from, [3, 4, 5]);
            assert!(edges(&mesh).values().all(|uses| *uses == [1, 1]), "{:?}", edges(&mesh));
            let is_below = |face: &[u32; 3]| face.iter().any(|&v| v < 3);
            assert!(mesh.corner_vertices.iter().filter(|face| is_below(face)).flatten().all(|v| !(6..9).contains(v)));
            let vertex_of = |wedge: u32| mesh.wedge_vertex[wedge as usize];
            assert!(mesh.corners.iter().zip(&mesh.corner_vertices).all(|(w, v)| w.map(vertex_of) == *v));
            // Wedges are still linked to those of the same vertex.
            let next = |wedge: usize| mesh.wedge_next[wedge] as usize;
            assert!((0..mesh.wedge_vertex.len()).all(|w| mesh.wedge_vertex[next(w)] == mesh.wedge_vertex[w]));
        }
    }

    #[test]
    fn handles_with_a_vertex_in_common_are_not_cut_at_once() {
        let mut mesh = tube(3, DVec2::NAN);
        let (rings, handles) = found(&mesh, f64::INFINITY);
        assert_eq!(cut(&mut mesh, &rings, &[handles[0], handles[0]]).len(), 3);
    }
}

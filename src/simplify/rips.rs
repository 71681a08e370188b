//! Rips: open borders that run along other open borders, such as those of tiles that overlap by a strip. They are
//! closed vertex by vertex, so that the borders do not recede from each other.
//!
//! ```text
//!    \   /  \   /           \   /   \  /
//!   --a0------a1--         --c0------c1--     a0 and b0 merge into c0, a1 and b1 into c1; edges with the same
//!   -b0-------b1--   ──▶   /  \    /   \      ends are then one edge
//!    /  \    /  \
//! ```

use glam::{DVec3, Vec3};

use crate::base::id::TiVec;
use crate::geometry::boxtree::{Bounds, BoxTree, END_OF_SEARCH};
use crate::mesh::ClusterMesh;
use crate::mesh::class::Classes;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::mesh::ring::{Rings, Spoke};

/// Largest number of faces of a vertex that is paired: each compares all pairs of its faces.
pub const FACES_MAX: usize = 32;

/// Border vertices that a search looks at: where thousands lie within the length of one edge, but on borders that do not
/// face its vertex, a tree does not help.
const LOOKS_MAX: u32 = 1024;

/// Border vertices, each with the nearest one of another border, or of another part of its own.
#[derive(Debug, Default)]
pub struct Rips {
    /// Partner of each vertex; empty if there is no border.
    partners: TiVec<LocalVertex, LocalVertex>,
}

impl Rips {
    /// Pairs the border vertices of a mesh without dead faces, over at most the length of their shortest border edge.
    /// Builds a tree over them: O(n log n).
    pub fn pair(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &Classes) {
        self.partners.clear();
        let may_border = |v: &LocalVertex| classes[*v].may_border();
        let mut spokes = Vec::new();
        let mut rims = Vec::new();
        for vertex in mesh.vertex_ids().filter(may_border) {
            rims.extend(Rim::of(mesh, rings, vertex, &mut spokes));
        }
        if rims.is_empty() {
            return;
        }
        self.partners.resize(mesh.positions.len(), LocalVertex::NONE);
        let place = |item: u32| mesh.positions[rims[item as usize].vertex];
        let tree = BoxTree::new(rims.len(), |item| Bounds::around([place(item)]));
        for rim in rims.iter().filter(|rim| !mesh.is_locked(rim.vertex)) {
            let at = mesh.positions[rim.vertex];
            let (mut nearest, mut looks) = ((rim.reach_sq, LocalVertex::NONE), 0);
            tree.nearest_sq(at, rim.reach_sq, |item| {
                looks += 1;
                if looks > LOOKS_MAX {
                    return END_OF_SEARCH;
                }
                let other = &rims[item as usize];
                let distance_sq = at.distance_squared(place(item));
                let is_beside = |face: FaceId| mesh.vertices(face).contains(&other.vertex);
                if (distance_sq, other.vertex) >= nearest
                    || !rim.faces(other)
                    || mesh.is_shared(other.vertex)
                    || rings.faces(mesh, rim.vertex).any(is_beside)
                {
                    return f64::INFINITY;
                }
                nearest = (distance_sq, other.vertex);
                distance_sq
            });
            self.partners[rim.vertex] = nearest.1;
        }
    }

    /// The vertices with a partner, ascending.
    pub fn vertices(&self) -> impl Iterator<Item = LocalVertex> + '_ {
        self.partners.keys().filter(|&vertex| self.partner_of(vertex).is_some())
    }

    /// The vertex of another border that was nearest to a border vertex.
    #[inline]
    pub fn partner_of(&self, vertex: LocalVertex) -> Option<LocalVertex> {
        self.partners.get(vertex)?.some()
    }
}

/// Distance between two vertices, relative to the shortest border edge at the first, at most 1; 1 if [`border_ends`]
/// finds no such edge.
pub fn closeness(mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex, partner: LocalVertex) -> f32 {
    let distance_sq = |other: LocalVertex| mesh.positions[vertex].distance_squared(mesh.positions[other]);
    let reach_sq = border_ends(mesh, rings, vertex).map(distance_sq).min_by(f64::total_cmp);
    reach_sq.map_or(1.0, |reach_sq| (distance_sq(partner) / reach_sq).sqrt().min(1.0) as f32)
}

/// The other ends of the border edges at a vertex; none if it has more than [`FACES_MAX`] faces.
pub fn border_ends(mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex) -> impl Iterator<Item = LocalVertex> {
    let corners = rings.of(vertex);
    // The next and the previous vertex in each face.
    let (mut ends, mut count) = ([[LocalVertex::NONE; 2]; FACES_MAX], 0);
    let mut seen = [VertexFilter::default(); 2];
    if corners.len() <= FACES_MAX {
        for &corner in corners.iter().filter(|&&corner| mesh.living(corner).is_some()) {
            ends[count] = mesh.others_of(corner);
            seen.iter_mut().zip(ends[count]).for_each(|(filter, end)| filter.insert(end));
            count += 1;
        }
    }
    (0..2 * count).filter_map(move |i| {
        let (end, other) = (ends[i / 2][i % 2], 1 - i % 2);
        let is_border = !seen[other].may_contain(end) || ends[..count].iter().all(|ends| ends[other] != end);
        is_border.then_some(end)
    })
}

/// A set of vertices that may seem to contain others, too.
///
/// # Source
/// Bloom, "Space/time trade-offs in hash coding with allowable errors", 1970; with one hash function.
#[derive(Debug, Clone, Copy, Default)]
pub struct VertexFilter([u64; 4]);

impl VertexFilter {
    pub fn insert(&mut self, vertex: LocalVertex) {
        self.0[vertex.index() / 64 % 4] |= 1 << (vertex.index() % 64);
    }

    /// Whether a vertex is in the set, or seems to be.
    pub fn may_contain(&self, vertex: LocalVertex) -> bool {
        self.0[vertex.index() / 64 % 4] >> (vertex.index() % 64) & 1 == 1
    }
}

/// A border at one of its vertices.
#[derive(Debug, PartialEq)]
struct Rim {
    vertex: LocalVertex,
    /// Squared length of its shortest border edge.
    reach_sq: f64,
    /// Unit normal of the faces.
    normal: Vec3,
    /// Unit vector into the surface, perpendicular to the border.
    inwards: Vec3,
}

impl Rim {
    /// The border at a vertex; `None` if it lies on none, or has too many faces. `spokes` is a buffer.
    fn of(mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex, spokes: &mut Vec<Spoke>) -> Option<Self> {
        spokes.clear();
        if rings.of(vertex).len() > FACES_MAX {
            return None;
        }
        spokes.extend(rings.of(vertex).iter().map(|&corner| Spoke::of(mesh, corner)));
        let place = |v: LocalVertex| mesh.positions[v] - mesh.positions[vertex];
        let (mut along, mut reach_sq, mut normal) = (DVec3::ZERO, f64::INFINITY, DVec3::ZERO);
        for spoke in &*spokes {
            normal += place(spoke.next).cross(place(spoke.previous));
            if spokes.iter().all(|other| other.previous != spoke.next) {
                along += place(spoke.next);
                reach_sq = reach_sq.min(place(spoke.next).length_squared());
            }
            if spokes.iter().all(|other| other.next != spoke.previous) {
                along -= place(spoke.previous);
                reach_sq = reach_sq.min(place(spoke.previous).length_squared());
            }
        }
        let normal = normal.normalize_or_zero();
        let inwards = normal.cross(along).normalize_or_zero();
        let (normal, inwards) = (normal.as_vec3(), inwards.as_vec3());
        reach_sq.is_finite().then_some(Self { vertex, reach_sq, normal, inwards })
    }

    /// Whether the surface continues beyond the other border: both have similar normals, and lie on opposite sides.
    fn faces(&self, other: &Self) -> bool {
        self.normal.dot(other.normal) > 0.0 && self.inwards.dot(other.inwards) < 0.0
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use glam::DVec2;
    use proptest::prelude::*;

    use super::*;
    use crate::mesh::class::classify;
    use crate::mesh::cluster::samples::mesh_of;
    use crate::mesh::id::short::v;

    fn with_rings(mesh: ClusterMesh) -> (ClusterMesh, Rings) {
        let mut rings = Rings::default();
        rings.build(&mesh);
        (mesh, rings)
    }

    #[test]
    fn a_partner_is_as_close_as_the_shortest_border_edge_is_long() {
        let places = [[0.0, 0.0], [4.0, 0.0], [0.0, 2.0], [-0.5, 0.0], [-9.0, 0.0]];
        let vertices = places.map(|[x, y]| (DVec3::new(x, y, 0.0), DVec2::ZERO));
        let (mesh, rings) = with_rings(mesh_of(vertices, &[[0, 1, 2]]));
        assert_eq!(closeness(&mesh, &rings, v(0), v(3)), 0.25);
        assert_eq!(closeness(&mesh, &rings, v(0), v(4)), 1.0);
    }

    #[test]
    fn a_vertex_without_border_edges_is_not_close() {
        let places = [[0.0, 0.0], [4.0, 0.0], [0.0, 2.0], [-0.5, 0.0]];
        let vertices = places.map(|[x, y]| (DVec3::new(x, y, 0.0), DVec2::ZERO));
        let (mesh, rings) = with_rings(mesh_of(vertices, &[[0, 1, 2], [0, 2, 1]]));
        assert_eq!(closeness(&mesh, &rings, v(0), v(3)), 1.0);
    }

    // The copies of the first face lie between it and the face across, and face the same way as it does.
    #[test]
    fn a_search_among_very_many_borders_ends() {
        let partner = |copies: u32| {
            let first = [[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]];
            let across = [[-0.5, -0.5], [-4.0, -0.5], [-0.5, -4.0]];
            let vertices = (0..copies).flat_map(|_| first).chain(across);
            let faces: Vec<_> = (0..=copies).map(|at| [3 * at, 3 * at + 1, 3 * at + 2]).collect();
            let (mesh, rings) = with_rings(mesh_of(vertices.map(|[x, y]| (DVec3::new(x, y, 0.0), DVec2::NAN)), &faces));
            let (mut classes, mut rips) = (TiVec::new(), Rips::default());
            classify(&mesh, &rings, &mut classes);
            rips.pair(&mesh, &rings, &classes);
            rips.partner_of(v(0)).map(|partner| partner == v(3 * copies))
        };
        assert_eq!([1, 20, 2 * LOOKS_MAX].map(partner), [Some(true), Some(true), None]);
    }

    proptest! {
        /// Vertices 256 numbers apart are one to a filter.
        #[test]
        fn a_border_edge_has_no_counterpart(
            faces in prop::collection::vec([0u32..5, 0u32..5].prop_filter("two ends", |[a, b]| a != b), 0..FACES_MAX),
        ) {
            let number = |end: u32| 1 + end % 3 + 256 * (end / 3);
            let faces: Vec<_> = faces.into_iter().map(|ends| ends.map(number)).collect();
            let triangles: Vec<_> = faces.iter().map(|&[next, previous]| [0, next, previous]).collect();
            let vertices = (0..300).map(|x| (DVec3::new(f64::from(x), f64::from(x * x % 7), 0.0), DVec2::ZERO));
            let (mesh, rings) = with_rings(mesh_of(vertices, &triangles));
            let expected: BTreeSet<_> = [0, 1]
                .into_iter()
                .flat_map(|side| faces.iter().map(move |ends| (ends[side], 1 - side)))
                .filter(|&(end, other)| faces.iter().all(|ends| ends[other] != end))
                .map(|(end, _)| v(end))
                .collect();
            prop_assert_eq!(border_ends(&mesh, &rings, v(0)).collect::<BTreeSet<_>>(), expected);
        }
    }
}

//! Rips: open borders that run along other open borders, such as those of tiles that overlap by a strip. They are closed
//! vertex by vertex, so that they do not draw back from each other.
//!
//! ```text
//!    \   /  \   /           \   /   \  /
//!   --a0------a1--         --c0------c1--     c0 is a0 and b0: edges that have both ends in common
//!   -b0-------b1--   ──▶   /  \    /   \      are one from then on
//!    /  \    /  \
//! ```

use glam::{DVec3, Vec3};

use crate::geometry::boxtree::{Bounds, BoxTree};
use crate::mesh::ClusterMesh;
use crate::mesh::class::Class;
use crate::mesh::ring::{Rings, Spoke};

/// Two borders along a rip face each other by at least this cosine.
const FACING_MIN: f32 = 0.0;

/// Vertices of more faces have no part in this: each looks at all pairs of its faces.
pub const FACES_MAX: usize = 32;

/// What a border vertex is paired with.
#[derive(Debug, Clone, Copy)]
pub struct Pair {
    /// The nearest vertex of another border.
    pub partner: u32,
    /// Distance to it, as share of the shortest border edge at the border vertex.
    pub closeness: f32,
}

impl Pair {
    const NONE: Self = Self { partner: u32::MAX, closeness: 1.0 };
}

/// Border vertices, each with the nearest one of another border, or of another part of its own.
#[derive(Debug, Default)]
pub struct Rips {
    /// Of each vertex, or empty if there is no border.
    pairs: Vec<Pair>,
}

impl Rips {
    /// Pairs the border vertices of a mesh without dead faces, up to the length of their shortest border edge. Sorts them
    /// by place: O(n log n).
    pub fn pair(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &[Class]) {
        self.pairs.clear();
        let may_border = |v: &u32| classes[*v as usize].may_border();
        let mut spokes = Vec::new();
        let mut rims = Vec::new();
        for vertex in (0..mesh.positions.len() as u32).filter(may_border) {
            rims.extend(Rim::of(mesh, rings, vertex, &mut spokes));
        }
        if rims.is_empty() {
            return;
        }
        self.pairs.resize(mesh.positions.len(), Pair::NONE);
        let place = |item: u32| mesh.positions[rims[item as usize].vertex as usize];
        let tree = BoxTree::new(rims.len(), |item| Bounds::around([place(item)]));
        for rim in rims.iter().filter(|rim| !mesh.is_locked(rim.vertex)) {
            let at = mesh.positions[rim.vertex as usize];
            let mut nearest = (rim.reach_sq, u32::MAX);
            tree.nearest_sq(at, rim.reach_sq, |item| {
                let other = &rims[item as usize];
                let distance_sq = at.distance_squared(place(item));
                let is_beside = |face: u32| mesh.vertices(face).contains(&other.vertex);
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
            if nearest.1 != u32::MAX {
                let closeness = (nearest.0 / rim.reach_sq).sqrt() as f32;
                self.pairs[rim.vertex as usize] = Pair { partner: nearest.1, closeness };
            }
        }
    }

    /// The vertices that have partners, ascending.
    pub fn vertices(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.pairs.len() as u32).filter(|&vertex| self.pair_of(vertex).is_some())
    }

    /// The vertex that a border vertex was paired with.
    #[inline]
    pub fn pair_of(&self, vertex: u32) -> Option<Pair> {
        self.pairs.get(vertex as usize).copied().filter(|pair| pair.partner != u32::MAX)
    }
}

/// Whether one of the border edges at a vertex has an other end that is accepted.
pub fn has_border_end(mesh: &ClusterMesh, rings: &Rings, vertex: u32, mut accept: impl FnMut(u32) -> bool) -> bool {
    let corners = rings.of(vertex);
    if corners.len() > FACES_MAX {
        return false;
    }
    // The vertices that each face has after this one, and before it.
    let (mut ends, mut count) = ([[0; 2]; FACES_MAX], 0);
    for &corner in corners.iter().filter(|&&corner| mesh.living(corner).is_some()) {
        ends[count] = ClusterMesh::following(corner).map(|corner| mesh.vertex_of(corner));
        count += 1;
    }
    let ends = &ends[..count];
    ends.iter().any(|&[next, previous]| {
        (ends.iter().all(|other| other[1] != next) && accept(next))
            || (ends.iter().all(|other| other[0] != previous) && accept(previous))
    })
}

/// A border at one of its vertices.
#[derive(Debug, PartialEq)]
struct Rim {
    vertex: u32,
    /// Squared length of its shortest border edge.
    reach_sq: f64,
    /// Unit normal of the faces.
    normal: Vec3,
    /// Unit vector into the surface, at right angles to the border.
    inwards: Vec3,
}

impl Rim {
    /// Of a vertex, if it lies on a border; `spokes` is scratch space.
    fn of(mesh: &ClusterMesh, rings: &Rings, vertex: u32, spokes: &mut Vec<Spoke>) -> Option<Self> {
        spokes.clear();
        if rings.of(vertex).len() > FACES_MAX {
            return None;
        }
        spokes.extend(rings.of(vertex).iter().map(|&corner| Spoke::of(mesh, corner)));
        let place = |v: u32| mesh.positions[v as usize] - mesh.positions[vertex as usize];
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

    /// Whether the surface goes on beyond the other border: both look the same way, and lie on opposite sides.
    fn faces(&self, other: &Self) -> bool {
        self.normal.dot(other.normal) > FACING_MIN && self.inwards.dot(other.inwards) < -FACING_MIN
    }
}

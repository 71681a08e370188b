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
use crate::geometry::boxtree::{Bounds, BoxTree};
use crate::mesh::ClusterMesh;
use crate::mesh::class::Classes;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::mesh::ring::{Rings, Spoke};

/// Lowest cosine of the angle between the normals, and between the opposed inward directions, of two borders along a
/// rip.
const FACING_MIN: f32 = 0.0;

/// Largest number of faces of a vertex that is paired: each compares all pairs of its faces.
pub const FACES_MAX: usize = 32;

/// The partner of a border vertex.
#[derive(Debug, Clone, Copy)]
pub struct Partner {
    /// The nearest vertex of another border.
    pub partner: LocalVertex,
    /// Distance to it, relative to the shortest border edge at the border vertex.
    pub closeness: f32,
}

impl Partner {
    const NONE: Self = Self { partner: LocalVertex::NONE, closeness: 1.0 };
}

/// Border vertices, each with the nearest one of another border, or of another part of its own.
#[derive(Debug, Default)]
pub struct Rips {
    /// Pair of each vertex; empty if there is no border.
    pairs: TiVec<LocalVertex, Partner>,
}

impl Rips {
    /// Pairs the border vertices of a mesh without dead faces, over at most the length of their shortest border edge.
    /// Builds a tree over them: O(n log n).
    pub fn pair(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &Classes) {
        self.pairs.clear();
        let may_border = |v: &LocalVertex| classes[*v].may_border();
        let mut spokes = Vec::new();
        let mut rims = Vec::new();
        for vertex in mesh.vertex_ids().filter(may_border) {
            rims.extend(Rim::of(mesh, rings, vertex, &mut spokes));
        }
        if rims.is_empty() {
            return;
        }
        self.pairs.resize(mesh.positions.len(), Partner::NONE);
        let place = |item: u32| mesh.positions[rims[item as usize].vertex];
        let tree = BoxTree::new(rims.len(), |item| Bounds::around([place(item)]));
        for rim in rims.iter().filter(|rim| !mesh.is_locked(rim.vertex)) {
            let at = mesh.positions[rim.vertex];
            let mut nearest = (rim.reach_sq, LocalVertex::NONE);
            tree.nearest_sq(at, rim.reach_sq, |item| {
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
            if nearest.1 != LocalVertex::NONE {
                let closeness = (nearest.0 / rim.reach_sq).sqrt() as f32;
                self.pairs[rim.vertex] = Partner { partner: nearest.1, closeness };
            }
        }
    }

    /// The vertices with a partner, ascending.
    pub fn vertices(&self) -> impl Iterator<Item = LocalVertex> + '_ {
        self.pairs.keys().filter(|&vertex| self.pair_of(vertex).is_some())
    }

    /// The pair of a border vertex; `None` if it has no partner.
    #[inline]
    pub fn pair_of(&self, vertex: LocalVertex) -> Option<Partner> {
        self.pairs.get(vertex).copied().filter(|pair| pair.partner != LocalVertex::NONE)
    }
}

/// Whether `accept` returns `true` for the other end of some border edge at a vertex.
pub fn has_border_end(
    mesh: &ClusterMesh,
    rings: &Rings,
    vertex: LocalVertex,
    mut accept: impl FnMut(LocalVertex) -> bool,
) -> bool {
    let corners = rings.of(vertex);
    if corners.len() > FACES_MAX {
        return false;
    }
    // The next and the previous vertex in each face.
    let (mut ends, mut count) = ([[LocalVertex::NONE; 2]; FACES_MAX], 0);
    for &corner in corners.iter().filter(|&&corner| mesh.living(corner).is_some()) {
        ends[count] = mesh.others_of(corner);
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
        self.normal.dot(other.normal) > FACING_MIN && self.inwards.dot(other.inwards) < -FACING_MIN
    }
}

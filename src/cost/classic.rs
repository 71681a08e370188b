//! The baseline of the published systems: squared distance to planes, all of the same weight.
//!
//! # Source
//! Garland & Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH 1997.
//!
//! | symbol | here |
//! | --- | --- |
//! | Kp of a face's plane p, without the weight of its area | `planes::unit_planes` |
//! | Q = Σ Kp over the faces around a vertex (§5) | `quadrics` |
//! | v̄ of least v̄ᵀ(Q1 + Q2)v̄ (§4) | [`PlacePolicy::place`] |
//! | constraint planes through border edges (§6) | `border` |
//!
//! The sum Q1 + Q2 is kept from the first stage of a pass to its last. Without `border`, as in the baseline that papers
//! compare with, an open border has no constraint planes and wears away.
//!
//! # Where we differ
//! * Only edges are candidate pairs: two vertices without a common edge never merge.
//! * Folds are refused and the link condition holds, as for every metric here; the paper leaves both to the reader.
//!   With `guards=0` faces may fold, become needles, and turn over in the texture, as in the baselines that papers
//!   compare with.
//! * A spring of a millionth of the stiffness keeps the minimum near the edge where the planes do not determine it. If
//!   the minimum is more than two edge lengths away, the best of the middle and both ends is taken.
//! * Texture seams collapse along themselves; texture coordinates are read off the old surface. With `guards=0` they
//!   are those of the edge at the point nearest to the new vertex.
//! * Collapses are made in rounds, not from a heap: see [`engine`](crate::simplify::engine).
//!
//! `placement=three` takes the best of both ends and the middle, as the paper does where the minimum does not exist
//! (§4), and as the baseline of [`sharpness`](super::sharpness) does everywhere.
//!
//! # Memory
//! 80 bytes a vertex.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::metric::{EdgeCase, Metric, Placement, fits};
use super::parameter::{Parameter, choice, factor, switch};
use super::planes::{PlacePolicy, area_of, ends, extended, priced, texcoords_along, unit_planes};
use super::quadric::Quadric;
use crate::base::id::TiVec;
use crate::mesh::class::{Class, Classes, Rule};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::edge::EdgeKind;
use crate::mesh::id::LocalVertex;
use crate::mesh::ring::Rings;

/// Parameters.
pub const PARAMETERS: [Parameter; 3] = [
    factor("border", 0.0, "weight of the planes through border edges; 0 leaves borders to wear away"),
    choice("placement", PlacePolicy::WORDS, "three places vertices at the best of both ends and the middle"),
    switch("guards", 1.0, "0 lets faces fold, become needles and turn over in the texture"),
];

/// Settings, in the order of [`PARAMETERS`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ClassicSettings {
    /// Weight of a plane through a border edge.
    pub border: f64,
    /// Placement of a vertex.
    pub placement: PlacePolicy,
    /// Whether collapses that fold faces or turn texture over are refused.
    pub has_guards: bool,
}

impl From<[f64; 3]> for ClassicSettings {
    fn from([border, placement, guards]: [f64; 3]) -> Self {
        Self { border, placement: PlacePolicy::from_parameter(placement), has_guards: guards > 0.0 }
    }
}

/// The cost function: a quadric per vertex of a cluster.
#[derive(Debug)]
pub struct ClassicCost {
    settings: ClassicSettings,
    quadrics: TiVec<LocalVertex, Quadric>,
    area: f64,
}

impl Metric for ClassicCost {
    type Settings = ClassicSettings;

    fn new(settings: &ClassicSettings) -> Self {
        Self { settings: *settings, quadrics: TiVec::new(), area: 0.0 }
    }

    fn reads_texture(_: &ClassicSettings) -> bool {
        false
    }

    fn refresh(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &Classes) {
        self.area = area_of(mesh);
        let kept = std::mem::take(&mut self.quadrics);
        let planes = |first| unit_planes(mesh, rings, classes, self.settings.border).raw.split_off(first);
        self.quadrics = extended(kept, mesh.positions.len(), planes);
    }

    fn place(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> Placement {
        let sum = self.quadrics[edge.from] + self.quadrics[edge.to];
        let position = self.settings.placement.place(mesh, edge, &sum);
        priced(mesh, edge, position, sum.at(position))
    }

    fn join(&mut self, _mesh: &ClusterMesh, edge: &EdgeCase<'_>) {
        let vanished = self.quadrics[edge.from];
        self.quadrics[edge.to] += vanished;
    }

    fn area(&self) -> f64 {
        self.area
    }

    fn has_guards(&self) -> bool {
        self.settings.has_guards
    }

    fn texcoords(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>, position: DVec3, out: &mut Vec<DVec2>) -> bool {
        if self.settings.has_guards {
            return false;
        }
        let (pa, pb) = ends(mesh, edge);
        let along = (position - pa).dot(pb - pa) / pa.distance_squared(pb);
        let share = if along.is_finite() { along.clamp(0.0, 1.0) } else { 1.0 };
        texcoords_along(mesh, edge, share, out);
        true
    }

    /// Without border planes a border vertex is unconstrained: collapses onto it and along the border have free
    /// placement.
    fn rule(&self, from: Class, to: Class, kind: EdgeKind) -> Rule {
        match (from, to, kind) {
            (Class::Smooth, Class::Border, EdgeKind::Inner) if self.settings.border == 0.0 => Rule::Free,
            (Class::Border, Class::Border, EdgeKind::Border) if self.settings.border == 0.0 => Rule::Free,
            _ if fits(from, kind) => from.rule(to),
            _ => Rule::Never,
        }
    }
}

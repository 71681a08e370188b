//! The baseline of the published systems: squared distance to planes, all of the same weight.
//!
//! # Source
//! Garland & Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH 1997.
//!
//! | symbol | here |
//! | --- | --- |
//! | Kp of a face's plane p, without the weight of its area | `planes::unit_planes` |
//! | Q = Σ Kp over the faces around a vertex (§5) | `quadrics` |
//! | v̄ of least v̄ᵀ(Q1 + Q2)v̄ (§4) | `planes::best_place` |
//! | constraint planes through border edges (§6) | `border` |
//!
//! Q1 + Q2 is carried from the first stage of a pass to its last. Without `border`, which is the baseline that papers
//! compare with, an open border is surface like any other and wears away.
//!
//! # Where we differ
//! * Only edges are pairs: no two vertices are joined that no edge joins.
//! * Folds are refused, and the link condition holds, as for every metric here; the paper leaves both to the reader.
//! * A spring of a millionth of the stiffness keeps the minimum near the edge where the planes do not determine it; a
//!   minimum beyond two edge lengths gives way to the best of the middle and both ends.
//! * Seams of the texture collapse along themselves; the picture is read off the old surface.
//!
//! # Memory
//! 80 bytes a vertex.

use super::knob::{Knob, factor};
use super::metric::{Metric, fits};
use super::planes::{area_of, best_place, newcomers, priced, unit_planes};
use super::quadric::Quadric;
use super::surface::{EdgeCase, Placement};
use crate::mesh::class::{Class, Rule};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::edge::EdgeKind;
use crate::mesh::ring::Rings;

/// What may be set.
pub const KNOBS: [Knob; 1] =
    [factor("border", 0.0, "weight of the planes through border edges; 0 leaves borders to wear away")];

/// Settings, in the order of [`KNOBS`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Weight of a plane through a border edge.
    pub border: f64,
}

impl From<[f64; 1]> for Settings {
    fn from([border]: [f64; 1]) -> Self {
        Self { border }
    }
}

/// Quadrics of every vertex of a cluster.
#[derive(Debug)]
pub struct ClassicCost {
    settings: Settings,
    quadrics: Vec<Quadric>,
    area: f64,
}

impl Metric for ClassicCost {
    type Settings = Settings;

    fn new(settings: &Settings) -> Self {
        Self { settings: *settings, quadrics: Vec::new(), area: 0.0 }
    }

    fn reads_texture(_: &Settings) -> bool {
        false
    }

    fn refresh(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &[Class]) {
        self.area = area_of(mesh);
        let planes = || unit_planes(mesh, rings, classes, self.settings.border);
        self.quadrics.extend(newcomers(self.quadrics.len(), mesh.positions.len(), planes));
    }

    fn place(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> Placement {
        let sum = self.quadrics[edge.from as usize] + self.quadrics[edge.to as usize];
        let position = best_place(mesh, edge, &sum);
        priced(mesh, edge, position, sum.at(position))
    }

    fn join(&mut self, _mesh: &ClusterMesh, edge: &EdgeCase<'_>) {
        let vanished = self.quadrics[edge.from as usize];
        self.quadrics[edge.to as usize] += vanished;
    }

    fn area(&self) -> f64 {
        self.area
    }

    /// Without border planes a border vertex is free: an inner one that joins it goes where the planes want it.
    fn rule(&self, from: Class, to: Class, kind: EdgeKind) -> Rule {
        match (from, to, kind) {
            (Class::Smooth, Class::Border, EdgeKind::Inner) if self.settings.border == 0.0 => Rule::Free,
            (Class::Border, Class::Border, EdgeKind::Border) if self.settings.border == 0.0 => Rule::Free,
            _ if fits(from, kind) => from.rule(to),
            _ => Rule::Never,
        }
    }
}

//! Quadrics weighted by sharpness and by the texture area of a face: small parts and painted detail outlast the rest.
//!
//! # Source
//! Li, Jiang, Tang, "High-quality simplified algorithm of texture model for detailed features preserving", Application
//! Research of Computers 37(1), 2020, doi 10.19734/j.issn.1001-3695.2018.04.0481.
//!
//! | symbol | here |
//! | --- | --- |
//! | N_i, S_i, S: normals, areas and whole area of a ring | [`Fan`] |
//! | σ = Σ (S_i + S_i+1) / 2S · angle(N_i, N_i+1) \[5\] | [`sharpness`] |
//! | R = (1/n) Σ S_tex / S \[6\] | `texture_share` |
//! | cost = v0ᵀ (A^(σ1+R1) Q1 + A^(σ2+R2) Q2) v0 with A = 2 \[7\] | `quadrics`, [`BASE`] |
//!
//! The candidates for v0 are both ends and the middle; texture coordinates are interpolated like positions. The factors
//! are applied to Q at the start of a pass and never recomputed; weighted Qs add. Boundary and complex vertices never
//! vanish.
//!
//! # Where we differ
//! * R is divided by its mean over the whole mesh, since its unit is uv² / length², and is at most `cap`: slivers
//!   overflow 2^R. S_tex is first scaled to lengths for each material, as for every metric here, so R compares places
//!   of one texture, not textures with each other.
//! * Q is the sum of unit planes; those of seam edges are added with half the weight of `border`.
//! * Seams collapse along themselves.
//! * Edges at boundary and complex vertices never collapse; the paper gives them the maximal cost, so that they go
//!   last. If `boundary` is 1, an inner vertex may collapse onto a boundary vertex, which stays.
//! * Collapses are made in rounds, not from a heap: see [`engine`](crate::simplify::engine).
//!
//! # Memory
//! 80 bytes a vertex.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::fan::{Fan, angle_between};
use super::mesh_stats::MeshStats;
use super::metric::{EdgeCase, Metric, Placement, fits};
use super::parameter::{Parameter, factor, number, switch};
use super::planes::{area_of, ends, extended, least, priced, texcoords_along, unit_planes};
use super::quadric::Quadric;
use crate::base::id::TiVec;
use crate::mesh::class::{Class, Classes, Rule};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::edge::EdgeKind;
use crate::mesh::id::LocalVertex;
use crate::mesh::ring::Rings;

/// The base A of the weight.
pub const BASE: f64 = 2.0;

/// Parameters.
pub const PARAMETERS: [Parameter; 5] = [
    switch("sigma", 1.0, "0 leaves the sharpness out"),
    switch("texture", 1.0, "0 leaves the texture factor out"),
    number("cap", 8.0, [0.0, 64.0], "largest texture factor, in means of the mesh"),
    factor("border", 1.0, "weight of the planes through border edges"),
    switch("boundary", 0.0, "1 lets inner vertices join boundary vertices, which stay"),
];

/// Settings, in the order of [`PARAMETERS`], and the frozen mean.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SharpnessSettings {
    has_sigma: bool,
    has_texture: bool,
    cap: f64,
    border: f64,
    joins_boundary: bool,
    /// Mean of R over the mesh.
    mean_share: f64,
}

impl From<[f64; 5]> for SharpnessSettings {
    fn from([sigma, texture, cap, border, boundary]: [f64; 5]) -> Self {
        Self {
            has_sigma: sigma > 0.0,
            has_texture: texture > 0.0,
            cap,
            border,
            joins_boundary: boundary > 0.0,
            mean_share: 1.0,
        }
    }
}

/// σ of a vertex; 0 if its one-ring has no area.
pub fn sharpness(fan: &Fan) -> f64 {
    let area = fan.area();
    if area <= 0.0 {
        return 0.0;
    }
    let joints = fan.joints().filter(|(a, b, _)| a.area > 0.0 && b.area > 0.0);
    joints.map(|(a, b, _)| (a.area + b.area) / (2.0 * area) * angle_between(a.normal, b.normal)).sum()
}

/// R of a vertex; 0 without texture.
fn texture_share(mesh: &ClusterMesh, fan: &Fan) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for spoke in fan.spokes.iter().filter(|spoke| spoke.area > 0.0) {
        let uv = mesh.uv_triangle(spoke.face);
        let texture = 0.5 * (uv[1] - uv[0]).perp_dot(uv[2] - uv[0]).abs();
        if texture.is_finite() {
            sum += texture / spoke.area;
            count += 1.0;
        }
    }
    if count > 0.0 { sum / count } else { 0.0 }
}

/// The cost function: a weighted quadric per vertex of a cluster.
#[derive(Debug)]
pub struct SharpnessCost {
    settings: SharpnessSettings,
    quadrics: TiVec<LocalVertex, Quadric>,
    complex: TiVec<LocalVertex, bool>,
    area: f64,
}

impl SharpnessCost {
    /// Quadrics of all vertices, times A^(σ+R).
    fn sharp_planes(&self, mesh: &ClusterMesh, rings: &Rings, classes: &Classes) -> Vec<Quadric> {
        let mut quadrics = unit_planes(mesh, rings, classes, self.settings.border);
        let mut fan = Fan::default();
        for (vertex, quadric) in quadrics.iter_mut_enumerated() {
            fan.gather(mesh, rings, vertex);
            let sigma = if self.settings.has_sigma { sharpness(&fan) } else { 0.0 };
            let share = texture_share(mesh, &fan) / self.settings.mean_share;
            let share = if self.settings.has_texture { share.min(self.settings.cap) } else { 0.0 };
            *quadric = quadric.scaled(libm::pow(BASE, sigma + share));
        }
        quadrics.raw
    }

    fn sum(&self, edge: &EdgeCase<'_>) -> Quadric {
        self.quadrics[edge.from] + self.quadrics[edge.to]
    }

    /// Position along the edge, from the end that vanishes (0) to the one that stays (1): 0, ½ or 1.
    fn best_share(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> f64 {
        let (pa, pb) = ends(mesh, edge);
        let sum = self.sum(edge);
        if edge.onto { 1.0 } else { least([0.5, 0.0, 1.0], |share| sum.at(pa.lerp(pb, share))) }
    }
}

impl Metric for SharpnessCost {
    type Settings = SharpnessSettings;

    const NEEDS_STATS: bool = true;

    fn new(settings: &SharpnessSettings) -> Self {
        Self { settings: *settings, quadrics: TiVec::new(), complex: TiVec::new(), area: 0.0 }
    }

    fn count(_: &SharpnessSettings, mesh: &ClusterMesh, rings: &Rings, _: &Classes, stats: &mut MeshStats) {
        let mut fan = Fan::default();
        for vertex in mesh.vertex_ids().filter(|&vertex| !mesh.is_shared(vertex)) {
            fan.gather(mesh, rings, vertex);
            stats.add(texture_share(mesh, &fan));
        }
    }

    fn normalise(settings: &mut SharpnessSettings, stats: &MeshStats) {
        settings.mean_share = stats.mean().filter(|&mean| mean > 0.0).unwrap_or(1.0);
    }

    fn refresh(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &Classes) {
        self.area = area_of(mesh);
        let kept = std::mem::take(&mut self.quadrics);
        let planes = |first| self.sharp_planes(mesh, rings, classes).split_off(first);
        self.quadrics = extended(kept, mesh.positions.len(), planes);
        let is_complex = |(vertex, class): (_, &Class)| *class == Class::Complex && !mesh.is_shared(vertex);
        self.complex.extend(classes.iter_enumerated().skip(self.complex.len()).map(is_complex));
    }

    fn place(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> Placement {
        let (pa, pb) = ends(mesh, edge);
        let position = pa.lerp(pb, self.best_share(mesh, edge));
        if self.complex[edge.to] && !self.settings.joins_boundary {
            return Placement { position, cost: f64::INFINITY };
        }
        priced(mesh, edge, position, self.sum(edge).at(position))
    }

    fn join(&mut self, _mesh: &ClusterMesh, edge: &EdgeCase<'_>) {
        let vanished = self.quadrics[edge.from];
        self.quadrics[edge.to] += vanished;
    }

    fn area(&self) -> f64 {
        self.area
    }

    fn rule(&self, from: Class, to: Class, kind: EdgeKind) -> Rule {
        let touches_border = from.is_border() || to.is_border();
        let is_allowed = !touches_border || (self.settings.joins_boundary && !from.is_border());
        if is_allowed && fits(from, kind) { from.rule(to) } else { Rule::Never }
    }

    fn texcoords(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>, _position: DVec3, out: &mut Vec<DVec2>) -> bool {
        texcoords_along(mesh, edge, self.best_share(mesh, edge), out);
        true
    }
}

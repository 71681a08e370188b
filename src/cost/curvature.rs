//! Quadrics weighted by area and curvature: thin parts outlast flat ones.
//!
//! # Source
//! Quan, Wu, Yang, Bai, Wang, Zhao, Wang, Wei, Hou, "Improved QEM three-dimensional model simplification method",
//! patent CN105303614A, 2015/2016. The published text lacks its formulas; they are reconstructed here.
//!
//! | symbol | here |
//! | --- | --- |
//! | e_j, α_j = angle(e_j, e_j+1), n_j | edges, angles and normals of the [`Fan`] |
//! | β_j = angle between the normals of the faces at e_j, 0 when flat | `angle_between` |
//! | A = area of the ring | `Fan::area` |
//! | K = (2π - Σα_j) / (A/3), H = ¼ Σ \|e_j\| β_j / (A/3) | `Bend::gauss`, `Bend::mean` |
//! | c = k1² + k2² = 4H² - 2K | `Bend::total` |
//! | Q' = A c Q \[4.12\] | `weights` × `quadrics` |
//!
//! A c has no unit, so the cost is a length² at any scale. Each round of collapses recomputes the areas and curvatures
//! of the vertices around it. `curvature=0` sets c = 1 and changes nothing else: the patent's area-weighted baseline.
//!
//! # Where we differ
//! * A/3 instead of the patent's A, with which c is negative on a sphere.
//! * c is at least `floor` times the median of its positive values over the whole mesh (1 / diagonal² if there are
//!   none), so that collapses on flat ground are ordered, too.
//! * On borders K = 0, and edges without two faces are left out of H: a flat border has no curvature.
//! * Border and seam edges have their own planes, weighted by `border`, as in the metric of 1997, so that they keep
//!   their line.
//! * The patent does not say whether areas weight each plane or the sum of a vertex; here they weight the sum.
//! * Q is accumulated without its weight; the weighted sum of both ends is minimised.
//! * If the minimum is more than two edge lengths away, the best of the middle and both ends is taken.
//! * Collapses are made in rounds, not from a heap: see [`engine`](crate::simplify::engine).
//!
//! # Memory
//! 104 bytes a vertex.

use std::f64::consts::TAU;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::around::Around;
use super::fan::{Fan, angle_between};
use super::mesh_stats::MeshStats;
use super::metric::{EdgeCase, Metric, Placement};
use super::parameter::{Parameter, factor, switch};
use super::planes::{area_of, best_place, extended, priced, unit_planes};
use super::quadric::Quadric;
use crate::base::id::{TiSlice, TiVec};
use crate::mesh::class::Classes;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::LocalVertex;
use crate::mesh::ring::Rings;

/// Parameters.
pub const PARAMETERS: [Parameter; 3] = [
    switch("curvature", 1.0, "0 takes c = 1: quadrics weighted by area alone, the patent's baseline"),
    factor("floor", 1e-3, "least c, in medians of its positive values"),
    factor("border", 1.0, "weight of the planes through border edges"),
];

/// Settings, in the order of [`PARAMETERS`], and the frozen floor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CurvatureSettings {
    has_curvature: bool,
    floor_share: f64,
    border: f64,
    /// Least c, in 1 / length².
    floor: f64,
}

impl From<[f64; 3]> for CurvatureSettings {
    fn from([curvature, floor_share, border]: [f64; 3]) -> Self {
        Self { has_curvature: curvature > 0.0, floor_share, border, floor: 0.0 }
    }
}

/// Curvature and area at a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Bend {
    /// Gaussian curvature K, in 1 / length².
    pub gauss: f64,
    /// Mean curvature H, in 1 / length.
    pub mean: f64,
    /// Area A of the one-ring.
    area: f64,
}

impl Bend {
    pub fn of(fan: &Fan, centre: DVec3, positions: &TiSlice<LocalVertex, DVec3>) -> Self {
        let area = fan.area();
        if area <= 0.0 {
            return Self::default();
        }
        let third = area / 3.0;
        let angles: f64 = fan.spokes.iter().filter(|spoke| spoke.area > 0.0).map(|spoke| spoke.angle).sum();
        let bent = fan.joints().filter(|(a, b, _)| a.area > 0.0 && b.area > 0.0);
        let turn: f64 =
            bent.map(|(a, b, end)| positions[end].distance(centre) * angle_between(a.normal, b.normal)).sum();
        Self { gauss: if fan.is_closed { (TAU - angles) / third } else { 0.0 }, mean: 0.25 * turn / third, area }
    }

    /// c = 4H² - 2K, clamped at 0; in 1 / length².
    pub fn total(&self) -> f64 {
        (4.0 * self.mean * self.mean - 2.0 * self.gauss).max(0.0)
    }
}

/// The cost function: a quadric and a weight per vertex of a cluster.
#[derive(Debug)]
pub struct CurvatureCost {
    settings: CurvatureSettings,
    quadrics: TiVec<LocalVertex, Quadric>,
    /// A c of each vertex.
    weights: TiVec<LocalVertex, f64>,
    around: Around,
    fan: Fan,
    area: f64,
}

impl CurvatureCost {
    fn weigh(&mut self, mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex) {
        self.fan.gather(mesh, rings, vertex);
        let bend = Bend::of(&self.fan, mesh.positions[vertex], &mesh.positions);
        let curvature = if self.settings.has_curvature { bend.total().max(self.settings.floor) } else { 1.0 };
        self.weights[vertex] = bend.area * curvature;
    }
}

#[cfg(test)]
impl CurvatureCost {
    /// A c of a vertex.
    pub(super) fn weight(&self, vertex: LocalVertex) -> f64 {
        self.weights[vertex]
    }
}

impl Metric for CurvatureCost {
    type Settings = CurvatureSettings;

    const VERTEX_BYTES: u64 = 24;
    const NEEDS_STATS: bool = true;

    fn new(settings: &CurvatureSettings) -> Self {
        Self {
            settings: *settings,
            quadrics: TiVec::new(),
            weights: TiVec::new(),
            around: Around::default(),
            fan: Fan::default(),
            area: 0.0,
        }
    }

    fn count(_: &CurvatureSettings, mesh: &ClusterMesh, rings: &Rings, _: &Classes, stats: &mut MeshStats) {
        let mut fan = Fan::default();
        for vertex in mesh.vertex_ids().filter(|&vertex| !mesh.is_shared(vertex)) {
            fan.gather(mesh, rings, vertex);
            stats.add(Bend::of(&fan, mesh.positions[vertex], &mesh.positions).total());
        }
    }

    fn normalise(settings: &mut CurvatureSettings, stats: &MeshStats) {
        let smallest = 1.0 / (stats.diagonal() * stats.diagonal());
        settings.floor = stats.median().map_or(smallest, |median| settings.floor_share * median);
    }

    fn reads_texture(_: &CurvatureSettings) -> bool {
        false
    }

    fn refresh(&mut self, mesh: &ClusterMesh, rings: &Rings, classes: &Classes) {
        self.area = area_of(mesh);
        let kept = std::mem::take(&mut self.quadrics);
        let planes = |first| unit_planes(mesh, rings, classes, self.settings.border).raw.split_off(first);
        self.quadrics = extended(kept, mesh.positions.len(), planes);
        self.weights.resize(mesh.positions.len(), 0.0);
        self.around.resize(mesh.positions.len());
        for vertex in mesh.vertex_ids() {
            self.weigh(mesh, rings, vertex);
        }
    }

    fn place(&self, mesh: &ClusterMesh, edge: &EdgeCase<'_>) -> Placement {
        let (from, to) = (edge.from, edge.to);
        let sum = self.quadrics[from].scaled(self.weights[from]) + self.quadrics[to].scaled(self.weights[to]);
        let position = best_place(mesh, edge, &sum);
        priced(mesh, edge, position, sum.at(position))
    }

    fn join(&mut self, _mesh: &ClusterMesh, edge: &EdgeCase<'_>) {
        let vanished = self.quadrics[edge.from];
        self.quadrics[edge.to] += vanished;
    }

    fn area(&self) -> f64 {
        self.area
    }

    fn follow(&mut self, mesh: &ClusterMesh, rings: &Rings, survivors: &[LocalVertex], changed: &mut Vec<LocalVertex>) {
        let start = changed.len();
        self.around.collect(mesh, rings, survivors, changed);
        changed[start..].iter().for_each(|&vertex| self.weigh(mesh, rings, vertex));
    }
}

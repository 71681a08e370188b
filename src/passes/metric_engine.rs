//! The engine together with its metric, behind an interface that does not name the metric.
//!
//! The engine is compiled once per metric; everything above this interface is compiled once.

use serde::{Deserialize, Serialize};

use super::floor::Floor;
use super::sample;
use super::stop_rule::{ClusterStop, Wanted, run_stages_to, share_within};
use crate::cost::Metric;
use crate::cost::mesh_stats::MeshStats;
use crate::mesh::ClusterMesh;
use crate::simplify::{Changes, Engine, LoggedCollapse, Milestone};

/// What the engine may do to a cluster.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct EngineRules {
    /// Whether open borders are locked.
    pub lock_borders: bool,
    /// Whether vertices on seams are locked.
    pub lock_seams: bool,
    /// Whether collapses may change the topology where that is cheap.
    pub frees_topology: bool,
    /// Whether edges collapse one at a time in order of cost.
    pub one_by_one: bool,
    /// Whether handles are cut where a face count cannot be reached otherwise.
    pub seeks_handles: bool,
    /// Whether borders that lie close together are welded.
    pub welds: bool,
    /// Largest deviation from the cluster as loaded, in units of length; `None` if it is unbounded.
    pub deviation_max: Option<f64>,
}

/// A simplified cluster.
pub(super) struct Simplified {
    /// The mesh; `None` in a trial.
    pub mesh: Option<ClusterMesh>,
    /// Faces before.
    pub faces_in: u64,
    /// Faces after.
    pub faces_out: u64,
    /// Highest cost of a collapse in the last stage that removed faces.
    pub cost: f32,
    /// Area at the start of the last stage, in units of length².
    pub area: f64,
    /// Estimated mean squared deviation, in units of length².
    pub squared_error: f64,
    /// State at the end of each stage.
    pub milestones: Vec<Milestone>,
    /// Vertices on seams.
    pub seam_vertices: u64,
    /// Changes of topology.
    pub changes: Changes,
    /// What prevented further collapses.
    pub floor: Floor,
    /// In a trial: collapses of the last stage.
    pub log: Vec<LoggedCollapse>,
}

/// The engine with one metric, for clusters one after another.
pub(super) trait MetricEngine: Sync {
    /// Whether the metric reads texture coordinates, so that their scale must be measured.
    fn reads_texture(&self) -> bool;
    /// Whether it needs texture coordinates without the scale of their material.
    fn wants_raw_texture(&self) -> bool;
    /// Whether it needs statistics of the whole mesh.
    fn needs_statistics(&self) -> bool;
    /// Sets the predicted share of the result's vertices that lie on seams.
    fn learn_seam_density(&mut self, seam_density: f64);
    /// Sets the normalisers from the statistics of the whole mesh.
    fn normalise(&mut self, stats: &MeshStats);
    /// Adds a cluster's values to the statistics.
    fn count(&self, mesh: ClusterMesh, stats: &mut MeshStats);
    /// Bytes that the metric adds to a cluster with these numbers of vertices and wedges.
    fn extra_bytes(&self, vertices: u64, wedges: u64) -> u64;
    /// Simplifies a cluster.
    fn simplify(&self, mesh: ClusterMesh, rules: &EngineRules, stop: &ClusterStop, wanted: Wanted) -> Simplified;
    /// Simplifies a sample; returns the cost thresholds that leave these shares of its faces.
    fn thresholds(&self, sample: ClusterMesh, rules: &EngineRules, shares: &[f64]) -> Vec<f32>;
    /// Simplifies a sample as far as these bounds on the deviation allow, one after the other, in units of length;
    /// returns the share of its free faces that is left.
    fn share_within(&self, sample: ClusterMesh, rules: &EngineRules, bounds: &[f64]) -> f64;
}

/// A metric with its settings.
pub(super) struct EngineOf<M: Metric> {
    pub settings: M::Settings,
}

impl<M: Metric> EngineOf<M> {
    fn start(&self, mesh: ClusterMesh, rules: &EngineRules) -> Engine<M> {
        let mut engine = Engine::new(mesh, &self.settings);
        engine.lock_borders = rules.lock_borders;
        engine.lock_seams = rules.lock_seams;
        engine.frees_topology = rules.frees_topology;
        engine.one_by_one = rules.one_by_one;
        engine.seeks_handles = rules.seeks_handles;
        engine.welds = rules.welds;
        if let Some(most) = rules.deviation_max {
            engine.bound_deviation(most);
        }
        engine
    }
}

impl<M: Metric> MetricEngine for EngineOf<M> {
    fn reads_texture(&self) -> bool {
        M::reads_texture(&self.settings)
    }

    fn wants_raw_texture(&self) -> bool {
        M::wants_raw_texture(&self.settings)
    }

    fn needs_statistics(&self) -> bool {
        M::NEEDS_STATS
    }

    fn learn_seam_density(&mut self, seam_density: f64) {
        M::learn_seam_density(&mut self.settings, seam_density);
    }

    fn normalise(&mut self, stats: &MeshStats) {
        M::normalise(&mut self.settings, stats);
    }

    fn count(&self, mesh: ClusterMesh, stats: &mut MeshStats) {
        Engine::<M>::count(mesh, &self.settings, stats);
    }

    fn extra_bytes(&self, vertices: u64, wedges: u64) -> u64 {
        vertices * M::VERTEX_BYTES + wedges * M::WEDGE_BYTES
    }

    fn simplify(&self, mesh: ClusterMesh, rules: &EngineRules, stop: &ClusterStop, wanted: Wanted) -> Simplified {
        let mut engine = self.start(mesh, rules);
        let faces_in = engine.mesh.face_count as u64;
        let cost = run_stages_to(&mut engine, stop, wanted);
        Simplified {
            faces_in,
            faces_out: engine.mesh.face_count as u64,
            cost,
            area: engine.area(),
            squared_error: engine.squared_error,
            milestones: std::mem::take(&mut engine.milestones),
            seam_vertices: engine.seam_vertices,
            changes: engine.changes(),
            floor: Floor::of(&engine),
            log: engine.log.take().unwrap_or_default(),
            mesh: (wanted == Wanted::Mesh).then(|| engine.finish()),
        }
    }

    fn thresholds(&self, sample: ClusterMesh, rules: &EngineRules, shares: &[f64]) -> Vec<f32> {
        sample::thresholds(&mut self.start(sample, rules), shares)
    }

    fn share_within(&self, sample: ClusterMesh, rules: &EngineRules, bounds: &[f64]) -> f64 {
        share_within(&mut self.start(sample, rules), bounds)
    }
}

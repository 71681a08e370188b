//! Forces a target: faces may fold or turn over where a number of faces can be reached only that way.

use super::Engine;
use crate::base::id::TiVec;
use crate::cost::Metric;
use crate::mesh::class::Class;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::LocalVertex;
use crate::simplify::changes::Changes;
use crate::simplify::refusal::Refusal;
use crate::simplify::shape_rule::ShapeRule;
use crate::simplify::stage::{StageResult, Stop};

/// Smallest share of the faces above the target that must go for forced collapses to stand.
const SHARE_MIN: f64 = 0.5;

/// The state before a step that may be undone.
pub(super) struct Restorable {
    pub mesh: ClusterMesh,
    classes: TiVec<LocalVertex, Class>,
    changes: Changes,
    refusals: [u64; Refusal::COUNT],
    squared_error: f64,
    last_cost: f32,
    spare_edges: i64,
    seam_vertices: u64,
    area: f64,
    milestones: usize,
    collapses: Option<usize>,
}

impl<M: Metric> Engine<M> {
    /// Continues a stage that ended with `result` under weaker and weaker rules for the shapes of faces. Returns the
    /// result of the whole. Where even the weakest rule misses the target, and by far, nothing changes: folds that gain
    /// little are not worth having.
    pub(super) fn force(&mut self, stop: Stop, result: StageResult) -> StageResult {
        let (Stop::Faces(target) | Stop::Cost(_, target)) = stop;
        let excess = |engine: &Self| engine.mesh.face_count.saturating_sub(target) as f64;
        let unforced = self.remember();
        let excess_before = excess(self);
        let mut forced = result;
        while !forced.reached
            && let Some(weaker) = self.collapser.shape_rule().weaker()
        {
            self.collapser.set_shape_rule(weaker);
            forced = forced.then(self.run_and_cut(stop));
        }
        self.collapser.set_shape_rule(ShapeRule::Strict);
        if forced.reached || excess(self) <= (1.0 - SHARE_MIN) * excess_before {
            return forced;
        }
        self.return_to(unforced);
        result
    }

    pub(super) fn remember(&mut self) -> Restorable {
        self.tidy();
        Restorable {
            mesh: self.mesh.clone(),
            classes: self.classes.clone(),
            changes: self.changes,
            refusals: self.refusals,
            squared_error: self.squared_error,
            last_cost: self.last_cost,
            spare_edges: self.spare_edges,
            seam_vertices: self.seam_vertices,
            area: self.stage_area,
            milestones: self.milestones.len(),
            collapses: self.log.as_ref().map(Vec::len),
        }
    }

    pub(super) fn return_to(&mut self, state: Restorable) {
        self.mesh = state.mesh;
        self.classes = state.classes;
        self.changes = state.changes;
        self.refusals = state.refusals;
        self.squared_error = state.squared_error;
        self.last_cost = state.last_cost;
        self.spare_edges = state.spare_edges;
        self.seam_vertices = state.seam_vertices;
        self.stage_area = state.area;
        self.milestones.truncate(state.milestones);
        if let (Some(log), Some(collapses)) = (&mut self.log, state.collapses) {
            log.truncate(collapses);
        }
        self.is_tidy = false;
        self.is_classified = false;
        self.prepare();
    }
}

//! The loop over edges: rounds of sorted candidates, inside stages that recompute the quadrics.
//!
//! ```text
//! stage    rings, classes and quadrics from the current mesh; every vertex proposes its cheapest collapse
//! ├ round  the cheapest proposals in order; a vertex takes part in one collapse a round;
//! │        then only vertices near the changes make new proposals
//! └ relocate  vertices that others collapsed onto move to their best position
//! ```
//! How rounds compare with one collapse at a time: `docs/results/papers/README.md`, "Rounds against a heap".

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::alternatives::Alternatives;
use super::changes::Changes;
use super::collapse::Collapser;
use super::loners::Loners;
use super::proposal::{Bid, Proposal};
use super::refusal::Refusal;
use super::relocate::Relocator;
use super::rips::Rips;
use super::stage::{LoggedCollapse, Milestone, StageResult, Stop};
use super::witness::Witnesses;
use crate::base::id::TiVec;
use crate::cost::mesh_stats::MeshStats;
use crate::cost::{Metric, planes};
use crate::mesh::class::{Class, classify, reclassify, reclassify_all};
use crate::mesh::cluster::{ClusterMesh, flag};
use crate::mesh::id::LocalVertex;
use crate::mesh::orient::{orient, restore};
use crate::mesh::ring::{Rings, Spoke};

/// Share of the faces that one round aims to remove: small enough to stay close to the order of a single queue.
const ROUND_SHARE: f64 = 0.20;
/// A stage with a cost limit ends after a round over all its candidates that removes at most this share of the faces.
const LAST_SHARE: f64 = 0.0005;
/// A stage to a number of faces ends after a round that tried all its candidates and removed at most this share of the
/// faces above the target: at this pace, it would take ever more rounds to get there.
const STUCK_SHARE: f64 = 1.0 / 64.0;

/// Simplifies one cluster.
#[derive(Debug)]
pub struct Engine<M> {
    /// The current mesh.
    pub mesh: ClusterMesh,
    cost: M,
    pub(super) rings: Rings,
    /// Whether no face is dead and the rings are freshly built.
    is_tidy: bool,
    pub(super) classes: TiVec<LocalVertex, Class>,
    /// Whether the classes are those of the current mesh.
    is_classified: bool,
    /// The cheapest collapse of every vertex.
    proposals: TiVec<LocalVertex, Proposal>,
    /// The next collapses of vertices of many faces that were refused in this round.
    alternatives: Alternatives,
    /// Vertices whose cheapest collapse was refused; may contain duplicates.
    refused: Vec<LocalVertex>,
    collapser: Collapser,
    relocator: Relocator,
    witnesses: Witnesses,
    loners: Loners,
    rips: Rips,
    /// Highest cost of a collapse so far.
    last_cost: f32,
    /// Area of the mesh at the start of the last stage, in units of length².
    stage_area: f64,
    /// Last round in which each vertex took part in a collapse.
    touched: TiVec<LocalVertex, u32>,
    /// 2 × the last round in which a face around each vertex changed, plus 1 if all edges of the vertex were evaluated
    /// then.
    stirred: TiVec<LocalVertex, u32>,
    survivors: Vec<LocalVertex>,
    changed: Vec<LocalVertex>,
    /// Vertices that others collapsed onto in this stage.
    joined: TiVec<LocalVertex, bool>,
    round: u32,
    spokes: Vec<Spoke>,
    costs: Vec<f32>,
    /// Vertices refused in this round, with the cost of their next best proposal.
    again: BinaryHeap<Reverse<Bid>>,
    /// Cost above which this round ends.
    patience: f32,
    /// Vertices of this stage that may vanish.
    candidates: Vec<LocalVertex>,
    /// Candidates of this round, in order of cost.
    chosen: Vec<Bid>,
    /// Topology changes so far; [`changes`](Engine::changes) adds the resolved vertices.
    pub(super) changes: Changes,
    /// Number of faces of the initial mesh.
    faces_before: usize,
    /// Number of non-manifold vertices of the initial mesh; `None` until it is classified.
    complex_before: Option<u64>,
    /// Non-manifold edges (more than two faces) that collapses resolved, minus those that they created. Collapses may
    /// create this many: where a wall stands on a floor between the floor's vertices, neither could be simplified
    /// otherwise.
    spare_edges: i64,
    /// Number of refusals of each [`Refusal`].
    pub refusals: [u64; Refusal::COUNT],
    /// Estimate of the mean squared deviation that all stages so far have added, in units of length².
    pub squared_error: f64,
    /// One entry for each stage that had something to do.
    pub milestones: Vec<Milestone>,
    /// Number of vertices on seams at the start of the last stage.
    pub seam_vertices: u64,
    /// All collapses in their order; `None` to record nothing.
    pub log: Option<Vec<LoggedCollapse>>,
    /// Whether seam vertices are locked.
    pub lock_seams: bool,
    /// Whether border vertices are locked.
    pub lock_borders: bool,
    /// Whether borders that run along each other are welded; only if `frees_topology` is set.
    pub welds: bool,
    /// Whether the topology may change where that is cheap: holes close, connected components vanish, non-manifold
    /// vertices collapse.
    pub frees_topology: bool,
    /// Whether handles are also cut before the first stage: in an input mesh that takes long and brings little.
    pub seeks_handles: bool,
    /// Whether the shapes of faces are kept less strictly where a number of faces can be reached only that way; only if
    /// `frees_topology` is set.
    pub forces_target: bool,
    /// Whether a round is a single collapse: this gives the order of a heap that is always up to date.
    pub one_by_one: bool,
}

impl<M: Metric> Engine<M> {
    /// An engine for a mesh; all options are off.
    pub fn new(mesh: ClusterMesh, settings: &M::Settings) -> Self {
        Self {
            faces_before: mesh.face_count,
            mesh,
            cost: M::new(settings),
            rings: Rings::default(),
            is_tidy: false,
            classes: TiVec::new(),
            is_classified: false,
            proposals: TiVec::new(),
            alternatives: Alternatives::default(),
            refused: Vec::new(),
            collapser: Collapser::default(),
            relocator: Relocator::default(),
            witnesses: Witnesses::default(),
            loners: Loners::default(),
            rips: Rips::default(),
            last_cost: 0.0,
            stage_area: 0.0,
            touched: TiVec::new(),
            stirred: TiVec::new(),
            survivors: Vec::new(),
            changed: Vec::new(),
            joined: TiVec::new(),
            round: 0,
            spokes: Vec::new(),
            costs: Vec::new(),
            again: BinaryHeap::new(),
            patience: f32::INFINITY,
            candidates: Vec::new(),
            chosen: Vec::new(),
            changes: Changes::default(),
            complex_before: None,
            spare_edges: 0,
            refusals: [0; Refusal::COUNT],
            squared_error: 0.0,
            milestones: Vec::new(),
            seam_vertices: 0,
            log: None,
            lock_seams: false,
            lock_borders: false,
            welds: false,
            frees_topology: false,
            seeks_handles: false,
            forces_target: false,
            one_by_one: false,
        }
    }

    /// Adds the statistics of a mesh that the metric normalises by.
    pub fn count(mesh: ClusterMesh, settings: &M::Settings, stats: &mut MeshStats) {
        let mut engine = Self::new(mesh, settings);
        engine.prepare();
        M::count(settings, &engine.mesh, &engine.rings, &engine.classes, stats);
    }

    /// Number of faces that would go if every vertex vanished that the current locks allow to move or vanish: two for
    /// each, one for a vertex on an open border.
    pub fn count_free_faces(&mut self) -> usize {
        self.prepare();
        let free = self.mesh.vertex_ids().filter(|&v| !self.rings.of(v).is_empty() && !self.is_held(v));
        free.map(|v| if self.classes[v].is_border() { 1 } else { 2 }).sum()
    }

    /// Runs one stage. If a number of faces cannot be reached otherwise, and the topology may change, cuts handles and
    /// continues; then, if it [may](Engine::forces_target), forces the target.
    pub fn run(&mut self, stop: Stop) -> StageResult {
        if !matches!(stop, Stop::Faces(_)) || !self.cuts_handles() {
            return self.run_once(stop);
        }
        let result = self.run_and_cut(stop);
        if self.forces_target && !result.reached { self.force(stop, result) } else { result }
    }

    /// Runs one stage; cuts handles and continues until the stop is reached, no handle is left, or a cut adds more faces
    /// than can go after it: that cut is undone.
    fn run_and_cut(&mut self, stop: Stop) -> StageResult {
        let mut result = self.run_once(stop);
        while !result.reached {
            let uncut = self.remember();
            if !self.cut_shortest_handles() {
                break;
            }
            let longer = result.then(self.run_once(stop));
            if self.mesh.face_count > uncut.mesh.face_count {
                self.return_to(uncut);
                break;
            }
            result = longer;
        }
        result
    }

    fn run_once(&mut self, stop: Stop) -> StageResult {
        let mut result = StageResult::default();
        if self.is_done(stop) {
            return StageResult { reached: true, ..result };
        }
        let cost = match stop {
            Stop::Cost(cost, _) if cost < f32::MAX => cost,
            _ => self.last_cost,
        };
        self.prepare();
        if cost > 0.0 {
            self.mend(f64::from(cost));
        }
        self.begin_stage();
        self.cost.refresh(&self.mesh, &self.rings, &self.classes);
        self.mesh.flags.iter_mut().for_each(|flags| *flags &= !flag::FOLDS);
        for &vertex in self.cost.near_folds(&self.mesh, &self.rings).iter() {
            self.mesh.flags[vertex] |= flag::FOLDS;
        }
        self.stage_area = self.cost.area();
        let is_seam =
            |class: &&Class| matches!(class, Class::Seam | Class::Corner | Class::BorderSeam | Class::BorderCorner);
        self.seam_vertices = self.classes.iter().filter(is_seam).count() as u64;
        self.witnesses.gather(&self.mesh, &self.rings);
        self.judge_all();
        let mut widen = 1.0;
        loop {
            let before = self.mesh.face_count;
            let (bound, tried_all) = self.choose(stop, widen);
            if self.chosen.is_empty() {
                break;
            }
            self.round += 1;
            let went_through = self.collapse_chosen(stop, bound, &mut result);
            let removed = before - self.mesh.face_count;
            if self.is_done(stop) {
                result.reached = true;
                break;
            }
            let few = match stop {
                _ if self.one_by_one => 0,
                Stop::Faces(target) if went_through => ((before - target) as f64 * STUCK_SHARE) as usize,
                Stop::Faces(_) => 0,
                Stop::Cost(..) => (before as f64 * LAST_SHARE) as usize,
            };
            if tried_all && removed <= few {
                break;
            }
            let aim = if self.one_by_one { 1 } else { (before as f64 * ROUND_SHARE) as usize };
            widen = if removed * 8 < aim { widen * 2.0 } else { 1.0 };
            self.rejudge();
        }
        result.reached |= matches!(stop, Stop::Cost(..));
        self.last_cost = self.last_cost.max(result.cost);
        self.is_tidy = false;
        self.is_classified = false;
        self.tidy();
        if M::ENDPOINTS {
            self.relocate();
        }
        self.measure_stage();
        let (faces, squared_error) = (self.mesh.face_count, self.squared_error);
        self.milestones.push(Milestone { faces, cost: result.cost, squared_error });
        result
    }

    /// Area of the mesh at the start of the last stage, in units of length²; of the current mesh if no stage had
    /// anything to do.
    pub fn area(&self) -> f64 {
        if self.milestones.is_empty() { planes::area_of(&self.mesh) } else { self.stage_area }
    }

    /// Limits the deviation from the input to `most`, in units of length.
    pub fn bound_deviation(&mut self, most: f64) {
        self.collapser.deviation_max = Some(most);
    }

    /// Number of topology changes so far.
    pub fn changes(&mut self) -> Changes {
        let before = self.complex_before.unwrap_or(0);
        if before > 0 {
            self.tidy();
            let is_complex = |vertex: &LocalVertex| self.classes[*vertex] == Class::Complex;
            let complex: Vec<LocalVertex> = self.classes.keys().filter(is_complex).collect();
            self.reclassify(&complex);
        }
        Changes { complex_resolved: before.saturating_sub(self.complex_count()), ..self.changes }
    }

    /// Returns the mesh without dead faces, with every face in its input direction.
    pub fn finish(mut self) -> ClusterMesh {
        self.mesh.compact_faces();
        debug_assert!(self.mesh.has_matching_corners(), "a corner has a vertex that its wedge has not");
        restore(&mut self.mesh);
        self.mesh
    }

    fn is_done(&self, stop: Stop) -> bool {
        let (Stop::Faces(target) | Stop::Cost(_, target)) = stop;
        self.mesh.face_count <= target
    }

    /// Removes dead faces and builds the rings, unless the mesh has not changed since the last call.
    fn tidy(&mut self) {
        if !self.is_tidy {
            self.mesh.compact_faces();
            self.rings.build(&self.mesh);
            self.is_tidy = true;
        }
    }

    fn prepare(&mut self) {
        self.tidy();
        if !self.is_classified {
            self.mesh.unlink_unused_wedges();
            if !self.classes.is_empty() {
                reclassify_all(&self.mesh, &self.rings, &mut self.classes);
            } else if classify(&self.mesh, &self.rings, &mut self.classes) {
                let turned = orient(&mut self.mesh, &self.rings);
                self.rings.build(&self.mesh);
                reclassify(&self.mesh, &self.rings, &mut self.classes, &turned);
            }
            for vertex in self.mesh.vertex_ids().filter(|&vertex| self.mesh.is_shared(vertex)) {
                self.classes[vertex] = Class::Fixed;
            }
            self.is_classified = true;
            let count = self.complex_count();
            self.complex_before.get_or_insert(count);
        }
    }

    /// Recomputes the classes of the given vertices; all others keep theirs.
    fn reclassify(&mut self, vertices: &[LocalVertex]) {
        self.classes.resize(self.mesh.positions.len(), Class::Fixed);
        reclassify(&self.mesh, &self.rings, &mut self.classes, vertices);
        for &vertex in vertices.iter().filter(|&&vertex| self.mesh.is_shared(vertex)) {
            self.classes[vertex] = Class::Fixed;
        }
    }

    fn begin_stage(&mut self) {
        self.touched.clear();
        self.touched.resize(self.mesh.positions.len(), 0);
        self.stirred.clear();
        self.stirred.resize(self.mesh.positions.len(), 0);
        self.joined.clear();
        self.joined.resize(self.mesh.positions.len(), false);
        self.round = 0;
        self.collapser.reset(&self.mesh);
    }

    #[inline(always)]
    fn is_held(&self, vertex: LocalVertex) -> bool {
        self.mesh.is_locked(vertex)
            || match self.classes[vertex] {
                Class::Smooth => false,
                Class::Seam | Class::Corner => self.lock_seams,
                Class::BorderSeam | Class::BorderCorner => self.lock_seams || self.lock_borders,
                Class::Border => self.lock_borders,
                Class::Complex => {
                    !self.frees_topology || self.lock_borders || (self.lock_seams && self.has_seams(vertex))
                }
                Class::Fixed => true,
            }
    }

    /// Whether a vertex has several wedges in living faces.
    fn has_seams(&self, vertex: LocalVertex) -> bool {
        let mut wedges = self.rings.of(vertex).iter().filter_map(|&corner| self.mesh.living(corner));
        let first = wedges.next();
        wedges.any(|wedge| Some(wedge) != first)
    }

    /// Relocates every vertex that others collapsed onto to its best position, in the order of ids.
    fn relocate(&mut self) {
        let deviation_max = self.collapser.deviation_max;
        for vertex in self.mesh.vertex_ids() {
            if self.joined[vertex] && !self.is_held(vertex) && !self.rings.of(vertex).is_empty() {
                let class = self.classes[vertex];
                self.relocator.relocate(&mut self.mesh, &self.rings, &self.cost, vertex, class, deviation_max);
            }
        }
    }

    /// Adds the deviation of this stage to the estimate of the error.
    fn measure_stage(&mut self) {
        self.squared_error += self.witnesses.mean_sq(&self.mesh, &self.rings, |vertex| self.went_to(vertex));
    }
}

mod force;
mod judge;
mod round;
mod topology;

#[cfg(test)]
mod tests;

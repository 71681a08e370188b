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

use super::changes::Changes;
use super::collapse::{Collapse, Collapser};
use super::edge_star::VanishingFan;
use super::loners::Loners;
use super::proposal::{Bid, EdgeAt, Proposal, all_edges_at, chain_edges_at};
use super::refusal::Refusal;
use super::relocate::Relocator;
use super::rips::Rips;
use super::stage::{Milestone, StageResult, Stop};
use super::texture::insets;
use super::witness::{Witnesses, area_of};
use crate::base::id::TiVec;
use crate::cost::mesh_stats::MeshStats;
use crate::cost::{EdgeCase, Metric, planes};
use crate::mesh::class::{Class, Rule, classify, reclassify, reclassify_all};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::edge::EdgeKind;
use crate::mesh::id::{Corner, Edge, End, LocalVertex, WedgePair};
use crate::mesh::orient::{orient, restore};
use crate::mesh::ring::{Rings, Spoke};

/// Share of the faces that one round aims to remove: small enough to stay close to the order of a single queue.
const ROUND_SHARE: f64 = 0.20;
/// Candidates tried for each collapse that a round aims at, because neighbours block each other.
const TRIES_PER_COLLAPSE: f64 = 2.0;
/// NOTE: tuned. A round ends at the first collapse that costs more than this many times the costliest one that it aims
/// at.
const COST_SPREAD: f32 = 4.0;
/// A stage with a cost limit ends after a round over all its candidates that removes at most this share of the faces.
const LAST_SHARE: f64 = 0.0005;

/// Faces by which the last collapse of a stage may undershoot the target.
const BELOW_MAX: usize = 2;

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
    /// Vertices whose cheapest collapse was refused; may contain duplicates.
    refused: Vec<LocalVertex>,
    collapser: Collapser,
    relocator: Relocator,
    witnesses: Witnesses,
    loners: Loners,
    rips: Rips,
    /// Highest cost of a collapse so far.
    last_cost: f32,
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
    /// Neighbours of a smooth vertex; `onto_costs` holds the cost of collapsing onto each.
    ends: Vec<End>,
    onto_costs: Vec<f32>,
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
    /// Cost and number of dead faces of every collapse; `None` to record nothing.
    pub log: Option<Vec<(f32, u8)>>,
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
            refused: Vec::new(),
            collapser: Collapser::default(),
            relocator: Relocator::default(),
            witnesses: Witnesses::default(),
            loners: Loners::default(),
            rips: Rips::default(),
            last_cost: 0.0,
            touched: TiVec::new(),
            stirred: TiVec::new(),
            survivors: Vec::new(),
            changed: Vec::new(),
            joined: TiVec::new(),
            round: 0,
            spokes: Vec::new(),
            ends: Vec::new(),
            onto_costs: Vec::new(),
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
    /// continues.
    pub fn run(&mut self, stop: Stop) -> StageResult {
        let mut result = self.run_once(stop);
        while matches!(stop, Stop::Faces(_)) && !result.reached && self.cut_shortest_handles() {
            let again = self.run_once(stop);
            result = StageResult { cost: result.cost.max(again.cost), ..again };
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
            self.collapse_chosen(stop, bound, &mut result);
            let removed = before - self.mesh.face_count;
            if self.is_done(stop) {
                result.reached = true;
                break;
            }
            let few = if self.one_by_one { 0 } else { (before as f64 * LAST_SHARE) as usize };
            let is_last = match stop {
                Stop::Faces(_) => tried_all && removed == 0,
                Stop::Cost(..) => tried_all && removed <= few,
            };
            if is_last {
                break;
            }
            let aim = if self.one_by_one { 1 } else { (before as f64 * ROUND_SHARE) as usize };
            widen = if removed * 8 < aim { widen * 2.0 } else { 1.0 };
            self.rejudge();
        }
        result.reached |= matches!(stop, Stop::Cost(..));
        self.last_cost = self.last_cost.max(result.cost);
        (self.is_tidy, self.is_classified) = (false, false);
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
        if self.milestones.is_empty() { planes::area_of(&self.mesh) } else { self.cost.area() }
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
                orient(&mut self.mesh);
                self.rings.build(&self.mesh);
                classify(&self.mesh, &self.rings, &mut self.classes);
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

    fn may_vanish(&self, vertex: LocalVertex) -> bool {
        let class = self.classes[vertex];
        (M::CORNERS_VANISH || !class.is_corner()) && !self.is_held(vertex)
    }

    /// Whether a vertex keeps its position when another collapses onto it.
    fn stays(&self, vertex: LocalVertex) -> bool {
        M::ENDPOINTS || self.is_held(vertex)
    }

    /// Share of the overhang by which the texture coordinates of `to` move into their charts; 0 if the edge is on no
    /// chain, or if `to` is held.
    #[inline(always)]
    fn inset(&self, to: LocalVertex, chain: bool) -> f64 {
        if chain && self.cost.inset() > 0.0 && !self.is_held(to) { self.cost.inset() } else { 0.0 }
    }

    /// Rule for an edge of this kind, given both classes and both locks.
    fn rule(&self, from: LocalVertex, to: LocalVertex, kind: EdgeKind) -> Rule {
        if self.is_held(from) {
            return Rule::Never;
        }
        match self.cost.rule(self.classes[from], self.classes[to], kind) {
            Rule::Free if self.stays(to) => Rule::Onto,
            Rule::Chain if self.stays(to) => Rule::ChainOnto,
            rule => rule,
        }
    }

    fn judge_all(&mut self) {
        self.refused.clear();
        self.proposals.clear();
        self.proposals.resize(self.mesh.positions.len(), Proposal::NONE);
        self.candidates.clear();
        for vertex in self.mesh.vertex_ids() {
            if !self.may_vanish(vertex) {
                continue;
            }
            if !self.frees_topology && self.is_alone(vertex) {
                self.refusals[Refusal::Piece as usize] += 1;
                continue;
            }
            self.candidates.push(vertex);
        }
        if self.frees_topology {
            self.look_around();
        }
        for i in 0..self.candidates.len() {
            self.judge(self.candidates[i], None);
        }
    }

    /// Finds the cheapest collapse of a vertex; if `after` is given, the cheapest one above this key.
    fn judge(&mut self, vertex: LocalVertex, after: Option<Bid>) {
        let mut best = Proposal { second_best: after.is_some(), ..Proposal::NONE };
        let take = |best: &mut Proposal, proposal: Proposal| {
            // An infinite cost is no proposal: it marks a vanished vertex.
            if proposal.cost.is_finite()
                && proposal.key() < best.key()
                && after.is_none_or(|after| proposal.key() > after)
            {
                *best = Proposal { second_best: after.is_some(), ..proposal };
            }
        };
        if let Some(price) = self.price_alone(vertex) {
            if let Some(corner) = self.rings.living(&self.mesh, vertex).next() {
                let to = self.mesh.vertex_of(corner.next());
                take(&mut best, Proposal::onto(to, price));
            }
        } else if self.classes[vertex] == Class::Smooth {
            // One closed fan and one wedge: each face gives the edge to its next vertex.
            if !self.mesh.is_locked(vertex) && M::ENDPOINTS {
                self.propose_onto_all(vertex, |proposal| take(&mut best, proposal));
            } else if !self.mesh.is_locked(vertex) {
                for edge in self.rings.of(vertex).iter().filter_map(|&corner| EdgeAt::ahead(&self.mesh, corner)) {
                    take(&mut best, self.propose(vertex, &edge));
                }
            }
        } else if self.classes[vertex] == Class::Complex && self.may_vanish(vertex) {
            let mut spokes = std::mem::take(&mut self.spokes);
            all_edges_at(&self.mesh, &self.rings, vertex, &mut spokes, |edge| {
                take(&mut best, self.propose(vertex, edge));
            });
            self.spokes = spokes;
        } else if self.may_vanish(vertex) {
            let mut spokes = std::mem::take(&mut self.spokes);
            let is_on_border = self.classes[vertex].is_border();
            chain_edges_at(&self.mesh, &self.rings, vertex, is_on_border, &mut spokes, |edge| {
                take(&mut best, self.propose(vertex, edge));
            });
            self.spokes = spokes;
        }
        if let Some(proposal) = self.propose_weld(vertex) {
            take(&mut best, proposal);
        }
        self.proposals[vertex] = best;
    }

    /// Proposal to collapse an edge from a smooth vertex.
    #[inline(always)]
    fn propose_inside(&self, from: LocalVertex, edge: &EdgeAt) -> Proposal {
        if !M::ENDPOINTS {
            return self.propose(from, edge);
        }
        let cost = self.cost.place(&self.mesh, &EdgeCase::inside(from, edge.other, &edge.wedges[..1])).cost as f32;
        Proposal::onto(edge.other, cost)
    }

    /// Passes every collapse of a smooth vertex onto a neighbour to `take`.
    #[inline(always)]
    fn propose_onto_all(&mut self, from: LocalVertex, mut take: impl FnMut(Proposal)) {
        let Self { mesh, rings, cost, ends, onto_costs, .. } = self;
        let mut own = None;
        ends.clear();
        for &corner in rings.of(from) {
            if let Some(wedge) = mesh.living(corner) {
                ends.push(mesh.end_of(corner.next()));
                own = Some(End { vertex: from, wedge });
            }
        }
        onto_costs.clear();
        own.into_iter().for_each(|own| cost.costs_onto(mesh, own, ends, onto_costs));
        ends.iter().zip(onto_costs).for_each(|(end, cost)| take(Proposal::onto(end.vertex, *cost)));
    }

    /// Proposal to collapse an edge that was gathered at `from`; [`Proposal::NONE`] if the rules forbid it.
    #[inline(always)]
    fn propose(&self, from: LocalVertex, edge: &EdgeAt) -> Proposal {
        let (to, kind) = (edge.other, edge.kind());
        let is_plain = edge.face_count <= 2 || self.classes[from] == Class::Complex;
        let rule = if is_plain { self.rule(from, to, kind) } else { Rule::Never };
        // If the ends meet in between, both directions cost the same: the lower end proposes it, if both may.
        let meets = |rule| matches!(rule, Rule::Free | Rule::Chain);
        if rule == Rule::Never || (meets(rule) && to < from && meets(self.rule(to, from, kind))) {
            return Proposal::NONE;
        }
        let wedges = if kind == EdgeKind::Seam { &edge.wedges[..2] } else { &edge.wedges[..1] };
        let onto = matches!(rule, Rule::Onto | Rule::ChainOnto);
        let chain = matches!(rule, Rule::Chain | Rule::ChainOnto);
        let insets = insets(&self.mesh, &self.rings, self.inset(to, chain), Edge { from, to }, wedges);
        let case = EdgeCase { from, to, onto, stays: self.stays(to), wedges, insets };
        let share = if kind == EdgeKind::Border { self.closing_share(from, to) } else { 1.0 };
        let cost = share * self.cost.place(&self.mesh, &case).cost as f32;
        if cost.is_finite() { Proposal { cost, to, onto, chain, second_best: false } } else { Proposal::NONE }
    }

    /// Chooses the vertices of a round, in order of cost. Returns the highest cost, and whether these are all that the
    /// stop rule allows.
    fn choose(&mut self, stop: Stop, widen: f64) -> (f32, bool) {
        let faces = self.mesh.face_count as f64;
        let (limit, excess) = match stop {
            Stop::Faces(target) => (f32::MAX, (self.mesh.face_count - target) as f64),
            Stop::Cost(cost, _) => (cost.min(f32::MAX), faces),
        };
        let collapses = if self.one_by_one { 1.0 } else { (0.5 * excess.min(faces * ROUND_SHARE)).ceil() };
        let wanted = (collapses * TRIES_PER_COLLAPSE * widen).max(8.0) as usize;
        let proposals = &self.proposals;
        let cost_of = |&vertex: &LocalVertex| proposals[vertex].cost;
        self.costs.clear();
        self.costs.extend(self.candidates.iter().map(cost_of).filter(|&cost| cost <= limit));
        let tried_all = self.costs.len() <= wanted;
        let bound = if tried_all { limit } else { *self.costs.select_nth_unstable_by(wanted, f32::total_cmp).1 };
        self.chosen.clear();
        let bid = |vertex: &LocalVertex| Bid::new(cost_of(vertex), *vertex);
        self.chosen.extend(self.candidates.iter().filter(|&vertex| cost_of(vertex) <= bound).map(bid));
        self.chosen.sort_unstable();
        let aim = self.chosen.get((collapses as usize).saturating_sub(1));
        self.patience = aim.map_or(f32::INFINITY, |bid| COST_SPREAD * bid.cost());
        (bound, tried_all)
    }

    /// Collapses the chosen vertices in order of cost. A refused vertex is tried again with its next best proposal.
    fn collapse_chosen(&mut self, stop: Stop, bound: f32, result: &mut StageResult) {
        self.survivors.clear();
        self.again.clear();
        let mut at = 0;
        loop {
            let chosen = self.chosen.get(at).copied();
            let again = self.again.peek().map(|&Reverse(bid)| bid);
            let Some(from) = chosen.into_iter().chain(again).min().map(Bid::vertex) else { return };
            if chosen.is_some_and(|bid| bid.vertex() == from) {
                at += 1;
            } else {
                self.again.pop();
            }
            if !self.survivors.is_empty() && self.proposals[from].cost > self.patience {
                return;
            }
            if !self.try_proposal(from, stop, result) && self.proposals[from].cost <= bound {
                self.again.push(Reverse(Bid::new(self.proposals[from].cost, from)));
            }
            if self.is_done(stop) || (self.one_by_one && !self.survivors.is_empty()) {
                return;
            }
        }
    }

    /// Collapses a vertex as proposed, unless one end took part in a collapse of this round. Returns `false` if the
    /// proposal was refused and replaced by another one.
    fn try_proposal(&mut self, from: LocalVertex, stop: Stop, result: &mut StageResult) -> bool {
        let proposal = self.proposals[from];
        let Proposal { cost, to, onto, chain, .. } = proposal;
        if self.touched[from] == self.round || self.touched[to] == self.round {
            return true;
        }
        let class = self.classes[from];
        let is_complex = class == Class::Complex;
        let is_rip = self.is_apart(from, to);
        let may_close = self.frees_topology && !is_rip && (class.is_border() || class == Class::Complex);
        let closes_hole = may_close && self.is_beside_hole(from, to);
        let fan = VanishingFan {
            closed: class == Class::Smooth,
            strands: M::CORNERS_VANISH && (class.is_corner() || is_complex),
            is_complex,
            is_alone: self.price_alone(from).is_some(),
            is_free: self.frees_topology,
            is_rip,
            spare_edges: self.spare_edges,
        };
        if fan.is_alone && self.has_lost_neighbour(from) {
            self.proposals[from] = Proposal { second_best: true, ..Proposal::NONE };
            return false;
        }
        let inset = self.inset(to, chain);
        let area = if fan.is_alone { area_of(self.mesh.triangle(self.rings.of(from)[0].face())) } else { 0.0 };
        // NOTE: the papers' metrics have no check against faces that span empty space; an infinite price disables it.
        let price = if M::ENDPOINTS { f64::from(cost) } else { f64::INFINITY };
        let (Stop::Faces(target) | Stop::Cost(_, target)) = stop;
        let dying_max = self.mesh.face_count.saturating_sub(target) + BELOW_MAX;
        let stays = self.stays(to);
        let collapse = Collapse { from, to, onto, stays, chain, fan, cost: price, dying_max, inset };
        match self.collapser.try_collapse(&mut self.mesh, &self.rings, &mut self.cost, collapse) {
            Ok(died) => {
                self.spare_edges -= self.collapser.new_non_manifold_edges();
                self.changes.vertices_welded += u64::from(is_rip);
                self.changes.holes_closed += u64::from(closes_hole);
                if fan.is_alone {
                    self.changes.pieces_dropped += 1;
                    self.changes.pieces_area += area;
                }
                self.touched[from] = self.round;
                self.touched[to] = self.round;
                self.rings.join(&self.mesh, from, to);
                self.survivors.push(to);
                self.joined[to] = true;
                for &vertex in self.collapser.unsettled() {
                    let class = &mut self.classes[vertex];
                    if *class != Class::Fixed {
                        *class = Class::Complex;
                    }
                }
                // `to` stays in the proposal: the witnesses follow it.
                self.proposals[from].cost = f32::INFINITY;
                result.cost = result.cost.max(cost);
                if let Some(log) = &mut self.log {
                    log.push((cost, died as u8));
                }
                true
            }
            Err(refusal) => {
                self.refusals[refusal as usize] += 1;
                self.refused.push(from);
                self.judge(from, Some(proposal.key()));
                false
            }
        }
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

    /// Re-evaluates what this round's collapses changed: survivors, their neighbours, and refused vertices near them.
    fn rejudge(&mut self) {
        let round = self.round;
        if self.rings.is_scattered(&self.mesh) {
            self.mesh.compact_faces();
            self.rings.build(&self.mesh);
        }
        let Self { candidates, rings, .. } = self;
        candidates.retain(|&vertex| !rings.of(vertex).is_empty());
        self.cost.follow(&self.mesh, &self.rings, &self.survivors, &mut self.changed);
        self.changed.drain(..).for_each(|vertex| self.touched[vertex] = round);
        // In the order of ids, because neighbours on the surface are neighbours in memory.
        for vertex in self.mesh.vertex_ids() {
            if self.touched[vertex] != round || self.rings.of(vertex).is_empty() {
                continue;
            }
            self.judge(vertex, None);
            let is_closed = self.classes[vertex] == Class::Smooth;
            for i in 0..self.rings.of(vertex).len() {
                let corner = self.rings.of(vertex)[i];
                if self.mesh.living(corner).is_none() {
                    continue;
                }
                let [next, previous] = corner.others();
                self.rejudge_neighbour(next, corner);
                if !is_closed {
                    self.rejudge_neighbour(previous, corner);
                }
            }
        }
        let mut refused = std::mem::take(&mut self.refused);
        refused.retain(|&vertex| self.proposals[vertex].second_best);
        for &vertex in &refused {
            let near = |&corner: &Corner| {
                let ring = self.mesh.others_of(corner);
                self.mesh.living(corner).is_some() && ring.iter().any(|&far| self.stirred[far] / 2 == round)
            };
            if self.rings.of(vertex).iter().any(near) {
                self.judge(vertex, None);
            }
        }
        refused.retain(|&vertex| self.proposals[vertex].second_best);
        self.refused = refused;
    }

    /// Re-evaluates a neighbour of a survivor; both are given as corners of one face.
    ///
    /// The costs of its other edges are unchanged. All its edges are evaluated only if its proposal led to a changed
    /// vertex or followed a refused one.
    fn rejudge_neighbour(&mut self, corner: Corner, survivor: Corner) {
        let (vertex, round) = (self.mesh.vertex_of(corner), self.round);
        if self.touched[vertex] == round {
            return;
        }
        if self.stirred[vertex] == 2 * round + 1 {
            return;
        }
        let Proposal { to, second_best, .. } = self.proposals[vertex];
        let is_stale = second_best || self.touched.get(to) == Some(&round);
        let is_first = self.stirred[vertex] != 2 * round;
        self.stirred[vertex] = 2 * round;
        // What collapsed onto a vertex that is still smooth was smooth, and no chain vertex collapses onto it.
        let meets_chain = self.classes[self.mesh.vertex_of(survivor)] != Class::Smooth;
        if M::ENDPOINTS && self.classes[vertex] != Class::Smooth && !meets_chain && !is_stale {
            return;
        }
        // NOTE: if `vertex` was evaluated earlier in this round, its proposal is not stale, even if it leads to a
        // survivor.
        if self.classes[vertex] != Class::Smooth || (is_stale && is_first) {
            self.stirred[vertex] += 1;
            self.judge(vertex, None);
        } else if !self.is_held(vertex) {
            let pair = WedgePair { from: self.mesh.wedge_of(corner), to: self.mesh.wedge_of(survivor) };
            let edge = EdgeAt { other: self.mesh.vertex_of(survivor), wedges: [pair; 2], face_count: 2 };
            let proposal = self.propose_inside(vertex, &edge);
            if proposal.key() < self.proposals[vertex].key() {
                self.proposals[vertex] = proposal;
            }
        }
    }
}

mod topology;

#[cfg(test)]
mod tests;

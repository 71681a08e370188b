//! A round: the cheapest proposals in order, each vertex in one collapse.

use std::cmp::Reverse;

use super::{Engine, ROUND_SHARE};
use crate::base::cache::prefetch;
use crate::cost::Metric;
use crate::geometry::triangle::area;
use crate::mesh::class::Class;
use crate::mesh::id::{Edge, LocalVertex};
use crate::simplify::collapse::Collapse;
use crate::simplify::edge_star::VanishingFan;
use crate::simplify::proposal::{Bid, Proposal};
use crate::simplify::retreat::Retreat;
use crate::simplify::shape_rule::ShapeRule;
use crate::simplify::stage::{LoggedCollapse, StageResult, Stop};

/// Candidates tried for each collapse that a round aims at, because neighbours block each other.
const TRIES_PER_COLLAPSE: f64 = 2.0;
/// NOTE: tuned. A round ends at the first collapse that costs more than this many times the costliest one that it aims
/// at.
const COST_SPREAD: f32 = 4.0;
/// Collapses between one level of indirection and the next, when memory is asked for in advance.
const AHEAD: usize = 4;
/// Faces by which the last collapse of a stage may undershoot the target.
const BELOW_MAX: usize = 2;

impl<M: Metric> Engine<M> {
    /// Chooses the vertices of a round, in order of cost. Returns the highest cost, and whether these are all that the
    /// stop rule allows.
    pub(super) fn choose(&mut self, stop: Stop, widen: f64) -> (f32, bool) {
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
    /// Returns whether all were tried, and not only those up to a cost.
    pub(super) fn collapse_chosen(&mut self, stop: Stop, bound: f32, result: &mut StageResult) -> bool {
        self.survivors.clear();
        self.again.clear();
        self.alternatives.clear();
        let mut at = 0;
        loop {
            self.prefetch(at);
            let chosen = self.chosen.get(at).copied();
            let again = self.again.peek().map(|&Reverse(bid)| bid);
            let Some(from) = chosen.into_iter().chain(again).min().map(Bid::vertex) else { return true };
            if chosen.is_some_and(|bid| bid.vertex() == from) {
                at += 1;
            } else {
                self.again.pop();
            }
            if !self.survivors.is_empty() && self.proposals[from].cost > self.patience {
                return false;
            }
            if !self.try_proposal(from, stop, result) && self.proposals[from].cost <= bound {
                self.again.push(Reverse(Bid::new(self.proposals[from].cost, from)));
            }
            if self.is_done(stop) || (self.one_by_one && !self.survivors.is_empty()) {
                return false;
            }
        }
    }

    /// Asks for what the collapses after the one at `at` will read: they are scattered over the cluster, so each would
    /// wait for the memory of one thing after the other.
    #[inline(always)]
    fn prefetch(&self, at: usize) {
        let Self { mesh, rings, proposals, chosen, cost, touched, .. } = self;
        if let Some(from) = chosen.get(at + 4 * AHEAD).map(|bid| bid.vertex()) {
            prefetch(&proposals[from]);
            prefetch(&touched[from]);
            rings.prefetch_row(from);
        }
        if let Some(from) = chosen.get(at + 3 * AHEAD).map(|bid| bid.vertex())
            && let Some(to) = proposals[from].to.some()
        {
            rings.prefetch(from);
            rings.prefetch_row(to);
            prefetch(&touched[to]);
        }
        if let Some(Edge { from, to }) = self.upcoming(at + 2 * AHEAD) {
            cost.prefetch(from);
            cost.prefetch(to);
            mesh.prefetch_faces(rings.of(from));
            rings.prefetch(to);
        }
        if let Some(Edge { from, to }) = self.upcoming(at + AHEAD) {
            mesh.prefetch_ends(rings.of(from));
            mesh.prefetch_faces(rings.of(to));
            for &corner in rings.of(from) {
                rings.prefetch_row(mesh.vertex_of(corner.next()));
            }
        }
        if let Some(Edge { from, to }) = self.upcoming(at + AHEAD / 2) {
            for &corner in rings.of(from) {
                rings.prefetch(mesh.vertex_of(corner.next()));
            }
            for wedge in [from, to].into_iter().filter_map(|end| mesh.living(*rings.of(end).first()?)) {
                cost.prefetch_wedge(wedge);
            }
        }
    }

    /// The edge that is chosen as number `at` of the round, if neither end took part in a collapse yet.
    #[inline(always)]
    fn upcoming(&self, at: usize) -> Option<Edge> {
        let from = self.chosen.get(at)?.vertex();
        let to = self.proposals[from].to.some()?;
        let is_free = self.touched[from] != self.round && self.touched[to] != self.round;
        is_free.then_some(Edge { from, to })
    }

    /// Collapses a vertex as proposed, unless one end took part in a collapse of this round. Returns `false` if the
    /// proposal was refused and replaced by another one.
    pub(super) fn try_proposal(&mut self, from: LocalVertex, stop: Stop, result: &mut StageResult) -> bool {
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
        // NOTE: the papers' metrics have costs of other units. Last triangles and welds have prices of their own.
        if M::ENDPOINTS && !fan.is_alone && !is_rip && self.costs_more(from) {
            return false;
        }
        let inset = self.inset(to, chain);
        let area = if fan.is_alone { area(self.mesh.triangle(self.rings.of(from)[0].face())) } else { 0.0 };
        // NOTE: the papers' metrics have no check against faces that span empty space; an infinite price disables it.
        let price = if M::ENDPOINTS { f64::from(cost) } else { f64::INFINITY };
        let (Stop::Faces(target) | Stop::Cost(_, target)) = stop;
        let dying_max = self.mesh.face_count.saturating_sub(target) + BELOW_MAX;
        let stays = self.stays(to);
        let neighbour = if fan.is_alone { self.loners.neighbour_of(from) } else { None };
        let neighbour = neighbour.map(|neighbour| self.followed(neighbour));
        let collapse = Collapse { from, to, onto, stays, chain, fan, cost: price, dying_max, neighbour, inset };
        match self.collapser.try_collapse(&mut self.mesh, &self.rings, &mut self.cost, collapse) {
            Ok(died) => {
                self.spare_edges -= self.collapser.new_non_manifold_edges();
                if self.collapser.shape_rule() != ShapeRule::Strict {
                    self.changes.faces_forced += died as u64;
                }
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
                    log.push(LoggedCollapse { cost, faces: self.mesh.face_count as u32 });
                }
                true
            }
            Err(refusal) => {
                self.refusals[refusal as usize] += 1;
                self.refused.push(from);
                self.judge_after(from, proposal.key());
                false
            }
        }
    }

    /// Replaces a proposal that does not cover how far the surface would retreat by the cheapest one that does. Returns
    /// whether it did.
    fn costs_more(&mut self, from: LocalVertex) -> bool {
        let Proposal { to, cost, .. } = self.proposals[from];
        let is_covered = Retreat::of(&self.mesh, &self.rings, from).cost_onto(to, cost) <= cost;
        if !is_covered {
            self.refused.push(from);
            self.judge_after(from, Bid::LOWEST);
        }
        !is_covered
    }
}

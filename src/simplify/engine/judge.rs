//! Judges edges: which collapses the rules permit, what they cost, and the cheapest one of every vertex.

use super::Engine;
use crate::cost::{EdgeCase, LANES, Metric};
use crate::mesh::class::{Class, Rule};
use crate::mesh::edge::EdgeKind;
use crate::mesh::id::{Corner, Edge, End, LocalVertex, WedgePair};
use crate::simplify::alternatives::Cheapest;
use crate::simplify::proposal::{Bid, EdgeAt, Proposal, all_edges_at, chain_edges_at};
use crate::simplify::refusal::Refusal;
use crate::simplify::retreat::cost_with_retreat;
use crate::simplify::texture::insets;

/// Fewest faces of a non-manifold vertex that keeps its [alternatives](crate::simplify::alternatives).
const MANY_FACES: usize = 16;

impl<M: Metric> Engine<M> {
    pub(super) fn may_vanish(&self, vertex: LocalVertex) -> bool {
        let class = self.classes[vertex];
        (M::CORNERS_VANISH || !class.is_corner()) && !self.is_held(vertex)
    }

    /// Whether a vertex keeps its position when another collapses onto it.
    pub(super) fn stays(&self, vertex: LocalVertex) -> bool {
        M::ENDPOINTS || self.is_held(vertex)
    }

    /// Share of the overhang by which the texture coordinates of `to` move into their charts; 0 if the edge is on no
    /// chain, or if `to` is held.
    #[inline(always)]
    pub(super) fn inset(&self, to: LocalVertex, chain: bool) -> f64 {
        if chain && self.cost.inset() > 0.0 && !self.is_held(to) { self.cost.inset() } else { 0.0 }
    }

    /// Rule for an edge of this kind, given both classes and both locks.
    pub(super) fn rule(&self, from: LocalVertex, to: LocalVertex, kind: EdgeKind) -> Rule {
        if self.is_held(from) {
            return Rule::Never;
        }
        match self.cost.rule(self.classes[from], self.classes[to], kind) {
            Rule::Free if self.stays(to) => Rule::Onto,
            Rule::Chain if self.stays(to) => Rule::ChainOnto,
            rule => rule,
        }
    }

    pub(super) fn judge_all(&mut self) {
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

    /// Finds the cheapest collapse of a vertex. If `after` is given, finds the cheapest one above this key, at costs that
    /// cover [how far the surface retreats](cost_with_retreat).
    pub(super) fn judge(&mut self, vertex: LocalVertex, after: Option<Bid>) {
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
                if let Some(bid) = self.cheapest_onto(vertex, after) {
                    take(&mut best, Proposal::onto(bid.vertex(), bid.cost()));
                }
            } else if !self.mesh.is_locked(vertex) {
                for edge in self.rings.of(vertex).iter().filter_map(|&corner| EdgeAt::ahead(&self.mesh, corner)) {
                    take(&mut best, self.propose(vertex, &edge));
                }
            }
        } else if self.may_vanish(vertex) {
            let mut spokes = std::mem::take(&mut self.spokes);
            let Self { mesh, rings, classes, .. } = &*self;
            let offer = |edge: &EdgeAt| {
                let proposal = self.propose(vertex, edge);
                // The full price is never lower.
                if proposal.key() < best.key() {
                    take(&mut best, self.fully_priced(vertex, proposal, after));
                }
            };
            if classes[vertex] == Class::Complex {
                all_edges_at(mesh, rings, vertex, &mut spokes, offer);
            } else {
                chain_edges_at(mesh, rings, vertex, classes[vertex].is_border(), &mut spokes, offer);
            }
            self.spokes = spokes;
        }
        if let Some(proposal) = self.propose_weld(vertex) {
            take(&mut best, proposal);
        }
        self.proposals[vertex] = best;
    }

    /// Finds the cheapest collapse of a refused vertex above a key, at costs that cover how far the surface retreats.
    pub(super) fn judge_after(&mut self, vertex: LocalVertex, after: Bid) {
        let has_many = self.classes[vertex] == Class::Complex && self.rings.of(vertex).len() >= MANY_FACES;
        if !has_many || !self.may_vanish(vertex) {
            return self.judge(vertex, Some(after));
        }
        let mut alternatives = std::mem::take(&mut self.alternatives);
        let next = alternatives.next(vertex, || self.cheapest_of_all(vertex, after));
        self.alternatives = alternatives;
        self.proposals[vertex] = Proposal { second_best: true, ..next.unwrap_or(Proposal::NONE) };
    }

    /// The cheapest collapses of a non-manifold vertex above a key.
    fn cheapest_of_all(&mut self, vertex: LocalVertex, after: Bid) -> Cheapest {
        let mut cheapest = Cheapest::above(after);
        let mut spokes = std::mem::take(&mut self.spokes);
        all_edges_at(&self.mesh, &self.rings, vertex, &mut spokes, |edge| {
            let proposal = self.propose(vertex, edge);
            // The full price is never lower.
            if cheapest.has_room(proposal.key()) {
                cheapest.add(self.fully_priced(vertex, proposal, Some(after)));
            }
        });
        self.spokes = spokes;
        self.propose_weld(vertex).into_iter().for_each(|weld| cheapest.add(weld));
        cheapest
    }

    /// A proposal at a cost that covers how far the surface retreats, if `after` is given.
    fn fully_priced(&self, from: LocalVertex, proposal: Proposal, after: Option<Bid>) -> Proposal {
        let Proposal { to, cost, .. } = proposal;
        if after.is_none() || !M::ENDPOINTS || !cost.is_finite() {
            return proposal;
        }
        Proposal { cost: cost_with_retreat(&self.mesh, &self.rings, Edge { from, to }, cost), ..proposal }
    }

    /// Proposal to collapse an edge from a smooth vertex.
    #[inline(always)]
    pub(super) fn propose_inside(&self, from: End, to: End) -> Proposal {
        if M::ENDPOINTS {
            return Proposal::onto(to.vertex, self.cost.cost_onto(&self.mesh, from, to));
        }
        let pair = WedgePair { from: from.wedge, to: to.wedge };
        self.propose(from.vertex, &EdgeAt { other: to.vertex, wedges: [pair; 2], face_count: 2 })
    }

    /// The neighbour onto which a smooth vertex collapses at the least cost; if `after` is given, of those above it.
    #[inline(always)]
    pub(super) fn cheapest_onto(&self, from: LocalVertex, after: Option<Bid>) -> Option<Bid> {
        let Self { mesh, rings, cost, .. } = self;
        let mut corners = rings.living(mesh, from);
        let own = End { vertex: from, wedge: mesh.wedge_of(corners.clone().next()?) };
        // An infinite cost is no proposal: it marks a vanished vertex.
        let mut best = Bid::new(f32::INFINITY, LocalVertex::new(0));
        let mut ends = [own; LANES];
        loop {
            let mut count = 0;
            for (end, corner) in ends.iter_mut().zip(&mut corners) {
                *end = mesh.end_of(corner.next());
                count += 1;
            }
            for (end, cost) in ends.iter().zip(cost.costs_onto(mesh, own, &ends)).take(count) {
                let mut bid = Bid::new(cost, end.vertex);
                if after.is_some() && bid < best {
                    let edge = Edge { from, to: end.vertex };
                    bid = Bid::new(cost_with_retreat(mesh, rings, edge, cost), end.vertex);
                }
                if bid < best && after.is_none_or(|after| bid > after) {
                    best = bid;
                }
            }
            if count < LANES {
                return (best.cost() < f32::INFINITY).then_some(best);
            }
        }
    }

    /// Proposal to collapse an edge that was gathered at `from`; [`Proposal::NONE`] if the rules forbid it.
    #[inline(always)]
    pub(super) fn propose(&self, from: LocalVertex, edge: &EdgeAt) -> Proposal {
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

    /// Re-evaluates what this round's collapses changed: survivors, their neighbours, and refused vertices near them.
    pub(super) fn rejudge(&mut self) {
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
    pub(super) fn rejudge_neighbour(&mut self, corner: Corner, survivor: Corner) {
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
            let [from, to] = [corner, survivor].map(|corner| self.mesh.end_of(corner));
            let proposal = self.propose_inside(from, to);
            if proposal.key() < self.proposals[vertex].key() {
                self.proposals[vertex] = proposal;
            }
        }
    }
}

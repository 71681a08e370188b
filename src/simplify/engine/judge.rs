//! Judges edges: which collapses the rules permit, what they cost, and the cheapest one of every vertex.

use super::Engine;
use crate::cost::{EdgeCase, LANES, Metric};
use crate::mesh::class::{Class, Rule};
use crate::mesh::edge::{EdgeKind, edge_kind};
use crate::mesh::id::{Corner, Edge, End, LocalVertex, WedgePair};
use crate::simplify::alternatives::Cheapest;
use crate::simplify::edge_star::is_hub;
use crate::simplify::proposal::{Bid, EdgeAt, Proposal, all_edges_at, chain_edges_at};
use crate::simplify::refusal::Refusal;
use crate::simplify::retreat::Retreat;
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
        if self.is_held(from) { Rule::Never } else { self.rule_of_free(from, to, kind) }
    }

    /// The same, if `from` is not held.
    #[inline(always)]
    fn rule_of_free(&self, from: LocalVertex, to: LocalVertex, kind: EdgeKind) -> Rule {
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
    /// cover [how far the surface retreats](Retreat).
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
                let cheapest = match after {
                    None => self.cheapest_onto(vertex),
                    Some(after) => self.cheapest_above(vertex, after),
                };
                if let Some(bid) = cheapest {
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
            let retreat = if after.is_some() { self.retreat_of(vertex) } else { None };
            let offer = |edge: &EdgeAt| {
                let proposal = self.propose(vertex, edge);
                // The full price is never lower.
                if proposal.key() < best.key() {
                    take(&mut best, fully_priced(proposal, retreat.as_ref()));
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
        let retreat = self.retreat_of(vertex);
        all_edges_at(&self.mesh, &self.rings, vertex, &mut spokes, |edge| {
            let proposal = self.propose(vertex, edge);
            // The full price is never lower.
            if cheapest.has_room(proposal.key()) {
                cheapest.add(fully_priced(proposal, retreat.as_ref()));
            }
        });
        self.spokes = spokes;
        self.propose_weld(vertex).into_iter().for_each(|weld| cheapest.add(weld));
        cheapest
    }

    /// The surface that may retreat from a vertex; `None` if costs need not cover that.
    fn retreat_of(&self, vertex: LocalVertex) -> Option<Retreat<'_>> {
        M::ENDPOINTS.then(|| Retreat::of(&self.mesh, &self.rings, vertex))
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

    /// The neighbour onto which a smooth vertex collapses at the least cost.
    #[inline(always)]
    fn cheapest_onto(&self, from: LocalVertex) -> Option<Bid> {
        // An infinite cost is no proposal: it marks a vanished vertex.
        let none = Bid::new(f32::INFINITY, LocalVertex::new(0));
        let mut best = none;
        self.for_each_onto(from, |bids| best = bids.into_iter().fold(best, Bid::min));
        (best < none).then_some(best)
    }

    /// The same of those above `after`, at costs that cover [how far the surface retreats](Retreat).
    fn cheapest_above(&self, from: LocalVertex, after: Bid) -> Option<Bid> {
        let retreat = Retreat::of(&self.mesh, &self.rings, from);
        let none = Bid::new(f32::INFINITY, LocalVertex::new(0));
        let mut best = none;
        self.for_each_onto(from, |bids| {
            for bid in bids {
                // The full price is never lower.
                if bid < best {
                    let full = Bid::new(retreat.cost_onto(bid.vertex(), bid.cost()), bid.vertex());
                    best = if full > after { best.min(full) } else { best };
                }
            }
        });
        (best < none).then_some(best)
    }

    /// Passes on the collapses of a smooth vertex onto its neighbours, several at a time; some may occur more than once.
    #[inline(always)]
    fn for_each_onto(&self, from: LocalVertex, mut take: impl FnMut([Bid; LANES])) {
        let Self { mesh, rings, cost, .. } = self;
        let Some(first) = rings.living(mesh, from).next() else { return };
        let own = End { vertex: from, wedge: mesh.wedge_of(first) };
        let mut last = mesh.end_of(first.next());
        for corners in rings.of(from).chunks(LANES) {
            let mut ends = [last; LANES];
            for (end, &corner) in ends.iter_mut().zip(corners) {
                // The edge before takes the place of a dead one: a branch could not be predicted.
                last = if mesh.living(corner).is_some() { mesh.end_of(corner.next()) } else { last };
                *end = last;
            }
            let costs = cost.costs_onto(mesh, own, &ends);
            take(std::array::from_fn(|lane| Bid::new(costs[lane], ends[lane].vertex)));
        }
    }

    /// Proposal to collapse an edge that was gathered at `from`, which is not held; [`Proposal::NONE`] if the rules
    /// forbid it, or if the other end is a hub: that collapse would be refused.
    #[inline(always)]
    pub(super) fn propose(&self, from: LocalVertex, edge: &EdgeAt) -> Proposal {
        let (to, kind) = (edge.other, edge.kind());
        if is_hub(&self.mesh, &self.rings, to) {
            return Proposal::NONE;
        }
        let is_plain = edge.face_count <= 2 || self.classes[from] == Class::Complex;
        let rule = if is_plain { self.rule_of_free(from, to, kind) } else { Rule::Never };
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

    /// Whether a vertex that is not smooth may collapse onto a survivor beside it, or with the survivor's change
    /// elsewhere.
    fn is_on_way(&self, vertex: LocalVertex, survivor: LocalVertex) -> bool {
        // What collapsed onto a vertex that is still smooth was smooth, and no chain vertex collapses onto it.
        self.classes[survivor] != Class::Smooth
            && (self.classes[vertex] == Class::Complex
                || self.rips.partner_of(vertex).is_some()
                || edge_kind(&self.mesh, &self.rings, vertex, survivor) != EdgeKind::Inner)
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
        // A hub has no proposal, and nearly always a face that changed: the refused vertices around it would all be
        // tried again in every round.
        if self.stirred[vertex] == 2 * round + 1 || is_hub(&self.mesh, &self.rings, vertex) {
            return;
        }
        let Proposal { to, second_best, .. } = self.proposals[vertex];
        let is_stale = second_best || self.touched.get(to) == Some(&round);
        let is_first = self.stirred[vertex] != 2 * round;
        self.stirred[vertex] = 2 * round;
        let survivor_vertex = self.mesh.vertex_of(survivor);
        if M::ENDPOINTS
            && self.classes[vertex] != Class::Smooth
            && !is_stale
            && !self.is_on_way(vertex, survivor_vertex)
        {
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

/// A proposal at a cost that covers how far the surface retreats, if it must.
fn fully_priced(proposal: Proposal, retreat: Option<&Retreat<'_>>) -> Proposal {
    match retreat {
        Some(retreat) if proposal.cost.is_finite() => {
            Proposal { cost: retreat.cost_onto(proposal.to, proposal.cost), ..proposal }
        }
        _ => proposal,
    }
}

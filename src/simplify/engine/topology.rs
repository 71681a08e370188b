//! Topology changes: cuts handles, closes holes and rips, and removes the last triangles of connected components.

use super::Engine;
use crate::cost::{EdgeCase, Metric};
use crate::mesh::class::Class;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::simplify::loners::Loner;
use crate::simplify::proposal::Proposal;
use crate::simplify::rips::{VertexFilter, border_ends, closeness};
use crate::simplify::{caps, handles};

/// Largest squared edge length of a handle that is cut, relative to the square root of the highest cost of a collapse.
const HANDLE_SHARE: f64 = 2.0;
/// If nothing else is left, all handles with squared edge lengths up to this many times the least are cut together.
const HANDLES_SQ: f64 = 4.0;

/// Share of its cost that is charged for a collapse that closes a rip or a three-edge hole. Border planes hold both
/// sides in place, and an open gap is seen long before an error in distance.
const CLOSING_SHARE: f32 = 0.05;

impl<M: Metric> Engine<M> {
    /// Cuts handles up to a length that depends on `cost`, the highest cost of a collapse, and closes holes that cost
    /// no more than that. The mesh must be prepared, and is so afterwards.
    pub(super) fn mend(&mut self, cost: f64) {
        let mut changed = Vec::new();
        if self.cuts_handles() && (self.seeks_handles || !self.milestones.is_empty()) {
            let handles = self.handles(HANDLE_SHARE * cost.sqrt());
            changed = self.cut(&handles);
        }
        if self.closes_rips() {
            // The rings are outdated only at cut handles, none of which has a vertex on a border.
            let room = self.faces_before.saturating_sub(self.mesh.face_count);
            let shut = caps::shut(&mut self.mesh, &self.rings, &self.classes, cost, room);
            self.changes.holes_closed += shut.count;
            changed.extend(shut.vertices);
        }
        self.follow_changes(&changed);
    }

    /// Cuts the shortest handles that can be cut, with those of similar length. Returns whether any was cut.
    pub(super) fn cut_shortest_handles(&mut self) -> bool {
        self.prepare();
        let handles = self.handles(f64::INFINITY);
        let mut longer = &handles[..];
        while let Some(shortest) = longer.first() {
            let similar = longer.partition_point(|handle| handle.length_sq <= HANDLES_SQ * shortest.length_sq);
            let changed = self.cut(&longer[..similar]);
            if !changed.is_empty() {
                self.follow_changes(&changed);
                return true;
            }
            longer = &longer[similar..];
        }
        false
    }

    pub(super) fn cuts_handles(&self) -> bool {
        self.frees_topology && self.collapser.deviation_max.is_none()
    }

    fn handles(&self, most_sq: f64) -> Vec<handles::Handle> {
        handles::find(&self.mesh, &self.rings, &self.classes, |vertex| !self.is_held(vertex), most_sq)
    }

    /// Cuts handles. Returns their vertices and the copies of these.
    fn cut(&mut self, handles: &[handles::Handle]) -> Vec<LocalVertex> {
        let copies = self.mesh.positions.len();
        let mut changed = handles::cut(&mut self.mesh, &self.rings, handles);
        self.changes.handles_cut += changed.len() as u64 / 3;
        changed.extend(self.mesh.vertex_ids().skip(copies));
        changed
    }

    /// Rebuilds the rings and the classes of the `changed` vertices, if there are any.
    fn follow_changes(&mut self, changed: &[LocalVertex]) {
        if !changed.is_empty() {
            self.is_tidy = false;
            self.tidy();
            self.mesh.unlink_unused_wedges();
            self.reclassify(changed);
        }
    }

    /// Whether borders are welded to each other.
    pub(super) fn closes_rips(&self) -> bool {
        let may_close = self.frees_topology && self.welds && !self.lock_borders;
        M::ENDPOINTS && may_close && self.collapser.deviation_max.is_none()
    }

    /// Prices isolated triangles, and pairs the borders along rips. Vertices of rips become candidates, even if they
    /// have no other collapse.
    pub(super) fn look_around(&mut self) {
        let alone = self.candidates.iter().copied().filter(|&vertex| self.is_alone(vertex));
        let faces = alone.map(|vertex| Loner { vertex, face: self.rings.of(vertex)[0].face() }).collect();
        self.loners.price(&self.mesh, faces);
        if self.closes_rips() {
            self.rips.pair(&self.mesh, &self.rings, &self.classes);
            self.candidates.extend(self.rips.vertices());
            self.candidates.sort_unstable();
            self.candidates.dedup();
        }
    }

    /// Whether a vertex belongs to an isolated triangle: one that shares no vertex with another face.
    pub(super) fn is_alone(&self, vertex: LocalVertex) -> bool {
        let &[corner] = self.rings.of(vertex) else { return false };
        let ring = self.mesh.others_of(corner);
        ring.iter().all(|&far| self.rings.of(far).len() == 1 && !self.mesh.is_shared(far))
    }

    /// Cost of removing the triangle of a vertex; `None` if the triangle is not isolated.
    pub(super) fn price_alone(&self, vertex: LocalVertex) -> Option<f32> {
        if self.is_alone(vertex) { self.loners.price_of(vertex) } else { None }
    }

    /// Whether the surface that an isolated triangle was priced against has vanished.
    pub(super) fn has_lost_neighbour(&self, vertex: LocalVertex) -> bool {
        let (Some(neighbour), &[corner, ..]) = (self.loners.neighbour_of(vertex), self.rings.of(vertex)) else {
            return false;
        };
        self.rings.faces(&self.mesh, self.followed(neighbour)).all(|face| face == corner.face())
    }

    /// The collapse of a vertex onto the border vertex that it was paired with, or onto the vertex that this one
    /// collapsed into. `None` if it has no such partner left, is held, or belongs to an isolated triangle.
    pub(super) fn propose_weld(&self, vertex: LocalVertex) -> Option<Proposal> {
        if self.classes[vertex] == Class::Smooth {
            return None;
        }
        let to = self.followed(self.rips.partner_of(vertex)?);
        // An isolated triangle has its own price.
        if self.is_held(vertex)
            || self.is_alone(vertex)
            || to == vertex
            || self.rings.faces(&self.mesh, to).next().is_none()
            || !self.is_apart(vertex, to)
        {
            return None;
        }
        let case = EdgeCase { from: vertex, to, onto: true, stays: true, wedges: &[], insets: Default::default() };
        let closeness = closeness(&self.mesh, &self.rings, vertex, to);
        let share = (closeness * closeness.sqrt()).max(CLOSING_SHARE);
        Some(Proposal::onto(to, share * self.cost.place(&self.mesh, &case).cost as f32))
    }

    /// Whether `from` has a partner, and no face in common with `to`.
    pub(super) fn is_apart(&self, from: LocalVertex, to: LocalVertex) -> bool {
        let has_to = |face: FaceId| self.mesh.vertices(face).contains(&to);
        self.classes[from] != Class::Smooth
            && self.rips.partner_of(from).is_some()
            && !self.rings.faces(&self.mesh, from).any(has_to)
    }

    /// Share of its cost that is charged for the collapse of a border edge.
    pub(super) fn closing_share(&self, from: LocalVertex, to: LocalVertex) -> f32 {
        if self.closes_rips() && self.is_beside_hole(from, to) { CLOSING_SHARE } else { 1.0 }
    }

    /// Whether this border edge belongs to a hole of three edges.
    pub(super) fn is_beside_hole(&self, from: LocalVertex, to: LocalVertex) -> bool {
        let closes = |third: LocalVertex| third != to && self.is_border_beside(to, [third, from]);
        if self.classes[from].is_border() {
            // In an open fan every outer vertex occurs once as next and once as previous, except the two on the border:
            // the XOR of all leaves the border neighbour that is not `to`.
            let mut third = to.number();
            for corner in self.rings.living(&self.mesh, from) {
                let [next, previous] = self.mesh.others_of(corner);
                third ^= next.number() ^ previous.number();
            }
            let third = LocalVertex::new(third);
            return third.index() < self.classes.len() && closes(third) && self.is_border_beside(from, [third, to]);
        }
        let mut beside = VertexFilter::default();
        self.rings.living(&self.mesh, to).for_each(|corner| {
            self.mesh.others_of(corner).into_iter().for_each(|neighbour| beside.insert(neighbour));
        });
        border_ends(&self.mesh, &self.rings, from).any(|third| beside.may_contain(third) && closes(third))
    }

    /// Whether `vertex` has a border edge to `end`, and no face with both `end` and `third`.
    fn is_border_beside(&self, vertex: LocalVertex, [end, third]: [LocalVertex; 2]) -> bool {
        let (mut count, mut has_both) = (0, false);
        for corner in self.rings.of(vertex) {
            let [a, b] = self.mesh.others_of(*corner);
            // No branch: which face has the edge cannot be predicted.
            let has_end = ((a == end) | (b == end)) & !self.mesh.is_dead(corner.face());
            count += u32::from(has_end);
            has_both |= has_end & ((a == third) | (b == third));
        }
        count == 1 && !has_both
    }

    /// The vertex that a vertex merged into in this stage, over any number of collapses, or itself.
    pub(super) fn followed(&self, mut vertex: LocalVertex) -> LocalVertex {
        while let Some(next) = self.went_to(vertex) {
            vertex = next;
        }
        vertex
    }

    /// The vertex that a vertex collapsed onto in this stage; `None` if it did not, even if its component has vanished.
    pub(super) fn went_to(&self, vertex: LocalVertex) -> Option<LocalVertex> {
        let proposal = &self.proposals[vertex];
        let has_vanished = self.rings.of(vertex).is_empty() && proposal.cost == f32::INFINITY;
        proposal.to.some().filter(|_| has_vanished)
    }

    /// Number of non-manifold vertices that no other cluster uses.
    pub(super) fn complex_count(&self) -> u64 {
        self.classes.iter().filter(|&&class| class == Class::Complex).count() as u64
    }
}

//! Where the topology may change: handles are cut, holes shut, rips closed, and the last triangles of pieces go.

use super::Engine;
use crate::cost::{EdgeCase, Metric};
use crate::mesh::class::Class;
use crate::mesh::cluster::ClusterMesh;
use crate::simplify::proposal::Proposal;
use crate::simplify::rips::has_border_end;
use crate::simplify::{caps, handles};

/// A handle is cut where an edge of it may have a squared length of this share of the root of what a collapse may cost.
const HANDLE_SHARE: f64 = 2.0;
/// Where nothing else is left, handles whose edges have up to this many times the least squared length are cut at once.
const HANDLES_SQ: f64 = 4.0;

/// Share of its cost that a collapse takes if it closes a rip or a hole of three edges: border planes hold both sides where
/// they are, and what is left open is seen before any distance is.
const CLOSING_SHARE: f32 = 0.05;

impl<M: Metric> Engine<M> {
    /// Cuts handles up to a length that goes by what a collapse may cost, and shuts holes that cost no more than that. The mesh is to be prepared, and is so afterwards.
    pub(super) fn mend(&mut self, cost: f64) {
        let mut changed = Vec::new();
        if self.cuts_handles() && (self.seeks_handles || !self.milestones.is_empty()) {
            let handles = self.handles(HANDLE_SHARE * cost.sqrt());
            changed = self.cut(&handles);
        }
        if self.closes_rips() {
            // What was cut has no vertex on a border.
            let room = self.faces_before.saturating_sub(self.mesh.face_count);
            let shut = caps::shut(&mut self.mesh, &self.rings, &self.classes, cost, room);
            self.changes.holes_closed += shut.count;
            changed.extend(shut.vertices);
        }
        self.follow_changes(&changed);
    }

    /// Cuts the shortest handles, and those about as long; returns whether there were any.
    pub(super) fn cut_shortest_handles(&mut self) -> bool {
        if !self.cuts_handles() {
            return false;
        }
        self.prepare();
        let mut handles = self.handles(f64::INFINITY);
        let Some(shortest_sq) = handles.first().map(|handle| handle.length_sq) else { return false };
        handles.retain(|handle| handle.length_sq <= HANDLES_SQ * shortest_sq);
        let changed = self.cut(&handles);
        self.follow_changes(&changed);
        !changed.is_empty()
    }

    fn cuts_handles(&self) -> bool {
        self.frees_topology && self.collapser.deviation_max.is_none()
    }

    fn handles(&self, most_sq: f64) -> Vec<handles::Handle> {
        handles::find(&self.mesh, &self.rings, &self.classes, |vertex| !self.is_held(vertex), most_sq)
    }

    /// Cuts handles; returns the vertices at them, with their copies.
    fn cut(&mut self, handles: &[handles::Handle]) -> Vec<u32> {
        let copies = self.mesh.positions.len() as u32;
        let mut changed = handles::cut(&mut self.mesh, &self.rings, handles);
        self.changes.handles_cut += changed.len() as u64 / 3;
        changed.extend(copies..self.mesh.positions.len() as u32);
        changed
    }

    /// Builds the rings, and finds the classes of some vertices, if there are any whose faces were changed.
    fn follow_changes(&mut self, changed: &[u32]) {
        if !changed.is_empty() {
            self.is_tidy = false;
            self.tidy();
            self.mesh.unlink_unused_wedges();
            self.classify_anew(changed);
        }
    }

    /// Whether borders are welded to each other.
    pub(super) fn closes_rips(&self) -> bool {
        let may_close = self.frees_topology && self.welds && !self.lock_borders;
        M::ENDPOINTS && may_close && self.collapser.deviation_max.is_none()
    }

    /// Prices the triangles that hang on no other, and pairs the borders along rips. The vertices of rips become
    /// candidates, even if they may do nothing else.
    pub(super) fn look_around(&mut self) {
        let alone = self.candidates.iter().copied().filter(|&vertex| self.is_alone(vertex));
        let faces = alone.map(|vertex| (vertex, self.rings.of(vertex)[0] / 3)).collect();
        self.loners.price(&self.mesh, faces);
        if self.closes_rips() {
            self.rips.pair(&self.mesh, &self.rings, &self.classes);
            self.candidates.extend(self.rips.vertices());
            self.candidates.sort_unstable();
            self.candidates.dedup();
        }
    }

    /// Whether a vertex belongs to a triangle that hangs on no other.
    pub(super) fn is_alone(&self, vertex: u32) -> bool {
        let &[corner] = self.rings.of(vertex) else { return false };
        let ring = ClusterMesh::following(corner).map(|corner| self.mesh.vertex_of(corner));
        ring.iter().all(|&far| self.rings.of(far).len() == 1 && !self.mesh.is_shared(far))
    }

    /// What it costs if the triangle of a vertex vanishes, if it hangs on no other.
    pub(super) fn price_alone(&self, vertex: u32) -> Option<f32> {
        if self.is_alone(vertex) { self.loners.price_of(vertex) } else { None }
    }

    /// Whether a triangle that hangs on no other has lost what was nearest to it, by which it was priced.
    pub(super) fn has_lost_neighbour(&self, vertex: u32) -> bool {
        let (Some(neighbour), &[corner, ..]) = (self.loners.neighbour_of(vertex), self.rings.of(vertex)) else {
            return false;
        };
        self.rings.faces(&self.mesh, self.followed(neighbour)).all(|face| face == corner / 3)
    }

    /// The collapse of a vertex onto that of another border that it was paired with, or what that one went into.
    pub(super) fn propose_weld(&self, vertex: u32) -> Option<Proposal> {
        if self.classes[vertex as usize] == Class::Smooth {
            return None;
        }
        let pair = self.rips.pair_of(vertex)?;
        let to = self.followed(pair.partner);
        // A triangle that hangs on no other has a price of its own.
        if self.is_held(vertex)
            || self.is_alone(vertex)
            || to == vertex
            || self.rings.of(to).is_empty()
            || !self.is_apart(vertex, to)
        {
            return None;
        }
        let case = EdgeCase { from: vertex, to, onto: true, stays: true, wedges: &[], insets: Default::default() };
        let share = pair.closeness.max(CLOSING_SHARE);
        Some(Proposal::onto(to, share * self.cost.place(&self.mesh, &case).cost as f32))
    }

    /// Whether a vertex was paired with one that it has no face in common with.
    pub(super) fn is_apart(&self, from: u32, to: u32) -> bool {
        let has_to = |face: u32| self.mesh.vertices(face).contains(&to);
        self.classes[from as usize] != Class::Smooth
            && self.rips.pair_of(from).is_some()
            && !self.rings.faces(&self.mesh, from).any(has_to)
    }

    /// Share of its cost that the collapse of a border edge takes.
    pub(super) fn closing_share(&self, from: u32, to: u32) -> f32 {
        if self.closes_rips() && self.is_beside_hole(from, to) { CLOSING_SHARE } else { 1.0 }
    }

    /// Whether a hole of three edges has this border edge.
    pub(super) fn is_beside_hole(&self, from: u32, to: u32) -> bool {
        let closes = |third: u32| third != to && self.is_border_beside(to, [third, from]);
        if self.classes[from as usize].is_border() {
            // Around one open fan every vertex follows another and precedes one, but for the two on the border.
            let mut third = to;
            for &corner in self.rings.of(from).iter().filter(|&&corner| self.mesh.living(corner).is_some()) {
                let [next, previous] = ClusterMesh::following(corner).map(|corner| self.mesh.vertex_of(corner));
                third ^= next ^ previous;
            }
            return (third as usize) < self.classes.len() && closes(third) && self.is_border_beside(from, [third, to]);
        }
        has_border_end(&self.mesh, &self.rings, from, closes)
    }

    /// Whether a vertex has a border edge to another one, and no face with that and a third one.
    fn is_border_beside(&self, vertex: u32, [end, third]: [u32; 2]) -> bool {
        let mut count = 0;
        for face in self.rings.faces(&self.mesh, vertex) {
            let corners = self.mesh.vertices(face);
            if corners.contains(&end) {
                if corners.contains(&third) {
                    return false;
                }
                count += 1;
            }
        }
        count == 1
    }

    /// The vertex that a vertex went into in this stage, or itself.
    pub(super) fn followed(&self, mut vertex: u32) -> u32 {
        while let Some(next) = self.went_to(vertex) {
            vertex = next;
        }
        vertex
    }

    /// What a vertex collapsed onto in this stage. A vertex may also be without faces since its piece has vanished.
    pub(super) fn went_to(&self, vertex: u32) -> Option<u32> {
        let proposal = &self.proposals[vertex as usize];
        let went = self.rings.of(vertex).is_empty() && proposal.cost == f32::INFINITY && proposal.to != u32::MAX;
        went.then_some(proposal.to)
    }

    /// Vertices at non-manifold places that no other cluster uses.
    pub(super) fn complex_count(&self) -> u64 {
        self.classes.iter().filter(|&&class| class == Class::Complex).count() as u64
    }
}

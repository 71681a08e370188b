//! The loop over edges: rounds of sorted candidates, inside stages that recompute the quadrics.
//!
//! ```text
//! stage    rings, classes and quadrics from the current mesh; every edge is judged
//! └ round  the cheapest edges in order; a vertex takes part in one collapse a round;
//!          then only edges around changed vertices are judged anew
//! ```
//! Rounds give the quality of a heap at two to three times its speed.

use super::collapse::{Collapse, Collapser};
use super::legality::Refusal;
use crate::cost::census::Census;
use crate::cost::surface::EdgeKind;
use crate::cost::{EdgeCase, Metric};
use crate::mesh::class::{Class, Rule, VALENCE_MAX, classify};
use crate::mesh::cluster::{ClusterMesh, flag};
use crate::mesh::ring::Rings;

/// Share of the faces that one round aims to remove: small enough to stay near the order of one queue.
const ROUND_SHARE: f64 = 0.10;
/// Candidates tried for each collapse that a round aims at: neighbours block each other.
const TRIES_PER_COLLAPSE: f64 = 1.5;
/// A stage that stops on a cost ends when a round over all its candidates removes less than this share of the faces.
const LAST_SHARE: f64 = 0.0005;

/// When a stage ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stop {
    /// As soon as no more than this many faces are left.
    Faces(usize),
    /// When no legal collapse costs this or less, or no more than this many faces are left.
    Cost(f32, usize),
}

/// What a stage did.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StageResult {
    /// Highest cost of a collapse.
    pub cost: f32,
    /// Whether the stop was reached before the legal collapses ran out.
    pub reached: bool,
}

/// A judged edge.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    cost: f32,
    from: u32,
    to: u32,
    onto: bool,
    chain: bool,
    /// Refused, and nothing around it has changed since.
    parked: bool,
}

impl Candidate {
    fn key(&self) -> (u32, u32, u32) {
        (self.cost.to_bits(), self.from.min(self.to), self.from.max(self.to))
    }
}

/// An edge at a vertex, with the wedges of its faces (of the vertex, of the other end).
#[derive(Debug, Clone, Copy)]
struct EdgeAt {
    other: u32,
    wedges: [(u32, u32); 2],
    face_count: u32,
}

impl EdgeAt {
    fn kind(&self) -> EdgeKind {
        match self.face_count {
            1 => EdgeKind::Border,
            _ if self.wedges[0] == self.wedges[1] => EdgeKind::Inner,
            _ => EdgeKind::Seam,
        }
    }
}

/// What a cluster was like at the end of a stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Milestone {
    /// Faces left.
    pub faces: usize,
    /// Highest cost of a collapse in the stage.
    pub cost: f32,
    /// Estimate of the mean squared deviation that all stages so far have added, in units of length².
    pub squared_error: f64,
}

/// Simplifies one cluster.
#[derive(Debug)]
pub struct Engine<M> {
    /// The mesh as it stands.
    pub mesh: ClusterMesh,
    cost: M,
    rings: Rings,
    classes: Vec<Class>,
    candidates: Vec<Candidate>,
    collapser: Collapser,
    /// Round in which a vertex took part in a collapse.
    touched: Vec<u32>,
    /// Round in which a face around a vertex changed.
    stirred: Vec<u32>,
    survivors: Vec<u32>,
    changed: Vec<u32>,
    round: u32,
    edges: Vec<EdgeAt>,
    costs: Vec<f32>,
    chosen: Vec<u32>,
    /// How often each [`Refusal`] was met.
    pub refusals: [u64; Refusal::COUNT],
    /// Estimate of the mean squared deviation that the stages so far have added, in units of length².
    pub squared_error: f64,
    /// Each stage that had something to do.
    pub milestones: Vec<Milestone>,
    /// Vertices on seams when the last stage began.
    pub seam_vertices: u64,
    /// Cost and dead faces of every collapse, if wanted.
    pub log: Option<Vec<(f32, u8)>>,
    /// Whether seam vertices are locked.
    pub lock_seams: bool,
    /// Whether border vertices are locked.
    pub lock_borders: bool,
}

impl<M: Metric> Engine<M> {
    /// Takes a mesh.
    pub fn new(mesh: ClusterMesh, settings: &M::Settings) -> Self {
        Self {
            mesh,
            cost: M::new(settings),
            rings: Rings::default(),
            classes: Vec::new(),
            candidates: Vec::new(),
            collapser: Collapser::default(),
            touched: Vec::new(),
            stirred: Vec::new(),
            survivors: Vec::new(),
            changed: Vec::new(),
            round: 0,
            edges: Vec::new(),
            costs: Vec::new(),
            chosen: Vec::new(),
            refusals: [0; Refusal::COUNT],
            squared_error: 0.0,
            milestones: Vec::new(),
            seam_vertices: 0,
            log: None,
            lock_seams: false,
            lock_borders: false,
        }
    }

    /// Adds the numbers of a mesh that the metric divides by.
    pub fn count(mesh: ClusterMesh, settings: &M::Settings, census: &mut Census) {
        let mut engine = Self::new(mesh, settings);
        engine.prepare();
        M::count(settings, &engine.mesh, &engine.rings, &engine.classes, census);
    }

    /// Number of vertices with faces that may move or vanish under the current locks, and of those that may not.
    pub fn count_free(&mut self) -> (usize, usize) {
        self.prepare();
        let used = (0..self.mesh.positions.len() as u32).filter(|&v| !self.rings.of(v).is_empty());
        let (mut free, mut held) = (0, 0);
        for vertex in used {
            if self.is_held(vertex) || self.classes[vertex as usize] == Class::Fixed {
                held += 1;
            } else {
                free += 1;
            }
        }
        (free, held)
    }

    /// Number of living vertices of each class, in the order of [`Class::ALL`].
    pub fn class_counts(&self) -> [u64; 7] {
        let mut counts = [0; 7];
        for vertex in 0..self.classes.len() {
            if !self.rings.of(vertex as u32).is_empty() {
                counts[self.classes[vertex] as usize] += 1;
            }
        }
        counts
    }

    /// Runs one stage.
    pub fn run(&mut self, stop: Stop) -> StageResult {
        let mut result = StageResult::default();
        if self.is_done(stop) {
            return StageResult { reached: true, ..result };
        }
        self.prepare();
        self.cost.refresh(&self.mesh, &self.rings, &self.classes);
        let is_seam =
            |class: &&Class| matches!(class, Class::Seam | Class::Corner | Class::BorderSeam | Class::BorderCorner);
        self.seam_vertices = self.classes.iter().filter(is_seam).count() as u64;
        self.judge_all();
        let mut widen = 1.0;
        loop {
            let before = self.mesh.face_count;
            let tried_all = self.choose(stop, widen);
            if self.chosen.is_empty() {
                break;
            }
            self.round += 1;
            self.collapse_chosen(stop, &mut result);
            let removed = before - self.mesh.face_count;
            if self.is_done(stop) {
                result.reached = true;
                break;
            }
            let few = (before as f64 * LAST_SHARE) as usize;
            let is_last = match stop {
                Stop::Faces(_) => tried_all && removed == 0,
                Stop::Cost(..) => tried_all && removed <= few,
            };
            if is_last {
                break;
            }
            widen = if removed * 8 < (before as f64 * ROUND_SHARE) as usize { widen * 2.0 } else { 1.0 };
            self.rejudge();
        }
        result.reached |= matches!(stop, Stop::Cost(..));
        self.squared_error += std::mem::take(&mut self.collapser.displaced) / self.cost.area().max(f64::MIN_POSITIVE);
        let (faces, squared_error) = (self.mesh.face_count, self.squared_error);
        self.milestones.push(Milestone { faces, cost: result.cost, squared_error });
        result
    }

    /// Area of the mesh when the last stage began.
    pub fn area(&self) -> f64 {
        self.cost.area()
    }

    /// Bounds the deviation from the input, in units of length.
    pub fn bound_deviation(&mut self, most: f64) {
        self.collapser.deviation_max = Some(most);
    }

    /// Gives the mesh back, without dead faces and unused wedges.
    pub fn finish(mut self) -> ClusterMesh {
        self.mesh.compact_faces();
        self.mesh
    }

    fn is_done(&self, stop: Stop) -> bool {
        let (Stop::Faces(target) | Stop::Cost(_, target)) = stop;
        self.mesh.face_count <= target
    }

    fn prepare(&mut self) {
        self.mesh.compact_faces();
        self.mesh.unlink_unused_wedges();
        self.rings.build(&self.mesh);
        classify(&self.mesh, &self.rings, &mut self.classes);
        for vertex in 0..self.classes.len() {
            if self.mesh.flags[vertex] & flag::SHARED != 0 {
                self.classes[vertex] = Class::Fixed;
            }
        }
        self.touched.clear();
        self.touched.resize(self.mesh.positions.len(), 0);
        self.stirred.clear();
        self.stirred.resize(self.mesh.positions.len(), 0);
        self.round = 0;
        self.collapser.reset(&self.mesh);
    }

    fn is_held(&self, vertex: u32) -> bool {
        self.mesh.is_locked(vertex)
            || match self.classes[vertex as usize] {
                Class::Smooth => false,
                Class::Seam | Class::Corner => self.lock_seams,
                Class::BorderSeam | Class::BorderCorner => self.lock_seams || self.lock_borders,
                Class::Border => self.lock_borders,
                Class::Fixed => true,
            }
    }

    /// What the edge's kind, both classes and both locks allow.
    fn rule(&self, from: u32, to: u32, kind: EdgeKind) -> Rule {
        // A crowded end would be refused by the link condition, after its many wedges had been judged.
        if self.is_held(from) || self.rings.of(to).len() > 2 * VALENCE_MAX {
            return Rule::Never;
        }
        match self.cost.rule(self.classes[from as usize], self.classes[to as usize], kind) {
            Rule::Free if self.is_held(to) => Rule::Onto,
            Rule::Chain if self.is_held(to) => Rule::ChainOnto,
            rule => rule,
        }
    }

    fn judge_all(&mut self) {
        self.candidates.clear();
        for vertex in 0..self.mesh.positions.len() as u32 {
            self.judge_around(vertex, |engine, other| other > vertex || engine.classes[other as usize] == Class::Fixed);
        }
    }

    /// Judges the edges at a vertex whose other end `wanted` accepts.
    fn judge_around(&mut self, vertex: u32, wanted: impl Fn(&Self, u32) -> bool) {
        if self.classes[vertex as usize] == Class::Fixed {
            return;
        }
        let mut edges = std::mem::take(&mut self.edges);
        edges_at(&self.mesh, &self.rings, vertex, &mut edges);
        for edge in &edges {
            if edge.face_count <= 2 && wanted(self, edge.other) {
                self.judge(vertex, edge);
            }
        }
        self.edges = edges;
    }

    fn judge(&mut self, vertex: u32, edge: &EdgeAt) {
        let kind = edge.kind();
        let pairs = if kind == EdgeKind::Seam { &edge.wedges[..2] } else { &edge.wedges[..1] };
        let there = self.rule(vertex, edge.other, kind);
        let back = self.rule(edge.other, vertex, kind);
        let mut best: Option<Candidate> = None;
        for (rule, from, to) in [(there, vertex, edge.other), (back, edge.other, vertex)] {
            if rule == Rule::Never {
                continue;
            }
            let swapped = [(pairs[0].1, pairs[0].0), pairs.get(1).map_or((0, 0), |pair| (pair.1, pair.0))];
            let wedges = if from == vertex { pairs } else { &swapped[..pairs.len()] };
            let onto = matches!(rule, Rule::Onto | Rule::ChainOnto);
            let chain = matches!(rule, Rule::Chain | Rule::ChainOnto);
            let stays = self.is_held(to);
            let cost = self.cost.place(&self.mesh, &EdgeCase { from, to, onto, stays, wedges }).cost as f32;
            if best.is_none_or(|best| cost < best.cost) && cost.is_finite() {
                best = Some(Candidate { cost, from, to, onto, chain, parked: false });
            }
            if !onto {
                break;
            }
        }
        self.candidates.extend(best);
    }

    /// Chooses the candidates of a round, in order; returns whether they are all that the stop allows.
    fn choose(&mut self, stop: Stop, widen: f64) -> bool {
        let faces = self.mesh.face_count as f64;
        let (limit, excess) = match stop {
            Stop::Faces(target) => (f32::INFINITY, (self.mesh.face_count - target) as f64),
            Stop::Cost(cost, _) => (cost, faces),
        };
        let collapses = (0.5 * excess.min(faces * ROUND_SHARE)).ceil();
        let wanted = (collapses * TRIES_PER_COLLAPSE * widen).max(8.0) as usize;
        self.costs.clear();
        let open = |c: &&Candidate| !c.parked && c.cost <= limit;
        self.costs.extend(self.candidates.iter().filter(open).map(|c| c.cost));
        let tried_all = self.costs.len() <= wanted;
        let bound = if tried_all { limit } else { *self.costs.select_nth_unstable_by(wanted, f32::total_cmp).1 };
        self.chosen.clear();
        let candidates = &self.candidates;
        let is_chosen = |c: &Candidate| !c.parked && c.cost <= bound;
        self.chosen.extend((0..candidates.len() as u32).filter(|&i| is_chosen(&candidates[i as usize])));
        self.chosen.sort_unstable_by_key(|&i| candidates[i as usize].key());
        tried_all
    }

    fn collapse_chosen(&mut self, stop: Stop, result: &mut StageResult) {
        self.survivors.clear();
        let round = self.round;
        for i in 0..self.chosen.len() {
            let index = self.chosen[i] as usize;
            let Candidate { cost, from, to, onto, chain, .. } = self.candidates[index];
            if self.touched[from as usize] == round || self.touched[to as usize] == round {
                continue;
            }
            let collapse = Collapse { from, to, onto, stays: self.is_held(to), chain };
            match self.collapser.try_collapse(&mut self.mesh, &self.rings, &mut self.cost, collapse) {
                Ok(died) => {
                    self.touched[from as usize] = round;
                    self.touched[to as usize] = round;
                    self.survivors.push(to);
                    result.cost = result.cost.max(cost);
                    if let Some(log) = &mut self.log {
                        log.push((cost, died as u8));
                    }
                    self.stir(from);
                    self.stir(to);
                    if self.is_done(stop) {
                        return;
                    }
                }
                Err(refusal) => {
                    self.refusals[refusal as usize] += 1;
                    self.candidates[index].parked = true;
                }
            }
        }
    }

    /// Notes that the faces around a vertex changed.
    fn stir(&mut self, vertex: u32) {
        for face in self.rings.faces(&self.mesh, vertex) {
            for v in self.mesh.vertices(face) {
                self.stirred[v as usize] = self.round;
            }
        }
    }

    /// Judges the edges around this round's survivors anew, and lets refused edges near a change try again.
    fn rejudge(&mut self) {
        let round = self.round;
        self.mesh.compact_faces();
        self.rings.build(&self.mesh);
        self.cost.follow(&self.mesh, &self.rings, &self.survivors, &mut self.changed);
        for vertex in self.changed.drain(..) {
            if self.touched[vertex as usize] != round {
                self.touched[vertex as usize] = round;
                self.survivors.push(vertex);
            }
        }
        let (touched, stirred) = (&self.touched, &self.stirred);
        self.candidates.retain_mut(|c| {
            if stirred[c.from as usize] == round || stirred[c.to as usize] == round {
                c.parked = false;
            }
            touched[c.from as usize] != round && touched[c.to as usize] != round
        });
        let survivors = std::mem::take(&mut self.survivors);
        for &vertex in &survivors {
            self.judge_around(vertex, |engine, other| other > vertex || engine.touched[other as usize] != round);
        }
        self.survivors = survivors;
    }
}

/// The edges at a vertex, with the wedges at both ends in up to two faces.
fn edges_at(mesh: &ClusterMesh, rings: &Rings, vertex: u32, edges: &mut Vec<EdgeAt>) {
    edges.clear();
    for &corner in rings.of(vertex) {
        let own = mesh.wedge_of(corner);
        for far in ClusterMesh::following(corner) {
            let (other, wedge) = (mesh.vertex_of(far), mesh.wedge_of(far));
            match edges.iter_mut().find(|edge| edge.other == other) {
                Some(edge) => {
                    edge.wedges[1] = (own, wedge);
                    edge.face_count += 1;
                }
                None => edges.push(EdgeAt { other, wedges: [(own, wedge); 2], face_count: 1 }),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cost::surface::{SurfaceCost, Weights};
    use crate::mesh::cluster::samples;

    fn simplified(mesh: ClusterMesh, faces: usize) -> (ClusterMesh, StageResult) {
        let mut engine = Engine::<SurfaceCost>::new(mesh, &Weights::default());
        let result = engine.run(Stop::Faces(faces));
        (engine.finish(), result)
    }

    fn area(mesh: &ClusterMesh) -> f64 {
        let across = |t: [glam::DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]).length();
        (0..mesh.corners.len() as u32).map(|face| 0.5 * across(mesh.triangle(face))).sum()
    }

    #[test]
    fn a_flat_square_becomes_two_triangles_of_the_same_area() {
        let (mesh, result) = simplified(samples::grid(12, 0.0), 2);
        assert!(result.reached, "{result:?}");
        assert_eq!(mesh.corners.len(), 2);
        assert!((area(&mesh) - 144.0).abs() < 1e-3, "{}", area(&mesh));
    }

    #[test]
    fn the_face_target_is_hit() {
        let (mesh, result) = simplified(samples::grid(40, 0.5), 801);
        assert!(result.reached);
        assert!((799..=801).contains(&mesh.corners.len()));
    }

    #[test]
    fn a_locked_vertex_never_moves_and_never_vanishes() {
        let mut mesh = samples::grid(12, 0.3);
        let before = mesh.positions.clone();
        for vertex in (0..169).step_by(5) {
            mesh.flags[vertex] |= flag::LOCKED;
        }
        let (mesh, _) = simplified(mesh, 2);
        for vertex in (0..169).step_by(5) {
            assert_eq!(mesh.positions[vertex], before[vertex]);
            assert!(mesh.corners.iter().flatten().any(|&w| mesh.wedge_vertex[w as usize] as usize == vertex));
        }
    }

    #[test]
    fn a_seam_keeps_both_charts_on_their_sides() {
        let (mesh, result) = simplified(samples::two_charts(12), 4);
        assert!(result.reached, "{result:?}");
        assert!((area(&mesh) - 144.0).abs() < 1e-3, "{}", area(&mesh));
        for corners in &mesh.corners {
            let right = corners.iter().filter(|&&w| mesh.wedge_uv[w as usize].x >= 6.99).count();
            let left = corners.iter().filter(|&&w| mesh.wedge_uv[w as usize].x <= 0.601).count();
            assert!(right < 3 || left == 0, "a face spans both charts");
        }
    }

    #[test]
    fn locked_seams_stay_whole() {
        let mut engine = Engine::<SurfaceCost>::new(samples::two_charts(12), &Weights::default());
        engine.lock_seams = true;
        engine.run(Stop::Faces(4));
        let mesh = engine.finish();
        for y in 0..=12 {
            let vertex = y * 13 + 6;
            assert!(mesh.corners.iter().flatten().any(|&w| mesh.wedge_vertex[w as usize] == vertex), "{vertex}");
        }
    }
}

//! A new mesh for the old surface before its edges collapse: many vertices where it bends, few where it is flat.
//!
//! ```text
//! masses ──▶ cells ──▶ a centre each ──▶ more centres where collapses err ──▶ cells again, along the mesh ──▶ dual
//!            grown to   the point of     from a queue, until there are as       each vertex to the nearer    cells
//!            D_avg      least error      many as vertices before                centre                       shrink
//! ```
//! In: a cluster, and what was found over the whole mesh. Out: the cluster with other vertices and faces. Invariant: what
//! is locked, shared, on a border, on a seam or between materials stays vertex for vertex and edge for edge; new
//! vertices lie on edges of the old surface, and have its picture and colour there; every step is a legal
//! collapse, so that no mesh comes out worse than it went in.
//!
//! # Source
//! Liu, Chen, Wang, "Edge collapse of UDSM based on centroidal Voronoi diagram reconstruction", Journal of Applied
//! Optics 41(1), 2020, doi 10.5768/JAO202041.0102010; after Valette, Chassery, "Approximated centroidal Voronoi diagrams
//! for uniform polygonal mesh coarsening", Computer Graphics Forum 23(3), 2004 (ACVD).
//!
//! | symbol | here |
//! | --- | --- |
//! | k1, k2 by jet fitting | `curvature` |
//! | ρ = \|P\| (√(k1² + k2²))^λ \[13\] | [`mass::Part::mass`], `lambda` |
//! | D_avg = Σρ / n \[12\] | [`Frame::enough`] |
//! | C, the cells | `cells` (step 1), `clustering` (step 3) |
//! | z, a cell's centre | `centres` (step 2) |
//! | the queue by collapse error | `queue` (step 2) |
//! | F = Σi (\|zi\|² ΣM - 2 zi·ΣMγ) \[9-11\] | [`clustering::Clustering::energy`] |
//! | M, γ: a vertex's mass and place \[5-8\] | its ρ and its position |
//! | the dual, with junctions, Delaunay where it is flat | `dual`, `delaunay` (step 3) |
//!
//! Step 4 of the paper is the collapse that follows, with any metric. With `cells`, the paper's CVD(2), it is left out and
//! the cells are as many as asked for.
//!
//! # Where we differ
//! * Vertices are what cells are made of: section 1.2 of the paper ends with "the latter", which may mean vertices or
//!   faces. Distances are straight (in the paper geodesic), and cells grow and change along edges only.
//! * Seeds come in Morton order, and cells grow breadth-first (the paper walks the file's order); what cannot grow joins
//!   the lightest neighbour.
//! * k1² + k2² is floored at a share of its positive median (`floor`): flat ground would weigh nothing.
//! * D_avg and the queue's threshold are those of the whole mesh and frozen: as many cells in every cluster would undo
//!   what the masses are for. The paper puts D_avg to a use in the queue that it does not explain; here the queue ends
//!   when there are as many centres as wanted.
//! * The planes that choose a centre and that the queue errs by are weighted by area. A centre within a quarter of its
//!   edge from an end is that end.
//! * A picked point splits its edge and becomes a vertex; an edge takes at most seven, one between two held vertices, one with
//!   a centre on it, or one of a thin face none, a cluster no more than it has vertices. A point stays a quarter of its part
//!   of the edge away from both ends of it.
//! * On flat ground, where every point has the same error, a spring (`spring`) draws a centre to the middle of its cell.
//! * Held vertices (seams, borders, rims) are cells of their own, whatever they weigh.
//! * The dual is reached by legal collapses; what cannot collapse is left as it is and counted.
//!
//! # Memory
//! [`GROWTH`] times the cluster's own weight.

pub mod cells;
pub mod centres;
pub mod clustering;
pub mod curvature;
pub mod delaunay;
pub mod dual;
pub mod mass;
pub mod queue;

use std::str::FromStr;

use serde::{Deserialize, Serialize};

use self::cells::NO_CELL;
use self::centres::{Centre, Members};
use self::clustering::{Clustering, Pull};
use self::dual::Shrunk;
use self::mass::{MassSums, Part};
use self::queue::{ErrorCounts, Queue, sound_faces};
use crate::cost::knob::{self, Knob, factor, number, switch};
use crate::mesh::class::{Class, classify};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::ring::Rings;
use crate::mesh::split::{EdgePoint, split_edges};

/// What may be set.
pub const KNOBS: [Knob; 8] = [
    factor("lambda", 2.0, "power of the curvature in a vertex's mass"),
    factor("cells", 0.0, "cells wanted, without a collapse afterwards; 0 takes as many as there are vertices"),
    factor("floor", 1e-3, "least k1² + k2², in medians of its positive values"),
    number("rings", 2.0, [1.0, 4.0], "rings of vertices that a jet is fitted to"),
    factor("spring", 1e-3, "stiffness of the spring from a centre to the middle of its cell, in traces of its quadric"),
    factor("sweeps", 50.0, "times that vertices may change their cell, at most"),
    switch("centroidal", 0.0, "1 takes the centroids of cells for centres while vertices choose (ACVD)"),
    factor(
        "junctions",
        1.0,
        "error from which a junction becomes a vertex, in thresholds of the queue; 0 makes none, nor do cells",
    ),
];

/// A cluster takes this many times its weight while it is remeshed, in halves.
pub const GROWTH: u64 = 3;

/// Settings of the reconstruction: `cvd`, `cvd:1`, `cvd:1,cells=500`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Settings {
    /// Power of the curvature.
    pub lambda: f64,
    /// Cells wanted; nothing to take as many as there are vertices.
    pub cells: Option<u64>,
    /// Least k1² + k2², in medians.
    pub floor: f64,
    /// Rings of vertices that a jet is fitted to.
    pub rings: u32,
    /// Stiffness of the spring from a centre to the middle of its cell.
    pub spring: f64,
    /// Sweeps of the clustering, at most.
    pub sweeps: u32,
    /// Whether centres are centroids while vertices choose.
    pub centroidal: bool,
    /// Error from which a junction becomes a vertex, in thresholds of the queue; 0 makes none, nor do `cells`.
    pub junctions: f64,
}

impl Default for Settings {
    fn default() -> Self {
        KNOBS.map(|knob| knob.default).into()
    }
}

impl From<[f64; 8]> for Settings {
    fn from([lambda, cells, floor, rings, spring, sweeps, centroidal, junctions]: [f64; 8]) -> Self {
        Self {
            lambda,
            cells: (cells >= 1.0).then_some(cells as u64),
            floor,
            rings: rings as u32,
            spring,
            sweeps: sweeps as u32,
            centroidal: centroidal >= 0.5,
            junctions,
        }
    }
}

impl FromStr for Settings {
    type Err = String;

    /// Reads `cvd`, `cvd:λ` and `cvd:name=value,…`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (name, rest) = text.split_once(':').unwrap_or((text, ""));
        if name != "cvd" {
            return Err(format!("{name}: expected cvd"));
        }
        let words = rest.split(',').filter(|word| !word.is_empty());
        let given: Vec<String> = words
            .enumerate()
            .map(|(i, word)| if i == 0 && !word.contains('=') { format!("lambda={word}") } else { word.to_owned() })
            .collect();
        knob::read(&KNOBS, &given).map(Self::from)
    }
}

/// What was found over the whole mesh, and is frozen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Frame {
    /// Least k1² + k2².
    pub floor: f64,
    /// D_avg \[12\].
    pub enough: f64,
    /// Cells wanted.
    pub wanted: u64,
    /// Collapse error from which edges are split.
    pub threshold: f64,
}

impl Frame {
    /// From the masses of all clusters; the threshold is not known yet.
    pub fn new(sums: &MassSums, settings: &Settings) -> Self {
        let floor = sums.floor(settings.floor);
        let wanted = settings.cells.unwrap_or(sums.count()).max(1);
        Self { floor, enough: sums.total(settings.lambda, floor) / wanted as f64, wanted, threshold: f64::INFINITY }
    }
}

/// Cells grown in a cluster, and candidates for more.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Stock {
    /// Cells, those of shared vertices left out.
    pub cells: u64,
    /// Errors of the candidates.
    pub candidates: ErrorCounts,
}

impl Stock {
    /// Adds another cluster's.
    pub fn merge(&mut self, other: &Self) {
        self.cells += other.cells;
        self.candidates.merge(&other.candidates);
    }

    /// The threshold that leaves as many centres as are wanted.
    pub fn threshold(&self, frame: &Frame) -> f64 {
        self.candidates.threshold(frame.wanted.saturating_sub(self.cells))
    }
}

/// What was done to a cluster.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Outcome {
    /// Ends and share of every vertex that was put into an edge: the last ones of the mesh, in order.
    pub points: Vec<EdgePoint>,
    /// Cells that grew.
    pub cells: u64,
    /// Vertices that hold still, which are cells of their own.
    pub held: u64,
    /// Centres that the queue added.
    pub added: u64,
    /// What became of the other vertices.
    pub shrunk: Shrunk,
    /// Edges of the dual that were flipped.
    pub flipped: u64,
}

/// Adds the masses of a cluster's vertices.
pub fn weigh(mesh: &ClusterMesh, settings: &Settings, sums: &mut MassSums) {
    let field = Field::new(mesh, settings);
    for (vertex, part) in field.parts.iter().enumerate() {
        if !field.rings.of(vertex as u32).is_empty() && !mesh.is_shared(vertex as u32) {
            sums.add(*part, settings.lambda);
        }
    }
}

/// Counts the cells of a cluster, and the candidates for more.
pub fn take_stock(mesh: &ClusterMesh, settings: &Settings, frame: &Frame) -> Stock {
    let field = Field::new(mesh, settings);
    let (_, _, grown) = field.grow(mesh, settings, frame);
    let shared = (0..mesh.positions.len() as u32).filter(|&v| mesh.is_shared(v) && !field.rings.of(v).is_empty());
    Stock {
        cells: u64::from(grown).saturating_sub(shared.count() as u64),
        candidates: Queue::new(mesh, &field.rings, &field.is_held, &sound_faces(mesh)).count(most_points(mesh)),
    }
}

/// Makes the mesh anew.
pub fn reconstruct(mesh: &mut ClusterMesh, settings: &Settings, frame: &Frame) -> Outcome {
    mesh.compact_faces();
    mesh.unlink_unused_wedges();
    let field = Field::new(mesh, settings);
    let (mut cells, held, count) = field.grow(mesh, settings, frame);
    let members = Members::new(&cells, count);
    let is_sound = sound_faces(mesh);
    let fixed = (&field.is_held[..], &is_sound[..]);
    let chosen = centres::centres(mesh, &field.rings, &members, &cells, fixed, settings.spring);
    drop(members);
    let queue = Queue::new(mesh, &field.rings, &field.is_held, &is_sound);
    let picked = queue.points(frame.threshold, most_points(mesh));
    drop(queue);
    let Field { parts, is_held, .. } = field;
    let mut masses: Vec<f64> = parts.iter().map(|part| part.mass(settings.lambda, frame.floor)).collect();
    drop(parts);

    let points = Points::merge(&chosen, picked);
    let base = mesh.positions.len() as u32;
    split_edges(mesh, &points.on_edges);
    let mut vertices: Vec<u32> = chosen
        .iter()
        .map(|centre| match centre {
            Centre::Vertex(vertex) => *vertex,
            Centre::Edge(_) => NO_CELL,
        })
        .collect();
    let mut added = 0;
    for (at, cell) in points.cells.iter().enumerate() {
        let vertex = base + at as u32;
        if *cell == NO_CELL {
            cells.push(vertices.len() as u32);
            vertices.push(vertex);
            added += 1;
        } else {
            cells.push(*cell);
            vertices[*cell as usize] = vertex;
        }
    }
    // A new vertex stands for what its edge's ends stand for.
    for point in &points.on_edges {
        let [a, b] = point.ends.map(|end| masses[end as usize]);
        masses.push(a + (b - a) * point.share);
    }

    let mut rings = Rings::default();
    rings.build(mesh);
    let is_held = |vertex: u32| is_held.get(vertex as usize).copied().unwrap_or(false);
    let pull = if settings.centroidal { Pull::Centroidal } else { Pull::Fixed };
    let clustering = Clustering { mesh, rings: &rings, masses: &masses, centres: &vertices, pull };
    clustering.improve(&mut cells, settings.sweeps, is_held);
    // As many cells as were asked for are all that is wanted.
    let has_junctions = settings.junctions > 0.0 && settings.cells.is_none();
    let most = if has_junctions { settings.junctions * frame.threshold } else { f64::INFINITY };
    let junctions = dual::keep_junctions(mesh, &rings, &mut cells, &mut vertices, most, is_held);
    drop(rings);
    let shrunk = dual::shrink(mesh, &cells, &vertices, is_held);
    let flipped = delaunay::flip(mesh);
    Outcome {
        points: points.on_edges,
        cells: u64::from(count - held),
        held: u64::from(held),
        added,
        shrunk: Shrunk { junctions, ..shrunk },
        flipped,
    }
}

/// Points that a cluster's edges may take in all.
fn most_points(mesh: &ClusterMesh) -> u64 {
    mesh.positions.len() as u64
}

/// Where a cluster's surface bends, and what holds still.
struct Field {
    rings: Rings,
    parts: Vec<Part>,
    /// Vertices that neither move nor go.
    is_held: Vec<bool>,
}

impl Field {
    fn new(mesh: &ClusterMesh, settings: &Settings) -> Self {
        let (mut rings, mut classes) = (Rings::default(), Vec::new());
        rings.build(mesh);
        classify(mesh, &rings, &mut classes);
        let is_held = |(vertex, class): (usize, &Class)| {
            *class != Class::Smooth || mesh.is_locked(vertex as u32) || mesh.is_shared(vertex as u32)
        };
        let is_held = classes.iter().enumerate().map(is_held).collect();
        let parts = mass::parts(mesh, &rings, settings.rings);
        Self { rings, parts, is_held }
    }

    /// The first cells: those of held vertices, then those that grow; how many the former are, and how many all.
    fn grow(&self, mesh: &ClusterMesh, settings: &Settings, frame: &Frame) -> (Vec<u32>, u32, u32) {
        let masses: Vec<f64> = self.parts.iter().map(|part| part.mass(settings.lambda, frame.floor)).collect();
        let mut cells = vec![NO_CELL; mesh.positions.len()];
        let mut held = 0;
        for (vertex, cell) in cells.iter_mut().enumerate() {
            if self.is_held[vertex] && !self.rings.of(vertex as u32).is_empty() {
                *cell = held;
                held += 1;
            }
        }
        let free = (0..cells.len() as u32).filter(|&v| !self.is_held[v as usize] && !self.rings.of(v).is_empty());
        let order = cells::morton_order(&mesh.positions, free);
        let neighbours = |vertex: u32, ring: &mut Vec<u32>| {
            ring.clear();
            ring.extend(self.rings.of(vertex).iter().map(|&c| mesh.vertex_of(ClusterMesh::following(c)[0])));
        };
        let count = cells::grow(&order, &masses, frame.enough, &mut cells, neighbours);
        (cells, held, count)
    }
}

/// Points to put into edges, and the cell that each is the centre of, if that is one of those grown.
struct Points {
    on_edges: Vec<EdgePoint>,
    cells: Vec<u32>,
}

impl Points {
    /// Centres that lie on edges, and the queue's points on other edges.
    fn merge(centres: &[Centre], picked: Vec<EdgePoint>) -> Self {
        let mut on_edges: Vec<(EdgePoint, u32)> = Vec::new();
        for (cell, centre) in centres.iter().enumerate() {
            if let Centre::Edge(point) = centre {
                on_edges.push((*point, cell as u32));
            }
        }
        on_edges.sort_unstable_by_key(|(point, _)| point.ends);
        let count = on_edges.len();
        for point in picked {
            if on_edges[..count].binary_search_by_key(&point.ends, |(point, _)| point.ends).is_err() {
                on_edges.push((point, NO_CELL));
            }
        }
        on_edges.sort_unstable_by(|(a, _), (b, _)| a.ends.cmp(&b.ends).then(a.share.total_cmp(&b.share)));
        let (on_edges, cells) = on_edges.into_iter().unzip();
        Self { on_edges, cells }
    }
}

//! Remeshes a cluster before its edges collapse: many vertices where the surface bends, few where it is flat.
//!
//! ```text
//! masses ──▶ cells ──▶ a centre each ──▶ more centres where collapses err ──▶ cells again, along the mesh ──▶ dual
//!            grown to   the point of     from a queue, until there are as       each vertex to the nearer    cells
//!            D_avg      least error      many as vertices before                centre                       shrink
//! ```
//! In: a cluster, and statistics of the whole mesh. Out: the cluster with other vertices and faces. Invariant: vertices
//! and edges that are locked, shared, on a border, on a seam or between materials stay as they are; new vertices lie on
//! edges of the old surface, and have its texture and colour there; every step is a legal collapse, so no mesh gets
//! invalid.
//!
//! # Source
//! Liu, Chen, Wang, "Edge collapse of UDSM based on centroidal Voronoi diagram reconstruction", Journal of Applied
//! Optics 41(1), 2020, doi 10.5768/JAO202041.0102010; after Valette, Chassery, "Approximated centroidal Voronoi
//! diagrams for uniform polygonal mesh coarsening", Computer Graphics Forum 23(3), 2004 (ACVD).
//!
//! | symbol | here |
//! | --- | --- |
//! | k1, k2 by jet fitting | `curvature` |
//! | ρ = \|P\| (√(k1² + k2²))^λ \[13\] | [`mass::VertexPart::mass`], `lambda` |
//! | D_avg = Σρ / n \[12\] | [`FrozenStatistics::enough`] |
//! | C, the cells | `cells` (step 1), `clustering` (step 3) |
//! | z, a cell's centre | `centres` (step 2) |
//! | the queue by collapse error | `queue` (step 2) |
//! | F = Σi (\|zi\|² ΣM - 2 zi·ΣMγ) \[9-11\] | [`clustering::Clustering::energy`] |
//! | M, γ: a vertex's mass and place \[5-8\] | its ρ and its position |
//! | the dual, with junctions, Delaunay where it is flat | `dual`, `delaunay` (step 3) |
//!
//! Step 4 of the paper is the collapse that follows, with any metric. With `cells`, which is the paper's CVD(2), it is
//! left out, and `cells` is the number of cells.
//!
//! # Where we differ
//! * Cells consist of vertices: section 1.2 of the paper ends with "the latter", which may mean vertices or faces.
//!   Distances are straight (in the paper geodesic), and cells grow and change along edges only.
//! * Seeds come in Morton order, and cells grow breadth-first (the paper follows the order of the file). A cell that
//!   cannot grow joins its lightest neighbour.
//! * k1² + k2² is at least a share of its positive median (`floor`), because flat ground would have no mass.
//! * D_avg and the queue's threshold are computed over the whole mesh and then frozen: the same number of cells in
//!   every cluster would defeat the masses. The paper uses D_avg in the queue without an explanation; here the queue
//!   ends at the wanted number of centres.
//! * The planes that choose a centre and that give the queue's errors are weighted by area. A centre within a quarter
//!   of its edge from an end is that end.
//! * A picked point splits its edge and becomes a vertex. An edge takes at most seven points; none if it joins two held
//!   vertices, has a centre on it, or belongs to a thin face. A cluster takes at most as many points as it has
//!   vertices. A point keeps a quarter of its part of the edge away from both ends of the part.
//! * On flat ground, where every point has the same error, a spring (`spring`) pulls a centre to the middle of its
//!   cell.
//! * Held vertices (seams, borders, rims) are cells of their own, whatever their mass.
//! * The dual is reached by legal collapses; vertices that cannot collapse are left and counted.
//!
//! # Memory
//! [`GROWTH`] halves of the cluster's own weight.

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

use self::cells::VoronoiCell;
use self::centres::{Centre, Members};
use self::clustering::{Clustering, Pull};
use self::dual::Shrunk;
use self::mass::{MassSums, VertexPart};
use self::queue::{ErrorCounts, Queue, sound_faces};
use crate::base::id::{TiSlice, TiVec};
use crate::cost::parameter::{self, Parameter, factor, number, switch};
use crate::mesh::class::{Class, classify};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::LocalVertex;
use crate::mesh::ring::Rings;
use crate::mesh::split::{EdgePoint, split_edges};

/// Parameters.
pub const PARAMETERS: [Parameter; 8] = [
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

/// Memory of a cluster while it is remeshed, in halves of its weight.
pub const GROWTH: u64 = 3;

/// Settings of the reconstruction: `cvd`, `cvd:1`, `cvd:1,cells=500`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CvdSettings {
    /// Power λ of the curvature in a vertex's mass.
    pub lambda: f64,
    /// Number of cells, without a collapse afterwards; `None` for as many as there are vertices.
    pub cells: Option<u64>,
    /// Least k1² + k2², in medians of its positive values.
    pub floor: f64,
    /// Number of rings of vertices that a jet is fitted to.
    pub rings: u32,
    /// Stiffness of the spring from a centre to the middle of its cell, relative to the trace of its quadric.
    pub spring: f64,
    /// Largest number of sweeps of the clustering.
    pub sweeps: u32,
    /// Whether centres are the centroids of their cells during the clustering (ACVD).
    pub centroidal: bool,
    /// Error above which a junction becomes a vertex, relative to the queue's threshold. 0 makes no junctions; neither
    /// does `cells`.
    pub junctions: f64,
}

impl Default for CvdSettings {
    fn default() -> Self {
        PARAMETERS.map(|parameter| parameter.default).into()
    }
}

impl From<[f64; 8]> for CvdSettings {
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

impl FromStr for CvdSettings {
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
        parameter::read(&PARAMETERS, &given).map(Self::from)
    }
}

/// Statistics of the whole mesh, frozen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FrozenStatistics {
    /// Least k1² + k2², in 1 / length².
    pub floor: f64,
    /// D_avg \[12\]: a cell closes at this mass.
    pub enough: f64,
    /// Number of cells wanted.
    pub wanted: u64,
    /// Collapse error from which edges are split; infinite until it is known.
    pub threshold: f64,
}

impl FrozenStatistics {
    /// Computed from the masses of all clusters, without the threshold.
    pub fn new(sums: &MassSums, settings: &CvdSettings) -> Self {
        let floor = sums.floor(settings.floor);
        let wanted = settings.cells.unwrap_or(sums.count()).max(1);
        Self { floor, enough: sums.total(settings.lambda, floor) / wanted as f64, wanted, threshold: f64::INFINITY }
    }

    /// Computed from a mesh that is one cluster, with the threshold.
    pub fn of_one(mesh: &ClusterMesh, settings: &CvdSettings) -> Self {
        let mut sums = MassSums::default();
        weigh(mesh, settings, &mut sums);
        let frame = Self::new(&sums, settings);
        let threshold = take_stock(mesh, settings, &frame).threshold(&frame);
        Self { threshold, ..frame }
    }
}

/// Number of cells grown in a cluster, and errors of candidates for more centres.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Stock {
    /// Number of cells, except those of shared vertices.
    pub cells: u64,
    /// Errors of the candidates.
    pub candidates: ErrorCounts,
}

impl Stock {
    /// Adds the counts of another cluster.
    pub fn merge(&mut self, other: &Self) {
        self.cells += other.cells;
        self.candidates.merge(&other.candidates);
    }

    /// The threshold that gives the wanted number of centres.
    pub fn threshold(&self, frame: &FrozenStatistics) -> f64 {
        self.candidates.threshold(frame.wanted.saturating_sub(self.cells))
    }
}

/// Result of remeshing a cluster.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Reconstruction {
    /// Ends and share of every vertex that splits an edge: the last vertices of the mesh, in order.
    pub points: Vec<EdgePoint>,
    /// Number of cells that grew.
    pub cells: u64,
    /// Number of held vertices, which are cells of their own.
    pub held: u64,
    /// Number of centres that the queue added.
    pub added: u64,
    /// Fate of the other vertices.
    pub shrunk: Shrunk,
    /// Number of edges of the dual that were flipped.
    pub flipped: u64,
}

/// Adds the masses of a cluster's vertices to `sums`; shared vertices are left out.
pub fn weigh(mesh: &ClusterMesh, settings: &CvdSettings, sums: &mut MassSums) {
    let field = Field::new(mesh, settings);
    for (vertex, part) in field.parts.iter_enumerated() {
        if !field.rings.of(vertex).is_empty() && !mesh.is_shared(vertex) {
            sums.add(*part, settings.lambda);
        }
    }
}

/// Counts the cells of a cluster, and the candidates for more centres.
pub fn take_stock(mesh: &ClusterMesh, settings: &CvdSettings, frame: &FrozenStatistics) -> Stock {
    let field = Field::new(mesh, settings);
    let grown = field.grow(mesh, settings, frame);
    let shared = mesh.vertex_ids().filter(|&v| mesh.is_shared(v) && !field.rings.of(v).is_empty());
    Stock {
        cells: (grown.count as u64).saturating_sub(shared.count() as u64),
        candidates: Queue::new(mesh, &field.rings, &field.is_held, &sound_faces(mesh)).count(most_points(mesh)),
    }
}

/// Remeshes the cluster.
pub fn reconstruct(mesh: &mut ClusterMesh, settings: &CvdSettings, frame: &FrozenStatistics) -> Reconstruction {
    mesh.compact_faces();
    mesh.unlink_unused_wedges();
    let field = Field::new(mesh, settings);
    let Grown { mut cells, held, count } = field.grow(mesh, settings, frame);
    let members = Members::new(&cells, count);
    let is_sound = sound_faces(mesh);
    let fixed = (&*field.is_held, &*is_sound);
    let chosen = centres::centres(mesh, &field.rings, &members, &cells, fixed, settings.spring);
    drop(members);
    let queue = Queue::new(mesh, &field.rings, &field.is_held, &is_sound);
    let picked = queue.points(frame.threshold, most_points(mesh));
    drop(queue);
    let Field { parts, is_held, .. } = field;
    let mut masses: TiVec<LocalVertex, f64> =
        parts.iter().map(|part| part.mass(settings.lambda, frame.floor)).collect();
    drop(parts);

    let points = Points::merge(&chosen, picked);
    let before = mesh.positions.len();
    split_edges(mesh, &points.on_edges);
    let mut vertices: TiVec<VoronoiCell, LocalVertex> = chosen
        .iter()
        .map(|centre| match centre {
            Centre::Vertex(vertex) => *vertex,
            Centre::Edge(_) => LocalVertex::NONE,
        })
        .collect();
    let mut added = 0;
    for (vertex, cell) in mesh.vertex_ids().skip(before).zip(&points.cells) {
        if let Some(cell) = cell.some() {
            cells.push(cell);
            vertices[cell] = vertex;
        } else {
            cells.push(vertices.push_and_get_key(vertex));
            added += 1;
        }
    }
    // The mass of a new vertex is interpolated between those of its edge's ends.
    for point in &points.on_edges {
        let [a, b] = point.ends.map(|end| masses[end]);
        masses.push(a + (b - a) * point.share);
    }

    let mut rings = Rings::default();
    rings.build(mesh);
    let is_held = |vertex: LocalVertex| is_held.get(vertex).copied().unwrap_or(false);
    let pull = if settings.centroidal { Pull::Centroidal } else { Pull::Fixed };
    let clustering = Clustering { mesh, rings: &rings, masses: &masses, centres: &vertices, pull };
    clustering.improve(&mut cells, settings.sweeps, is_held);
    // If the number of cells is given, junctions must not add to it.
    let has_junctions = settings.junctions > 0.0 && settings.cells.is_none();
    let most = if has_junctions { settings.junctions * frame.threshold } else { f64::INFINITY };
    let junctions = dual::keep_junctions(mesh, &rings, &mut cells, &mut vertices, most, is_held);
    drop(rings);
    let shrunk = dual::shrink(mesh, &cells, &vertices, is_held);
    let flipped = delaunay::flip(mesh);
    Reconstruction {
        points: points.on_edges,
        cells: (count - held) as u64,
        held: held as u64,
        added,
        shrunk: Shrunk { junctions, ..shrunk },
        flipped,
    }
}

/// Largest number of points on the edges of a cluster.
fn most_points(mesh: &ClusterMesh) -> u64 {
    mesh.positions.len() as u64
}

/// Rings, curvatures and held vertices of a cluster.
struct Field {
    rings: Rings,
    parts: TiVec<LocalVertex, VertexPart>,
    /// Vertices that neither move nor vanish.
    is_held: TiVec<LocalVertex, bool>,
}

impl Field {
    fn new(mesh: &ClusterMesh, settings: &CvdSettings) -> Self {
        let (mut rings, mut classes) = (Rings::default(), TiVec::new());
        rings.build(mesh);
        classify(mesh, &rings, &mut classes);
        let is_held =
            |(vertex, class): (_, &Class)| *class != Class::Smooth || mesh.is_locked(vertex) || mesh.is_shared(vertex);
        let is_held = classes.iter_enumerated().map(is_held).collect();
        let parts = mass::parts(mesh, &rings, settings.rings);
        Self { rings, parts, is_held }
    }

    /// The first cells: those of held vertices, then those that grow.
    fn grow(&self, mesh: &ClusterMesh, settings: &CvdSettings, frame: &FrozenStatistics) -> Grown {
        let masses: TiVec<LocalVertex, f64> =
            self.parts.iter().map(|part| part.mass(settings.lambda, frame.floor)).collect();
        let mut cells = mesh.per_vertex(VoronoiCell::NONE);
        let mut held = 0;
        for (vertex, cell) in cells.iter_mut_enumerated() {
            if self.is_held[vertex] && !self.rings.of(vertex).is_empty() {
                *cell = VoronoiCell::from(held);
                held += 1;
            }
        }
        let free = mesh.vertex_ids().filter(|&v| !self.is_held[v] && !self.rings.of(v).is_empty());
        let order = cells::morton_order(&mesh.positions, free);
        let neighbours = |vertex: LocalVertex, ring: &mut Vec<LocalVertex>| {
            ring.clear();
            ring.extend(self.rings.of(vertex).iter().map(|&c| mesh.vertex_of(c.next())));
        };
        let count = cells::grow(&order, &masses, frame.enough, &mut cells, neighbours);
        Grown { cells, held, count }
    }
}

/// The first cells.
struct Grown {
    /// Cell of each vertex.
    cells: TiVec<LocalVertex, VoronoiCell>,
    /// Number of held vertices, which are cells of their own.
    held: usize,
    /// Number of all cells.
    count: usize,
}

/// Points that split edges, and the grown cell that each is the centre of, or [`VoronoiCell::NONE`].
struct Points {
    on_edges: Vec<EdgePoint>,
    cells: Vec<VoronoiCell>,
}

impl Points {
    /// Merges the centres that lie on edges with the queue's points on other edges.
    fn merge(centres: &TiSlice<VoronoiCell, Centre>, picked: Vec<EdgePoint>) -> Self {
        let mut on_edges: Vec<(EdgePoint, VoronoiCell)> = Vec::new();
        for (cell, centre) in centres.iter_enumerated() {
            if let Centre::Edge(point) = centre {
                on_edges.push((*point, cell));
            }
        }
        on_edges.sort_unstable_by_key(|(point, _)| point.ends);
        let count = on_edges.len();
        for point in picked {
            if on_edges[..count].binary_search_by_key(&point.ends, |(point, _)| point.ends).is_err() {
                on_edges.push((point, VoronoiCell::NONE));
            }
        }
        on_edges.sort_unstable_by(|(a, _), (b, _)| a.ends.cmp(&b.ends).then(a.share.total_cmp(&b.share)));
        let (on_edges, cells) = on_edges.into_iter().unzip();
        Self { on_edges, cells }
    }
}

//! Counts edges, components, charts, borders and shapes of triangles, cell by cell.
//!
//! ```text
//!      own ────── own        every face at an own vertex is in this cell: counted at once
//!       │  ╲       │
//!       │    ╲     │
//!   shared ═══ shared        the face on the other side may be in another cell: its sides are matched at the end,
//!                            and join the components, charts and borders that reach it
//! ```
//! In: loaded clusters. Out: [`TopologyCounts`], [`Quality`], folded triangles, the edges of the border and of seams.
//! Invariant: the numbers are those that [`check`](super::super::check) counts on the whole mesh, and the edges come in
//! the same order at any memory budget.
//!
//! # Memory
//! 90 bytes a face of a cell; 4 bytes a shared vertex; 28 bytes for each component, chart and border that leaves its
//! cell; one bucket of shared sides at a time.
//!
//! # Files
//! `measure-sides.buckets` (80 bytes for each side of a face between shared vertices), removed at the end, and the file
//! of [`seams`](super::seams).

use std::path::Path;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;
use xxhash_rust::xxh3::xxh3_64;

use super::super::forest::DisjointSets;
use super::seams::{EdgeTexture, SeamEdge, SeamEdges, SeamWriter};
use crate::base::Result;
use crate::base::id::TiVec;
use crate::file::buckets::{BucketWriter, Verbatim};
use crate::geometry::triangle::{is_flat, regularity};
use crate::measure::figures::{Quality, SLIVER_REGULARITY, TopologyCounts};
use crate::mesh::ClusterMesh;
use crate::mesh::fold::{across, is_angle_small};
use crate::mesh::id::{FaceId, LocalVertex, Wedge};
use crate::model::Catalogue;
use crate::partition::{ClusterSource, Shared, id::PartitionVertex};

/// Bytes of a bucket of shared sides, if all sides are shared and [`BUCKETS_MAX`] allows as many buckets.
const BUCKET_BYTES: u64 = 8 << 20;
/// Maximum number of buckets of shared sides.
const BUCKETS_MAX: u64 = 256;
/// Marks a face without texture.
const NO_CHART: u32 = u32::MAX;
/// Bit in a shared vertex's edge count that marks it as lying on a border.
const ON_BORDER: u32 = 1 << 31;

/// Counts.
#[derive(Debug, Clone, Copy, Default)]
struct TallyCounts {
    topology: TopologyCounts,
    folded: u64,
    regularity_sum: f64,
    slivers: u64,
    valence_max: u64,
    inner_vertices: u64,
    regular_vertices: u64,
}

impl TallyCounts {
    fn add(&mut self, other: &Self) {
        let (t, o) = (&mut self.topology, &other.topology);
        t.vertices += o.vertices;
        t.edges += o.edges;
        t.faces += o.faces;
        t.boundary_edges += o.boundary_edges;
        t.boundary_loops += o.boundary_loops;
        t.non_manifold_edges += o.non_manifold_edges;
        t.folded_edges += o.folded_edges;
        t.components += o.components;
        t.seam_edges += o.seam_edges;
        t.charts += o.charts;
        t.degenerate_faces += o.degenerate_faces;
        self.folded += other.folded;
        self.regularity_sum += other.regularity_sum;
        self.slivers += other.slivers;
        self.valence_max = self.valence_max.max(other.valence_max);
        self.inner_vertices += other.inner_vertices;
        self.regular_vertices += other.regular_vertices;
    }

    fn add_vertex(&mut self, edges: u32) {
        let (valence, on_border) = (edges & !ON_BORDER, edges & ON_BORDER != 0);
        self.topology.vertices += 1;
        self.valence_max = self.valence_max.max(u64::from(valence));
        if !on_border {
            self.inner_vertices += 1;
            self.regular_vertices += u64::from((5..=7).contains(&valence));
        }
    }

    fn add_edge(&mut self, faces: usize, is_seam: bool) {
        self.topology.edges += 1;
        self.topology.boundary_edges += u64::from(faces == 1);
        self.topology.non_manifold_edges += u64::from(faces > 2);
        self.topology.seam_edges += u64::from(faces == 2 && is_seam);
    }

    /// Counts an edge as folded if its two faces, which lead away from it in these directions, are folded.
    fn add_fold(&mut self, across: [DVec3; 2]) {
        self.topology.folded_edges += u64::from(is_angle_small(across));
    }

    fn add_chart(&mut self, chart: &Chart) {
        self.topology.charts += 1;
        self.folded += match chart.area.total_cmp(&0.0) {
            _ if chart.area == 0.0 => 0,
            std::cmp::Ordering::Less => chart.positive,
            _ => chart.negative,
        };
    }
}

/// A chart: faces that are connected in texture space.
#[derive(Debug, Clone, Copy, Default)]
struct Chart {
    /// Sum of their areas in texture space, negative for faces that are turned over.
    area: f64,
    positive: u64,
    negative: u64,
}

/// A side of a face between two shared vertices.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct SharedSide {
    /// Ids in the partition, the lower one first.
    vertices: [u32; 2],
    /// Key of texture coordinate and material at each of them.
    keys: [u64; 2],
    /// Direction in which the face leads away from it.
    across: [f64; 3],
    piece: u32,
    /// Chart of the face, or [`NO_CHART`].
    chart: u32,
    texture: EdgeTexture,
    length: f32,
}

impl Verbatim for SharedSide {}

impl SharedSide {
    /// The same with the lower id first.
    fn lower_first(self) -> Self {
        let ([a, b], [key_a, key_b]) = (self.vertices, self.keys);
        match a < b {
            true => self,
            false => Self { vertices: [b, a], keys: [key_b, key_a], texture: self.texture.reversed(), ..self },
        }
    }
}

/// Counts of one cell, and the records that leave it.
#[derive(Debug, Default)]
pub struct CellTally {
    counts: TallyCounts,
    sides: Vec<SharedSide>,
    /// Number of components that leave the cell; sides refer to them from 0.
    pieces: u32,
    /// Charts that leave the cell.
    charts: Vec<Chart>,
    /// Number of borders that leave the cell.
    borders: u32,
    /// Shared vertices with the borders that end there.
    border_ends: Vec<(u32, u32)>,
    /// Shared vertices with their edges that end at an own vertex.
    shared_vertices: Vec<(u32, u32)>,
    border_edges: Vec<[DVec3; 2]>,
    seams: Vec<SeamEdge>,
}

/// A side of a face: its vertices, the lower one first, the wedges there, and the face.
type FaceSide = ([LocalVertex; 2], [Wedge; 2], FaceId);

/// Counts a cell; `images` has the texture image of each part.
pub fn tally(source: &ClusterSource, catalogue: &Catalogue, images: &[u32]) -> CellTally {
    let mesh = &source.mesh;
    let mut found = CellTally::default();
    found.counts.topology.faces = mesh.corners.len() as u64;
    found.counts.topology.degenerate_faces = source.degenerate;
    for face in mesh.face_ids() {
        // The regularity is NaN if the sides are too long to be squared.
        let regularity = regularity(mesh.triangle(face)).max(0.0);
        found.counts.regularity_sum += regularity;
        found.counts.slivers += u64::from(regularity < SLIVER_REGULARITY);
    }
    let sides = sorted_sides(mesh);
    let is_shared = |vertices: [LocalVertex; 2]| vertices.iter().all(|&vertex| mesh.is_shared(vertex));
    let is_textured = |face: FaceId| mesh.uv_triangle(face).iter().all(|uv| uv.is_finite());
    let mut pieces = DisjointSets::new(mesh.corners.len());
    let mut charts = DisjointSets::new(mesh.corners.len());
    let mut border = DisjointSets::new(mesh.positions.len());
    let mut on_border = Vec::new();
    let mut edges_at = mesh.per_vertex(0);
    let length = |vertices: [LocalVertex; 2]| {
        let [from, to] = vertices.map(|vertex| mesh.positions[vertex]);
        from.distance(to)
    };
    let texture = |(_, wedges, face): FaceSide| EdgeTexture::of(mesh, wedges, images[mesh.parts[face].index()]);
    for edge in sides.chunk_by(|a, b| a.0 == b.0) {
        let (vertices, wedges, face) = edge[0];
        edge[1..].iter().for_each(|side| pieces.join(face.number(), side.2.number()));
        if is_shared(vertices) {
            continue;
        }
        let is_seam = edge[1..].iter().any(|side| side.1 != wedges);
        found.counts.add_edge(edge.len(), is_seam);
        if let [a, b] = edge {
            found.counts.add_fold([*a, *b].map(|side| across_side(mesh, side)));
        }
        vertices.iter().for_each(|&vertex| edges_at[vertex] += 1);
        match edge {
            [_] => {
                border.join(vertices[0].number(), vertices[1].number());
                vertices.iter().for_each(|&vertex| edges_at[vertex] |= ON_BORDER);
                on_border.extend(vertices);
                found.border_edges.push(vertices.map(|vertex| mesh.positions[vertex] + source.origin));
            }
            [a, b] if !is_seam && is_textured(a.2) && is_textured(b.2) => charts.join(a.2.number(), b.2.number()),
            [a, b] if is_seam => found.seams.extend(SeamEdge::between(length(vertices), [*a, *b].map(texture))),
            _ => {}
        }
    }
    found.count_borders(source, &mut border, on_border);
    let piece_of = found.count_pieces(mesh, &sides, &mut pieces);
    let chart_of = found.count_charts(mesh, &sides, &mut charts);
    let keys = shared_keys(source, catalogue);
    for &side in sides.iter().filter(|side| is_shared(side.0)) {
        let (vertices, wedges, face) = side;
        let chart = if is_textured(face) { chart_of[charts.root(face.number()) as usize] } else { NO_CHART };
        let side = SharedSide {
            vertices: vertices.map(|vertex| source.vertex_id(vertex).number()),
            keys: wedges.map(|wedge| keys[wedge]),
            across: across_side(mesh, side).to_array(),
            piece: piece_of[pieces.root(face.number()) as usize],
            chart,
            texture: texture(side),
            length: length(vertices) as f32,
        };
        found.sides.push(side.lower_first());
    }
    for (vertex, &edges) in edges_at.iter_enumerated() {
        match mesh.is_shared(vertex) {
            true => found.shared_vertices.push((source.vertex_id(vertex).number(), edges)),
            false => found.counts.add_vertex(edges),
        }
    }
    found
}

/// Direction in which the face of a side leads away from it.
fn across_side(mesh: &ClusterMesh, (ends, _, face): FaceSide) -> DVec3 {
    let [low, high] = ends.map(|vertex| mesh.positions[vertex]);
    let third = mesh.vertices(face).into_iter().find(|vertex| !ends.contains(vertex));
    third.map_or(DVec3::ZERO, |third| across(high - low, mesh.positions[third] - low))
}

fn sorted_sides(mesh: &ClusterMesh) -> Vec<FaceSide> {
    let mut sides = Vec::with_capacity(3 * mesh.corners.len());
    for (face, (corners, vertices)) in mesh.face_ids().zip(mesh.corners.iter().zip(&mesh.corner_vertices)) {
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let (from, to) = if vertices[from] < vertices[to] { (from, to) } else { (to, from) };
            sides.push(([vertices[from], vertices[to]], [corners[from], corners[to]], face));
        }
    }
    let number = |vertex: LocalVertex| u64::from(vertex.number());
    sides.sort_unstable_by_key(|&([low, high], _, face)| (number(low) << 32 | number(high), face));
    sides
}

/// Key of texture coordinate and material for each wedge at a shared vertex; 0 for other wedges.
fn shared_keys(source: &ClusterSource, catalogue: &Catalogue) -> TiVec<Wedge, u64> {
    let mesh = &source.mesh;
    let mut keys = mesh.per_wedge(0);
    for (corners, &part) in mesh.corners.iter().zip(&mesh.parts) {
        for &wedge in corners.iter().filter(|&&wedge| mesh.is_shared(mesh.wedge_vertex[wedge])) {
            let [u, v] = mesh.wedge_uv[wedge].to_array().map(|x| (x + 0.0).to_bits());
            keys[wedge] = xxh3_64(bytemuck::cast_slice(&[u, v, catalogue.material_of(part).number().into()]));
        }
    }
    keys
}

impl CellTally {
    /// Counts borders that stay in the cell, and numbers those that reach a shared vertex.
    fn count_borders(&mut self, source: &ClusterSource, border: &mut DisjointSets, mut vertices: Vec<LocalVertex>) {
        vertices.sort_unstable();
        vertices.dedup();
        let mut number = vec![u32::MAX; source.mesh.positions.len()];
        for &vertex in vertices.iter().filter(|&&vertex| source.mesh.is_shared(vertex)) {
            let number = &mut number[border.root(vertex.number()) as usize];
            if *number == u32::MAX {
                *number = self.borders;
                self.borders += 1;
            }
            self.border_ends.push((source.vertex_id(vertex).number(), *number));
        }
        let closed = vertices.iter().filter(|v| border.is_root(v.number()) && number[v.index()] == u32::MAX);
        self.counts.topology.boundary_loops = closed.count() as u64;
    }

    /// Counts components that stay in the cell, and numbers those with a side between shared vertices, by root.
    fn count_pieces(&mut self, mesh: &ClusterMesh, sides: &[FaceSide], pieces: &mut DisjointSets) -> Vec<u32> {
        let mut number = vec![u32::MAX; mesh.corners.len()];
        for (vertices, _, face) in sides {
            let number = &mut number[pieces.root(face.number()) as usize];
            if *number == u32::MAX && vertices.iter().all(|&vertex| mesh.is_shared(vertex)) {
                *number = self.pieces;
                self.pieces += 1;
            }
        }
        let closed = (0..mesh.corners.len()).filter(|&face| pieces.is_root(face as u32) && number[face] == u32::MAX);
        self.counts.topology.components = closed.count() as u64;
        number
    }

    /// Counts charts that stay in the cell, and numbers those with a side between shared vertices, by root.
    fn count_charts(&mut self, mesh: &ClusterMesh, sides: &[FaceSide], charts: &mut DisjointSets) -> Vec<u32> {
        let mut sums = vec![Chart::default(); mesh.corners.len()];
        let mut textured = mesh.per_face(false);
        let finite = mesh.wedge_uv.iter().filter(|uv| uv.is_finite());
        let largest = finite.fold(0.0f64, |largest, uv| largest.max(uv.abs().max_element()));
        for face in mesh.face_ids() {
            let [a, b, c] = mesh.uv_triangle(face);
            if !(a.is_finite() && b.is_finite() && c.is_finite()) {
                continue;
            }
            textured[face] = true;
            let area = (b - a).perp_dot(c - a);
            let longest_sq = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
            if !is_flat(area.abs(), longest_sq, largest) {
                let chart = &mut sums[charts.root(face.number()) as usize];
                chart.area += area;
                chart.positive += u64::from(area > 0.0);
                chart.negative += u64::from(area < 0.0);
            }
        }
        let mut number = vec![u32::MAX; mesh.corners.len()];
        for (vertices, _, face) in sides.iter().filter(|side| textured[side.2]) {
            let root = charts.root(face.number()) as usize;
            if number[root] == u32::MAX && vertices.iter().all(|&vertex| mesh.is_shared(vertex)) {
                number[root] = self.charts.len() as u32;
                self.charts.push(sums[root]);
            }
        }
        let is_closed = |f: &FaceId| textured[*f] && charts.is_root(f.number()) && number[f.index()] == u32::MAX;
        mesh.face_ids().filter(is_closed).for_each(|face| self.counts.add_chart(&sums[face.index()]));
        number
    }
}

/// Result of [`Tallies::finish`].
#[derive(Debug)]
pub struct Tallied {
    /// Counts.
    pub topology: TopologyCounts,
    /// Shapes.
    pub quality: Quality,
    /// Triangles that run against the majority of their chart in texture space.
    pub folded: u64,
    /// Edges of the border; `None` if there are more than asked for.
    pub border: Option<Vec<[DVec3; 2]>>,
    /// Edges between faces that show different places of images.
    pub seams: SeamEdges,
}

/// Collects the cells' tallies.
pub struct Tallies<'a> {
    sides: BucketWriter<SharedSide>,
    buckets: u64,
    seams: SeamWriter,
    sum: MeshSum<'a>,
}

/// Sums over the cells, and the records that leave them.
struct MeshSum<'a> {
    shared: &'a Shared,
    counts: TallyCounts,
    pieces: u32,
    charts: Vec<Chart>,
    borders: u32,
    border_ends: Vec<(u32, u32)>,
    /// Edges at each shared vertex, by its rank.
    edges_at: Vec<u32>,
    border_edges: Option<Vec<[DVec3; 2]>>,
    border_limit: usize,
}

impl<'a> Tallies<'a> {
    /// Creates the files for a mesh of `faces` faces. More than `border_limit` edges of the border are counted but not
    /// kept.
    ///
    /// # Errors
    /// If the files cannot be created.
    pub fn create(folder: &Path, shared: &'a Shared, faces: u64, border_limit: usize) -> Result<Self> {
        // The number of buckets depends on the mesh alone, not on the budget: seams come in the order of buckets.
        let most_bytes = 3 * faces * size_of::<SharedSide>() as u64;
        let buckets = most_bytes.div_ceil(BUCKET_BYTES).clamp(1, BUCKETS_MAX);
        let sum = MeshSum {
            shared,
            counts: TallyCounts::default(),
            pieces: 0,
            charts: Vec::new(),
            borders: 0,
            border_ends: Vec::new(),
            edges_at: vec![0; shared.len() as usize],
            border_edges: Some(Vec::new()),
            border_limit,
        };
        let sides = BucketWriter::create(&folder.join("measure-sides.buckets"), buckets as usize)?;
        Ok(Self { sides, buckets, seams: SeamWriter::create(folder)?, sum })
    }

    /// Counts triangles that were dropped before.
    pub fn add_degenerate(&mut self, count: u64) {
        self.sum.counts.topology.degenerate_faces += count;
    }

    /// Adds a cell.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn push(&mut self, cell: CellTally) -> Result<()> {
        for mut side in cell.sides {
            side.piece += self.sum.pieces;
            if side.chart != NO_CHART {
                side.chart += self.sum.charts.len() as u32;
            }
            let [low, high] = side.vertices.map(u64::from);
            let mixed = (low << 32 | high).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            self.sides.push(((mixed >> 40) % self.buckets) as usize, side)?;
        }
        self.seams.push(&cell.seams)?;
        let sum = &mut self.sum;
        sum.counts.add(&cell.counts);
        sum.pieces += cell.pieces;
        sum.charts.extend(cell.charts);
        sum.border_ends.extend(cell.border_ends.into_iter().map(|(vertex, border)| (vertex, border + sum.borders)));
        sum.borders += cell.borders;
        cell.shared_vertices.into_iter().for_each(|(vertex, edges)| sum.meet(vertex, edges));
        sum.keep_border(&cell.border_edges);
        Ok(())
    }

    /// Matches what cells share and sums up; `positions` returns those of vertices by ascending ids of the partition.
    ///
    /// # Errors
    /// On failed reads and writes.
    pub fn finish(self, positions: impl Fn(&[u32]) -> Result<Vec<DVec3>>) -> Result<Tallied> {
        let Self { sides, buckets, mut seams, mut sum } = self;
        let sides = sides.finish()?;
        let mut pieces = DisjointSets::new(sum.pieces as usize);
        let mut charts = DisjointSets::new(sum.charts.len());
        let mut border: Vec<[u32; 2]> = Vec::new();
        for bucket in 0..buckets as usize {
            let mut records: Vec<SharedSide> = Vec::with_capacity(sides.len(bucket) as usize);
            sides.read(bucket, |read| {
                records.extend_from_slice(read);
                Ok(())
            })?;
            records.sort_unstable_by_key(|side| side.vertices);
            for edge in records.chunk_by(|a, b| a.vertices == b.vertices) {
                let first = &edge[0];
                let is_seam = edge.iter().any(|side| side.keys != first.keys);
                let is_border = edge.len() == 1;
                sum.counts.add_edge(edge.len(), is_seam);
                if let [a, b] = edge {
                    sum.counts.add_fold([a, b].map(|side| side.across.into()));
                }
                edge[1..].iter().for_each(|side| pieces.join(first.piece, side.piece));
                first.vertices.into_iter().for_each(|v| sum.meet(v, 1 | if is_border { ON_BORDER } else { 0 }));
                match edge {
                    [_] => border.push(first.vertices),
                    [a, b] if !is_seam && a.chart != NO_CHART && b.chart != NO_CHART => charts.join(a.chart, b.chart),
                    [a, b] if is_seam => {
                        let edge = SeamEdge::between(f64::from(a.length), [a.texture, b.texture]);
                        seams.push(edge.as_slice())?;
                    }
                    _ => {}
                }
            }
        }
        sum.count_open(&mut pieces, &mut charts, &border);
        sum.keep_shared_border(&border, positions)?;
        Ok(sum.tallied(seams.finish()?))
    }
}

impl MeshSum<'_> {
    fn meet(&mut self, vertex: u32, edges: u32) {
        let at = &mut self.edges_at[self.shared.rank(PartitionVertex::new(vertex)).index()];
        *at = ((*at & !ON_BORDER) + (edges & !ON_BORDER)) | ((*at | edges) & ON_BORDER);
    }

    fn keep_border(&mut self, edges: &[[DVec3; 2]]) {
        if let Some(kept) = &mut self.border_edges {
            kept.extend_from_slice(edges);
            if kept.len() > self.border_limit {
                self.border_edges = None;
            }
        }
    }

    /// Counts the components, charts, borders and vertices that several cells have.
    fn count_open(&mut self, pieces: &mut DisjointSets, charts: &mut DisjointSets, border: &[[u32; 2]]) {
        self.counts.topology.components += (0..self.pieces).filter(|&piece| pieces.is_root(piece)).count() as u64;
        for chart in 0..self.charts.len() as u32 {
            let root = charts.root(chart) as usize;
            if root != chart as usize {
                let Chart { area, positive, negative } = self.charts[chart as usize];
                let sum = &mut self.charts[root];
                sum.area += area;
                sum.positive += positive;
                sum.negative += negative;
            }
        }
        for chart in (0..self.charts.len()).filter(|&chart| charts.is_root(chart as u32)) {
            self.counts.add_chart(&self.charts[chart]);
        }
        let mut ends = std::mem::take(&mut self.border_ends);
        for (&vertices, number) in border.iter().zip(self.borders..) {
            ends.extend(vertices.map(|vertex| (vertex, number)));
        }
        ends.sort_unstable();
        let mut borders = DisjointSets::new(self.borders as usize + border.len());
        for same in ends.chunk_by(|a, b| a.0 == b.0) {
            same[1..].iter().for_each(|end| borders.join(same[0].1, end.1));
        }
        let all = self.borders + border.len() as u32;
        self.counts.topology.boundary_loops += (0..all).filter(|&number| borders.is_root(number)).count() as u64;
        for edges in std::mem::take(&mut self.edges_at) {
            if edges & !ON_BORDER > 0 {
                self.counts.add_vertex(edges);
            }
        }
    }

    fn keep_shared_border(
        &mut self,
        border: &[[u32; 2]],
        positions: impl Fn(&[u32]) -> Result<Vec<DVec3>>,
    ) -> Result<()> {
        if self.border_edges.as_ref().is_none_or(|kept| kept.len() + border.len() > self.border_limit) {
            self.border_edges = None;
            return Ok(());
        }
        let mut ids: Vec<u32> = border.iter().flatten().copied().collect();
        ids.sort_unstable();
        ids.dedup();
        let positions = positions(&ids)?;
        let at = |id: u32| positions[ids.partition_point(|&other| other < id)];
        let edges: Vec<[DVec3; 2]> = border.iter().map(|vertices| vertices.map(at)).collect();
        self.keep_border(&edges);
        Ok(())
    }

    fn tallied(self, seams: SeamEdges) -> Tallied {
        let counts = self.counts;
        let mut topology = counts.topology;
        topology.euler = topology.vertices as i64 - topology.edges as i64 + topology.faces as i64;
        let share = |part: f64, of: u64| if of == 0 { 0.0 } else { part / of as f64 };
        let quality = Quality {
            regularity_mean: share(counts.regularity_sum, topology.faces),
            sliver_share: share(counts.slivers as f64, topology.faces),
            valence_mean: share(2.0 * topology.edges as f64, topology.vertices),
            valence_max: counts.valence_max,
            valence_regular_share: share(counts.regular_vertices as f64, counts.inner_vertices),
        };
        Tallied { topology, quality, folded: counts.folded, border: self.border_edges, seams }
    }
}

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

use glam::DVec3;

use super::super::forest::DisjointSets;
use super::cell_tally::CellTally;
use super::seams::{SeamEdge, SeamEdges, SeamWriter};
use super::tally_counts::{BorderEnd, Chart, NO_CHART, ON_BORDER, SharedEdges, SharedSide, TallyCounts};
use crate::base::Result;
use crate::base::id::TiVec;
use crate::file::buckets::BucketWriter;
use crate::measure::figures::{Quality, TopologyCounts};
use crate::model::id::SharedVertex;
use crate::partition::Shared;
use crate::partition::id::PartitionVertex;

/// Bytes of a bucket of shared sides, if all sides are shared and [`BUCKETS_MAX`] allows as many buckets.
const BUCKET_BYTES: u64 = 8 << 20;
/// Maximum number of buckets of shared sides.
const BUCKETS_MAX: u64 = 256;
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
    border_ends: Vec<BorderEnd>,
    /// Edges at each shared vertex.
    edges_at: TiVec<SharedVertex, u32>,
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
            edges_at: vec![0; shared.len() as usize].into(),
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
            let [low, high] = side.vertices.map(|vertex| u64::from(vertex.number()));
            let mixed = (low << 32 | high).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            self.sides.push(((mixed >> 40) % self.buckets) as usize, side)?;
        }
        self.seams.push(&cell.seams)?;
        let sum = &mut self.sum;
        sum.counts.add(&cell.counts);
        sum.pieces += cell.pieces;
        sum.charts.extend(cell.charts);
        let numbered = |end: BorderEnd| BorderEnd { border: end.border + sum.borders, ..end };
        sum.border_ends.extend(cell.border_ends.into_iter().map(numbered));
        sum.borders += cell.borders;
        cell.shared_vertices.into_iter().for_each(|shared| sum.meet(shared));
        sum.keep_border(&cell.border_edges);
        Ok(())
    }

    /// Matches what cells share and sums up; `positions` returns those of vertices by ascending ids of the partition.
    ///
    /// # Errors
    /// On failed reads and writes.
    pub fn finish(self, positions: impl Fn(&[PartitionVertex]) -> Result<Vec<DVec3>>) -> Result<Tallied> {
        let Self { sides, buckets, mut seams, mut sum } = self;
        let sides = sides.finish()?;
        let mut pieces = DisjointSets::new(sum.pieces as usize);
        let mut charts = DisjointSets::new(sum.charts.len());
        let mut border: Vec<[PartitionVertex; 2]> = Vec::new();
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
                let edges = 1 | if is_border { ON_BORDER } else { 0 };
                first.vertices.into_iter().for_each(|vertex| sum.meet(SharedEdges { vertex, edges }));
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
    fn meet(&mut self, SharedEdges { vertex, edges }: SharedEdges) {
        let at = &mut self.edges_at[self.shared.rank(vertex)];
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
    fn count_open(&mut self, pieces: &mut DisjointSets, charts: &mut DisjointSets, border: &[[PartitionVertex; 2]]) {
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
        for (&vertices, border) in border.iter().zip(self.borders..) {
            ends.extend(vertices.map(|vertex| BorderEnd { vertex, border }));
        }
        ends.sort_unstable();
        let mut borders = DisjointSets::new(self.borders as usize + border.len());
        for same in ends.chunk_by(|a, b| a.vertex == b.vertex) {
            same[1..].iter().for_each(|end| borders.join(same[0].border, end.border));
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
        border: &[[PartitionVertex; 2]],
        positions: impl Fn(&[PartitionVertex]) -> Result<Vec<DVec3>>,
    ) -> Result<()> {
        if self.border_edges.as_ref().is_none_or(|kept| kept.len() + border.len() > self.border_limit) {
            self.border_edges = None;
            return Ok(());
        }
        let mut ids: Vec<PartitionVertex> = border.iter().flatten().copied().collect();
        ids.sort_unstable();
        ids.dedup();
        let positions = positions(&ids)?;
        let at = |id: PartitionVertex| positions[ids.partition_point(|&other| other < id)];
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

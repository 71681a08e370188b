//! Counts a mesh cluster by cluster: sums up what each has alone, and matches what they share.
//!
//! ```text
//! cluster ──count_cluster──▶ counts ───────────────────────────────────────────────▶ sum
//!                       └──▶ sides between shared vertices ──▶ buckets ──▶ edges ──┘ │
//!                            join the components, charts and borders that reach them ┘
//! ```
//! In: counted clusters. Out: [`MeshCounts`], the edges of the border and of seams. Invariant: the numbers are those of
//! the whole mesh counted as one [cell](super::cell), and the edges come in the same order at any memory budget.
//!
//! # Memory
//! 100 bytes a face of a cluster; 20 bytes a shared vertex; 40 bytes for each component and chart that leaves its
//! cluster, 4 for each border and each shared edge of one face; one bucket of shared sides at a time, of which no more
//! than three of an edge stay.
//!
//! # Files
//! `topology-sides.buckets` (88 bytes for each side of a face between shared vertices), removed at the end.

use std::path::Path;

use glam::DVec3;

use super::atlas::Chart;
use super::cluster::{BorderEnd, ClusterCounts, SharedSide};
use super::counts::{AtVertex, Joint, MeshCounts};
use super::id::{OpenBorder, OpenChart, OpenComponent};
use super::seam_edge::SeamEdge;
use crate::base::Result;
use crate::base::id::TiVec;
use crate::file::buckets::BucketWriter;
use crate::mesh::forest::DisjointSets;
use crate::model::id::SharedVertex;
use crate::partition::Shared;
use crate::partition::id::PartitionVertex;

/// Bytes of a bucket of shared sides, if all sides are shared and [`BUCKETS_MAX`] allows as many buckets.
const BUCKET_BYTES: u64 = 8 << 20;
/// Maximum number of buckets of shared sides.
const BUCKETS_MAX: u64 = 256;
/// Sides of an edge that matter: an edge of three faces or more is not manifold, however many it has.
const SIDES_KEPT: usize = 3;
/// Sides of a bucket from which those of an edge beyond [`SIDES_KEPT`] are dropped.
const CROWD_SIDES: usize = 2 * BUCKET_BYTES as usize / size_of::<SharedSide>();

/// Result of [`Counter::finish`].
#[derive(Debug)]
pub struct Topology {
    /// Counts.
    pub counts: MeshCounts,
    /// Edges of the border; `None` if there are more than asked for.
    pub border: Option<Vec<[DVec3; 2]>>,
}

/// Collects the counts of clusters.
pub struct Counter<'a, W> {
    sides: BucketWriter<SharedSide>,
    buckets: u64,
    on_seam: W,
    sum: MeshSum<'a>,
}

/// Sums over the clusters, and the records that leave them.
struct MeshSum<'a> {
    shared: &'a Shared,
    counts: MeshCounts,
    components: usize,
    charts: TiVec<OpenChart, Chart>,
    /// Borders that leave their cluster, those of one vertex in one set.
    borders: DisjointSets<OpenBorder>,
    /// The first border of each shared vertex, or none.
    border_of: TiVec<SharedVertex, OpenBorder>,
    vertices: TiVec<SharedVertex, AtVertex>,
    border_edges: Option<Vec<[DVec3; 2]>>,
    border_limit: usize,
}

impl<'a, W: FnMut(&[SeamEdge]) -> Result<()>> Counter<'a, W> {
    /// Creates the files for a mesh of `faces` faces. More than `border_limit` edges of the border are counted but not
    /// kept; `on_seam` hears of the edges between faces that show different places of images.
    ///
    /// # Errors
    /// If the files cannot be created.
    pub fn create(folder: &Path, shared: &'a Shared, faces: u64, border_limit: usize, on_seam: W) -> Result<Self> {
        // The number of buckets depends on the mesh alone, not on the budget: seams come in the order of buckets.
        let most_bytes = 3 * faces * size_of::<SharedSide>() as u64;
        let buckets = most_bytes.div_ceil(BUCKET_BYTES).clamp(1, BUCKETS_MAX);
        let sum = MeshSum {
            shared,
            counts: MeshCounts::default(),
            components: 0,
            charts: TiVec::new(),
            borders: DisjointSets::new(0),
            border_of: vec![OpenBorder::NONE; shared.len() as usize].into(),
            vertices: vec![AtVertex::default(); shared.len() as usize].into(),
            border_edges: Some(Vec::new()),
            border_limit,
        };
        let sides = BucketWriter::create(&folder.join("topology-sides.buckets"), buckets as usize)?;
        Ok(Self { sides, buckets, on_seam, sum })
    }

    /// Counts triangles that were dropped before.
    pub fn add_degenerate(&mut self, count: u64) {
        self.sum.counts.topology.degenerate_faces += count;
    }

    /// Adds a cluster.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn push(&mut self, cluster: ClusterCounts) -> Result<()> {
        let sum = &mut self.sum;
        for mut side in cluster.sides {
            side.component = side.component.plus(sum.components as u32);
            side.chart = side.chart.some().map_or(OpenChart::NONE, |chart| chart.plus(sum.charts.len() as u32));
            let [low, high] = side.vertices.map(|vertex| u64::from(vertex.number()));
            let mixed = (low << 32 | high).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            self.sides.push(((mixed >> 40) % self.buckets) as usize, side)?;
        }
        (self.on_seam)(&cluster.seams)?;
        sum.counts.add(&cluster.counts);
        sum.components += cluster.components;
        sum.charts.extend(cluster.charts);
        let own: Vec<OpenBorder> = (0..cluster.borders).map(|_| sum.borders.add()).collect();
        for BorderEnd { vertex, border } in cluster.border_ends {
            sum.meet_border(vertex, own[border.index()]);
        }
        cluster.shared_vertices.iter().for_each(|(vertex, at)| sum.vertices[sum.shared.rank(*vertex)].add(at));
        sum.keep_border(&cluster.border_edges);
        Ok(())
    }

    /// Matches what clusters share and sums up; `positions` returns those of vertices by ascending ids of the
    /// partition.
    ///
    /// # Errors
    /// On failed reads and writes.
    pub fn finish(self, positions: impl Fn(&[PartitionVertex]) -> Result<Vec<DVec3>>) -> Result<Topology> {
        let Self { sides, buckets, mut on_seam, mut sum } = self;
        let sides = sides.finish()?;
        let mut matching = Matching {
            components: DisjointSets::new(sum.components),
            charts: DisjointSets::new(sum.charts.len()),
            border: Some(Vec::new()),
        };
        for bucket in 0..buckets as usize {
            let mut records: Vec<SharedSide> = Vec::with_capacity((sides.len(bucket) as usize).min(CROWD_SIDES));
            let mut crowd = CROWD_SIDES;
            sides.read(bucket, |read| {
                records.extend_from_slice(read);
                if records.len() > crowd {
                    matching.thin_out(&mut records);
                    crowd = CROWD_SIDES.max(2 * records.len());
                }
                Ok(())
            })?;
            records.sort_unstable_by_key(|side| side.vertices);
            for edge in records.chunk_by(|a, b| a.vertices == b.vertices) {
                on_seam(matching.add_edge(edge, &mut sum).as_slice())?;
            }
        }
        sum.count_open(&mut matching);
        sum.keep_shared_border(matching.border.as_deref(), positions)?;
        Ok(Topology { counts: sum.counts.finished(), border: sum.border_edges })
    }
}

/// What is joined by the sides of shared edges.
struct Matching {
    components: DisjointSets<OpenComponent>,
    charts: DisjointSets<OpenChart>,
    /// Shared edges of one face; `None` if there are more than asked for.
    border: Option<Vec<[PartitionVertex; 2]>>,
}

impl Matching {
    /// Counts the edge of some sides; returns it if it is on a seam.
    /// Drops the sides of each edge beyond [`SIDES_KEPT`], and joins what they join.
    fn thin_out(&mut self, sides: &mut Vec<SharedSide>) {
        sides.sort_by_key(|side| side.vertices);
        let mut end = 0;
        for at in 0..sides.len() {
            let side = sides[at];
            let is_beyond = end >= SIDES_KEPT && sides[end - SIDES_KEPT].vertices == side.vertices;
            if is_beyond {
                self.components.join(sides[end - 1].component, side.component);
            } else {
                sides[end] = side;
                end += 1;
            }
        }
        sides.truncate(end);
    }

    fn add_edge(&mut self, edge: &[SharedSide], sum: &mut MeshSum<'_>) -> Option<SeamEdge> {
        let first = &edge[0];
        let joint = sum.counts.add_edge(edge.len(), |at| edge[at].side());
        edge[1..].iter().for_each(|side| self.components.join(first.component, side.component));
        for vertex in first.vertices {
            sum.vertices[sum.shared.rank(vertex)].add_edge(edge.len() == 1);
        }
        if edge.len() == 1 {
            let border = sum.borders.add();
            first.vertices.into_iter().for_each(|vertex| sum.meet_border(vertex, border));
            self.border = self.border.take().filter(|kept| kept.len() < sum.border_limit);
            self.border.iter_mut().for_each(|kept| kept.push(first.vertices));
        }
        if joint == Joint::Chart {
            self.charts.join(first.chart, edge[1].chart);
        }
        let seam = || SeamEdge::between(f64::from(first.length), [first.texture, edge[1].texture]);
        (joint == Joint::Seam).then(seam).flatten()
    }
}

impl MeshSum<'_> {
    fn keep_border(&mut self, edges: &[[DVec3; 2]]) {
        if let Some(kept) = &mut self.border_edges {
            kept.extend_from_slice(edges);
            if kept.len() > self.border_limit {
                self.border_edges = None;
            }
        }
    }

    /// Joins a border with the others that meet it at a shared vertex.
    fn meet_border(&mut self, vertex: PartitionVertex, border: OpenBorder) {
        let first = &mut self.border_of[self.shared.rank(vertex)];
        match first.some() {
            Some(other) => self.borders.join(other, border),
            None => *first = border,
        }
    }

    /// Counts the components, charts, borders and vertices that several clusters have.
    fn count_open(&mut self, Matching { components, charts, .. }: &mut Matching) {
        self.counts.topology.components += components.roots().count() as u64;
        let mut whole = self.charts.clone();
        for (chart, part) in self.charts.iter_enumerated() {
            let root = charts.root(chart);
            if root != chart {
                whole[root].add(part);
            }
        }
        charts.roots().for_each(|chart| self.counts.add_chart(&whole[chart]));

        self.counts.topology.boundary_loops += self.borders.roots().count() as u64;
        self.vertices.iter().for_each(|at| self.counts.add_vertex(at));
    }

    fn keep_shared_border(
        &mut self,
        border: Option<&[[PartitionVertex; 2]]>,
        positions: impl Fn(&[PartitionVertex]) -> Result<Vec<DVec3>>,
    ) -> Result<()> {
        let kept = self.border_edges.as_ref().map_or(0, Vec::len);
        let Some(border) = border.filter(|border| kept + border.len() <= self.border_limit) else {
            self.border_edges = None;
            return Ok(());
        };
        let mut ids: Vec<PartitionVertex> = border.iter().flatten().copied().collect();
        ids.sort_unstable();
        ids.dedup();
        let positions = positions(&ids)?;
        let at = |id: PartitionVertex| positions[ids.partition_point(|&other| other < id)];
        let edges: Vec<[DVec3; 2]> = border.iter().map(|vertices| vertices.map(at)).collect();
        self.keep_border(&edges);
        Ok(())
    }
}

//! What is counted of a cell and of the whole mesh, and the records that leave a cell to be matched.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::seams::EdgeTexture;
use crate::file::buckets::Verbatim;
use crate::measure::figures::TopologyCounts;
use crate::mesh::fold::is_angle_small;
use crate::partition::id::PartitionVertex;

/// Marks a face without texture.
pub(super) const NO_CHART: u32 = u32::MAX;
/// Bit in a shared vertex's edge count that marks it as lying on a border.
pub(super) const ON_BORDER: u32 = 1 << 31;

/// Counts.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TallyCounts {
    pub(super) topology: TopologyCounts,
    pub(super) folded: u64,
    pub(super) regularity_sum: f64,
    pub(super) slivers: u64,
    pub(super) valence_max: u64,
    pub(super) inner_vertices: u64,
    pub(super) regular_vertices: u64,
}

impl TallyCounts {
    pub(super) fn add(&mut self, other: &Self) {
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

    pub(super) fn add_vertex(&mut self, edges: u32) {
        let (valence, on_border) = (edges & !ON_BORDER, edges & ON_BORDER != 0);
        self.topology.vertices += 1;
        self.valence_max = self.valence_max.max(u64::from(valence));
        if !on_border {
            self.inner_vertices += 1;
            self.regular_vertices += u64::from((5..=7).contains(&valence));
        }
    }

    pub(super) fn add_edge(&mut self, faces: usize, is_seam: bool) {
        self.topology.edges += 1;
        self.topology.boundary_edges += u64::from(faces == 1);
        self.topology.non_manifold_edges += u64::from(faces > 2);
        self.topology.seam_edges += u64::from(faces == 2 && is_seam);
    }

    /// Counts an edge as folded if its two faces, which lead away from it in these directions, are folded.
    pub(super) fn add_fold(&mut self, across: [DVec3; 2]) {
        self.topology.folded_edges += u64::from(is_angle_small(across));
    }

    pub(super) fn add_chart(&mut self, chart: &Chart) {
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
pub(super) struct Chart {
    /// Sum of their areas in texture space, negative for faces that are turned over.
    pub(super) area: f64,
    pub(super) positive: u64,
    pub(super) negative: u64,
}

/// A side of a face between two shared vertices.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub(super) struct SharedSide {
    /// The lower one first.
    pub(super) vertices: [PartitionVertex; 2],
    /// Key of texture coordinate and material at each of them.
    pub(super) keys: [u64; 2],
    /// Direction in which the face leads away from it.
    pub(super) across: [f64; 3],
    pub(super) piece: u32,
    /// Chart of the face, or [`NO_CHART`].
    pub(super) chart: u32,
    pub(super) texture: EdgeTexture,
    pub(super) length: f32,
}

impl Verbatim for SharedSide {}

impl SharedSide {
    /// The same with the lower id first.
    pub(super) fn lower_first(self) -> Self {
        let ([a, b], [key_a, key_b]) = (self.vertices, self.keys);
        match a < b {
            true => self,
            false => Self { vertices: [b, a], keys: [key_b, key_a], texture: self.texture.reversed(), ..self },
        }
    }
}

/// A border that leaves its cell, at a shared vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct BorderEnd {
    /// The vertex.
    pub(super) vertex: PartitionVertex,
    /// Number of the border.
    pub(super) border: u32,
}

/// Edges of a cell at a shared vertex, whose other ends are its own.
#[derive(Debug, Clone, Copy)]
pub(super) struct SharedEdges {
    /// The vertex.
    pub(super) vertex: PartitionVertex,
    /// Their number, and [`ON_BORDER`].
    pub(super) edges: u32,
}

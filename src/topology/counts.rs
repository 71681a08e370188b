//! What is counted of a cell and of a mesh.

use glam::DVec3;
use serde::Serialize;

use super::atlas::{Chart, UvCounts};
use crate::mesh::fold::is_angle_small;

/// A triangle is a sliver if its regularity is below this (definition of Li, Jiang and Tang 2020): an isosceles one
/// lower than about a quarter of its base.
pub const SLIVER_REGULARITY: f64 = 0.5;

/// Counts after welding vertices at bit-identical positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct TopologyCounts {
    /// Vertices that faces use.
    pub vertices: u64,
    /// Of these, vertices at which faces show several texture coordinates or materials.
    pub seam_vertices: u64,
    /// Edges.
    pub edges: u64,
    /// Triangles, without those that repeat a vertex.
    pub faces: u64,
    /// Edges of one face.
    pub boundary_edges: u64,
    /// Sets of boundary edges connected through vertices: borders that touch at a vertex count as one.
    pub boundary_loops: u64,
    /// Edges of three or more faces.
    pub non_manifold_edges: u64,
    /// Edges of two faces that run along it in the same direction.
    pub inconsistent_edges: u64,
    /// Edges of two faces that are folded onto each other, back to back.
    pub folded_edges: u64,
    /// Connected components: sets of faces connected over edges. Faces that share only a vertex are not connected.
    pub components: u64,
    /// Vertices - edges + faces.
    pub euler: i64,
    /// Edges of two faces whose texture coordinates (by value) or materials differ there.
    pub seam_edges: u64,
    /// Sets of textured faces connected over edges that are no seams. An edge connects only if its two faces run along
    /// it in opposite directions: otherwise one of them shows its back, and their signs cannot be compared.
    pub charts: u64,
    /// Faces that repeat a vertex.
    pub degenerate_faces: u64,
}

/// A face at an edge.
#[derive(Debug, Clone, Copy)]
pub struct EdgeSide {
    /// What the face shows at the edge's lower and upper vertex; see [`shown_key`](super::cell::shown_key).
    pub shown: [u64; 2],
    /// Whether the face has texture coordinates.
    pub is_textured: bool,
    /// Whether the face runs along the edge from the lower to the upper vertex.
    pub runs_up: bool,
    /// Direction in which the face leads away from the edge; see [`across`](crate::mesh::fold::across).
    pub across: DVec3,
}

/// What an edge is to the texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Joint {
    /// Two faces that show different places of the texture, or different materials.
    Seam,
    /// Two faces of one chart.
    Chart,
    /// Neither.
    Apart,
}

/// What is known of a vertex; that of all cells together is met from theirs.
#[derive(Debug, Clone, Copy, Default)]
pub struct AtVertex {
    /// What the first face shows there, or 0 without any face.
    shown: u64,
    edges: u32,
    is_on_border: bool,
    is_on_seam: bool,
}

impl AtVertex {
    /// Adds an edge.
    pub fn add_edge(&mut self, is_border: bool) {
        self.edges += 1;
        self.is_on_border |= is_border;
    }

    /// Adds what a face shows there.
    pub fn add_shown(&mut self, shown: u64) {
        match self.shown {
            0 => self.shown = shown,
            first => self.is_on_seam |= shown != 0 && shown != first,
        }
    }

    /// Adds what is known from another cell.
    pub fn add(&mut self, other: &Self) {
        self.edges += other.edges;
        self.is_on_border |= other.is_on_border;
        self.is_on_seam |= other.is_on_seam;
        self.add_shown(other.shown);
    }

    /// Whether a face uses the vertex.
    pub fn is_used(&self) -> bool {
        self.shown != 0
    }
}

/// Counts of a cell or of a mesh.
#[derive(Debug, Clone, Copy, Default)]
pub struct MeshCounts {
    /// Topology; Euler's characteristic is calculated at the end.
    pub topology: TopologyCounts,
    /// Triangles in texture space.
    pub uv: UvCounts,
    /// Sum of the triangles' regularities.
    pub regularity_sum: f64,
    /// Triangles below [`SLIVER_REGULARITY`].
    pub slivers: u64,
    /// Most edges at a vertex.
    pub valence_max: u64,
    /// Vertices on no border.
    pub inner_vertices: u64,
    /// Of these, vertices of 5, 6 or 7 edges.
    pub regular_vertices: u64,
}

impl MeshCounts {
    /// Adds the counts of another part of the mesh.
    pub fn add(&mut self, other: &Self) {
        let (t, o) = (&mut self.topology, &other.topology);
        t.vertices += o.vertices;
        t.seam_vertices += o.seam_vertices;
        t.edges += o.edges;
        t.faces += o.faces;
        t.boundary_edges += o.boundary_edges;
        t.boundary_loops += o.boundary_loops;
        t.non_manifold_edges += o.non_manifold_edges;
        t.inconsistent_edges += o.inconsistent_edges;
        t.folded_edges += o.folded_edges;
        t.components += o.components;
        t.seam_edges += o.seam_edges;
        t.charts += o.charts;
        t.degenerate_faces += o.degenerate_faces;
        self.uv.add(&other.uv);
        self.regularity_sum += other.regularity_sum;
        self.slivers += other.slivers;
        self.valence_max = self.valence_max.max(other.valence_max);
        self.inner_vertices += other.inner_vertices;
        self.regular_vertices += other.regular_vertices;
    }

    /// Adds a vertex, unless no face uses it.
    pub fn add_vertex(&mut self, at: &AtVertex) {
        if !at.is_used() {
            return;
        }
        self.topology.vertices += 1;
        self.topology.seam_vertices += u64::from(at.is_on_seam);
        self.valence_max = self.valence_max.max(u64::from(at.edges));
        if !at.is_on_border {
            self.inner_vertices += 1;
            self.regular_vertices += u64::from((5..=7).contains(&at.edges));
        }
    }

    /// Adds a chart.
    pub(super) fn add_chart(&mut self, chart: &Chart) {
        self.topology.charts += 1;
        self.uv.add_chart(chart);
    }

    /// Adds a triangle of a [regularity](crate::geometry::triangle::regularity).
    pub fn add_face(&mut self, regularity: f64) {
        // The regularity is NaN if the sides are too long to be squared.
        let regularity = regularity.max(0.0);
        self.topology.faces += 1;
        self.regularity_sum += regularity;
        self.slivers += u64::from(regularity < SLIVER_REGULARITY);
    }

    /// Adds an edge of `faces` faces; `side` returns what is asked of the first two.
    pub fn add_edge(&mut self, faces: usize, side: impl Fn(usize) -> EdgeSide) -> Joint {
        let topology = &mut self.topology;
        topology.edges += 1;
        topology.boundary_edges += u64::from(faces == 1);
        topology.non_manifold_edges += u64::from(faces > 2);
        if faces != 2 {
            return Joint::Apart;
        }
        let (a, b) = (side(0), side(1));
        let is_inconsistent = a.runs_up == b.runs_up;
        let is_seam = a.shown != b.shown;
        topology.inconsistent_edges += u64::from(is_inconsistent);
        topology.folded_edges += u64::from(is_angle_small([a.across, b.across]));
        topology.seam_edges += u64::from(is_seam);
        if is_seam {
            Joint::Seam
        } else if a.is_textured && b.is_textured && !is_inconsistent {
            Joint::Chart
        } else {
            Joint::Apart
        }
    }

    /// The counts of a mesh, of whose cells these are the sums.
    pub fn finished(mut self) -> Self {
        let topology = &mut self.topology;
        topology.euler = topology.vertices as i64 - topology.edges as i64 + topology.faces as i64;
        self
    }
}

//! The faces around the two ends of an edge: which vanish with it, and which wedge becomes which.
//!
//! Scratch space is kept between edges; `legality` and `legality/edges` check it.

use super::fold::FoldCheck;
use super::shape_rule::ShapeRule;
use crate::base::id::TiVec;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::{Corner, FaceId, LocalVertex, Wedge, WedgePair};
use crate::mesh::ring::{Rings, VALENCE_MAX};

/// Properties of the faces around a vertex that is to vanish.
#[derive(Debug, Clone, Copy, Default)]
pub struct VanishingFan {
    /// They form one closed fan, in which the vertex has one wedge.
    pub closed: bool,
    /// Wedges of the vertex may be left without a counterpart at the other end.
    pub strands: bool,
    /// The vertex is non-manifold.
    pub is_complex: bool,
    /// The vertex belongs to an isolated face, which may vanish.
    pub is_alone: bool,
    /// The topology may change.
    pub is_free: bool,
    /// The vertex has no edge with the one that it collapses onto.
    pub is_rip: bool,
    /// Number of edges that may get more than two faces: surfaces meet there.
    pub spare_edges: i64,
}

/// Effects of a collapse on the faces around its edge; buffers are reused.
#[derive(Debug, Default)]
pub struct EdgeStar {
    /// What the changed faces must not do.
    pub shape_rule: ShapeRule,
    /// Faces that vanish.
    pub dying: Vec<FaceId>,
    /// Wedges of the vanishing vertex, and the wedges of the staying one that they become.
    pub wedges: Vec<WedgePair>,
    /// Wedges of the vanishing vertex, in living faces, that no face at the edge has.
    pub stranded: Vec<Wedge>,
    /// Vertices whose classes may change, where the topology changes.
    pub unsettled: Vec<LocalVertex>,
    /// Increase in the number of edges of more than two faces, where the topology changes.
    pub new_non_manifold_edges: i64,
    /// Whether faces become neighbours that no dying face lies between.
    pub(super) joins: bool,
    /// A wedge of the staying vertex, if the ends have no face in common.
    pub(super) beside: Option<Wedge>,
    /// Neighbours of the ends, where the topology changes.
    pub(super) neighbours: Vec<Neighbour>,
    /// Sides of dying double faces that touch neither end.
    pub(super) far_sides: Vec<[LocalVertex; 2]>,
    /// Buffer for the corners at the vanishing end of faces that have the edge, dead ones included.
    pub(super) at_edge: Vec<Corner>,
    /// Both ends of the edge.
    pub(super) ends: [LocalVertex; 2],
    pub(super) opposite: Vec<LocalVertex>,
    pub(super) mark: TiVec<LocalVertex, u32>,
    pub(super) epoch: u32,
    pub(super) folds: FoldCheck,
}

/// A neighbour of the ends, and the number of faces that join it to them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Neighbour {
    pub(super) vertex: LocalVertex,
    /// Faces with the vanishing end, and faces with the staying end.
    pub(super) before: [u32; 2],
    /// Faces with the staying end after the collapse.
    pub(super) after: u32,
    /// How many of these have it directly after the staying end.
    pub(super) after_ahead: u32,
    /// How many of these are turned over during processing.
    pub(super) after_turned: u32,
}

impl EdgeStar {
    /// Prepares for a mesh with `vertex_count` vertices; call before its first edge.
    pub fn reset(&mut self, vertex_count: usize) {
        self.mark.clear();
        self.mark.resize(vertex_count, 0);
        self.epoch = 0;
    }

    /// Collects the faces at the edge and the pairs of wedges.
    pub fn gather(&mut self, mesh: &ClusterMesh, rings: &Rings, from: LocalVertex, to: LocalVertex) {
        self.dying.clear();
        self.wedges.clear();
        self.opposite.clear();
        self.stranded.clear();
        self.unsettled.clear();
        self.new_non_manifold_edges = 0;
        self.joins = false;
        self.ends = [from, to];
        let ring = rings.of(from);
        self.at_edge.resize(ring.len().max(self.at_edge.len()), Corner::new(0));
        let mut count = 0;
        for &corner in ring {
            // No branch: which faces have the edge cannot be predicted.
            let [next, previous] = mesh.others_of(corner);
            self.at_edge[count] = corner;
            count += usize::from((next == to) | (previous == to));
        }
        for &corner in &self.at_edge[..count] {
            let Some(wedge) = mesh.living(corner) else { continue };
            let far = corner.others();
            let Some(k) = far.iter().position(|&c| mesh.vertex_of(c) == to) else { continue };
            let pair = WedgePair { from: wedge, to: mesh.wedge_of(far[k]) };
            self.dying.push(corner.face());
            self.opposite.push(mesh.vertex_of(far[1 - k]));
            if !self.wedges.contains(&pair) {
                self.wedges.push(pair);
            }
        }
        if self.dying.is_empty() {
            self.pair_alike(mesh, rings, from, to);
        }
    }

    /// Pairs the wedges of two vertices with equal texture coordinates, or with none.
    fn pair_alike(&mut self, mesh: &ClusterMesh, rings: &Rings, from: LocalVertex, to: LocalVertex) {
        let wedges_of = |vertex: LocalVertex| rings.of(vertex).iter().filter_map(|&corner| mesh.living(corner));
        let uv = |wedge: Wedge| mesh.wedge_uv[wedge];
        for wedge in wedges_of(from) {
            let is_alike = |&other: &Wedge| uv(other) == uv(wedge) || (uv(other).is_nan() && uv(wedge).is_nan());
            if let Some(other) = wedges_of(to).find(is_alike)
                && let pair = (WedgePair { from: wedge, to: other })
                && !self.wedges.contains(&pair)
            {
                self.wedges.push(pair);
            }
        }
        self.beside = wedges_of(to).next();
    }
}

/// Whether a vertex has too many faces for another to collapse onto it. Stops counting at the limit, because hubs are
/// checked often.
pub(super) fn is_hub(mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex) -> bool {
    rings.of(vertex).len() > 2 * VALENCE_MAX && rings.faces(mesh, vertex).nth(2 * VALENCE_MAX).is_some()
}

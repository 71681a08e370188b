//! The edges at a vertex, and the cheapest of its collapses.
//!
//! ```text
//!        x
//!       /|\      a vertex inside a chart has one wedge and a closed fan: each face gives the edge that leads on
//!      a-v-b     from it; at seams and borders, edges are gathered with the wedges on both sides
//!       \|/
//!        y
//! ```

use crate::cost::surface::EdgeKind;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::ring::Rings;

/// The cheapest collapse of a vertex.
#[derive(Debug, Clone, Copy)]
pub struct Proposal {
    /// Area × length².
    pub cost: f32,
    /// The vertex that stays.
    pub to: u32,
    /// Whether it keeps its texture coordinates.
    pub onto: bool,
    /// Whether the edge lies on a seam or border that both ends keep to.
    pub chain: bool,
    /// Dearer than one that was refused since anything around the vertex changed.
    pub second_best: bool,
}

impl Proposal {
    /// None.
    pub const NONE: Self = Self { cost: f32::INFINITY, to: u32::MAX, onto: false, chain: false, second_best: false };

    /// Order of the collapses of one vertex.
    pub fn key(&self) -> (u32, u32) {
        (self.cost.to_bits(), self.to)
    }
}

/// An edge at a vertex, with the wedges of its faces (of the vertex, of the other end).
#[derive(Debug, Clone, Copy)]
pub struct EdgeAt {
    /// The other end.
    pub other: u32,
    /// Of the vertex and of the other end, in two of the faces; the same twice if there is one.
    pub wedges: [(u32, u32); 2],
    /// Faces with the edge.
    pub face_count: u32,
}

impl EdgeAt {
    /// The edge from a corner to the next one of its face, inside a chart; nothing if the face is dead.
    #[inline(always)]
    pub fn ahead(mesh: &ClusterMesh, corner: u32) -> Option<Self> {
        let own = mesh.living(corner)?;
        let next = ClusterMesh::following(corner)[0];
        Some(Self { other: mesh.vertex_of(next), wedges: [(own, mesh.wedge_of(next)); 2], face_count: 2 })
    }

    pub fn kind(&self) -> EdgeKind {
        match self.face_count {
            1 => EdgeKind::Border,
            _ if self.wedges[0] == self.wedges[1] => EdgeKind::Inner,
            _ => EdgeKind::Seam,
        }
    }
}

/// The edges at a vertex, with the wedges at both ends in up to two faces.
pub fn edges_at(mesh: &ClusterMesh, rings: &Rings, vertex: u32, edges: &mut Vec<EdgeAt>) {
    edges.clear();
    for &corner in rings.of(vertex) {
        let Some(own) = mesh.living(corner) else { continue };
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

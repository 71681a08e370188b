//! The edges at a vertex, and the cheapest of its collapses.
//!
//! ```text
//!        x
//!       /|\      a vertex inside a chart has one wedge and a closed fan: each face gives the edge that leads on
//!      a-v-b     from it; others collapse along seams and borders, whose wedges are gathered on both sides
//!       \|/
//!        y
//! ```

use crate::mesh::cluster::ClusterMesh;
use crate::mesh::edge::EdgeKind;
use crate::mesh::ring::{Rings, Spoke};

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

    /// Onto a neighbour inside a chart.
    ///
    /// NOTE: bits of a cost that is not a number are above those of infinity, so that it is never taken.
    #[inline(always)]
    pub fn onto(to: u32, cost: f32) -> Self {
        Self { cost, to, onto: true, chain: false, second_best: false }
    }

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

    /// The edge to another vertex, among the faces around one.
    #[inline(always)]
    fn among(spokes: &[Spoke], other: u32) -> Self {
        let mut edge = Self { other, wedges: [(0, 0); 2], face_count: 0 };
        for wedges in spokes.iter().filter_map(|spoke| spoke.edge_to(other)) {
            // Of more than two faces, one whose wedges are others is the second.
            if edge.face_count < 2 || edge.wedges[0] == edge.wedges[1] {
                edge.wedges[usize::from(edge.face_count > 0)] = wedges;
            }
            edge.face_count += 1;
        }
        if edge.face_count == 1 {
            edge.wedges[1] = edge.wedges[0];
        }
        edge
    }

    /// How the faces with the edge are joined.
    #[inline(always)]
    pub fn kind(&self) -> EdgeKind {
        match self.face_count {
            1 => EdgeKind::Border,
            _ if self.wedges[0] == self.wedges[1] => EdgeKind::Inner,
            _ => EdgeKind::Seam,
        }
    }
}

/// Hands the seam and border edges at a vertex to `take`, with the wedges at both ends in up to two faces; `spokes` is
/// scratch space. An edge whose faces are turned against each other may come twice.
#[inline(always)]
pub fn chain_edges_at(
    mesh: &ClusterMesh,
    rings: &Rings,
    vertex: u32,
    is_on_border: bool,
    spokes: &mut Vec<Spoke>,
    mut take: impl FnMut(&EdgeAt),
) {
    gather_spokes(mesh, rings, vertex, spokes);
    for spoke in &*spokes {
        // All are looked at: where the other face of the edge stands, no branch could foresee.
        let differs = |other: &Spoke| (other.wedge ^ spoke.wedge) | (other.previous_wedge ^ spoke.next_wedge);
        if spokes.iter().fold(true, |is_chain, other| is_chain & (differs(other) != 0)) {
            take(&EdgeAt::among(spokes, spoke.next));
        }
        if is_on_border && spokes.iter().all(|other| other.next != spoke.previous) {
            take(&EdgeAt::among(spokes, spoke.previous));
        }
    }
}

/// The living faces around a vertex.
#[inline(always)]
fn gather_spokes(mesh: &ClusterMesh, rings: &Rings, vertex: u32, spokes: &mut Vec<Spoke>) {
    let corners = rings.of(vertex).iter().filter(|&&corner| mesh.living(corner).is_some());
    spokes.clear();
    spokes.extend(corners.map(|&corner| Spoke::of(mesh, corner)));
}

/// Hands every edge at a vertex to `take`, once, with the wedges at both ends in up to two faces; `spokes` is scratch
/// space.
pub fn all_edges_at(
    mesh: &ClusterMesh,
    rings: &Rings,
    vertex: u32,
    spokes: &mut Vec<Spoke>,
    mut take: impl FnMut(&EdgeAt),
) {
    gather_spokes(mesh, rings, vertex, spokes);
    for (i, spoke) in spokes.iter().enumerate() {
        let is_new = |end: u32| spokes[..i].iter().all(|before| before.edge_to(end).is_none());
        for end in [spoke.next, spoke.previous].into_iter().filter(|&end| is_new(end)) {
            take(&EdgeAt::among(spokes, end));
        }
    }
}

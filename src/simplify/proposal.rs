//! The edges at a vertex, and its cheapest collapse.
//!
//! ```text
//!        x
//!       /|\      a vertex inside a chart has one wedge and a closed fan: each face gives the edge to the next vertex;
//!      a-v-b     other vertices collapse along seams and borders, with the wedges on both sides of them
//!       \|/
//!        y
//! ```

use crate::mesh::cluster::ClusterMesh;
use crate::mesh::edge::EdgeKind;
use crate::mesh::id::{Corner, LocalVertex, WedgePair};
use crate::mesh::ring::{Rings, Spoke};

/// The cheapest collapse of a vertex.
#[derive(Debug, Clone, Copy)]
pub struct Proposal {
    /// Cost in the metric's unit; area × length² in the default one.
    pub cost: f32,
    /// The vertex that stays.
    pub to: LocalVertex,
    /// Whether `to` keeps its texture coordinates.
    pub onto: bool,
    /// Whether the edge lies on a seam or border that both ends follow.
    pub chain: bool,
    /// Whether a cheaper proposal of the vertex was refused and nothing around it has changed since.
    pub second_best: bool,
}

impl Proposal {
    /// No proposal.
    pub const NONE: Self =
        Self { cost: f32::INFINITY, to: LocalVertex::NONE, onto: false, chain: false, second_best: false };

    /// A collapse onto a neighbour inside a chart.
    ///
    /// NOTE: the bits of a NaN cost order above those of infinity, so it is never chosen.
    #[inline(always)]
    pub fn onto(to: LocalVertex, cost: f32) -> Self {
        Self { cost, to, onto: true, chain: false, second_best: false }
    }

    /// Order of the proposals of one vertex: by cost, then by `to`.
    pub fn key(&self) -> Bid {
        Bid::new(self.cost, self.to)
    }
}

/// A vertex with a cost that is not negative; ordered by cost, then by vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Bid(u64);

impl Bid {
    /// Below all others, except one at no cost of vertex 0.
    pub const LOWEST: Self = Self(0);

    /// A vertex with a cost.
    #[inline(always)]
    pub fn new(cost: f32, vertex: LocalVertex) -> Self {
        // The bits of costs order like their values.
        Self(u64::from(cost.to_bits()) << 32 | u64::from(vertex.number()))
    }

    /// The cost.
    #[inline(always)]
    pub fn cost(self) -> f32 {
        f32::from_bits((self.0 >> 32) as u32)
    }

    /// The vertex.
    #[inline(always)]
    pub fn vertex(self) -> LocalVertex {
        LocalVertex::new(self.0 as u32)
    }
}

/// An edge at a vertex, with the wedges of its faces.
#[derive(Debug, Clone, Copy)]
pub struct EdgeAt {
    /// The other end.
    pub other: LocalVertex,
    /// Wedges of the vertex and of the other end in two of the faces; the same pair twice if there is one face.
    pub wedges: [WedgePair; 2],
    /// Number of faces with the edge.
    pub face_count: u32,
}

impl EdgeAt {
    /// The edge from a corner to the next one of its face, inside a chart; `None` if the face is dead.
    #[inline(always)]
    pub fn ahead(mesh: &ClusterMesh, corner: Corner) -> Option<Self> {
        let from = mesh.living(corner)?;
        let next = mesh.end_of(corner.next());
        Some(Self { other: next.vertex, wedges: [WedgePair { from, to: next.wedge }; 2], face_count: 2 })
    }

    /// The edge to `other`, gathered from the faces around a vertex.
    #[inline(always)]
    fn among(spokes: &[Spoke], other: LocalVertex) -> Self {
        let mut edge = Self { other, wedges: [WedgePair::default(); 2], face_count: 0 };
        for wedges in spokes.iter().filter_map(|spoke| spoke.edge_to(other)) {
            // With more than two faces, the second pair is one that differs from the first.
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

    /// Kind of the edge.
    #[inline(always)]
    pub fn kind(&self) -> EdgeKind {
        match self.face_count {
            1 => EdgeKind::Border,
            _ if self.wedges[0] == self.wedges[1] => EdgeKind::Inner,
            _ => EdgeKind::Seam,
        }
    }
}

/// Passes the seam and border edges at a vertex to `take`, with the wedges at both ends in up to two faces. `spokes` is
/// a buffer. An edge whose faces run along it in the same direction may be passed twice.
#[inline(always)]
pub fn chain_edges_at(
    mesh: &ClusterMesh,
    rings: &Rings,
    vertex: LocalVertex,
    is_on_border: bool,
    spokes: &mut Vec<Spoke>,
    mut take: impl FnMut(&EdgeAt),
) {
    gather_spokes(mesh, rings, vertex, spokes);
    for spoke in &*spokes {
        // Compares all spokes, because a branch on the position of the edge's other face would be unpredictable.
        let differs = |other: &Spoke| {
            (other.wedge.number() ^ spoke.wedge.number()) | (other.previous_wedge.number() ^ spoke.next_wedge.number())
        };
        if spokes.iter().fold(true, |is_chain, other| is_chain & (differs(other) != 0)) {
            take(&EdgeAt::among(spokes, spoke.next));
        }
        if is_on_border && spokes.iter().all(|other| other.next != spoke.previous) {
            take(&EdgeAt::among(spokes, spoke.previous));
        }
    }
}

/// Collects the living faces around a vertex.
#[inline(always)]
fn gather_spokes(mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex, spokes: &mut Vec<Spoke>) {
    let corners = rings.living(mesh, vertex);
    spokes.clear();
    spokes.extend(corners.map(|corner| Spoke::of(mesh, corner)));
}

/// Passes every edge at a vertex to `take`, once, with the wedges at both ends in up to two faces. `spokes` is a
/// buffer.
pub fn all_edges_at(
    mesh: &ClusterMesh,
    rings: &Rings,
    vertex: LocalVertex,
    spokes: &mut Vec<Spoke>,
    mut take: impl FnMut(&EdgeAt),
) {
    gather_spokes(mesh, rings, vertex, spokes);
    for (i, spoke) in spokes.iter().enumerate() {
        let is_new = |end: LocalVertex| spokes[..i].iter().all(|before| before.edge_to(end).is_none());
        for end in [spoke.next, spoke.previous].into_iter().filter(|&end| is_new(end)) {
            take(&EdgeAt::among(spokes, end));
        }
    }
}

//! Edge kinds: inside a chart, on a seam, or on a border.

use super::cluster::ClusterMesh;
use super::ring::{Rings, Spoke};

/// How the faces at an edge are connected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EdgeKind {
    /// Two faces or more, all with the same wedges at both ends.
    Inner,
    /// Two faces or more that differ in the wedge of an end.
    Seam,
    /// One face.
    Border,
}

/// Kind of the edge from the centre of `spokes` to the vertex `to`. `wedges` are those of the centre and of `to` in one
/// of the faces at the edge.
pub fn kind_among(spokes: &[Spoke], wedges: (u32, u32), to: u32) -> EdgeKind {
    let (mut count, mut differs) = (0, false);
    for found in spokes.iter().filter_map(|spoke| spoke.edge_to(to)) {
        count += 1;
        differs |= found != wedges;
    }
    match count {
        _ if differs => EdgeKind::Seam,
        1 => EdgeKind::Border,
        _ => EdgeKind::Inner,
    }
}

/// Kind of the edge between two vertices that share a face.
pub fn edge_kind(mesh: &ClusterMesh, rings: &Rings, a: u32, b: u32) -> EdgeKind {
    let mut first = None;
    let mut kind = EdgeKind::Border;
    for &corner in rings.of(a) {
        let Some(wa) = mesh.living(corner) else { continue };
        let Some(far) = ClusterMesh::following(corner).into_iter().find(|&c| mesh.vertex_of(c) == b) else { continue };
        let wb = mesh.wedge_of(far);
        match first {
            None => first = Some((wa, wb)),
            Some(wedges) if wedges == (wa, wb) => kind = EdgeKind::Inner,
            Some(_) => return EdgeKind::Seam,
        }
    }
    kind
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;

    #[test]
    fn edges_between_charts_are_seams_and_rims_are_borders() {
        let mesh = samples::two_charts(4);
        let mut rings = Rings::default();
        rings.build(&mesh);
        assert_eq!(edge_kind(&mesh, &rings, 7, 12), EdgeKind::Seam);
        assert_eq!(edge_kind(&mesh, &rings, 0, 1), EdgeKind::Border);
        assert_eq!(edge_kind(&mesh, &rings, 6, 12), EdgeKind::Inner);
    }
}

//! Edge kinds: inside a chart, on a seam, or on a border.

use super::cluster::ClusterMesh;
use super::id::{LocalVertex, WedgePair};
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
pub fn kind_among(spokes: &[Spoke], wedges: WedgePair, to: LocalVertex) -> EdgeKind {
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
pub fn edge_kind(mesh: &ClusterMesh, rings: &Rings, a: LocalVertex, b: LocalVertex) -> EdgeKind {
    let [a, b] = rings.search_order([a, b]);
    let mut first = None;
    let mut kind = EdgeKind::Border;
    for &corner in rings.of(a) {
        let Some(from) = mesh.living(corner) else { continue };
        let Some(far) = corner.others().into_iter().find(|&far| mesh.vertex_of(far) == b) else { continue };
        let wedges = WedgePair { from, to: mesh.wedge_of(far) };
        match first {
            None => first = Some(wedges),
            Some(first) if first == wedges => kind = EdgeKind::Inner,
            Some(_) => return EdgeKind::Seam,
        }
    }
    kind
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::v;

    #[test]
    fn edges_between_charts_are_seams_and_rims_are_borders() {
        let mesh = samples::two_charts(4);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let kind = |a, b| edge_kind(&mesh, &rings, v(a), v(b));
        assert_eq!([kind(7, 12), kind(0, 1), kind(6, 12)], [EdgeKind::Seam, EdgeKind::Border, EdgeKind::Inner]);
    }

    #[test]
    fn the_kind_of_an_edge_at_a_hub_is_found_from_its_other_end() {
        let mesh = samples::disc(300);
        let mut rings = Rings::default();
        rings.build(&mesh);
        assert_eq!([[0, 5], [5, 0]].map(|edge| rings.search_order(edge.map(v))), [[5, 0].map(v); 2]);
        assert_eq!(rings.search_order([5, 6].map(v)), [5, 6].map(v));
        let kinds = [[0, 5], [5, 0], [5, 6]].map(|[a, b]| edge_kind(&mesh, &rings, v(a), v(b)));
        assert_eq!(kinds, [EdgeKind::Inner, EdgeKind::Inner, EdgeKind::Border]);
    }
}

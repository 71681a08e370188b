//! Tells whether a chart that was laid flat overlaps itself.
//!
//! No triangle of the chart is turned over, so it covers each place as often as its outline goes around it. It covers
//! no place twice if its triangles go once around each vertex inside, if the outline neither crosses itself nor meets
//! itself at a vertex, and if one loop alone goes around counter-clockwise; the others go around holes.

use glam::DVec2;

use crate::mesh::id::LocalVertex;

/// An edge of a chart's outline, with the chart to its left.
#[derive(Debug, Clone, Copy)]
pub(super) struct OutlineEdge {
    pub vertices: [LocalVertex; 2],
    pub ends: [DVec2; 2],
}

/// Whether the outline of a chart crosses itself, meets itself at a vertex, or goes around several places.
pub(super) fn overlaps(mut edges: Vec<OutlineEdge>) -> bool {
    edges.sort_unstable_by_key(|edge| edge.vertices);
    let meets_itself = edges.windows(2).any(|pair| pair[0].vertices[0] == pair[1].vertices[0]);
    meets_itself || has_several_rims(&edges) || has_crossing(&mut edges)
}

/// Whether more than one loop goes around counter-clockwise; `edges` are sorted by their first vertex, and no two have the
/// same.
fn has_several_rims(edges: &[OutlineEdge]) -> bool {
    let mut are_seen = vec![false; edges.len()];
    let mut rims = 0;
    for first in 0..edges.len() {
        let (mut next, mut doubled_area) = (Some(first), 0.0);
        while let Some(at) = next.filter(|&at| !are_seen[at]) {
            are_seen[at] = true;
            let OutlineEdge { vertices, ends } = edges[at];
            doubled_area += (ends[0] - edges[first].ends[0]).perp_dot(ends[1] - edges[first].ends[0]);
            next = edges.binary_search_by_key(&vertices[1], |edge| edge.vertices[0]).ok();
        }
        rims += usize::from(doubled_area > 0.0);
    }
    rims > 1
}

fn has_crossing(edges: &mut [OutlineEdge]) -> bool {
    let low = |edge: &OutlineEdge| edge.ends[0].x.min(edge.ends[1].x);
    let high = |edge: &OutlineEdge| edge.ends[0].x.max(edge.ends[1].x);
    edges.sort_by(|a, b| low(a).total_cmp(&low(b)));
    (0..edges.len()).any(|at| {
        let edge = edges[at];
        let near = edges[at + 1..].iter().take_while(|other| low(other) <= high(&edge));
        near.into_iter().any(|other| cross(&edge, other))
    })
}

/// Whether two edges cross at an inner point of both.
fn cross(a: &OutlineEdge, b: &OutlineEdge) -> bool {
    let meets = a.vertices.iter().any(|vertex| b.vertices.contains(vertex));
    let side = |edge: &OutlineEdge, point: DVec2| (edge.ends[1] - edge.ends[0]).perp_dot(point - edge.ends[0]);
    !meets && side(a, b.ends[0]) * side(a, b.ends[1]) < 0.0 && side(b, a.ends[0]) * side(b, a.ends[1]) < 0.0
}

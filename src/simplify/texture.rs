//! Texture coordinates after a collapse: read off the old surface, never extrapolated. For vertices that are relocated
//! afterwards, `relocate.rs` chooses them.
//!
//! A free vertex takes the texture coordinate at the closest point of its old one-ring. A seam or border vertex takes
//! those at the closest point of the old chain, one for each side, so that both sides keep to the border of their
//! chart:
//!
//! ```text
//!      x ------ from ======= to ------ y        the chain; p is the new position
//!                      p'                        p' is the closest point of the chain
//! ```

use glam::{DVec2, DVec3, Vec2};

use crate::geometry::closest_weights;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::{Corner, Edge, End, LocalVertex, Wedge, WedgePair};
use crate::mesh::ring::Rings;

/// Texture coordinate at the closest point of the faces around some vertices; `None` if none of the faces has texture.
pub fn uv_on_ring(mesh: &ClusterMesh, rings: &Rings, vertices: &[LocalVertex], position: DVec3) -> Option<DVec2> {
    let mut best: Option<(f64, DVec2)> = None;
    for face in vertices.iter().flat_map(|&vertex| rings.faces(mesh, vertex)) {
        let uv = mesh.uv_triangle(face);
        if !uv.iter().all(|t| t.is_finite()) {
            continue;
        }
        let triangle = mesh.triangle(face);
        let weights = closest_weights(position, triangle);
        let at = triangle[0] * weights[0] + triangle[1] * weights[1] + triangle[2] * weights[2];
        let distance_sq = at.distance_squared(position);
        if best.is_none_or(|(least, _)| distance_sq < least) {
            best = Some((distance_sq, uv[0] * weights[0] + uv[1] * weights[1] + uv[2] * weights[2]));
        }
    }
    best.map(|(_, uv)| uv)
}

/// Writes the texture coordinates at the closest point of the chain through an edge, one for each wedge pair. `None` if
/// the chain cannot be followed on some side.
pub fn uv_on_chain(
    mesh: &ClusterMesh,
    rings: &Rings,
    edge: Edge,
    wedges: &[WedgePair],
    position: DVec3,
    out: &mut Vec<DVec2>,
) -> Option<()> {
    out.clear();
    let mut place = None;
    for pair in wedges {
        let [from, to] = ends_of(edge, *pair);
        let before = chain_end(mesh, rings, from, edge.to);
        let after = chain_end(mesh, rings, to, edge.from);
        let chain = [before, Some(from), Some(to), after];
        let (link, t) = *place.get_or_insert_with(|| closest_on_chain(mesh, &chain, position));
        let (start, end) = (chain[link]?, chain[link + 1]?);
        out.push(mesh.wedge_uv[start.wedge].lerp(mesh.wedge_uv[end.wedge], t));
    }
    Some(())
}

/// Both ends of an edge with these wedges.
fn ends_of(edge: Edge, wedges: WedgePair) -> [End; 2] {
    [End { vertex: edge.from, wedge: wedges.from }, End { vertex: edge.to, wedge: wedges.to }]
}

/// Moves of the texture coordinates of `to` into their charts when `from` vanishes: `share` of the move that keeps the
/// new edge from leaving the chart at the bend of `from`. In units of length.
///
/// ```text
///          from             the chart lies above: without a move the new edge to-next leaves it;
///   to ___/    \___ next    with the full move, the edge from to' passes through `from`
/// ```
pub fn insets(mesh: &ClusterMesh, rings: &Rings, share: f64, edge: Edge, wedges: &[WedgePair]) -> [Vec2; 2] {
    let mut insets = [Vec2::ZERO; 2];
    if share > 0.0 {
        for (inset, &pair) in insets.iter_mut().zip(wedges) {
            *inset = (share * overhang(mesh, rings, edge, pair).unwrap_or(DVec2::ZERO)).as_vec2();
        }
    }
    insets
}

/// The full move of the texture coordinate of `to`; `None` if the new edge stays inside the chart without it.
fn overhang(mesh: &ClusterMesh, rings: &Rings, edge: Edge, wedges: WedgePair) -> Option<DVec2> {
    let [from, to] = ends_of(edge, wedges);
    let next = chain_end(mesh, rings, from, to.vertex)?;
    let origin = mesh.wedge_uv[to.wedge];
    let from_to = |wedge: Wedge| mesh.wedge_uv[wedge] - origin;
    let (bend, chord) = (from_to(from.wedge), from_to(next.wedge));
    let inside = fan_at(mesh, rings, from).find_map(|corner| {
        let far = corner.others();
        let k = far.iter().position(|&c| mesh.vertex_of(c) == to.vertex)?;
        Some(bend.perp_dot(from_to(mesh.wedge_of(far[1 - k]))).signum())
    })?;
    let (length_sq, across) = (chord.length_squared(), inside * chord.perp_dot(bend));
    if !(across > 0.0 && length_sq > 0.0) {
        return None;
    }
    // Near the far end the full move would be too long: it is limited to twice the distance of the bend.
    let along = (bend.dot(chord) / length_sq).clamp(0.0, 0.5);
    Some(chord.perp() * (inside * across / (length_sq * (1.0 - along))))
}

/// Link of the chain (0 to 2) and parameter on it (0 to 1) closest to a position.
fn closest_on_chain(mesh: &ClusterMesh, chain: &[Option<End>; 4], position: DVec3) -> (usize, f64) {
    let mut best = (f64::INFINITY, 1, 0.5);
    for link in [1, 0, 2] {
        let (Some(a), Some(b)) = (chain[link], chain[link + 1]) else { continue };
        let (pa, pb) = (mesh.positions[a.vertex], mesh.positions[b.vertex]);
        let along = pb - pa;
        let t = ((position - pa).dot(along) / along.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let distance_sq = pa.lerp(pb, t).distance_squared(position);
        if distance_sq < best.0 {
            best = (distance_sq, link, t);
        }
    }
    (best.1, best.2)
}

/// Corners of living faces at a vertex that have its wedge.
fn fan_at<'a>(mesh: &'a ClusterMesh, rings: &'a Rings, at: End) -> impl Iterator<Item = Corner> + 'a {
    rings.of(at.vertex).iter().copied().filter(move |&corner| mesh.living(corner) == Some(at.wedge))
}

/// The other chain neighbour of a vertex, not `exclude`: the far end of the fan of faces that have its wedge. `None` if
/// the fan does not have exactly one other end.
fn chain_end(mesh: &ClusterMesh, rings: &Rings, at: End, exclude: LocalVertex) -> Option<End> {
    let mut ends: [Option<End>; 2] = [None; 2];
    for corner in fan_at(mesh, rings, at) {
        for end in corner.others().map(|far| mesh.end_of(far)) {
            let touches = |corner: &Corner| mesh.others_of(*corner).contains(&end.vertex);
            if end.vertex == exclude || fan_at(mesh, rings, at).filter(touches).count() != 1 {
                continue;
            }
            match ends[0] {
                None => ends[0] = Some(end),
                Some(_) => ends[1] = Some(end),
            }
        }
    }
    if ends[1].is_some() { None } else { ends[0] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::{pair, v, w};

    #[test]
    fn a_texture_coordinate_comes_from_the_closest_face_that_has_some() {
        let mut mesh = samples::grid(2, 0.0);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let at = DVec3::new(0.75, 0.25, 3.0);
        let uv = uv_on_ring(&mesh, &rings, &[v(4), v(0)], at).unwrap();
        let mut expected = (f64::INFINITY, DVec2::NAN);
        for face in [v(4), v(0)].into_iter().flat_map(|vertex| rings.faces(&mesh, vertex)) {
            let (weights, triangle) = (closest_weights(at, mesh.triangle(face)), mesh.triangle(face));
            let distance = (0..3).map(|k| triangle[k] * weights[k]).sum::<DVec3>().distance(at);
            if distance < expected.0 {
                expected = (distance, (0..3).map(|k| mesh.uv_triangle(face)[k] * weights[k]).sum());
            }
        }
        assert!(uv.distance(expected.1) < 1e-12, "{uv} {expected:?}");
        mesh.wedge_uv.fill(DVec2::NAN);
        assert_eq!(uv_on_ring(&mesh, &rings, &[v(4), v(0)], at), None);
    }

    //   2          charts left and right of the line x = 2; the chain 2-7-12-17 keeps both sides in step
    #[test]
    fn both_sides_of_a_seam_move_together() {
        let mesh = samples::two_charts(4);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let right = |at| (25..30).find(|&wedge| mesh.wedge_vertex[w(wedge)] == v(at)).unwrap();
        let wedges = [pair(7, 12), pair(right(7), right(12))];
        let (mut uv, edge) = (Vec::new(), Edge { from: v(7), to: v(12) });
        uv_on_chain(&mesh, &rings, edge, &wedges, DVec3::new(2.3, 1.25, 0.0), &mut uv).unwrap();
        assert!((uv[0] - DVec2::new(0.2, 0.125)).length() < 1e-12);
        assert!((uv[1] - DVec2::new(6.6, 0.125)).length() < 1e-12);
    }
}

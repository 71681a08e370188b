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
use crate::mesh::ring::Rings;

/// Texture coordinate at the closest point of the faces around some vertices; `None` if none of the faces has texture.
pub fn uv_on_ring(mesh: &ClusterMesh, rings: &Rings, vertices: &[u32], position: DVec3) -> Option<DVec2> {
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
    (from, to): (u32, u32),
    wedges: &[(u32, u32)],
    position: DVec3,
    out: &mut Vec<DVec2>,
) -> Option<()> {
    out.clear();
    let mut place = None;
    for &(from_wedge, to_wedge) in wedges {
        let before = chain_end(mesh, rings, from, from_wedge, to);
        let after = chain_end(mesh, rings, to, to_wedge, from);
        let chain = [before, Some((from, from_wedge)), Some((to, to_wedge)), after];
        let (link, t) = *place.get_or_insert_with(|| closest_on_chain(mesh, &chain, position));
        let (Some((_, w0)), Some((_, w1))) = (chain[link], chain[link + 1]) else { return None };
        let uv = mesh.wedge_uv[w0 as usize].lerp(mesh.wedge_uv[w1 as usize], t);
        out.push(uv);
    }
    Some(())
}

/// Moves of the texture coordinates of `to` into their charts when `from` vanishes: `share` of the move that keeps the
/// new edge from leaving the chart at the bend of `from`. In units of length.
///
/// ```text
///          from             the chart lies above: without a move the new edge to-next leaves it;
///   to ___/    \___ next    with the full move, the edge from to' passes through `from`
/// ```
pub fn insets(mesh: &ClusterMesh, rings: &Rings, share: f64, edge: (u32, u32), wedges: &[(u32, u32)]) -> [Vec2; 2] {
    let mut insets = [Vec2::ZERO; 2];
    if share > 0.0 {
        for (inset, &pair) in insets.iter_mut().zip(wedges) {
            *inset = (share * overhang(mesh, rings, edge, pair).unwrap_or(DVec2::ZERO)).as_vec2();
        }
    }
    insets
}

/// The full move of the texture coordinate of `to`; `None` if the new edge stays inside the chart without it.
fn overhang(
    mesh: &ClusterMesh,
    rings: &Rings,
    (from, to): (u32, u32),
    (from_wedge, to_wedge): (u32, u32),
) -> Option<DVec2> {
    let (_, next_wedge) = chain_end(mesh, rings, from, from_wedge, to)?;
    let origin = mesh.wedge_uv[to_wedge as usize];
    let from_to = |wedge: u32| mesh.wedge_uv[wedge as usize] - origin;
    let (bend, chord) = (from_to(from_wedge), from_to(next_wedge));
    let inside =
        rings.of(from).iter().filter(|&&corner| mesh.living(corner) == Some(from_wedge)).find_map(|&corner| {
            let far = ClusterMesh::following(corner);
            let k = far.iter().position(|&c| mesh.vertex_of(c) == to)?;
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
fn closest_on_chain(mesh: &ClusterMesh, chain: &[Option<(u32, u32)>; 4], position: DVec3) -> (usize, f64) {
    let mut best = (f64::INFINITY, 1, 0.5);
    for link in [1, 0, 2] {
        let (Some((a, _)), Some((b, _))) = (chain[link], chain[link + 1]) else { continue };
        let (pa, pb) = (mesh.positions[a as usize], mesh.positions[b as usize]);
        let along = pb - pa;
        let t = ((position - pa).dot(along) / along.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let distance_sq = pa.lerp(pb, t).distance_squared(position);
        if distance_sq < best.0 {
            best = (distance_sq, link, t);
        }
    }
    (best.1, best.2)
}

/// The other chain neighbour of `vertex`, not `exclude`, with its wedge: the far end of the fan of faces that have
/// `wedge`. `None` if the fan does not have exactly one other end.
fn chain_end(mesh: &ClusterMesh, rings: &Rings, vertex: u32, wedge: u32, exclude: u32) -> Option<(u32, u32)> {
    let mut ends: [Option<(u32, u32)>; 2] = [None; 2];
    let fan = || rings.of(vertex).iter().filter(|&&corner| mesh.living(corner) == Some(wedge));
    let touches = |corner: u32, other: u32| ClusterMesh::following(corner).iter().any(|&c| mesh.vertex_of(c) == other);
    for &corner in fan() {
        for far in ClusterMesh::following(corner) {
            let other = mesh.vertex_of(far);
            if other == exclude || fan().filter(|&&c| touches(c, other)).count() != 1 {
                continue;
            }
            match ends[0] {
                None => ends[0] = Some((other, mesh.wedge_of(far))),
                Some(_) => ends[1] = Some((other, mesh.wedge_of(far))),
            }
        }
    }
    if ends[1].is_some() { None } else { ends[0] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;

    #[test]
    fn a_texture_coordinate_comes_from_the_closest_face_that_has_some() {
        let mut mesh = samples::grid(2, 0.0);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let at = DVec3::new(0.75, 0.25, 3.0);
        let uv = uv_on_ring(&mesh, &rings, &[4, 0], at).unwrap();
        let mut expected = (f64::INFINITY, DVec2::NAN);
        for face in [4, 0].into_iter().flat_map(|vertex| rings.faces(&mesh, vertex)) {
            let (weights, triangle) = (closest_weights(at, mesh.triangle(face)), mesh.triangle(face));
            let distance = (0..3).map(|k| triangle[k] * weights[k]).sum::<DVec3>().distance(at);
            if distance < expected.0 {
                expected = (distance, (0..3).map(|k| mesh.uv_triangle(face)[k] * weights[k]).sum());
            }
        }
        assert!(uv.distance(expected.1) < 1e-12, "{uv} {expected:?}");
        mesh.wedge_uv.fill(DVec2::NAN);
        assert_eq!(uv_on_ring(&mesh, &rings, &[4, 0], at), None);
    }

    //   2          charts left and right of the line x = 2; the chain 2-7-12-17 keeps both sides in step
    #[test]
    fn both_sides_of_a_seam_move_together() {
        let mesh = samples::two_charts(4);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let right = |v: u32| (25..30).find(|&w| mesh.wedge_vertex[w as usize] == v).unwrap();
        let wedges = [(7, 12), (right(7), right(12))];
        let mut uv = Vec::new();
        uv_on_chain(&mesh, &rings, (7, 12), &wedges, DVec3::new(2.3, 1.25, 0.0), &mut uv).unwrap();
        assert!((uv[0] - DVec2::new(0.2, 0.125)).length() < 1e-12);
        assert!((uv[1] - DVec2::new(6.6, 0.125)).length() < 1e-12);
    }
}

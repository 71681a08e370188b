//! Faces that are folded onto each other, back to back.

use glam::DVec3;

/// Two faces with less than this angle between them, in radians, are folded onto each other.
pub const FOLD_ANGLE: f64 = 0.1;
/// Square of its cosine.
const FOLD_COSINE_SQ: f64 = 0.990_033_288_920_621;
/// Squared cosine of 0.15: no collapse brings faces nearer, since positions are rounded when they are written.
const NEARLY_COSINE_SQ: f64 = 0.977_668_245;

/// Whether the two faces at an edge, with these third corners, are folded onto each other; not if one has no area.
#[inline]
pub fn are_folded(edge: [DVec3; 2], thirds: [DVec3; 2]) -> bool {
    are_within(FOLD_COSINE_SQ, edge, thirds)
}

/// Whether they are folded onto each other, or nearly so.
#[inline]
pub fn are_nearly_folded(edge: [DVec3; 2], thirds: [DVec3; 2]) -> bool {
    are_within(NEARLY_COSINE_SQ, edge, thirds)
}

#[inline]
fn are_within(cosine_sq: f64, [a, b]: [DVec3; 2], thirds: [DVec3; 2]) -> bool {
    let along = b - a;
    let [p, q] = thirds.map(|third| third - a);
    // Mostly the two lie on different sides of the edge.
    let same_side = p.dot(q) * along.length_squared() > p.dot(along) * q.dot(along);
    same_side && is_angle_below(cosine_sq, [p, q].map(|third| across(along, third)))
}

/// Which way a face leads away from a side of its own, in the face and across the side, to a third corner relative to one
/// end of it.
pub fn across(side: DVec3, third: DVec3) -> DVec3 {
    let side = side.normalize_or_zero();
    third - side * third.dot(side)
}

/// Whether two faces at an edge that lead away from it [like this](across) are folded onto each other.
pub fn is_angle_small(ways: [DVec3; 2]) -> bool {
    is_angle_below(FOLD_COSINE_SQ, ways)
}

#[inline]
fn is_angle_below(cosine_sq: f64, [p, q]: [DVec3; 2]) -> bool {
    let dot = p.dot(q);
    dot > 0.0 && dot * dot > cosine_sq * p.length_squared() * q.length_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_are_folded_below_the_angle_and_not_above() {
        let edge = [DVec3::ZERO, DVec3::new(3.0, 1.0, -2.0)];
        let across = edge[1].any_orthonormal_vector();
        let up = edge[1].normalize().cross(across);
        let at = |angle: f64| (across * angle.cos() + up * angle.sin()) * 2.0 + edge[1] * 0.3;
        for size in [1e-20, 1.0, 1e20] {
            for (angle, folded) in [(0.0, true), (0.999, true), (1.001, false), (20.0, false), (31.4, false)] {
                let thirds = [at(0.0), at(angle * FOLD_ANGLE)].map(|third| third * size);
                assert_eq!(are_folded(edge.map(|end| end * size), thirds), folded, "{size}, {angle}");
            }
        }
        assert!(!are_folded(edge, [edge[1] * 0.5, at(0.0)]));
    }
}

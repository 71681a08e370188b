//! Tests whether two faces at an edge are folded onto each other, back to back.

use glam::DVec3;

/// Two faces are folded onto each other if the angle between them is below this, in radians.
pub const FOLD_ANGLE: f64 = 0.1;
/// cos² of [`FOLD_ANGLE`].
const FOLD_COSINE_SQ: f64 = 0.990_033_288_920_621;
/// cos² of 0.15 rad, the limit for collapses. It is wider than [`FOLD_ANGLE`], because positions are rounded when they
/// are written.
const NEARLY_COSINE_SQ: f64 = 0.977_668_245;

/// Whether the two faces at `edge` with the third corners `thirds` are folded onto each other. `false` if a face has no
/// area.
#[inline]
pub fn are_folded(edge: [DVec3; 2], thirds: [DVec3; 2]) -> bool {
    are_within(FOLD_COSINE_SQ, edge, thirds)
}

/// As [`are_folded`], with the wider limit of 0.15 rad.
#[inline]
pub fn are_nearly_folded(edge: [DVec3; 2], thirds: [DVec3; 2]) -> bool {
    are_within(NEARLY_COSINE_SQ, edge, thirds)
}

#[inline]
fn are_within(cosine_sq: f64, [a, b]: [DVec3; 2], thirds: [DVec3; 2]) -> bool {
    let along = b - a;
    let [p, q] = [thirds[0] - a, thirds[1] - a];
    // Cheap test first: most pairs of faces lie on different sides of their edge.
    let same_side = p.dot(q) * along.length_squared() > p.dot(along) * q.dot(along);
    same_side && is_angle_below(cosine_sq, [across(along, p), across(along, q)])
}

/// Component of `third` perpendicular to `side`: the direction in which a face leaves this side. `third` is the face's
/// third corner relative to one end of the side.
pub fn across(side: DVec3, third: DVec3) -> DVec3 {
    let side = side.normalize_or_zero();
    third - side * third.dot(side)
}

/// Whether two faces that leave their edge in these [directions](across) are folded onto each other.
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

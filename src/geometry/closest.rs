//! The point of a triangle that is closest to a point in space.
//!
//! # Source
//! Ericson, "Real-Time Collision Detection", 2005, section 5.1.5 (regions of the triangle's plane).

use glam::DVec3;

/// A triangle is a needle if the sine of its first angle is below this: weights lose twice as many digits as the sine
/// has zeros.
const NEEDLE_SINE: f64 = 1e-3;
/// A triangle is no needle if the square of that sine, as the squared lengths and the product of its sides have it, is above
/// this.
const CLEAR: f64 = 10.0 * NEEDLE_SINE * NEEDLE_SINE;
/// A needle is flat if that sine is below this. Its points are then no farther from its sides than this share of their
/// length, and rounding of its normal would move a point as far.
const FLAT_SINE: f64 = 1e-8;

/// Barycentric weights of the point of a triangle that is closest to `p`. On a needle they may be mostly rounding; see
/// [`closest_point`].
#[inline]
pub fn closest_weights(p: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    weights(p, [a, b, c], [b - a, c - a])
}

/// As [`closest_weights`], with the sides at the first corner.
#[inline(always)]
fn weights(p: DVec3, [a, b, c]: [DVec3; 3], [ab, ac]: [DVec3; 2]) -> [f64; 3] {
    let ap = p - a;
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = ratio(d1, d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = ratio(d2, d2 - d6);
        return [1.0 - t, 0.0, t];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = ratio(d4 - d3, (d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - t, t];
    }
    let total = va + vb + vc;
    let (v, w) = (ratio(vb, total), ratio(vc, total));
    [1.0 - v - w, v, w]
}

/// Squared distance of a point to a triangle, by [`closest_weights`].
pub fn distance_sq(p: DVec3, triangle: [DVec3; 3]) -> f64 {
    let w = closest_weights(p, triangle);
    p.distance_squared(triangle[0] * w[0] + triangle[1] * w[1] + triangle[2] * w[2])
}

/// The point of a triangle that is closest to `point`, also on needles and on triangles without area.
pub fn closest_point(point: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac) = (b - a, c - a);
    let (product_sq, along) = (ab.length_squared() * ac.length_squared(), ab.dot(ac));
    // Most triangles are no needles by far: then the normal, and a division, are not needed to know.
    let is_clear = product_sq.is_normal() && product_sq - along * along > CLEAR * product_sq;
    if !is_clear {
        let normal = ab.cross(ac);
        let sine_sq = normal.length_squared() / product_sq;
        if sine_sq.is_nan() || sine_sq < NEEDLE_SINE * NEEDLE_SINE {
            return closest_of_needle(point, [a, b, c], normal, sine_sq);
        }
    }
    let weights = weights(point, [a, b, c], [ab, ac]);
    a + ab * weights[1] + ac * weights[2]
}

/// As [`closest_point`], for a needle, whose two sides at the first corner are almost parallel. There the differences
/// of products in [`closest_weights`] are mostly rounding, and the point that they give may lie far along the triangle.
fn closest_of_needle(point: DVec3, [a, b, c]: [DVec3; 3], normal: DVec3, sine_sq: f64) -> DVec3 {
    if sine_sq > FLAT_SINE * FLAT_SINE {
        let foot = point - normal * ((point - a).dot(normal) / normal.length_squared());
        let is_inside = |[from, to]: [DVec3; 2]| (from - foot).cross(to - foot).dot(normal) >= 0.0;
        if [[a, b], [b, c], [c, a]].into_iter().all(is_inside) {
            return foot;
        }
    }
    [[a, b], [b, c], [c, a]]
        .map(|side| closest_of_side(point, side))
        .into_iter()
        .min_by(|p, q| p.distance_squared(point).total_cmp(&q.distance_squared(point)))
        .unwrap_or(a)
}

fn closest_of_side(point: DVec3, [from, to]: [DVec3; 2]) -> DVec3 {
    let step = to - from;
    let length_sq = step.length_squared();
    let along = if length_sq > 0.0 { ((point - from).dot(step) / length_sq).clamp(0.0, 1.0) } else { 0.0 };
    from + step * along
}

fn ratio(part: f64, whole: f64) -> f64 {
    if whole == 0.0 { 0.0 } else { part / whole }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_closest_point_is_found_in_every_region() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let closest = |p| {
            let w = closest_weights(p, triangle);
            triangle[0] * w[0] + triangle[1] * w[1] + triangle[2] * w[2]
        };
        for (p, expected) in [
            (DVec3::new(0.2, 0.3, 5.0), DVec3::new(0.2, 0.3, 0.0)),
            (DVec3::new(-1.0, -1.0, 1.0), DVec3::ZERO),
            (DVec3::new(2.0, -1.0, 0.0), DVec3::X),
            (DVec3::new(-1.0, 3.0, 0.0), DVec3::Y),
            (DVec3::new(0.4, -1.0, 0.0), DVec3::new(0.4, 0.0, 0.0)),
            (DVec3::new(-1.0, 0.7, 0.0), DVec3::new(0.0, 0.7, 0.0)),
            (DVec3::new(1.0, 1.0, 0.0), DVec3::new(0.5, 0.5, 0.0)),
        ] {
            assert!((closest(p) - expected).length() < 1e-12, "{p}");
        }
    }

    #[test]
    fn a_closest_point_lies_over_the_inside_on_a_side_or_at_a_corner() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        for (point, expected) in [
            ([0.25, 0.25, 3.0], [0.25, 0.25, 0.0]),
            ([0.5, -2.0, 1.0], [0.5, 0.0, 0.0]),
            ([2.0, 2.0, 0.0], [0.5, 0.5, 0.0]),
            ([-1.0, -1.0, 5.0], [0.0, 0.0, 0.0]),
        ] {
            let closest = closest_point(DVec3::from(point), triangle);
            assert!(closest.distance(DVec3::from(expected)) < 1e-12);
        }
    }

    proptest! {
        #[test]
        fn no_point_of_a_triangle_is_closer(
            corners in prop::array::uniform3(prop::array::uniform3(-1.0f64..1.0)),
            point in prop::array::uniform3(-2.0f64..2.0),
        ) {
            let (triangle, point) = (corners.map(DVec3::from_array), DVec3::from_array(point));
            let weights = closest_weights(point, triangle);
            prop_assert!(weights.iter().all(|weight| (0.0..=1.0).contains(weight)));
            prop_assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let closest = triangle[0] * weights[0] + triangle[1] * weights[1] + triangle[2] * weights[2];
            // A point of a convex set is the closest if and only if no point of the set lies beyond it.
            for corner in triangle {
                prop_assert!((point - closest).dot(corner - closest) < 1e-12);
            }
        }

        #[test]
        fn no_point_of_a_triangle_is_nearer_than_the_closest(
            raw in prop::array::uniform3(prop::array::uniform3(-9i16..9)),
            point in prop::array::uniform3(-20i16..20),
        ) {
            let (triangle, point) = (raw.map(|p| DVec3::from(p.map(f64::from))), DVec3::from(point.map(f64::from)));
            let closest = closest_point(point, triangle);
            for i in 0..=16 {
                for j in 0..=16 - i {
                    let [u, v] = [i, j].map(|k| f64::from(k) / 16.0);
                    let other = triangle[0] * (1.0 - u - v) + triangle[1] * u + triangle[2] * v;
                    prop_assert!(closest.distance(point) <= other.distance(point) + 1e-9);
                }
            }
        }

        #[test]
        fn a_point_over_a_needle_is_as_far_as_it_was_lifted(
            thin in -11i32..-1, first in 0usize..3, long in 1.0f64..5000.0, height in 0.0f64..3.0,
            u in 0.01f64..0.98, share in 0.01f64..0.98, middle in -0.9f64..1.9,
        ) {
            // long and thin, in an oblique plane, with any corner as the first; the third corner may lie beyond the
            // others
            let (x, y) = (DVec3::new(2.0, 1.0, 2.0) / 3.0, DVec3::new(-2.0, 2.0, 1.0) / 3.0);
            let corners = [DVec3::ZERO, x * long, x * (long * middle) + y * (long * 10f64.powi(thin))];
            let mut triangle = corners;
            triangle.rotate_left(first);
            let v = (1.0 - u) * share;
            let inside = corners[1] * u + corners[2] * v;
            let lifted = inside + x.cross(y) * height;
            let closest = closest_point(lifted, triangle);
            prop_assert!((closest.distance(lifted) - height).abs() < 2.0 * FLAT_SINE * long, "{} {height}", closest.distance(lifted));
        }
    }
}

//! Measures of one triangle, given by its corners.

use glam::{DVec2, DVec3};

/// A triangle lower than this, per length of its longest side, has no area.
const FLAT_RATIO: f64 = 1e-9;
/// A triangle lower than this many roundings of the largest coordinate has no area.
const FLAT_ROUNDINGS: f64 = 4.0;

/// Area of a triangle.
pub fn area([a, b, c]: [DVec3; 3]) -> f64 {
    0.5 * (b - a).cross(c - a).length()
}

/// Area of a triangle in texture space.
pub fn texture_area([a, b, c]: [[f32; 2]; 3]) -> f64 {
    let [across, along] = [b, c].map(|end| [0, 1].map(|axis| f64::from(end[axis]) - f64::from(a[axis])));
    0.5 * (across[0] * along[1] - across[1] * along[0]).abs()
}

/// Sum of the lengths of the three sides.
pub fn perimeter([a, b, c]: [DVec3; 3]) -> f64 {
    a.distance(b) + b.distance(c) + c.distance(a)
}

/// Normal of length 1; zero for a triangle without area.
pub fn unit_normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a).normalize_or_zero()
}

/// 4√3 · area / Σ length²: 1 for an equilateral triangle, 0 for a line.
pub fn regularity([a, b, c]: [DVec3; 3]) -> f64 {
    let lengths = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
    2.0 * 3f64.sqrt() * (b - a).cross(c - a).length() / lengths.max(f64::MIN_POSITIVE)
}

/// Whether a triangle of doubled area `area_2` and of a longest side of squared length `longest_sq` is flat, among
/// coordinates of up to `largest`.
pub fn is_flat(area_2: f64, longest_sq: f64, largest: f64) -> bool {
    let longest = longest_sq.sqrt();
    let height_limit = FLAT_RATIO * longest + FLAT_ROUNDINGS * f64::EPSILON * largest;
    // a triangle with a coordinate that is not a number has no area either
    area_2 <= longest * height_limit || area_2.is_nan() || height_limit.is_nan()
}

/// Whether a triangle is [flat](is_flat), among coordinates of up to `largest`.
pub fn has_no_area([a, b, c]: [DVec3; 3], largest: f64) -> bool {
    let longest_sq = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    is_flat((b - a).cross(c - a).length(), longest_sq, largest)
}

/// Whether a triangle is a line or a point, as far as its coordinates tell.
pub fn is_line(corners: [DVec3; 3]) -> bool {
    let largest = corners.iter().map(|corner| corner.abs().max_element()).fold(0.0, f64::max);
    has_no_area(corners, largest)
}

/// How the barycentric weights of the second and the third corner grow along both axes of a plane; not finite for a
/// triangle without area there.
pub fn weight_growth([a, b, c]: [DVec2; 3]) -> [DVec2; 2] {
    let [ab, ac] = [b - a, c - a];
    let doubled_area = ab.perp_dot(ac);
    [-ac.perp() / doubled_area, ab.perp() / doubled_area]
}

/// Barycentric weights of a point of the triangle's plane; those of the first corner if the triangle has no area.
pub fn barycentric(point: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let normal = ab.cross(ac);
    let area_sq = normal.length_squared();
    if area_sq > 0.0 {
        let at_c = ab.cross(ap).dot(normal) / area_sq;
        let at_b = ap.cross(ac).dot(normal) / area_sq;
        [1.0 - at_b - at_c, at_b, at_c]
    } else {
        [1.0, 0.0, 0.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn barycentric_weights_give_the_point_back() {
        let triangle = [DVec3::new(3.0, 1.0, 2.0), DVec3::new(-1.0, 4.0, 0.0), DVec3::new(2.0, 2.0, 7.0)];
        let point = triangle[0] * 0.2 + triangle[1] * 0.3 + triangle[2] * 0.5;
        let weights = barycentric(point, triangle);
        assert!((weights[0] - 0.2).abs() < 1e-12 && (weights[2] - 0.5).abs() < 1e-12);
    }
}

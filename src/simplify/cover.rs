//! How far a triangle is from a set of triangles, at most: a bound that holds for each of its points, not for samples.
//!
//! The distance to a triangle is a convex function, so that over a convex polygon it is largest at a corner. A polygon
//! whose corners are all near one triangle of the set is therefore near that triangle everywhere. Where no single
//! triangle will do, the polygon is cut along the sides of the nearest one, at right angles to it, and each part is
//! looked at by itself:
//!
//! ```text
//!     polygon a-b-c over the triangles 1 and 2 of a set          cut along the sides of 1
//!         a                                                        a
//!        / \   1 / 2                                              / \
//!       /   \   /                                                /___\ . .  part over 1: its height is linear
//!      b-----\-/--c                                             b    | \   c   part over 2
//! ```
//! Flat parts cost one cut for each side that crosses them, and their bound is exact. Bent parts are cut until the bound is
//! within [`TIGHT`] of the distance of a corner, or until there are [`PARTS_MAX`] of them.

use glam::DVec3;

use super::texture::closest_weights;

/// A part's bound may exceed the distance of its farthest corner by this factor.
const TIGHT: f64 = 1.15;
/// The same as a share of the largest distance allowed.
const SLACK: f64 = 1.0 / 128.0;
/// Parts that a triangle is cut into, at most; what is left is bounded as it is.
const PARTS_MAX: usize = 48;
/// Corners of a part, at most; a triangle that is cut once more gains one.
const CORNERS_MAX: usize = 9;

/// A triangle that others are measured against.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Its corners.
    pub corners: [DVec3; 3],
    /// What is added to the distance to it, in units of length.
    pub base: f64,
}

impl Target {
    fn distance(&self, point: DVec3) -> f64 {
        let [a, b, c] = self.corners;
        let w = closest_weights(point, self.corners);
        self.base + point.distance(a * w[0] + b * w[1] + c * w[2])
    }

    /// The planes through its sides at right angles to it: outward normal and offset. NaN where it has no area.
    fn sides(&self) -> [(DVec3, f64); 3] {
        let [a, b, c] = self.corners;
        let normal = (b - a).cross(c - a);
        [(a, b), (b, c), (c, a)].map(|(p, q)| {
            let outward = (q - p).cross(normal);
            (outward, outward.dot(p))
        })
    }
}

/// A convex polygon in a plane.
#[derive(Debug, Clone, Copy)]
struct Part {
    corners: [DVec3; CORNERS_MAX],
    count: usize,
}

impl Part {
    fn triangle([a, b, c]: [DVec3; 3]) -> Self {
        let mut corners = [DVec3::ZERO; CORNERS_MAX];
        corners[..3].copy_from_slice(&[a, b, c]);
        Self { corners, count: 3 }
    }

    fn empty() -> Self {
        Self { corners: [DVec3::ZERO; CORNERS_MAX], count: 0 }
    }

    fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    fn push(&mut self, corner: DVec3) {
        self.corners[self.count] = corner;
        self.count += 1;
    }

    fn middle(&self) -> DVec3 {
        self.corners().iter().copied().sum::<DVec3>() / self.count as f64
    }

    /// The parts on both sides of a plane, inside first; a part without an inner point has no corners.
    fn cut(&self, (normal, offset): (DVec3, f64)) -> [Self; 2] {
        let height = |corner: DVec3| normal.dot(corner) - offset;
        let heights = self.corners().iter().map(|&corner| height(corner));
        let (low, high) = heights.fold((0f64, 0f64), |(low, high), h| (low.min(h), high.max(h)));
        // Corners this near to the plane lie on it: the sides of neighbours are the same line, but for rounding.
        let touch = 1e-9 * (high - low);
        if high <= touch {
            return [*self, Self::empty()];
        }
        if -low <= touch {
            return [Self::empty(), *self];
        }
        let mut parts = [Self::empty(), Self::empty()];
        for i in 0..self.count {
            let (p, q) = (self.corners[i], self.corners[(i + 1) % self.count]);
            let (at_p, at_q) = (height(p), height(q));
            if at_p <= touch {
                parts[0].push(p);
            }
            if at_p >= -touch {
                parts[1].push(p);
            }
            if (at_p < -touch && at_q > touch) || (at_p > touch && at_q < -touch) {
                let crossing = p.lerp(q, at_p / (at_p - at_q));
                parts[0].push(crossing);
                parts[1].push(crossing);
            }
        }
        parts
    }

    /// Both halves across the middle of the longest side.
    fn halves(&self) -> [Self; 2] {
        let next = |i: usize| (i + 1) % self.count;
        let length_sq = |i: usize| self.corners[i].distance_squared(self.corners[next(i)]);
        let longest = (0..self.count).max_by(|&a, &b| length_sq(a).total_cmp(&length_sq(b))).unwrap_or(0);
        let middle = self.corners[longest].midpoint(self.corners[next(longest)]);
        // From the middle round to the corner opposite, and on from there.
        let turn = (self.count - 1).div_ceil(2);
        let mut halves = [Self::empty(), Self::empty()];
        halves[0].push(middle);
        halves[1].push(middle);
        for step in 1..=self.count {
            let corner = self.corners[(longest + step) % self.count];
            if step <= turn {
                halves[0].push(corner);
            }
            if step >= turn {
                halves[1].push(corner);
            }
        }
        halves
    }
}

/// Covers triangles; holds scratch space only.
#[derive(Debug, Default)]
pub struct Cover {
    parts: Vec<Part>,
}

impl Cover {
    /// Finds for every part of a triangle one of the targets and how far the part is from it, at most: distance plus the
    /// target's base.
    ///
    /// Returns false if that would be more than `most` for some part, or cannot be shown to be less; `found` is then
    /// not to be relied on.
    pub fn cover(
        &mut self,
        triangle: [DVec3; 3],
        targets: &[Target],
        most: f64,
        mut found: impl FnMut(usize, f64),
    ) -> bool {
        self.parts.clear();
        self.parts.push(Part::triangle(triangle));
        let (mut made, mut farthest) = (1, 0f64);
        while let Some(part) = self.parts.pop() {
            let Some(Nearest { target, bound, corner }) = nearest(&part, targets, most) else { return false };
            farthest = farthest.max(corner);
            let is_tight = bound <= farthest * TIGHT + most * SLACK;
            if bound <= most && (is_tight || made >= PARTS_MAX) {
                found(target, bound);
            } else if made >= PARTS_MAX {
                return false;
            } else {
                made += self.split(&part, targets);
            }
        }
        true
    }

    /// Cuts a part along the sides of the target nearest to its middle, or in halves where that cuts nothing; returns
    /// how many parts there are more.
    fn split(&mut self, part: &Part, targets: &[Target]) -> usize {
        let before = self.parts.len();
        let middle = part.middle();
        let nearest = targets.iter().min_by(|a, b| a.distance(middle).total_cmp(&b.distance(middle)));
        let mut inside = *part;
        if part.count + 3 <= CORNERS_MAX {
            for side in nearest.into_iter().flat_map(Target::sides) {
                let [within, beyond] = inside.cut(side);
                if beyond.count >= 3 && within.count >= 3 {
                    self.parts.push(beyond);
                    inside = within;
                }
            }
        }
        if self.parts.len() == before {
            self.parts.extend(part.halves());
        } else {
            self.parts.push(inside);
        }
        self.parts.len() - before
    }
}

/// The target that a part as a whole is nearest to.
struct Nearest {
    target: usize,
    /// How far the part is from it, at most.
    bound: f64,
    /// How far the corner is that is farthest from all targets.
    corner: f64,
}

/// Finds it, unless a corner is farther than `most` from all targets.
fn nearest(part: &Part, targets: &[Target], most: f64) -> Option<Nearest> {
    let mut least = [f64::INFINITY; CORNERS_MAX];
    let mut best = Nearest { target: 0, bound: f64::INFINITY, corner: 0.0 };
    for (i, target) in targets.iter().enumerate() {
        let mut bound = 0f64;
        for (corner, least) in part.corners().iter().zip(&mut least) {
            let distance = target.distance(*corner);
            bound = bound.max(distance);
            *least = least.min(distance);
        }
        if bound < best.bound {
            best = Nearest { target: i, bound, ..best };
        }
    }
    best.corner = least[..part.count].iter().copied().fold(0.0, f64::max);
    (best.corner <= most).then_some(best)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bound_of(triangle: [DVec3; 3], set: &[[DVec3; 3]], most: f64) -> Option<f64> {
        let targets: Vec<Target> = set.iter().map(|&corners| Target { corners, base: 0.0 }).collect();
        let mut bound = 0f64;
        let is_covered = Cover::default().cover(triangle, &targets, most, |_, distance| bound = bound.max(distance));
        is_covered.then_some(bound)
    }

    fn square() -> [[DVec3; 3]; 2] {
        let corner = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        [[corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0)], [corner(0.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)]]
    }

    #[test]
    fn a_triangle_that_lies_across_a_flat_set_is_at_distance_0() {
        let across = [DVec3::new(0.1, 0.2, 0.0), DVec3::new(0.9, 0.3, 0.0), DVec3::new(0.3, 0.9, 0.0)];
        assert!(bound_of(across, &square(), 1e-3).unwrap() < 1e-12);
        let lifted = across.map(|p| p + 0.25 * DVec3::Z);
        assert!((bound_of(lifted, &square(), 1.0).unwrap() - 0.25).abs() < 1e-12);
        assert_eq!(bound_of(lifted, &square(), 0.2), None);
    }

    #[test]
    fn the_middle_of_a_face_over_empty_space_counts() {
        // Two walls face each other; the new face spans the gap between their tops.
        let wall = |x: f64| [DVec3::new(x, 0.0, 0.0), DVec3::new(x, 1.0, 0.0), DVec3::new(x, 0.0, 1.0)];
        let span = [DVec3::new(0.0, 0.0, 1.0), DVec3::new(6.0, 0.0, 1.0), DVec3::new(0.0, 0.0, 0.9)];
        assert_eq!(bound_of(span, &[wall(0.0), wall(6.0)], 2.9), None);
        let bound = bound_of(span, &[wall(0.0), wall(6.0)], 4.0).unwrap();
        assert!((3.0..=3.2).contains(&bound), "{bound}");
    }

    #[test]
    fn the_base_of_a_target_is_added() {
        let [corners, _] = square();
        let mut found = Vec::new();
        let target = Target { corners, base: 0.5 };
        assert!(Cover::default().cover(corners, &[target], 0.6, |target, bound| found.push((target, bound))));
        assert_eq!(found, [(0, 0.5)]);
        assert!(!Cover::default().cover(corners, &[target], 0.4, |_, _| ()));
    }

    fn point() -> impl Strategy<Value = DVec3> {
        (-1.0..1.0f64, -1.0..1.0f64, -0.2..0.2f64).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
        [point(), point(), point()]
    }

    proptest! {
        #[test]
        fn no_point_is_farther_than_the_bound(
            triangle in triangle(),
            set in prop::collection::vec(triangle(), 1..6),
            most in 0.05..3.0f64,
        ) {
            let Some(bound) = bound_of(triangle, &set, most) else { return Ok(()) };
            prop_assert!(bound <= most);
            let mut farthest = 0f64;
            for i in 0..=20 {
                for j in 0..=20 - i {
                    let (u, v) = (f64::from(i) / 20.0, f64::from(j) / 20.0);
                    let at = triangle[0] * u + triangle[1] * v + triangle[2] * (1.0 - u - v);
                    let nearest = set.iter().map(|&corners| Target { corners, base: 0.0 }.distance(at));
                    farthest = farthest.max(nearest.fold(f64::INFINITY, f64::min));
                }
            }
            prop_assert!(farthest <= bound + 1e-12, "{farthest} > {bound}");
        }

        #[test]
        fn parts_of_a_part_have_its_area(triangle in triangle(), other in triangle()) {
            let area = |part: &Part| {
                let corners = part.corners();
                (1..part.count.saturating_sub(1))
                    .map(|i| 0.5 * (corners[i] - corners[0]).cross(corners[i + 1] - corners[0]).length())
                    .sum::<f64>()
            };
            let whole = Part::triangle(triangle);
            let mut cover = Cover::default();
            cover.split(&whole, &[Target { corners: other, base: 0.0 }]);
            let sum: f64 = cover.parts.iter().map(area).sum();
            prop_assert!((sum - area(&whole)).abs() < 1e-9);
            let sum: f64 = whole.halves().iter().map(area).sum();
            prop_assert!((sum - area(&whole)).abs() < 1e-12);
        }
    }
}

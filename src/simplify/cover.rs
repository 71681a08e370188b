//! Upper bounds on the distance from a triangle to a set of triangles: they hold for each of its points, not only for
//! samples.
//!
//! The distance to a triangle is a convex function, so over a convex polygon it is largest at a corner. If all corners
//! of a polygon are near one triangle of the set, the whole polygon is. If no single triangle is near enough, the
//! polygon is cut along the sides of the nearest one, perpendicular to it, and each part is bounded separately:
//!
//! ```text
//!     polygon a-b-c over the triangles 1 and 2 of a set          cut along the sides of 1
//!         a                                                        a
//!        / \   1 / 2                                              / \
//!       /   \   /                                                /___\ . .  part over 1: its height is linear
//!      b-----\-/--c                                             b    | \   c   part over 2
//! ```
//! Flat parts need one cut for each side that crosses them, and their bound is exact. Bent parts are cut until the
//! bound is within 15 % of the distance of a corner, or until there are 48 parts.

use glam::DVec3;

use super::parts::{ConvexPolygon, Parts};
use crate::geometry::distance_sq;

/// A part's bound may exceed the distance of its farthest corner by this factor.
const TIGHT: f64 = 1.15;
/// Additional tolerance, as a share of the largest distance allowed.
const SLACK: f64 = 1.0 / 128.0;
/// Largest number of parts of a triangle; after that, parts are bounded without further cuts.
const PARTS_MAX: usize = 48;

/// A triangle that others are measured against.
#[derive(Debug, Clone, Copy)]
pub struct CoveredFace {
    /// Its corners.
    pub corners: [DVec3; 3],
    /// Added to the distance to it, in units of length.
    pub base: f64,
}

impl CoveredFace {
    /// Distance from a point to it, its base included.
    pub fn distance(&self, point: DVec3) -> f64 {
        self.base + distance_sq(point, self.corners).sqrt()
    }

    /// The planes through its sides, perpendicular to it: outward normal, not of unit length, and offset. All 0 if it
    /// has no area.
    pub fn sides(&self) -> [(DVec3, f64); 3] {
        let [a, b, c] = self.corners;
        let normal = (b - a).cross(c - a);
        [(a, b), (b, c), (c, a)].map(|(p, q)| {
            let outward = (q - p).cross(normal);
            (outward, outward.dot(p))
        })
    }
}

/// Covers triangles by a set of targets; holds only buffers.
#[derive(Debug, Default)]
pub struct Cover {
    targets: Vec<CoveredFace>,
    /// Corners of covered triangles, shared within a patch, then those of their parts.
    cutter: Parts,
    /// Distance from each point to each target, its base included.
    distances: Vec<f64>,
    /// Parts to be covered.
    parts: Vec<ConvexPolygon>,
}

impl Cover {
    /// Sets the targets for the triangles that follow.
    pub fn aim_at(&mut self, targets: impl IntoIterator<Item = CoveredFace>) {
        self.targets.clear();
        self.targets.extend(targets);
        self.cutter.points.clear();
        self.distances.clear();
    }

    /// Finds, for every part of a triangle, one of the targets and an upper bound on the part's distance to it, the
    /// target's base included.
    ///
    /// Returns `false` if the bound of some part exceeds `most`, or cannot be proved to be lower; what `found` received
    /// is then invalid.
    pub fn cover(&mut self, triangle: [DVec3; 3], most: f64, mut found: impl FnMut(usize, f64)) -> bool {
        let whole = ConvexPolygon::triangle(triangle.map(|corner| self.shared_point(corner)));
        self.find_distances();
        let shared = self.cutter.points.len();
        self.parts.clear();
        self.parts.push(whole);
        let (mut made, mut farthest) = (1, 0f64);
        let mut is_covered = true;
        while let Some(part) = self.parts.pop() {
            let nearest = self.nearest(&part);
            farthest = farthest.max(nearest.corner);
            let is_tight = nearest.bound <= farthest * TIGHT + most * SLACK;
            if nearest.bound <= most && (is_tight || made >= PARTS_MAX) {
                found(nearest.target, nearest.bound);
            } else if nearest.corner > most || made >= PARTS_MAX {
                is_covered = false;
                break;
            } else {
                made += self.split(&part);
            }
        }
        self.cutter.points.truncate(shared);
        self.distances.truncate(shared * self.targets.len());
        is_covered
    }

    fn shared_point(&mut self, point: DVec3) -> u16 {
        match self.cutter.points.iter().position(|&known| known == point) {
            Some(at) => at as u16,
            None => self.cutter.push(point),
        }
    }

    /// Computes the distances of points that have none yet.
    fn find_distances(&mut self) {
        let known = self.distances.len() / self.targets.len().max(1);
        for &point in &self.cutter.points[known..] {
            self.distances.extend(self.targets.iter().map(|target| target.distance(point)));
        }
    }

    fn distances_of(&self, point: u16) -> &[f64] {
        let count = self.targets.len();
        &self.distances[usize::from(point) * count..][..count]
    }

    /// The target with the lowest bound for a part as a whole.
    fn nearest(&self, part: &ConvexPolygon) -> Nearest {
        let mut best = Nearest { target: 0, bound: f64::INFINITY, corner: 0.0 };
        for target in 0..self.targets.len() {
            let distances = part.corners().iter().map(|&corner| self.distances_of(corner)[target]);
            let bound = distances.fold(0.0, f64::max);
            if bound < best.bound {
                best = Nearest { target, bound, ..best };
            }
        }
        for &corner in part.corners() {
            best.corner = best.corner.max(self.distances_of(corner).iter().copied().fold(f64::INFINITY, f64::min));
        }
        best
    }

    /// Cuts a part along the sides of the target nearest to its corners on average, or in halves if that cuts nothing.
    /// Returns the number of resulting parts.
    fn split(&mut self, part: &ConvexPolygon) -> usize {
        let before = self.parts.len();
        let sum = |target: usize| part.corners().iter().map(|&corner| self.distances_of(corner)[target]).sum::<f64>();
        let nearest = (0..self.targets.len()).min_by(|&a, &b| sum(a).total_cmp(&sum(b)));
        let Self { targets, cutter, parts, .. } = self;
        let is_cut =
            nearest.is_some_and(|target| cutter.cut_along(part, targets[target].sides(), |part| parts.push(part)));
        if !is_cut {
            parts.extend(cutter.halves(part));
        }
        self.find_distances();
        self.parts.len() - before
    }
}

/// The target with the lowest bound for a part as a whole.
struct Nearest {
    target: usize,
    /// Upper bound on the distance from the part to it.
    bound: f64,
    /// Largest distance from a corner of the part to the target nearest to that corner.
    corner: f64,
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bound_of(triangle: [DVec3; 3], set: &[[DVec3; 3]], most: f64) -> Option<f64> {
        let targets: Vec<CoveredFace> = set.iter().map(|&corners| CoveredFace { corners, base: 0.0 }).collect();
        let (mut cover, mut bound) = (Cover::default(), 0f64);
        cover.aim_at(targets);
        cover.cover(triangle, most, |_, distance| bound = bound.max(distance)).then_some(bound)
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
        let mut cover = Cover::default();
        cover.aim_at([CoveredFace { corners, base: 0.5 }]);
        assert!(cover.cover(corners, 0.6, |target, bound| found.push((target, bound))));
        assert_eq!(found, [(0, 0.5)]);
        assert!(!cover.cover(corners, 0.4, |_, _| ()));
    }

    fn point() -> impl Strategy<Value = DVec3> {
        (-1.0..1.0f64, -1.0..1.0f64, -0.2..0.2f64).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
        [point(), point(), point()]
    }

    /// The parts that are found, with their targets and bounds, by the same rule with nothing kept between parts.
    fn expected(triangle: [DVec3; 3], targets: &[CoveredFace], most: f64) -> Option<Vec<(usize, f64)>> {
        let mut parts = Parts::default();
        let mut waiting = vec![ConvexPolygon::triangle(triangle.map(|corner| parts.push(corner)))];
        let (mut made, mut farthest, mut found) = (1, 0f64, Vec::new());
        while let Some(part) = waiting.pop() {
            let corners: Vec<DVec3> = part.corners().iter().map(|&corner| parts.point(corner)).collect();
            let to_all = |target: usize| corners.iter().map(move |&corner| targets[target].distance(corner));
            let bounds = (0..targets.len()).map(|target| (target, to_all(target).fold(0.0, f64::max)));
            let (target, bound) = bounds.min_by(|a, b| a.1.total_cmp(&b.1))?;
            let nearest = |corner: &DVec3| targets.iter().map(|t| t.distance(*corner)).fold(f64::INFINITY, f64::min);
            let farthest_corner = corners.iter().map(nearest).fold(0.0, f64::max);
            farthest = farthest.max(farthest_corner);
            if bound <= most && (made >= 48 || bound <= 1.15 * farthest + most / 128.0) {
                found.push((target, bound));
                continue;
            }
            if made >= 48 || farthest_corner > most {
                return None;
            }
            let sum = |target: &usize| to_all(*target).sum::<f64>();
            let beside = (0..targets.len()).min_by(|a, b| sum(a).total_cmp(&sum(b)))?;
            let before = waiting.len();
            if !parts.cut_along(&part, targets[beside].sides(), |part| waiting.push(part)) {
                waiting.extend(parts.halves(&part));
            }
            made += waiting.len() - before;
        }
        Some(found)
    }

    /// Few places, so that triangles share corners.
    fn set(most: usize) -> impl Strategy<Value = Vec<[DVec3; 3]>> {
        let triangles = prop::collection::vec(prop::array::uniform3(0..6usize), 0..most);
        (prop::array::uniform6(point()), triangles)
            .prop_map(|(places, triangles)| triangles.into_iter().map(|at| at.map(|at| places[at])).collect())
    }

    fn bases() -> impl Strategy<Value = [f64; 5]> {
        prop::array::uniform5(prop_oneof![Just(0.0), 0.0..0.2f64])
    }

    proptest! {
        #[test]
        fn the_planes_through_the_sides_of_a_face_are_perpendicular_to_it(corners in triangle()) {
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            prop_assume!(normal.length() > 1e-3);
            let sides = CoveredFace { corners, base: 0.0 }.sides();
            for (k, (outward, offset)) in sides.into_iter().enumerate() {
                let [p, q, inside] = [k, (k + 1) % 3, (k + 2) % 3].map(|k| outward.dot(corners[k]) - offset);
                prop_assert!(p.abs() < 1e-12 && q.abs() < 1e-12 && inside < -1e-9, "{p} {q} {inside}");
                prop_assert!(outward.dot(normal).abs() < 1e-12);
            }
        }

        #[test]
        fn what_was_covered_before_makes_no_difference(
            rounds in prop::collection::vec((set(5), set(4), bases()), 1..3),
            most in prop_oneof![0.05..1.0f64, 1.0..3.0f64],
        ) {
            let mut cover = Cover::default();
            for (set, triangles, bases) in rounds {
                let targets = set.into_iter().zip(bases).map(|(corners, base)| CoveredFace { corners, base });
                let targets: Vec<CoveredFace> = targets.collect();
                cover.aim_at(targets.iter().copied());
                for triangle in triangles {
                    let mut found = Vec::new();
                    let is_covered = cover.cover(triangle, most, |target, bound| found.push((target, bound)));
                    prop_assert_eq!(is_covered.then_some(found), expected(triangle, &targets, most));
                    // Only the corners of these triangles are kept.
                    prop_assert!(cover.cutter.points.len() <= 6);
                }
            }
        }

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
                    let nearest = set.iter().map(|&corners| CoveredFace { corners, base: 0.0 }.distance(at));
                    farthest = farthest.max(nearest.fold(f64::INFINITY, f64::min));
                }
            }
            prop_assert!(farthest <= bound + 1e-12, "{farthest} > {bound}");
        }
    }
}

//! The triangles of the original near a region, and which of them are closest to the points of a group in it.
//!
//! ```text
//!        . . p . .         the closest triangle of the middle is d away, the points lie within r of the middle:
//!   ─────────────────      so the closest one of each of them is at most d + 2 r away from the middle
//! ```
//! So a group looks at its few candidates alone, in the order of their distance. Spheres around the triangles exclude
//! most of the region at once.
//!
//! # Memory
//! 300 bytes for each triangle.

use glam::{DVec3, Vec3, Vec4};

use super::points::{PointGroup, PointSet};
use super::prism::{BOUND_MARGIN, FourPlaces, FourPoints, NearTriangle, Shown};
use super::spheres::Spheres;

/// A triangle that may be the closest one of a point of a group.
struct Candidate {
    /// Its distance from the middle of the group.
    least: f32,
    /// What it counts as farther for the present run.
    away: f32,
    triangle: u32,
}

/// The triangles near a region.
#[derive(Default)]
pub(super) struct Nearby {
    middle: DVec3,
    corners: Vec<[DVec3; 3]>,
    shown: Vec<Shown>,
    /// Spheres around the triangles.
    spheres: Spheres,
    /// Those triangles that were a candidate.
    triangles: Vec<Option<NearTriangle>>,
    candidates: Vec<Candidate>,
}

impl Nearby {
    /// Begins a region.
    pub fn begin(&mut self, middle: DVec3) {
        self.middle = middle;
        self.corners.clear();
        self.shown.clear();
        self.triangles.clear();
        self.spheres.clear();
    }

    /// Adds a triangle, whose corners are relative to the middle of the region.
    pub fn add(&mut self, corners: [DVec3; 3], shown: Shown) {
        self.spheres.push(corners);
        self.corners.push(corners);
        self.shown.push(shown);
        self.triangles.push(None);
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// The middle of the region.
    pub fn middle(&self) -> DVec3 {
        self.middle
    }

    /// Finds the numbers of the triangles that may be nearer to a point than `distance`, from the middle of the region.
    pub fn find_near(&mut self, point: Vec3, distance: f32, near: &mut Vec<usize>) {
        self.spheres.measure(point);
        near.clear();
        let distances = self.spheres.distances().iter().enumerate();
        near.extend(distances.filter(|(_, from)| **from < distance).map(|(number, _)| number));
    }

    /// A triangle, as its points ask for it.
    pub fn triangle(&mut self, number: usize) -> &NearTriangle {
        let (corners, shown) = (self.corners[number], self.shown[number]);
        self.triangles[number].get_or_insert_with(|| NearTriangle::new(corners, shown))
    }

    /// Four triangles that were asked for.
    pub fn four(&self, numbers: [u32; 4]) -> Option<[&NearTriangle; 4]> {
        let [a, b, c, d] = numbers.map(|number| self.triangles.get(number as usize)?.as_ref());
        Some([a?, b?, c?, d?])
    }

    /// A distance from a point within which there is a triangle.
    pub fn reach(&mut self, point: DVec3) -> f64 {
        let point = (point - self.middle).as_vec3();
        self.reach_of(point).map_or(f64::INFINITY, f64::from)
    }

    fn reach_of(&mut self, point: Vec3) -> Option<f32> {
        let nearest = self.spheres.nearest(point)?;
        Some(self.triangle(nearest).distance(point, f32::INFINITY))
    }

    /// Finds the candidates of a group, in order.
    fn choose(&mut self, middle: Vec3, radius: f32, away: f32) {
        let mut candidates = std::mem::take(&mut self.candidates);
        candidates.clear();
        if let Some(reach) = self.reach_of(middle) {
            let room = away + 2.0 * radius;
            let mut limit = reach + room;
            for number in 0..self.len() {
                if self.spheres.distances()[number] * BOUND_MARGIN > limit {
                    continue;
                }
                let least = self.triangle(number).distance(middle, limit);
                if least <= limit {
                    candidates.push(Candidate { least, away: 0.0, triangle: number as u32 });
                    limit = limit.min(least + room);
                }
            }
            candidates.retain(|candidate| candidate.least <= limit);
            candidates.sort_unstable_by(|a, b| a.least.total_cmp(&b.least).then(a.triangle.cmp(&b.triangle)));
        }
        self.candidates = candidates;
    }

    /// Calls `found` with the index of the first of up to four points of a group, their number, and the places closest to
    /// them, in order; a triangle that faces away counts as `away` farther.
    ///
    /// # Errors
    /// Those of `found`.
    pub fn of_group<E>(
        &mut self,
        set: &PointSet,
        group: &PointGroup,
        away: f64,
        mut found: impl FnMut(usize, usize, &FourPlaces<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        let middle = (group.middle - self.middle).as_vec3();
        self.choose(middle, group.radius as f32, away as f32);
        let mut first = group.first;
        for run in &set.runs[group.runs.clone()] {
            let normal = run.normal.as_vec3();
            for candidate in &mut self.candidates {
                let faces_away = self.triangles[candidate.triangle as usize]
                    .as_ref()
                    .is_some_and(|triangle| triangle.faces_away(normal));
                candidate.away = if faces_away { away as f32 } else { 0.0 };
            }
            let mut last = 0;
            for four in (first..run.end).step_by(4) {
                let count = (run.end - four).min(4);
                let own = &set.points[four..four + count];
                let points = FourPoints::new(|lane| (own[lane.min(count - 1)] - self.middle).as_vec3());
                let closest = self.closest(&points, points.distances(middle), last);
                let Some((triangles, likely)) = closest else { return Ok(()) };
                last = likely;
                found(four, count, &FourPlaces::new(triangles, &points))?;
            }
            first = run.end;
        }
        Ok(())
    }

    /// The triangle of a candidate.
    #[inline]
    fn candidate(&self, number: usize) -> Option<&NearTriangle> {
        self.triangles[self.candidates.get(number)?.triangle as usize].as_ref()
    }

    /// The triangles closest to four points, which are `from_middle` away from the middle of their group, and the number
    /// of the last one's candidate; `last` is that of a point beside them, which is mostly the same.
    #[inline]
    fn closest(&self, points: &FourPoints, from_middle: Vec4, last: usize) -> Option<([&NearTriangle; 4], usize)> {
        let (away, likely) = (self.candidates.get(last)?.away, self.candidate(last)?);
        let mut closest = [likely; 4];
        let mut last_closest = last;
        let mut least = likely.distances(points, Vec4::INFINITY) + away;
        for (number, candidate) in self.candidates.iter().enumerate() {
            if ((candidate.least - from_middle) * BOUND_MARGIN).cmpge(least).all() {
                break;
            }
            if number == last {
                continue;
            }
            let triangle = self.candidate(number)?;
            let distances = triangle.distances(points, least - candidate.away) + candidate.away;
            let is_nearer = distances.cmplt(least);
            if is_nearer.any() {
                least = least.min(distances);
                (0..4).filter(|&lane| is_nearer.test(lane)).for_each(|lane| closest[lane] = triangle);
                last_closest = if is_nearer.test(3) { number } else { last_closest };
            }
        }
        Some((closest, last_closest))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::bake::testing::{counted_distance, point};
    use crate::geometry::distance_sq;

    proptest! {
        #[test]
        fn the_closest_triangle_is_that_of_a_plain_search(
            corners in prop::collection::vec(prop::array::uniform3(point()), 1..40),
            points in prop::collection::vec(point(), 1..20),
            normal in point(),
            away in 0.0..0.5,
            scale in prop::sample::select(vec![1e-3, 1.0, 1e4]),
            is_flat in any::<bool>(),
        ) {
            let place = |point: DVec3| if is_flat { point.with_z(0.0) * scale } else { point * scale };
            let triangles: Vec<[DVec3; 3]> = corners.iter().map(|corners| corners.map(place)).collect();
            let (middle, away) = (DVec3::new(3.0, -2.0, 1.0) * scale, away * scale);
            let mut nearby = Nearby::default();
            nearby.begin(middle);
            triangles.iter().for_each(|corners| nearby.add(*corners, Shown::Nothing));
            let mut set = PointSet::default();
            points.iter().for_each(|point| set.push(middle + *point * scale));
            set.end_run(normal.normalize_or(DVec3::Z));
            set.end_group();
            let facing = normal.normalize_or(DVec3::Z);
            let counted = |point: DVec3, corners: [DVec3; 3]| counted_distance(point, corners, facing, away);
            let mut count = 0;
            let mut check = |number: usize, triangle: &NearTriangle, weights: [f32; 3]| {
                let point = points[number] * scale;
                let least = triangles.iter().map(|&corners| counted(point, corners)).fold(f64::INFINITY, f64::min);
                let corners = triangle.corners.map(Vec3::as_dvec3);
                prop_assert!(counted(point, corners) <= least + 1e-4 * scale, "{} {least}", counted(point, corners));
                let [a, b, c] = weights.map(f64::from);
                let place = corners[0] * a + corners[1] * b + corners[2] * c;
                let distance = distance_sq(point, corners).sqrt();
                prop_assert!(place.distance(point) <= distance + 1e-2 * scale, "{} {distance}", place.distance(point));
                count += 1;
                Ok(())
            };
            let found = |first: usize, count: usize, places: &FourPlaces<'_>| {
                (0..count).try_for_each(|lane| check(first + lane, places.triangles[lane], places.weights(lane)))
            };
            nearby.of_group(&set, &set.groups()[0], away, found)?;
            prop_assert_eq!(count, points.len());
        }
    }
}

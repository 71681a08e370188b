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

use std::ops::Range;

use glam::{DVec2, DVec3, DVec4, Vec2, Vec3, Vec4};

use crate::geometry::boxtree::Bounds;
use crate::geometry::triangle::area;
use crate::geometry::{closest_weights, distance_sq};
use crate::image::stored::Beyond;
use crate::model::id::ImageId;

/// Cosine between normals below which a triangle faces away: the back of a wall does, the folds of a crumpled surface do
/// not.
const AWAY: f32 = -0.5;
/// A triangle lower than this, per length of its sides, is measured without its prism.
const THIN: f64 = 1e-3;
/// Factor on lower bounds of distances, for the rounding of single precision.
const BOUND_MARGIN: f32 = 0.9995;

/// What a triangle of the original shows.
#[derive(Debug, Clone, Copy)]
pub(super) enum Shown {
    /// A part of an image, by the texture coordinates of the corners.
    Image(ImageId, [[f32; 2]; 3], Beyond),
    /// One colour.
    Plain(Vec3),
    /// The colours of its vertices, the fourth byte 0 where there is none, and what shows there.
    Vertices([[u8; 4]; 3], Option<Vec3>),
    /// Nothing.
    Nothing,
}

/// A triangle near a region; positions are relative to the middle of the region.
pub(super) struct NearTriangle {
    /// `None` over a triangle that is nearly a line.
    prism: Option<Prism>,
    corners: [Vec3; 3],
    normal: Vec3,
    /// What it shows.
    pub shown: Shown,
}

impl NearTriangle {
    /// A triangle with these corners.
    pub fn new(corners: [DVec3; 3], shown: Shown) -> Self {
        let across = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let normal = across.try_normalize().unwrap_or(DVec3::ZERO);
        let [a, b, c] = corners;
        let corners = [a.as_vec3(), b.as_vec3(), c.as_vec3()];
        Self { prism: Prism::over([a, b, c], normal), corners, normal: normal.as_vec3(), shown }
    }

    /// Its area in space.
    pub fn area(&self) -> f64 {
        area(self.corners.map(Vec3::as_dvec3))
    }

    /// Its distance from a point, if that is less than `bound`; else any number from `bound` on.
    #[inline]
    fn distance(&self, point: Vec3, bound: f32) -> f32 {
        let Some(prism) = &self.prism else {
            return distance_sq(point.as_dvec3(), self.corners.map(Vec3::as_dvec3)).sqrt() as f32;
        };
        let beyond = prism.beyond(point);
        let outside = larger(larger(beyond.y, beyond.z), beyond.w);
        if outside <= 0.0 {
            return beyond.x.abs();
        }
        let bound = larger(bound, 0.0);
        if (beyond.x * beyond.x + outside * outside) * BOUND_MARGIN >= bound * bound {
            return f32::INFINITY;
        }
        prism.closest_side(beyond, point, &self.corners).distance_sq.sqrt()
    }

    /// Barycentric weights of its place closest to a point.
    #[inline]
    fn weights(&self, point: Vec3) -> [f32; 3] {
        let Some(prism) = &self.prism else {
            return closest_weights(point.as_dvec3(), self.corners.map(Vec3::as_dvec3)).map(|weight| weight as f32);
        };
        let beyond = prism.beyond(point);
        if larger(larger(beyond.y, beyond.z), beyond.w) <= 0.0 {
            let [a, b] = [-beyond.y * prism.shares.x, -beyond.z * prism.shares.y];
            return [a, b, larger(1.0 - a - b, 0.0)];
        }
        let OnSide { corner, share, .. } = prism.closest_side(beyond, point, &self.corners);
        let mut weights = [0.0; 3];
        weights[(corner + 1) % 3] = 1.0 - share;
        weights[(corner + 2) % 3] = share;
        weights
    }
}

/// The larger of two numbers, as one instruction; `b` if one of them is none.
#[inline]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The prism of all points over a triangle: a point outside of a side is at least as far from the triangle as from that
/// side's plane. The planes of the triangle and of the sides opposite to its corners, side by side:
struct Prism {
    /// Normals of the planes, those of the sides away from the triangle.
    x: Vec4,
    y: Vec4,
    z: Vec4,
    /// Distances of the planes from the origin.
    limit: Vec4,
    /// Inverses of the distances of the first two corners from the opposite sides.
    shares: Vec2,
    /// Inverses of the squared lengths of the sides.
    inverse_sq: [f32; 3],
}

/// The place of a triangle's side that is closest to a point.
struct OnSide {
    distance_sq: f32,
    /// The corner opposite to the side.
    corner: usize,
    /// Where it lies between the next corner and the one after that.
    share: f32,
}

impl Prism {
    fn over(corners: [DVec3; 3], normal: DVec3) -> Option<Self> {
        let side = |corner: usize| {
            let (from, to) = (corners[(corner + 1) % 3], corners[(corner + 2) % 3]);
            let outwards = (to - from).cross(normal).try_normalize()?;
            let limit = outwards.dot(from);
            Some((outwards, limit, limit - corners[corner].dot(outwards), from.distance_squared(to)))
        };
        let [a, b, c] = [side(0)?, side(1)?, side(2)?];
        let longest = c.3.max(a.3).sqrt();
        if a.2.min(b.2).min(c.2) <= THIN * longest {
            return None;
        }
        let column = |axis: usize| DVec4::new(normal[axis], a.0[axis], b.0[axis], c.0[axis]).as_vec4();
        let limit = DVec4::new(normal.dot(corners[0]), a.1, b.1, c.1).as_vec4();
        let shares = DVec2::new(a.2.recip(), b.2.recip()).as_vec2();
        let inverse_sq = [a.3.recip() as f32, b.3.recip() as f32, c.3.recip() as f32];
        Some(Self { x: column(0), y: column(1), z: column(2), limit, shares, inverse_sq })
    }

    /// How far a point lies beyond each plane: above the triangle, and outside of its sides.
    #[inline]
    fn beyond(&self, point: Vec3) -> Vec4 {
        self.x * point.x + self.y * point.y + self.z * point.z - self.limit
    }

    /// The closest place of a triangle that a point is outside of: it lies on a side that the point is outside of.
    #[inline]
    fn closest_side(&self, beyond: Vec4, point: Vec3, corners: &[Vec3; 3]) -> OnSide {
        let mut best = OnSide { distance_sq: f32::INFINITY, corner: 0, share: 0.0 };
        for corner in 0..3 {
            if beyond[corner + 1] > 0.0 {
                let from = corners[(corner + 1) % 3];
                let (side, step) = (corners[(corner + 2) % 3] - from, point - from);
                let share = (step.dot(side) * self.inverse_sq[corner]).clamp(0.0, 1.0);
                let distance_sq = (step - side * share).length_squared();
                if distance_sq < best.distance_sq {
                    best = OnSide { distance_sq, corner, share };
                }
            }
        }
        best
    }
}

/// Points whose closest places are wanted, in groups that lie near each other.
#[derive(Default)]
pub(super) struct PointSet {
    points: Vec<DVec3>,
    runs: Vec<PointRun>,
    groups: Vec<PointGroup>,
}

/// Points of a group that face the same way: those up to `end`.
struct PointRun {
    end: usize,
    normal: DVec3,
}

/// Points that lie near each other.
pub(super) struct PointGroup {
    /// Indices of its runs; they have points.
    runs: Range<usize>,
    /// Index of its first point.
    first: usize,
    /// The middle of their box.
    pub middle: DVec3,
    /// Largest distance of a point from it.
    pub radius: f64,
}

impl PointSet {
    /// Takes all points out.
    pub fn clear(&mut self) {
        self.points.clear();
        self.runs.clear();
        self.groups.clear();
    }

    /// Adds a point.
    #[inline]
    pub fn push(&mut self, point: DVec3) {
        self.points.push(point);
    }

    /// The points since the last run face along `normal`.
    pub fn end_run(&mut self, normal: DVec3) {
        let end = self.points.len();
        if self.runs.last().map_or(0, |run| run.end) < end {
            self.runs.push(PointRun { end, normal });
        }
    }

    /// The runs since the last group lie near each other.
    pub fn end_group(&mut self) {
        let runs = self.groups.last().map_or(0, |group| group.runs.end)..self.runs.len();
        if runs.is_empty() {
            return;
        }
        let first = if runs.start == 0 { 0 } else { self.runs[runs.start - 1].end };
        let own = &self.points[first..];
        let bounds = Bounds::around(own.iter().copied());
        let middle = 0.5 * (bounds.low + bounds.high);
        let radius_sq = own.iter().map(|point| point.distance_squared(middle)).fold(0.0, f64::max);
        self.groups.push(PointGroup { runs, first, middle, radius: radius_sq.sqrt() });
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// The groups.
    pub fn groups(&self) -> &[PointGroup] {
        &self.groups
    }
}

/// A triangle that may be the closest one of a point of a group.
struct Candidate {
    /// Its distance from the middle of the group.
    least: f32,
    /// What it counts as farther for the present run.
    away: f32,
    triangle: u32,
}

/// Middles and radii of spheres.
#[derive(Default)]
struct Spheres {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    radius: Vec<f32>,
    /// Distances of the present point from the spheres, negative inside.
    distances: Vec<f32>,
}

impl Spheres {
    fn clear(&mut self) {
        [&mut self.x, &mut self.y, &mut self.z, &mut self.radius].into_iter().for_each(Vec::clear);
    }

    fn push(&mut self, middle: Vec3, radius: f32) {
        self.x.push(middle.x);
        self.y.push(middle.y);
        self.z.push(middle.z);
        self.radius.push(radius);
    }

    /// Measures the distances of a point; returns the number of the nearest sphere.
    fn measure(&mut self, point: Vec3) -> Option<usize> {
        self.distances.resize(self.x.len(), 0.0);
        let columns = self.x.iter().zip(&self.y).zip(&self.z).zip(&self.radius);
        for (distance, (((x, y), z), radius)) in self.distances.iter_mut().zip(columns) {
            let (x, y, z) = (x - point.x, y - point.y, z - point.z);
            *distance = (x * x + y * y + z * z).sqrt() - radius;
        }
        let least = self.distances.iter().copied().fold(f32::INFINITY, |a, b| if b < a { b } else { a });
        self.distances.iter().position(|&distance| distance == least)
    }
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
        let Bounds { low, high } = Bounds::around(corners);
        let middle = 0.5 * (low + high);
        let [a, b, c] = corners.map(|corner| corner.distance_squared(middle));
        self.spheres.push(middle.as_vec3(), a.max(b).max(c).sqrt() as f32);
        self.corners.push(corners);
        self.shown.push(shown);
        self.triangles.push(None);
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    fn triangle(&mut self, number: usize) -> &NearTriangle {
        let (corners, shown) = (self.corners[number], self.shown[number]);
        self.triangles[number].get_or_insert_with(|| NearTriangle::new(corners, shown))
    }

    /// A distance from a point within which there is a triangle.
    pub fn reach(&mut self, point: DVec3) -> f64 {
        let point = (point - self.middle).as_vec3();
        self.reach_of(point).map_or(f64::INFINITY, f64::from)
    }

    fn reach_of(&mut self, point: Vec3) -> Option<f32> {
        let nearest = self.spheres.measure(point)?;
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
                if self.spheres.distances[number] * BOUND_MARGIN > limit {
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

    /// Calls `found` with the index of each point of a group, the triangle closest to it, and the barycentric weights of
    /// the closest place; a triangle that faces away counts as `away` farther.
    ///
    /// # Errors
    /// Those of `found`.
    pub fn of_group<E>(
        &mut self,
        set: &PointSet,
        group: &PointGroup,
        away: f64,
        mut found: impl FnMut(usize, &NearTriangle, [f32; 3]) -> Result<(), E>,
    ) -> Result<(), E> {
        let middle = (group.middle - self.middle).as_vec3();
        self.choose(middle, group.radius as f32, away as f32);
        let mut first = group.first;
        for run in &set.runs[group.runs.clone()] {
            let normal = run.normal.as_vec3();
            for candidate in &mut self.candidates {
                let faces_away = self.triangles[candidate.triangle as usize]
                    .as_ref()
                    .is_some_and(|triangle| triangle.normal.dot(normal) < AWAY);
                candidate.away = if faces_away { away as f32 } else { 0.0 };
            }
            let mut last = 0;
            for number in first..run.end {
                let point = (set.points[number] - self.middle).as_vec3();
                if let Some((triangle, at)) = self.closest(point, point.distance(middle), last) {
                    last = at;
                    found(number, triangle, triangle.weights(point))?;
                }
            }
            first = run.end;
        }
        Ok(())
    }

    /// The candidate closest to a point, which is `from_middle` away from the middle of its group, and its number; `last`
    /// is that of the point before, which is mostly the same.
    #[inline]
    fn closest(&self, point: Vec3, from_middle: f32, last: usize) -> Option<(&NearTriangle, usize)> {
        let triangle = |candidate: &Candidate| self.triangles[candidate.triangle as usize].as_ref();
        let likely = self.candidates.get(last)?;
        let mut closest = (triangle(likely)?, last);
        let mut least = closest.0.distance(point, f32::INFINITY) + likely.away;
        for (number, candidate) in self.candidates.iter().enumerate() {
            if (candidate.least - from_middle) * BOUND_MARGIN >= least {
                break;
            }
            if number != last {
                let triangle = triangle(candidate)?;
                let distance = triangle.distance(point, least - candidate.away) + candidate.away;
                if distance < least {
                    (least, closest) = (distance, (triangle, number));
                }
            }
        }
        Some(closest)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0).prop_map(DVec3::from_array)
    }

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
            let counted = |point: DVec3, corners: [DVec3; 3]| {
                let across = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
                let faces_away = across.dot(normal.normalize_or(DVec3::Z)) < f64::from(AWAY);
                distance_sq(point, corners).sqrt() + if faces_away { away } else { 0.0 }
            };
            let mut count = 0;
            let found = |number: usize, triangle: &NearTriangle, weights: [f32; 3]| {
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
            nearby.of_group(&set, &set.groups()[0], away, found)?;
            prop_assert_eq!(count, points.len());
        }
    }
}

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

use super::texels::Beyond;
use crate::geometry::boxtree::Bounds;
use crate::geometry::triangle::area;
use crate::geometry::{closest_weights, distance_sq};
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

/// Points that lie near each other and face the same way.
#[derive(Debug, Clone)]
pub(super) struct PointGroup {
    /// Indices of the points.
    pub points: Range<usize>,
    /// Where they face.
    pub normal: DVec3,
    /// The middle of their box.
    pub middle: DVec3,
    /// Largest distance of a point from it.
    pub radius: f64,
}

impl PointGroup {
    /// The points of a range, which face along `normal`.
    pub fn new(all: &[DVec3], points: Range<usize>, normal: DVec3) -> Self {
        let own = &all[points.clone()];
        let bounds = Bounds::around(own.iter().copied());
        let middle = 0.5 * (bounds.low + bounds.high);
        let radius_sq = own.iter().map(|point| point.distance_squared(middle)).fold(0.0, f64::max);
        Self { points, normal, middle, radius: radius_sq.sqrt() }
    }
}

/// A candidate of a group.
struct Candidate {
    /// Its distance from the middle of the group, with what it counts for facing away.
    least: f32,
    away: f32,
    triangle: u32,
}

/// The triangles near a region.
#[derive(Default)]
pub(super) struct Nearby {
    middle: DVec3,
    triangles: Vec<NearTriangle>,
    /// Middle and radius of a sphere around each triangle.
    spheres: Vec<Vec4>,
    bounds: Vec<f32>,
    candidates: Vec<Candidate>,
}

impl Nearby {
    /// Begins a region.
    pub fn begin(&mut self, middle: DVec3) {
        self.middle = middle;
        self.triangles.clear();
        self.spheres.clear();
    }

    /// Adds a triangle, whose corners are relative to the middle of the region.
    pub fn add(&mut self, corners: [DVec3; 3], shown: Shown) {
        let Bounds { low, high } = Bounds::around(corners);
        let middle = 0.5 * (low + high);
        let radius_sq = corners.into_iter().map(|corner| corner.distance_squared(middle)).fold(0.0, f64::max);
        self.spheres.push(middle.extend(radius_sq.sqrt()).as_vec4());
        self.triangles.push(NearTriangle::new(corners, shown));
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Sets the lower bounds of the triangles' distances from a point, and returns the distance of that with the least.
    fn measure_spheres(&mut self, point: Vec3) -> Option<f32> {
        self.bounds.clear();
        self.bounds.extend(self.spheres.iter().map(|sphere| {
            let distance = (sphere.truncate() - point).length();
            distance - sphere.w
        }));
        let least = self.bounds.iter().zip(0..).min_by(|a, b| a.0.total_cmp(b.0))?.1;
        Some(self.triangles[least as usize].distance(point, f32::INFINITY))
    }

    /// A distance from a point within which there is a triangle.
    pub fn reach(&mut self, point: DVec3) -> f64 {
        let point = (point - self.middle).as_vec3();
        self.measure_spheres(point).map_or(f64::INFINITY, f64::from)
    }

    /// Finds the candidates of a group in order.
    fn choose(&mut self, middle: Vec3, radius: f32, normal: Vec3, away: f32) {
        self.candidates.clear();
        let Some(reach) = self.measure_spheres(middle) else { return };
        let mut limit = reach + away + 2.0 * radius;
        for (number, &bound) in self.bounds.iter().enumerate() {
            if bound * BOUND_MARGIN > limit {
                continue;
            }
            let triangle = &self.triangles[number];
            let away = if triangle.normal.dot(normal) < AWAY { away } else { 0.0 };
            let least = triangle.distance(middle, limit - away) + away;
            if least <= limit {
                self.candidates.push(Candidate { least, away, triangle: number as u32 });
                limit = limit.min(least + 2.0 * radius);
            }
        }
        self.candidates.retain(|candidate| candidate.least <= limit);
        self.candidates.sort_unstable_by(|a, b| a.least.total_cmp(&b.least).then(a.triangle.cmp(&b.triangle)));
    }

    /// Calls `found` with the index of each point of a group, the triangle closest to it, and the barycentric weights of
    /// the closest place; a triangle that faces away counts as `away` farther.
    ///
    /// # Errors
    /// Those of `found`.
    pub fn of_group<E>(
        &mut self,
        points: &[DVec3],
        group: &PointGroup,
        away: f64,
        mut found: impl FnMut(usize, &NearTriangle, [f32; 3]) -> Result<(), E>,
    ) -> Result<(), E> {
        let middle = (group.middle - self.middle).as_vec3();
        self.choose(middle, group.radius as f32, group.normal.as_vec3(), away as f32);
        let Some(first) = self.candidates.first() else { return Ok(()) };
        let mut last = first;
        for number in group.points.clone() {
            let point = (points[number] - self.middle).as_vec3();
            let from_middle = point.distance(middle);
            // Mostly the triangle of the point before.
            let mut closest = last;
            let mut least = self.triangles[last.triangle as usize].distance(point, f32::INFINITY) + last.away;
            for candidate in &self.candidates {
                if (candidate.least - from_middle) * BOUND_MARGIN >= least {
                    break;
                }
                let room = least - candidate.away;
                let distance = self.triangles[candidate.triangle as usize].distance(point, room) + candidate.away;
                if distance < least {
                    (least, closest) = (distance, candidate);
                }
            }
            last = closest;
            let triangle = &self.triangles[closest.triangle as usize];
            found(number, triangle, triangle.weights(point))?;
        }
        Ok(())
    }
}

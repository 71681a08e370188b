//! A triangle of the original, as points near it ask for its closest place.
//!
//! ```text
//!     │         │        over a triangle, the distance is that of its plane;
//!     │ d       │ ╲      outside of a side it is at least that, and what the point lies beyond the side's plane
//!     ▁▁▁▁▁▁▁▁▁▁▁
//! ```
//! Four points are asked for at once.

use glam::{DVec2, DVec3, DVec4, Vec2, Vec3, Vec4};

use crate::geometry::{closest_weights, distance_sq};
use crate::image::stored::Beyond;
use crate::model::id::ImageId;

/// A triangle lower than this, per length of its sides, is measured without its prism.
const THIN: f64 = 1e-3;
/// Cosine between normals below which a triangle faces away: the back of a wall does, the folds of a crumpled surface do
/// not.
pub(super) const AWAY: f32 = -0.5;
/// Factor on lower bounds of distances, for the rounding of single precision.
pub(super) const BOUND_MARGIN: f32 = 0.9995;

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
    pub corners: [Vec3; 3],
    pub normal: Vec3,
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

    /// Whether it faces away from what has this normal.
    #[inline]
    pub fn faces_away(&self, normal: Vec3) -> bool {
        self.normal.dot(normal) < AWAY
    }

    /// Its distance from a point, if that is less than `bound`; else any number from `bound` on.
    #[inline]
    pub fn distance(&self, point: Vec3, bound: f32) -> f32 {
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

    /// Its distances from four points, as far as they are less than `bounds`; else any numbers from these on.
    #[inline]
    pub fn distances(&self, points: &FourPoints, bounds: Vec4) -> Vec4 {
        let Some(prism) = &self.prism else {
            let distance = |lane: usize| self.distance(points.point(lane), f32::INFINITY);
            return Vec4::new(distance(0), distance(1), distance(2), distance(3));
        };
        let [above, a, b, c] = prism.beyond_four(points);
        let outside = a.max(b).max(c);
        let bounds = bounds.max(Vec4::ZERO);
        let is_inside = outside.cmple(Vec4::ZERO);
        let is_open = !is_inside & ((above * above + outside * outside) * BOUND_MARGIN).cmplt(bounds * bounds);
        let of_sides = if is_open.any() { self.sides_distances(prism, points) } else { Vec4::INFINITY };
        Vec4::select(is_inside, above.abs(), Vec4::select(is_open, of_sides, Vec4::INFINITY))
    }

    /// Distances of four points from the sides.
    #[inline]
    fn sides_distances(&self, prism: &Prism, points: &FourPoints) -> Vec4 {
        let mut least_sq = Vec4::INFINITY;
        for corner in 0..3 {
            let from = self.corners[(corner + 1) % 3];
            let side = self.corners[(corner + 2) % 3] - from;
            let [x, y, z] = [points.x - from.x, points.y - from.y, points.z - from.z];
            let share = (x * side.x + y * side.y + z * side.z) * prism.inverse_sq[corner];
            let share = share.max(Vec4::ZERO).min(Vec4::ONE);
            let [x, y, z] = [x - share * side.x, y - share * side.y, z - share * side.z];
            least_sq = least_sq.min(x * x + y * y + z * z);
        }
        roots(least_sq)
    }

    /// Barycentric weights of its places closest to four points, by corner.
    #[inline]
    fn weights_of_four(&self, points: &FourPoints) -> [Vec4; 3] {
        if let Some(prism) = &self.prism {
            let beyond = prism.beyond_four(points);
            if beyond[1].max(beyond[2]).max(beyond[3]).cmple(Vec4::ZERO).all() {
                let [a, b] = [-beyond[1] * prism.shares.x, -beyond[2] * prism.shares.y];
                return [a, b, (1.0 - a - b).max(Vec4::ZERO)];
            }
        }
        FourPlaces::each([self; 4], points)
    }

    /// Barycentric weights of its place closest to a point.
    #[inline]
    pub fn weights(&self, point: Vec3) -> [f32; 3] {
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
pub(super) fn larger(a: f32, b: f32) -> f32 {
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

    /// The same for four points, by plane.
    #[inline]
    fn beyond_four(&self, points: &FourPoints) -> [Vec4; 4] {
        let beyond = |plane: usize| {
            points.x * self.x[plane] + points.y * self.y[plane] + points.z * self.z[plane] - self.limit[plane]
        };
        [beyond(0), beyond(1), beyond(2), beyond(3)]
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

/// Four points side by side.
pub(super) struct FourPoints {
    pub x: Vec4,
    pub y: Vec4,
    pub z: Vec4,
}

impl FourPoints {
    /// The points at four numbers.
    #[inline]
    pub fn new(point: impl Fn(usize) -> Vec3) -> Self {
        let [a, b, c, d] = [point(0), point(1), point(2), point(3)];
        let axis = |axis: usize| Vec4::new(a[axis], b[axis], c[axis], d[axis]);
        Self { x: axis(0), y: axis(1), z: axis(2) }
    }

    /// One of them.
    #[inline]
    pub fn point(&self, lane: usize) -> Vec3 {
        Vec3::new(self.x[lane], self.y[lane], self.z[lane])
    }

    /// Their distances from a point.
    #[inline]
    pub fn distances(&self, point: Vec3) -> Vec4 {
        let [x, y, z] = [self.x - point.x, self.y - point.y, self.z - point.z];
        roots(x * x + y * y + z * z)
    }
}

/// The places closest to four points.
pub(super) struct FourPlaces<'a> {
    /// Their triangles.
    pub triangles: [&'a NearTriangle; 4],
    /// Their barycentric weights, by corner.
    weights: [Vec4; 3],
}

impl<'a> FourPlaces<'a> {
    /// The places of these triangles.
    #[inline]
    pub fn new(triangles: [&'a NearTriangle; 4], points: &FourPoints) -> Self {
        let [first, others @ ..] = triangles;
        let weights = if others.into_iter().all(|other| std::ptr::eq(other, first)) {
            first.weights_of_four(points)
        } else {
            Self::each(triangles, points)
        };
        Self { triangles, weights }
    }

    /// The weights, triangle by triangle.
    #[inline]
    fn each(triangles: [&NearTriangle; 4], points: &FourPoints) -> [Vec4; 3] {
        let of = |lane: usize| triangles[lane].weights(points.point(lane));
        let [a, b, c, d] = [of(0), of(1), of(2), of(3)];
        let corner = |corner: usize| Vec4::new(a[corner], b[corner], c[corner], d[corner]);
        [corner(0), corner(1), corner(2)]
    }

    /// Barycentric weights of one of them.
    #[inline]
    pub fn weights(&self, lane: usize) -> [f32; 3] {
        self.weights.map(|weights| weights[lane])
    }
}

#[inline]
fn roots(squares: Vec4) -> Vec4 {
    Vec4::new(squares.x.sqrt(), squares.y.sqrt(), squares.z.sqrt(), squares.w.sqrt())
}

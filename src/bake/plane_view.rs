//! How a triangle of a patch is looked at, along its normal: columns and rows of places near it.

use glam::{DVec2, DVec3, Vec2, Vec3, Vec4};

use super::plane::Plane;
use super::prism::{FourPoints, NearTriangle};
use super::raster::TexelRect;

/// How a triangle of the patch is looked at. Places are from the middle of the region, columns and rows from its corner.
pub(super) struct PlaneView {
    /// The place in the middle of the texels, and its column and row.
    pub origin: Vec3,
    at: Vec2,
    /// Steps of one column and one row.
    steps: [Vec3; 2],
    /// Columns and rows grow along these, by so much for each length, and the inverses of that.
    growth: [Vec3; 2],
    rates: [f32; 2],
    pub rate_recips: [f32; 2],
    pub normal: Vec3,
    /// All texels lie within this of the origin.
    pub radius: f32,
    /// The texels.
    rect: TexelRect,
}

impl PlaneView {
    /// `None` if the triangle has no area, or no texel.
    pub fn of(plane: &Plane, rect: TexelRect, middle: DVec3, region: TexelRect) -> Option<Self> {
        if rect.size().contains(&0) {
            return None;
        }
        let corner = DVec2::new(region.first[0] as f64, region.first[1] as f64);
        let [low, high] = [rect.first, rect.end].map(|[column, row]| DVec2::new(column as f64, row as f64));
        let at = 0.5 * (low + high);
        let [right, below] = plane.steps;
        // The inverse of the steps, as a map from the plane to the image.
        let [rr, rb, bb] = [right.dot(right), right.dot(below), below.dot(below)];
        let inverse = (rr * bb - rb * rb).recip();
        let growth = [(right * bb - below * rb) * inverse, (below * rr - right * rb) * inverse];
        let growth = growth.map(|growth| growth.as_vec3());
        let sides = [right * (high.x - low.x), below * (high.y - low.y)];
        let radius = 0.5 * (sides[0] + sides[1]).length().max((sides[0] - sides[1]).length());
        let view = Self {
            origin: (plane.place(at) - middle).as_vec3(),
            at: (at - corner).as_vec2(),
            steps: plane.steps.map(|step| step.as_vec3()),
            growth,
            rates: growth.map(Vec3::length),
            rate_recips: growth.map(Vec3::length_recip),
            normal: plane.normal.as_vec3(),
            radius: radius as f32,
            rect: rect.from(region.first),
        };
        let is_sound = view.growth.iter().all(|growth| growth.is_finite()) && view.origin.is_finite();
        is_sound.then_some(view)
    }

    /// Where a triangle is seen; `None` if no texel lies within `reach` of it.
    pub fn shadow(&self, triangle: &NearTriangle, reach: f32) -> Option<Shadow> {
        let from = triangle.corners.map(|corner| corner - self.origin);
        let above = from.map(|from| from.dot(self.normal));
        let (lowest, highest) = (above[0].min(above[1]).min(above[2]), above[0].max(above[1]).max(above[2]));
        let off = lowest.max(-highest).max(0.0);
        if off >= reach {
            return None;
        }
        let at = from.map(|from| self.at + Vec2::new(from.dot(self.growth[0]), from.dot(self.growth[1])));
        let (low, high) = (at[0].min(at[1]).min(at[2]), at[0].max(at[1]).max(at[2]));
        let range = |axis: usize| {
            let margin = reach * self.rates[axis];
            // Through 32 bits, which is faster; a region has far fewer columns.
            let first = ((low[axis] - margin).max(0.0) as u32 as usize).max(self.rect.first[axis]);
            let end = ((high[axis] + margin).max(-1.0) + 1.0) as u32 as usize;
            (first, end.min(self.rect.end[axis]))
        };
        let [(left, right), (top, bottom)] = [range(0), range(1)];
        let is_near = left < right && top < bottom;
        is_near.then_some(Shadow { rect: TexelRect { first: [left, top], end: [right, bottom] }, low, high, off })
    }

    /// The places of four samples of a texel.
    #[inline]
    pub fn points(&self, [column, row]: [usize; 2], [x, y]: &[Vec4; 2]) -> FourPoints {
        // Signed numbers become fractions by one instruction.
        let from = Vec2::new(column as i32 as f32 + 0.5, row as i32 as f32 + 0.5) - self.at;
        let (x, y) = (*x + from.x, *y + from.y);
        let [right, below] = self.steps;
        FourPoints {
            x: x * right.x + y * below.x + self.origin.x,
            y: x * right.y + y * below.y + self.origin.y,
            z: x * right.z + y * below.z + self.origin.z,
        }
    }
}

/// Where a triangle of the original is seen, if it is projected onto the plane of one of the patch.
pub(super) struct Shadow {
    /// The texels within reach.
    pub rect: TexelRect,
    /// Columns and rows that it covers.
    pub low: Vec2,
    pub high: Vec2,
    /// It is at least this far from the plane.
    pub off: f32,
}

//! A triangle of a chart: where the places of the image lie in space.
//!
//! ```text
//!   image  ▞▚ . .        a place beyond the triangle lies in its plane, unless it is far beyond a sliver
//!         ▞▁▁▚ . .
//! ```

use glam::{DVec2, DVec3};

use crate::geometry::closest_weights;
use crate::geometry::triangle::{unit_normal, weight_growth};

/// Far beyond a sliver, where a barycentric weight is below this, its plane leads astray.
const LEAST_WEIGHT: f64 = -1.0;
/// Barycentric weights that change by less than this from texel to texel stay above [`LEAST_WEIGHT`] in the gutter.
const PLUMP: f64 = 0.15;

/// A triangle of the image and in space.
pub(super) struct Plane {
    flat: [DVec2; 3],
    solid: [DVec3; 3],
    /// Its normal in space.
    pub normal: DVec3,
    /// How the barycentric weights of the second and third corner grow along the image.
    growth: [DVec2; 2],
    /// Steps in space of one column and one row.
    pub steps: [DVec3; 2],
    /// Whether all texels around one of its own lie close to it.
    is_plump: bool,
}

impl Plane {
    /// A triangle with these corners in the image and in space.
    pub fn new(flat: [DVec2; 3], solid: [DVec3; 3]) -> Self {
        let growth = weight_growth(flat);
        let along = |axis: usize| (solid[1] - solid[0]) * growth[0][axis] + (solid[2] - solid[0]) * growth[1][axis];
        let is_plump = growth[0].length() + growth[1].length() < PLUMP;
        Self { flat, solid, normal: unit_normal(solid), growth, steps: [along(0), along(1)], is_plump }
    }

    /// The place in space of one in the image; far beyond a sliver, that of the triangle's nearest place.
    #[inline]
    pub fn point(&self, at: DVec2) -> DVec3 {
        self.extended(at).unwrap_or_else(|| {
            let [a, b, c] = closest_weights(at.extend(0.0), self.flat.map(|corner| corner.extend(0.0)));
            self.solid[0] * a + self.solid[1] * b + self.solid[2] * c
        })
    }

    /// The place in space of one in the image, unless it is far beyond a sliver.
    #[inline]
    pub fn extended(&self, at: DVec2) -> Option<DVec3> {
        let from_a = at - self.flat[0];
        if !self.is_plump {
            let [at_b, at_c] = self.growth.map(|growth| growth.dot(from_a));
            let weights = [1.0 - at_b - at_c, at_b, at_c];
            if !weights.into_iter().all(|weight| weight >= LEAST_WEIGHT) {
                return None;
            }
        }
        Some(self.place(at))
    }

    /// The place in the triangle's plane of one in the image.
    #[inline]
    pub fn place(&self, at: DVec2) -> DVec3 {
        let from_a = at - self.flat[0];
        self.solid[0] + self.steps[0] * from_a.x + self.steps[1] * from_a.y
    }
}

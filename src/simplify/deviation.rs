//! How far a collapse moves the surface, both ways.
//!
//! Every face carries a bound on its distance from the input. A collapse replaces a patch of faces by another with the
//! same rim; the new faces' bound is the largest of the old patch plus the distance between both patches:
//!
//! ```text
//! input ── bound of the old patch ── old patch ── sampled, both ways ── new patch
//! ```
//! The sum overestimates, since deviations rarely add up; the samples (corners that move, middles of spokes, centroids)
//! underestimate a little; together the bound held in all our measurements.

use glam::DVec3;

use super::legality::Refusal;
use super::texture::closest_weights;

/// Old and new triangles around an edge, each turned so that its first corner is the one that moves; scratch space is
/// kept between edges.
#[derive(Debug, Default)]
pub struct Patches {
    /// Faces that will be replaced.
    pub old: Vec<[DVec3; 3]>,
    /// Faces that replace them.
    pub new: Vec<[DVec3; 3]>,
}

impl Patches {
    /// Forgets both patches.
    pub fn clear(&mut self) {
        self.old.clear();
        self.new.clear();
    }

    /// Bound of the new patch, if the old one's was `before`.
    ///
    /// # Errors
    /// If it exceeds `most`.
    pub fn bound(&self, before: f32, most: f64) -> Result<f64, Refusal> {
        let room = most - f64::from(before);
        if room < 0.0 {
            return Err(Refusal::Deviation);
        }
        let moved = self.distance_within(room).ok_or(Refusal::Deviation)?;
        Ok(f64::from(before) + moved)
    }

    /// The larger of both sampled one-sided distances between the patches; nothing if it exceeds `most`.
    fn distance_within(&self, most: f64) -> Option<f64> {
        let most_sq = most * most;
        let there = one_sided_sq(&self.new, &self.old, most_sq)?;
        let back = one_sided_sq(&self.old, &self.new, most_sq)?;
        Some(there.max(back).sqrt())
    }
}

/// Largest squared distance of samples on `from` to `to`; nothing if one exceeds `most_sq`.
fn one_sided_sq(from: &[[DVec3; 3]], to: &[[DVec3; 3]], most_sq: f64) -> Option<f64> {
    let mut farthest_sq = 0f64;
    let mut last = DVec3::NAN;
    for [a, b, c] in from {
        // The rim is common to both patches: only what moves is sampled, a corner once, a spoke once.
        let corner = (*a != last).then_some(*a);
        last = *a;
        for sample in corner.into_iter().chain([(a + b) * 0.5, (a + b + c) / 3.0]) {
            let mut nearest_sq = f64::INFINITY;
            for triangle in to {
                nearest_sq = nearest_sq.min(distance_sq(sample, *triangle));
                if nearest_sq <= farthest_sq {
                    break;
                }
            }
            farthest_sq = farthest_sq.max(nearest_sq);
            if farthest_sq > most_sq {
                return None;
            }
        }
    }
    Some(farthest_sq)
}

fn distance_sq(p: DVec3, triangle: [DVec3; 3]) -> f64 {
    let w = closest_weights(p, triangle);
    p.distance_squared(triangle[0] * w[0] + triangle[1] * w[1] + triangle[2] * w[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

    #[test]
    fn a_lifted_copy_is_as_far_as_it_was_lifted() {
        let lifted = TRIANGLE.map(|p| p + DVec3::Z * 0.25);
        let patches = Patches { old: vec![TRIANGLE], new: vec![lifted] };
        assert!((patches.distance_within(1.0).unwrap() - 0.25).abs() < 1e-12);
        assert_eq!(patches.distance_within(0.2), None);
    }

    #[test]
    fn a_patch_that_lost_a_corner_is_as_far_as_that_corner() {
        let whole = [DVec3::X, DVec3::Y, DVec3::ZERO];
        let cut = [DVec3::X * 0.5, DVec3::Y, DVec3::ZERO];
        let patches = Patches { old: vec![whole], new: vec![cut] };
        assert!((patches.distance_within(1.0).unwrap() - 0.5).abs() < 1e-12);
    }
}

//! Upper bounds on how far a collapse moves the surface, both ways.
//!
//! Every face carries a bound: each of its points is within this distance of the input, and for each point of the input
//! there is a face within that face's bound of it. A collapse replaces a patch of faces by another with the same rim:
//!
//! ```text
//! input ── bound of each old face ── old faces ── covered, both ways ── new faces
//! ```
//! Every part of a new face is within some distance of one old face; its bound is this distance plus the old face's
//! bound. Every part of an old face is within some distance of one new face, which takes this distance plus the old
//! face's bound. Both hold for all points (`cover.rs`), so the result is a proved bound. It is too large only because
//! moves that cancel each other add up.

use glam::DVec3;

use super::cover::{Cover, CoveredFace};
use super::refusal::Refusal;
use crate::mesh::cluster::rounded_up;

/// Old and new triangles around an edge; buffers are reused.
#[derive(Debug, Default)]
pub struct Patches {
    /// Faces that are replaced, each with its bound.
    old: Vec<CoveredFace>,
    /// Faces that replace them.
    new: Vec<CoveredFace>,
    /// Bounds of the new faces.
    bounds: Vec<f64>,
    cover: Cover,
}

impl Patches {
    /// Clears both patches.
    pub fn clear(&mut self) {
        self.old.clear();
        self.new.clear();
    }

    /// Adds a face that is replaced, with its bound.
    pub fn push_old(&mut self, corners: [DVec3; 3], bound: f32) {
        self.old.push(CoveredFace { corners, base: f64::from(bound) });
    }

    /// Adds a face that replaces others.
    pub fn push_new(&mut self, corners: [DVec3; 3]) {
        self.new.push(CoveredFace { corners, base: 0.0 });
    }

    /// Bounds of the new faces, in the order in which they were added.
    ///
    /// # Errors
    /// [`Refusal::Deviation`] if one exceeds `most`, or if there are no new faces.
    pub fn bound(&mut self, most: f64) -> Result<impl Iterator<Item = f32> + '_, Refusal> {
        let Self { old, new, bounds, cover } = self;
        if new.is_empty() {
            return Err(Refusal::Deviation);
        }
        bounds.clear();
        bounds.resize(new.len(), 0.0);
        cover.aim_at(new);
        for face in old.iter() {
            let take = |at: usize, distance: f64| bounds[at] = bounds[at].max(face.base + distance);
            if !cover.cover(face.corners, most - face.base, take) {
                return Err(Refusal::Deviation);
            }
        }
        cover.aim_at(old);
        for (face, bound) in new.iter().zip(bounds.iter_mut()) {
            if !cover.cover(face.corners, most, |_, distance| *bound = bound.max(distance)) {
                return Err(Refusal::Deviation);
            }
        }
        Ok(bounds.iter().map(|&bound| rounded_up(bound)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

    fn bounds(old: &[([DVec3; 3], f32)], new: &[[DVec3; 3]], most: f64) -> Option<Vec<f32>> {
        let mut patches = Patches::default();
        old.iter().for_each(|&(corners, bound)| patches.push_old(corners, bound));
        new.iter().for_each(|&corners| patches.push_new(corners));
        patches.bound(most).ok().map(Iterator::collect)
    }

    #[test]
    fn a_lifted_copy_is_as_far_as_it_was_lifted() {
        let lifted = TRIANGLE.map(|p| p + DVec3::Z * 0.25);
        assert_eq!(bounds(&[(TRIANGLE, 0.0)], &[lifted], 1.0), Some(vec![0.25]));
        assert_eq!(bounds(&[(TRIANGLE, 0.5)], &[lifted], 1.0), Some(vec![0.75]));
        assert_eq!(bounds(&[(TRIANGLE, 0.0)], &[lifted], 0.2), None);
        assert_eq!(bounds(&[(TRIANGLE, 0.1)], &[lifted], 0.3), None);
    }

    #[test]
    fn a_patch_that_lost_a_corner_is_as_far_as_that_corner() {
        let whole = [DVec3::X, DVec3::Y, DVec3::ZERO];
        let cut = [DVec3::X * 0.5, DVec3::Y, DVec3::ZERO];
        assert_eq!(bounds(&[(whole, 0.0)], &[cut], 1.0), Some(vec![0.5]));
    }

    #[test]
    fn what_is_far_in_one_place_does_not_count_in_another() {
        let beside = TRIANGLE.map(|p| p + 5.0 * DVec3::X);
        let lifted = TRIANGLE.map(|p| p + 0.25 * DVec3::Z);
        assert_eq!(bounds(&[(TRIANGLE, 0.0), (beside, 0.5)], &[lifted, beside], 1.0), Some(vec![0.25, 0.5]));
    }
}

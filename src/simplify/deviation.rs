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
    /// Faces that stay as they are and stand for replaced ones near them, with the bound of each.
    kept: Vec<(CoveredFace, f64)>,
    /// Bounds of the new faces, then of the kept ones.
    bounds: Vec<f64>,
    cover: Cover,
}

impl Patches {
    /// Clears both patches.
    pub fn clear(&mut self) {
        self.old.clear();
        self.new.clear();
        self.kept.clear();
    }

    /// Adds a face that is replaced, with its bound.
    pub fn push_old(&mut self, corners: [DVec3; 3], bound: f32) {
        self.old.push(CoveredFace { corners, base: f64::from(bound) });
    }

    /// Adds a face that replaces others.
    pub fn push_new(&mut self, corners: [DVec3; 3]) {
        self.new.push(CoveredFace { corners, base: 0.0 });
    }

    /// Adds a face that stays as it is, with its bound: replaced faces may lie near it instead of near a new one.
    pub fn push_kept(&mut self, corners: [DVec3; 3], bound: f32) {
        self.kept.push((CoveredFace { corners, base: 0.0 }, f64::from(bound)));
    }

    /// Bounds of the new faces, then of the kept ones, each in the order in which they were added.
    ///
    /// # Errors
    /// [`Refusal::Deviation`] if one exceeds `most`, or if there are neither new nor kept faces.
    pub fn bound(&mut self, most: f64) -> Result<impl Iterator<Item = f32> + '_, Refusal> {
        let Self { old, new, kept, bounds, cover } = self;
        if new.is_empty() && kept.is_empty() {
            return Err(Refusal::Deviation);
        }
        bounds.clear();
        bounds.resize(new.len(), 0.0);
        bounds.extend(kept.iter().map(|&(_, bound)| bound));
        cover.aim_at(new.iter().chain(kept.iter().map(|(face, _)| face)).copied());
        for face in old.iter() {
            let take = |at: usize, distance: f64| bounds[at] = bounds[at].max(face.base + distance);
            if !cover.cover(face.corners, most - face.base, take) {
                return Err(Refusal::Deviation);
            }
        }
        cover.aim_at(old.iter().copied());
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
    use proptest::prelude::*;

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

    #[test]
    fn a_face_that_stays_stands_for_one_that_vanishes() {
        let above = TRIANGLE.map(|p| p + DVec3::Z * 0.25);
        let bound = |most: f64, kept: f32| {
            let mut patches = Patches::default();
            patches.push_old(above, 0.5);
            patches.push_kept(TRIANGLE, kept);
            patches.bound(most).ok().map(Iterator::collect::<Vec<f32>>)
        };
        assert_eq!(bound(1.0, 0.0), Some(vec![0.75]));
        assert_eq!(bound(1.0, 0.9), Some(vec![0.9]));
        assert_eq!(bound(0.7, 0.0), None);
        assert!(bounds(&[(TRIANGLE, 0.0)], &[], 1.0).is_none());
        assert!(bounds(&[], &[], 1.0).is_none());
    }

    fn triangle() -> impl Strategy<Value = [DVec3; 3]> {
        let corner = || (-1.0..1.0, -1.0..1.0, -0.2..0.2).prop_map(DVec3::from);
        [corner(), corner(), corner()]
    }

    fn points([a, b, c]: [DVec3; 3]) -> impl Iterator<Item = DVec3> {
        let shares = (0..=8).flat_map(|i| (0..=8 - i).map(move |j| [i, j].map(|k| f64::from(k) / 8.0)));
        shares.map(move |[u, v]| a * u + b * v + c * (1.0 - u - v))
    }

    fn faces(most: usize) -> impl Strategy<Value = Vec<([DVec3; 3], f32)>> {
        prop::collection::vec((triangle(), 0.0..0.2f32), 0..most)
    }

    fn distance(point: DVec3, corners: [DVec3; 3]) -> f64 {
        CoveredFace { corners, base: 0.0 }.distance(point)
    }

    proptest! {
        #[test]
        fn all_points_of_one_side_are_within_the_bounds_of_faces_of_the_other(
            rounds in prop::collection::vec((faces(4), faces(3), faces(3)), 1..4),
            most in 0.3..3.0f64,
        ) {
            let mut used = Patches::default();
            for (old, new, kept) in rounds {
                let bounds_in = |patches: &mut Patches| {
                    old.iter().for_each(|&(corners, bound)| patches.push_old(corners, bound));
                    new.iter().for_each(|&(corners, _)| patches.push_new(corners));
                    kept.iter().for_each(|&(corners, bound)| patches.push_kept(corners, bound));
                    patches.bound(most).ok().map(Iterator::collect::<Vec<f32>>)
                };
                used.clear();
                let found = bounds_in(&mut used);
                prop_assert_eq!(&found, &bounds_in(&mut Patches::default()));
                let Some(found) = found else { continue };
                prop_assert_eq!(found.len(), new.len() + kept.len());
                let within =
                    |base: f32, distance: f64, bound: f32| f64::from(base) + distance <= f64::from(bound) + 1e-12;
                let is_near = |point: DVec3, base: f32| {
                    let faces = new.iter().chain(&kept).zip(&found);
                    faces.into_iter().any(|((corners, _), &bound)| within(base, distance(point, *corners), bound))
                };
                for &(corners, base) in &old {
                    prop_assert!(points(corners).all(|point| is_near(point, base)));
                }
                for (&(corners, _), &bound) in new.iter().zip(&found) {
                    let is_near = |p: DVec3| old.iter().any(|&(face, base)| within(base, distance(p, face), bound));
                    prop_assert!(points(corners).all(is_near) && f64::from(bound) <= most + 1e-6);
                }
                let grows = |((_, before), bound): (&([DVec3; 3], f32), &f32)| bound >= before;
                prop_assert!(kept.iter().zip(&found[new.len()..]).all(grows));
            }
        }
    }
}

//! How long texels are on each triangle of a patch.

use super::closest::ClosestPlaces;
use super::original::Original;
use super::patch_surface::PatchSurface;
use crate::base::Result;
use crate::base::id::TiVec;
use crate::mesh::id::FaceId;

/// Largest factor between a texel's length and that where the original has its median: an image gains little from texels
/// that crowd on a small part of the surface.
const RANGE: f64 = std::f64::consts::SQRT_2;

/// Length of a texel's side on each triangle of a patch: as the original has it there, within a factor of [`RANGE`] of
/// `usual`, its length where the original has the median.
///
/// # Errors
/// On failed reads.
pub(super) fn texel_lengths(original: &Original, patch: &PatchSurface<'_>, usual: f64) -> Result<TiVec<FaceId, f64>> {
    let mut closest = ClosestPlaces::new(original, 0.0);
    closest.begin_patch(patch.bounds());
    let factor = usual / original.median_texel;
    let faces = patch.triangles.vertices.keys();
    faces
        .map(|face| {
            let corners = patch.corners(face);
            let nearest = closest.nearest_triangle((corners[0] + corners[1] + corners[2]) / 3.0)?;
            let length = nearest.and_then(|(shown, area)| original.texel_of(&shown, area));
            let length = length.map_or(usual, |length| length * factor);
            Ok(length.clamp(usual / RANGE, usual * RANGE))
        })
        .collect()
}

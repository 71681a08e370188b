//! How long texels are on each triangle of a patch.

use super::closest::ClosestPlaces;
use super::original::Original;
use super::paint::PatchSurface;
use super::points::PointSet;
use crate::base::Result;
use crate::base::id::TiVec;
use crate::geometry::triangle::unit_normal;
use crate::mesh::id::FaceId;

/// Largest factor between a texel's length and that where the original has its median: an image gains little from texels
/// that crowd on a small part of the surface.
const RANGE: f64 = std::f64::consts::SQRT_2;

/// Length of a texel's side on each triangle of a patch: as the original has it there, within a factor of [`RANGE`] of
/// `usual`, its length where the original has the median. A surface that faces away counts as `away` farther.
///
/// # Errors
/// On failed reads.
pub(super) fn texel_lengths(
    original: &Original,
    patch: &PatchSurface<'_>,
    usual: f64,
    away: f64,
) -> Result<TiVec<FaceId, f64>> {
    let mut closest = ClosestPlaces::new(original, away);
    closest.begin_patch(patch.bounds());
    let factor = usual / original.median_texel;
    let mut points = PointSet::default();
    let faces = patch.triangles.vertices.keys();
    faces
        .map(|face| {
            let corners = patch.corners(face);
            points.clear();
            points.push((corners[0] + corners[1] + corners[2]) / 3.0);
            points.end_run(unit_normal(corners));
            points.end_group();
            let mut length = None;
            closest.of_points(&points, &mut |_, _, places| {
                let [triangle, ..] = places.triangles;
                length = original.texel_of(&triangle.shown, triangle.area());
                Ok(())
            })?;
            let length = length.map_or(usual, |length| length * factor);
            Ok(length.clamp(usual / RANGE, usual * RANGE))
        })
        .collect()
}

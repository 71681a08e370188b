//! What tests of closest places share.

use glam::DVec3;
use proptest::prelude::*;

use super::prism::AWAY;
use crate::geometry::distance_sq;

/// A point of a cube.
pub(super) fn point() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1.0..1.0).prop_map(DVec3::from_array)
}

/// The distance of a point from a triangle, `away` more if the triangle faces away from what has this normal.
pub(super) fn counted_distance(point: DVec3, corners: [DVec3; 3], normal: DVec3, away: f64) -> f64 {
    let across = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
    let faces_away = across.dot(normal) < f64::from(AWAY);
    distance_sq(point, corners).sqrt() + if faces_away { away } else { 0.0 }
}

//! Boxes along axes of their own, around triangles whose axis-aligned boxes overlap.
//!
//! ```text
//!   +-----------+
//!   |       .-' |     needles of a fan, pages of a book: their upright boxes hold each other,
//!   |   .-'.-'  |     so that a search would have to open all of them; tilted boxes are thin
//!   |.-'.-'     |
//!   +-----------+
//! ```
//! In: corners of triangles. Out: a box that contains them. Invariant: rounding never makes the box farther from a
//! point than what is in it.
//!
//! # Source
//! Axes are those of the corners' covariance (Gottschalk, Lin and Manocha 1996, "OBBTree").
//!
//! # Memory
//! 64 bytes a box.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DVec3, Vec3A};
use nalgebra::{Matrix3, SymmetricEigen};

/// Margin, as a multiple of that of upright boxes: turning a point rounds more often than taking a difference.
const TILTED_MARGINS: f64 = 4.0;
/// Maximum number of steps of the search for axes; three by three numbers take about ten.
const EIGEN_STEPS: usize = 100;

/// A box along axes of its own.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct TiltedBox {
    /// For each coordinate, its components along the three axes, so that three multiplications turn a point.
    columns: [[f32; 3]; 3],
    low: [f32; 3],
    high: [f32; 3],
    zero: u32,
}

impl TiltedBox {
    /// The box around at least one corner; `margin` is that of upright boxes.
    pub fn around(corners: impl Iterator<Item = DVec3> + Clone, margin: f64) -> Self {
        let axes = axes_of(corners.clone());
        let columns = axes.to_cols_array_2d().map(|column| column.map(|x| x as f32));
        let rounded = DMat3::from_cols_array_2d(&columns.map(|column| column.map(f64::from)));
        let (low, high) = corners.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), corner| {
            let turned = rounded * corner;
            (low.min(turned), high.max(turned))
        });
        let margin = TILTED_MARGINS * margin;
        let (low, high) = ((low - margin).as_vec3().to_array(), (high + margin).as_vec3().to_array());
        Self { columns, low, high, zero: 0 }
    }

    /// Squared distance of a point; 0 inside.
    #[inline]
    pub fn distance_sq(&self, point: Vec3A) -> f32 {
        let [x, y, z] = self.columns.map(Vec3A::from_array);
        let turned = x * point.x + y * point.y + z * point.z;
        let outside = (Vec3A::from_array(self.low) - turned).max(turned - Vec3A::from_array(self.high));
        outside.max(Vec3A::ZERO).length_squared()
    }

    /// Lengths along the three axes.
    pub fn extent(&self) -> Vec3A {
        Vec3A::from_array(self.high) - Vec3A::from_array(self.low)
    }
}

/// Three orthogonal axes, as rows, along which corners spread most and least; the upright ones if they cannot be found.
fn axes_of(corners: impl Iterator<Item = DVec3> + Clone) -> DMat3 {
    let (count, sum) = corners.clone().fold((0.0, DVec3::ZERO), |(count, sum), corner| (count + 1.0, sum + corner));
    let mean = sum / count;
    let mut spread = Matrix3::zeros();
    for corner in corners {
        let step = nalgebra::Vector3::from((corner - mean).to_array());
        spread += step * step.transpose();
    }
    let largest = spread.amax();
    if !(largest > 0.0 && largest.is_finite()) {
        return DMat3::IDENTITY;
    }
    let Some(found) = SymmetricEigen::try_new(spread / largest, f64::EPSILON, EIGEN_STEPS) else {
        return DMat3::IDENTITY;
    };
    let axes = [0, 1, 2].map(|axis| DVec3::from_slice(found.eigenvectors.column(axis).as_slice()));
    DMat3::from_cols_array_2d(&axes.map(|axis| axis.to_array())).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_box_around_a_slanted_needle_is_thin() {
        let corners = [DVec3::ZERO, DVec3::new(3.0, 4.0, 0.0), DVec3::new(3.0, 4.01, 0.0)];
        let tilted = TiltedBox::around(corners.into_iter(), 0.0);
        let mut extent = tilted.extent().to_array();
        extent.sort_unstable_by(f32::total_cmp);
        assert!(extent[0] < 1e-6 && extent[1] < 0.01 && (extent[2] - 5.0).abs() < 0.02, "{extent:?}");
        assert!((tilted.distance_sq(Vec3A::new(4.0, -3.0, 0.0)).sqrt() - 5.0).abs() < 0.01);
    }

    #[test]
    fn corners_at_one_place_have_a_box() {
        let tilted = TiltedBox::around([DVec3::ONE; 3].into_iter(), 0.0);
        assert_eq!(tilted.extent(), Vec3A::ZERO);
        assert_eq!(tilted.distance_sq(Vec3A::ONE), 0.0);
    }

    proptest! {
        #[test]
        fn no_corner_is_nearer_than_the_box(
            corners in prop::collection::vec(prop::array::uniform3(-300i16..300), 1..20),
            point in prop::array::uniform3(-2000i16..2000),
            scale in prop_oneof![Just(1.0), Just(1e-6), Just(1e6)],
        ) {
            let corners: Vec<DVec3> = corners.into_iter().map(|c| DVec3::from(c.map(f64::from)) * scale).collect();
            let point = DVec3::from(point.map(f64::from)) * scale;
            let tilted = TiltedBox::around(corners.iter().copied(), 300.0 * scale / f64::from(1 << 20));
            let nearest = corners.iter().map(|c| c.distance_squared(point)).fold(f64::INFINITY, f64::min);
            let bound = f64::from(tilted.distance_sq(Vec3A::from(point.as_vec3())));
            prop_assert!(bound <= nearest * 1.000_002, "{bound} {nearest}");
        }
    }
}

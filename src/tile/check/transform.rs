//! Checks how a tile is placed.

use glam::{DMat4, DVec3};
use serde_json::Value;

use super::reader::number;

/// What a rotation may be off, by rounding.
const ROUNDING: f64 = 1e-6;

/// What is wrong with the transform of a tile that lies in `depth` others: that of the root turns and moves it, and no
/// other tile has one.
pub fn transform_fault(transform: &Value, depth: usize) -> Option<&'static str> {
    if transform.is_null() {
        return None;
    }
    let numbers: Option<Vec<f64>> = transform.as_array().and_then(|numbers| numbers.iter().map(number).collect());
    let numbers: Option<[f64; 16]> = numbers.and_then(|numbers| numbers.try_into().ok());
    match numbers {
        None => Some("expected 16 numbers"),
        Some(_) if depth > 0 => Some("a tile below the root has one"),
        Some(numbers) if !is_rigid(DMat4::from_cols_array(&numbers)) => {
            Some("that of the root does not only turn and move it")
        }
        Some(_) => None,
    }
}

fn is_rigid(transform: DMat4) -> bool {
    let axes: [DVec3; 3] = [transform.x_axis, transform.y_axis, transform.z_axis].map(|axis| axis.truncate());
    let is_turned = (0..3).all(|axis| {
        let [next, last] = [axes[(axis + 1) % 3], axes[(axis + 2) % 3]];
        (axes[axis] - next.cross(last)).abs().max_element() <= ROUNDING && (axes[axis].length() - 1.0).abs() <= ROUNDING
    });
    is_turned && transform.row(3).to_array() == [0.0, 0.0, 0.0, 1.0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_root_may_be_turned_and_moved_and_no_other_tile() {
        let turned = DMat4::from_translation(DVec3::new(6e6, -3.0, 1e5)) * DMat4::from_rotation_x(0.7);
        let fault = |transform: DMat4, depth: usize| transform_fault(&json!(transform.to_cols_array()), depth);
        assert_eq!(fault(turned, 0), None);
        assert!(fault(turned, 1).is_some() && fault(DMat4::IDENTITY, 3).is_some());
        let scaled = [DVec3::splat(2.0), DVec3::new(1.0, 1.0, 1.001), DVec3::new(1.0, 1.0, -1.0), DVec3::ZERO];
        for scale in scaled {
            assert!(fault(turned * DMat4::from_scale(scale), 0).is_some(), "{scale}");
        }
        let mut projected = turned;
        projected.x_axis.w = 0.1;
        assert!(fault(projected, 0).is_some());
        assert_eq!(transform_fault(&Value::Null, 2), None);
        assert!(transform_fault(&json!([1, 2, "3"]), 0).is_some() && transform_fault(&json!(5), 0).is_some());
    }
}

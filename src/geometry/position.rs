//! Hash keys of positions.

use glam::DVec3;

/// Bits of a position as a hash key; 0 and -0 are equal.
pub fn position_key(position: DVec3) -> [u64; 3] {
    (position + 0.0).to_array().map(f64::to_bits)
}

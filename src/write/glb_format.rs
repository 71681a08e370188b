//! Numbers and names of glTF that its writers have in common.
//!
//! # Source
//! Khronos, glTF 2.0; `KHR_materials_unlit`; `EXT_meshopt_compression`.

use std::f64::consts::FRAC_1_SQRT_2;

/// Type of a component: 16 bits with a sign.
pub const SHORT: u32 = 5122;
/// 16 bits.
pub const UNSIGNED_SHORT: u32 = 5123;
/// 32 bits.
pub const UNSIGNED_INT: u32 = 5125;
/// A floating-point number.
pub const FLOAT: u32 = 5126;
/// Use of a buffer: vertices.
pub const ARRAY_BUFFER: u32 = 34962;
/// Indices.
pub const ELEMENT_ARRAY_BUFFER: u32 = 34963;
/// Filter of an image: between texels.
pub const LINEAR: u32 = 9729;
/// Between texels of two sizes.
pub const LINEAR_MIPMAP_LINEAR: u32 = 9987;
/// Beyond an image, it is shown again.
pub const REPEAT: u32 = 10497;
/// Beyond an image, its border is shown.
pub const CLAMP_TO_EDGE: u32 = 33071;
/// Colour of a material that has none.
pub const NO_COLOUR: [u8; 3] = [204; 3];
/// The turn by a quarter about x that makes (x, y, z) to (x, z, -y), as a quaternion.
pub const Z_TO_Y: [f64; 4] = [-FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2];
/// The extension for materials without light.
pub const UNLIT: &str = "KHR_materials_unlit";
/// The extension for compressed buffers.
pub const MESHOPT: &str = "EXT_meshopt_compression";

/// Rounds up to whole words.
pub fn padded(bytes: u64) -> u64 {
    bytes.next_multiple_of(4)
}

/// A channel of sRGB, from 0 to 1, as an amount of light.
pub fn linear(channel: f64) -> f64 {
    if channel <= 0.040_45 { channel / 12.92 } else { libm::pow((channel + 0.055) / 1.055, 2.4) }
}

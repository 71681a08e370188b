//! Sizes of images, and the room around charts.

/// Texels around each chart that no other one comes near to: at an eighth of the size, half a texel is left of them,
/// which is what a reader that mixes neighbours needs.
pub const GUTTER: u32 = 4;
/// Width of a column in texels.
pub(super) const COLUMN: u32 = 4;
/// Width and height of an image in texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageSize {
    /// Width.
    pub width: u32,
    /// Height.
    pub height: u32,
}

//! Sizes of images, and the room around charts.

/// Texels around each chart that no other one comes near to: at an eighth of the size, half a texel is left of them,
/// which is what a reader that mixes neighbours needs.
pub const GUTTER: u32 = 4;
/// Side of a cell of the grid that charts are packed on, in texels.
pub(super) const CELL: u32 = 2;
/// Width and height of an image in texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageSize {
    /// Width.
    pub width: u32,
    /// Height.
    pub height: u32,
}

//! Sizes of images, and the room around charts.

use glam::DVec2;

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

impl ImageSize {
    /// The texture coordinate, with (0, 0) at the lower left, of a place in texels from the upper left corner, downwards.
    pub fn texcoord(self, place: DVec2) -> DVec2 {
        DVec2::new(place.x / f64::from(self.width), 1.0 - place.y / f64::from(self.height))
    }
}

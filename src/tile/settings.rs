//! How tiles are made, and where.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::tree::TileLimits;
use crate::base::{Progress, WorkLimits};
use crate::job::WorkFolder;
use crate::model::image_format::ImageFormat;

/// Share of an image that charts are taken to fill, when tiles are chosen.
const FILL: f64 = 0.5;

/// Triangles of a skirt for each edge of the border of a tile.
pub const FACES_OF_STRIP: u64 = 2;

/// How tiles are made.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TileSettings {
    /// Triangles of a tile at most.
    pub faces: u64,
    /// Side of a tile's image at most, in texels.
    pub side: u32,
    /// How images are encoded.
    pub format: ImageFormat,
    /// Whether vertices and triangles are compressed.
    pub is_compressed: bool,
    /// Geometric error of a tile, as a multiple of the larger of its texel and its deviation.
    pub error_factor: f64,
    /// Whether the input has any colour.
    pub has_colour: bool,
}

impl TileSettings {
    /// What a tile may hold.
    pub fn limits(&self) -> TileLimits {
        tile_limits(self.faces, self.side)
    }
}

/// What a tile of up to `faces` triangles, with an image whose side is up to `side`, may hold.
pub fn tile_limits(faces: u64, side: u32) -> TileLimits {
    TileLimits { faces, texels: FILL * f64::from(side) * f64::from(side) }
}

/// Where a pyramid is built.
#[derive(Clone, Copy)]
pub struct TilePlace<'a> {
    /// Folder of the result.
    pub output: &'a Path,
    /// The folder for intermediate files, and its steps.
    pub work: &'a WorkFolder,
    /// What it may take of the machine.
    pub limits: WorkLimits,
    /// What hears of it.
    pub progress: &'a dyn Progress,
}

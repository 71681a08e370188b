//! How to bake, and where.

use crate::base::{Progress, WorkLimits};
use crate::job::WorkFolder;
use crate::model::image_format::ImageFormat;

/// How to bake.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BakeSettings {
    /// Texels as a share of those that the original shows.
    pub texels: f64,
    /// Largest side of an image, in texels.
    pub side: u32,
    /// How images are encoded.
    pub format: ImageFormat,
    /// Deviation of the result from the original, about, in the mesh's unit of length.
    pub deviation: f64,
}

/// Where a bake works.
#[derive(Clone, Copy)]
pub struct BakePlace<'a> {
    /// The folder for its files, and its steps.
    pub work: &'a WorkFolder,
    /// What it may take of the machine.
    pub limits: WorkLimits,
    /// What hears of it.
    pub progress: &'a dyn Progress,
}

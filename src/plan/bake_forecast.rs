//! What is predicted of new textures, and from what.

use serde::Serialize;

use crate::base::{bytes, counted};

/// Prediction for the new textures of a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BakeForecast {
    /// New images.
    pub images: u64,
    /// Texels of all images.
    pub texels: u64,
    /// Bytes of their files.
    pub bytes: u64,
    /// Images of the input that are read.
    pub input_images: u64,
    /// Their pixels.
    pub input_pixels: u64,
    /// Those of them that do not fit the memory and are read at a lower resolution.
    pub reduced_images: u64,
    /// Memory of the work, in bytes.
    #[serde(skip)]
    pub work_bytes: u64,
    /// Scratch space of what is kept of the input's surface until the end, in bytes.
    #[serde(skip)]
    pub surface_bytes: u64,
    /// Scratch space of what is read and written while textures are baked, in bytes.
    #[serde(skip)]
    pub baking_bytes: u64,
    /// Processor time in seconds.
    #[serde(skip)]
    pub core_seconds: f64,
}

/// What a run has and may take.
#[derive(Debug, Clone, Copy)]
pub struct BakeTask {
    /// Triangles of the input.
    pub faces: u64,
    /// Triangles of the result.
    pub target: u64,
    /// Threads.
    pub threads: usize,
    /// Memory in bytes.
    pub work_bytes: u64,
}

impl BakeForecast {
    /// The forecast for people.
    pub(super) fn words(&self) -> String {
        let (images, read) = (counted(self.images, "image"), counted(self.input_images, "image"));
        let [texels, pixels] =
            [self.texels, self.input_pixels].map(|count| format!("{:.1} million", count as f64 / 1e6));
        format!("about {images} of {texels} texels, {}, from {read} of {pixels} pixels", bytes::display(self.bytes))
    }
}

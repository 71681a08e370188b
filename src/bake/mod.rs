//! Bakes new textures for a simplified mesh: unwraps it patch by patch, and gives each texel the colour that the
//! original shows there.
//!
//! ```text
//! input ── original: cells with trees ────────────────────────╮
//!   │                                                         ▼
//!   ╰─ passes, without texture ──▶ result ── patches ── unwrap, paint, fill, encode ──▶ images, result with texture
//!                                                             ▲
//! images of the input ── texels: decoded once, in tiles ──────╯
//! ```
//! In: the mesh as it was read, the simplified mesh, the images of the input. Out: a mesh whose parts are images, and
//! these images. Invariant: the bytes depend on the mesh and the options, not on the memory (unless an image of the
//! input does not fit it) or the number of threads. A patch is done or not: after a kill, the patches that are done are
//! recalled.
//!
//! # Memory
//! A worker: 4.3 bytes for each texel of one image, the triangles of one patch (400
//! bytes each), 10 MiB for samples, and 3 MiB of tiles.

mod canvas;
mod closest;
mod encode;
mod original;
mod paint;
mod patch;
mod raster;
mod run;
mod sharpen;
mod texels;

use crate::job::StepKey;
use crate::model::image_format::ImageFormat;

pub use self::original::OriginalSurface;
pub use self::run::{Baked, BakedFigures, bake, geometry_catalogue, image_bytes};

/// Step that keeps the surface of the input.
pub const SURFACE: StepKey = StepKey::fixed("bake-surface");
/// Prefix of the steps that keep the images of the input.
const IMAGE: &str = "bake-image-";
/// Step that cuts the result into patches.
const PATCHES: StepKey = StepKey::fixed("bake-patches");
/// Prefix of the steps that bake patches.
const PATCH: &str = "bake-patch-";

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

/// What a bake may take of the machine.
#[derive(Debug, Clone, Copy)]
pub struct BakeLimits {
    /// Worker threads.
    pub threads: usize,
    /// Memory in bytes for work in flight.
    pub work_bytes: u64,
}

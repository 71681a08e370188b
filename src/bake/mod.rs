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
//! A patch: 4.3 bytes for each texel of one image, and its triangles (600 bytes each). A painter, of which there is one
//! for each thread: 7 MiB for samples, and 4 MiB of tiles.

pub mod arithmetic;
mod canvas;
mod catalogue;
mod closest;
mod crew;
mod density;
pub mod lend;
mod nearby;
mod original;
mod paint;
mod painters;
mod patch;
mod patch_surface;
mod plane;
mod plane_view;
mod points;
mod prism;
mod probe;
mod project;
mod raster;
mod run;
mod settings;
mod sharpen;
mod spheres;
mod steps;
#[cfg(test)]
mod testing;

pub use self::canvas::AtlasCanvas;
pub use self::catalogue::geometry_catalogue;
pub use self::original::{LengthHistogram, Original, OriginalSurface, TEXELS_OF_FACE, TexelSource};
pub use self::paint::Painted;
pub use self::painters::PAINTER_BYTES;
pub use self::patch::{PaintedImage, PatchBaker, PatchSettings};
pub use self::patch_surface::PatchSurface;
pub use self::probe::{ColourProbe, ProbedSquare};
pub use self::run::{BakeSize, Baked, BakedFigures, Unbaked, bake, image_bytes, patch_faces};
pub use self::settings::{BakePlace, BakeSettings};
pub use self::steps::{BakeStep, SURFACE};

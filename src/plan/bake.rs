//! Predicts what baking takes and gives: images, memory, scratch space, time.
//!
//! ```text
//! area in texture space of each part × pixels of its image ──▶ texels that the input shows ──▶ images, bytes, seconds
//! ```
//! In: how much of its images the input shows, and the headers of these. Out: a [`BakeForecast`]. Rates and bytes were
//! measured on 2026-11-26 on three surveys of 0.4 to 0.8 million triangles and a synthetic city.

use std::collections::BTreeSet;

use super::bake_forecast::{BakeForecast, BakeTask};
use crate::bake::{self, BakeSize, TEXELS_OF_FACE};
use crate::base::Findings;
use crate::base::id::TiVec;
use crate::image::decode::{self, DecodePlan};
use crate::image::textures::TextureImages;
use crate::model::id::ImageId;
use crate::model::image_format::ImageFormat;
use crate::model::texture_file::TextureReach;
use crate::options::{SimplifyOptions, TexturesOutside};
use crate::partition::cells::expected_count;
use crate::read::ShownTexture;

/// Share of an image that charts cover.
const FILL: f64 = 0.68;
/// Share of an image that is shown where no triangle could be measured.
const SHOWN_SHARE: f64 = 0.4;
/// Bytes of a texel of an image as PNG, and as JPEG.
const PNG_BYTES: f64 = 1.4;
const JPEG_BYTES: f64 = 0.25;
/// Bytes of scratch space for a triangle of the input's surface, for a pixel of its images, and for a triangle of the
/// textured result.
pub(super) const SURFACE_BYTES: f64 = 130.0;
const PIXEL_BYTES: f64 = 3.0;
const PIECE_BYTES: f64 = 24.0;
/// Pixels decoded, triangles of the input searched and texels baked in a second by one core.
const DECODE_PIXELS_PER_SECOND: f64 = 35e6;
const SEARCH_FACES_PER_SECOND: f64 = 100e3;
const TEXELS_PER_SECOND: f64 = 1.25e6;

/// Predicts a bake. Images that are missing are noted.
pub fn forecast(
    shown: &ShownTexture,
    task: &BakeTask,
    options: &SimplifyOptions,
    findings: &mut Findings,
) -> BakeForecast {
    let input = input_texels(shown, task, options.textures_outside, findings);
    let shown_texels = input.shown;
    let covered = options.texels * shown_texels;
    let texels = covered / FILL;
    let side = f64::from(options.atlas);
    let patch_faces = bake::patch_faces(covered, task.target, options.atlas);
    let count = expected_count(task.target, patch_faces, 0).max((texels / (side * side)).ceil() as u64);
    let bytes = texels * if options.image == ImageFormat::Png { PNG_BYTES } else { JPEG_BYTES };
    BakeForecast {
        images: count,
        texels: texels as u64,
        bytes: bytes as u64,
        input_images: input.images,
        input_pixels: input.pixels,
        reduced_images: input.reduced,
        work_bytes: {
            let size = BakeSize { texels: texels as u64, images: count, faces: task.target };
            size.expected_bytes(options.atlas, task.threads).max(input.decoding_bytes).min(task.work_bytes)
        },
        surface_bytes: (SURFACE_BYTES * task.faces as f64) as u64,
        baking_bytes: (PIXEL_BYTES * input.pixels as f64 + bytes + PIECE_BYTES * task.target as f64) as u64,
        core_seconds: input.pixels as f64 / DECODE_PIXELS_PER_SECOND
            + task.faces as f64 / SEARCH_FACES_PER_SECOND
            // Coarser texels are sampled at more places each.
            + covered.max(shown_texels * options.texels.sqrt()) / TEXELS_PER_SECOND,
    }
}

/// The images of the input.
pub(super) struct InputTexels {
    /// Texels that are shown.
    pub shown: f64,
    /// Images that can be read, their pixels, and those of them that do not fit the memory.
    pub images: u64,
    pub pixels: u64,
    pub reduced: u64,
    /// Memory while images are decoded on all threads, in bytes.
    pub decoding_bytes: u64,
}

/// Finds the images of the input. Those that are missing or refused are noted.
pub(super) fn input_texels(
    shown: &ShownTexture,
    task: &BakeTask,
    outside: TexturesOutside,
    findings: &mut Findings,
) -> InputTexels {
    let reach = TextureReach::of(&shown.catalogue, outside == TexturesOutside::Copy);
    let images = TextureImages::find(&shown.catalogue, &reach, findings);
    let plan_of = |image: ImageId| decode::plan(&images.files[image].path, task.work_bytes).ok();
    let plans: TiVec<ImageId, Option<DecodePlan>> = images.files.keys().map(plan_of).collect();
    let known = || plans.iter().flatten();
    InputTexels {
        shown: shown_texels(shown, &images, &plans, task.faces),
        images: known().count() as u64,
        pixels: known().map(|plan| plan.size.map(u64::from).iter().product::<u64>()).sum(),
        reduced: known().filter(|plan| plan.reduction > 1).count() as u64,
        decoding_bytes: known().map(|plan| plan.bytes).max().unwrap_or(0) * task.threads as u64,
    }
}

/// Texels of the input's images that its `faces` triangles show.
fn shown_texels(
    shown: &ShownTexture,
    images: &TextureImages,
    plans: &TiVec<ImageId, Option<DecodePlan>>,
    faces: u64,
) -> f64 {
    let pixels = |image: ImageId| Some(plans.get(image)?.as_ref()?.size.map(f64::from).iter().product::<f64>());
    let found: f64 = if shown.measured > 0 {
        let of_part =
            |(part, area): (_, &f64)| pixels(images.of_part[part]).map(|all| all * area * images.repeats(part));
        let measured: f64 = shown.areas.iter_enumerated().filter_map(of_part).sum();
        measured * faces as f64 / shown.measured as f64
    } else {
        let used: BTreeSet<ImageId> = images.of_part.iter().copied().collect();
        SHOWN_SHARE * used.into_iter().filter_map(pixels).sum::<f64>()
    };
    if found > 0.0 { found } else { TEXELS_OF_FACE * faces as f64 }
}

//! How the texture on the surface changed: colours, texture drift and seams, put together.
//!
//! In: what the points of both directions show, and the seams of both meshes. Out: [`Texture`]. Invariant: the result
//! depends on the memory budget only if an image does not fit it.
//!
//! # Files
//! Those of [`seams`](super::seams).

use super::cells::MeasuredMesh;
use super::contrast::{Pairs, compare_colours};
use super::direction::Direction;
use super::distribution::Distribution;
use super::options::{CompareOptions, SAMPLES};
use super::slide::{Atlas, Gaps};
use super::texture_pair::OriginalSide;
use crate::base::{Findings, Progress, Result};
use crate::measure::figures::{BeforeAfter, SeamFigures, Texture, share};

/// Bit of the seed that makes the points on seams differ from those on surfaces.
const SEAM_SEED: u64 = 1 << 62;

/// Compares the textures of `[original, result]`, whose points were measured `[forward, backward]`; `None` if one of
/// them shows no texture image that can be read.
///
/// # Errors
/// On a full disk, failed reads and writes.
pub fn compare(
    [before, after]: [&MeasuredMesh; 2],
    [forward, backward]: [&Direction; 2],
    limit: f64,
    options: &CompareOptions,
    findings: &mut Findings,
    progress: &dyn Progress,
) -> Result<Option<Texture>> {
    let known = [(forward, OriginalSide::Other), (backward, OriginalSide::Own)]
        .map(|(way, side)| way.filtered.as_ref().map(|colours| (colours, side)));
    let (Some(forward), Some(backward)) = (&forward.textures, &backward.textures) else { return Ok(None) };
    let resources = &options.resources;
    let contents = [before, after].map(|mesh| mesh.images.contents());
    let [old, new] = [(&before.images, &*contents[0]), (&after.images, &*contents[1])];
    let count = options.spread.by_area().unwrap_or(SAMPLES);
    let seam_points = |mesh: &MeasuredMesh| mesh.seams.points(mesh.folder(), count, options.seed ^ SEAM_SEED);
    let [old_seams, new_seams] = [seam_points(before)?, seam_points(after)?];
    let sets = [
        Pairs { column: forward, own: new, other: old, known: known[0] },
        Pairs { column: backward, own: old, other: new, known: known[1] },
        Pairs { column: &old_seams, own: old, other: old, known: None },
        Pairs { column: &new_seams, own: new, other: new, known: None },
    ];
    let colours = compare_colours(&sets, resources, findings, progress)?;
    if colours.images == 0 {
        return Ok(None);
    }
    let sources = [old, new].map(|(images, contents)| images.sources(contents, old));
    let [old_atlas, atlas] = sources.each_ref().map(|sources| Atlas::new(before, sources, limit, resources));
    let slides = atlas.slides(forward, progress)?;
    let [to_original, to_result, across_old, across_new] = [0, 1, 2, 3].map(|set| &colours.differences[set]);
    Ok(Some(Texture {
        colour_mean: to_original.mean(),
        colour_rms: to_original.rms(),
        colour_backward_mean: to_result.mean(),
        colour_backward_rms: to_result.rms(),
        slide_mean: slides.lengths.known(Distribution::mean),
        slide_median: slides.lengths.known(|lengths| lengths.quantile(0.5)),
        slide_p95: slides.lengths.known(|lengths| lengths.quantile(0.95)),
        slide_texels_median: slides.texels.known(|texels| texels.quantile(0.5)),
        slide_texels_p95: slides.texels.known(|texels| texels.quantile(0.95)),
        outside_fraction: share_of_some(slides.outside, slides.textured - slides.repeated),
        repeated_fraction: share(slides.repeated, slides.points),
        untextured_fraction: share(slides.points - slides.textured, slides.points),
        folded_triangles: after.counts.uv.folded_uv,
        folded_triangles_before: before.counts.uv.folded_uv,
        seams: BeforeAfter {
            before: seams(before, across_old, &old_atlas.gaps(&old_seams, &before.images, progress)?),
            after: seams(after, across_new, &atlas.gaps(&new_seams, &after.images, progress)?),
        },
        images: colours.images,
        reduced_images: colours.reduced,
    }))
}

/// The share of a part; `None` if the whole is empty.
fn share_of_some(part: u64, of: u64) -> Option<f64> {
    (of > 0).then(|| share(part, of))
}

fn seams(mesh: &MeasuredMesh, across: &Distribution, gaps: &Gaps) -> SeamFigures {
    SeamFigures {
        length: mesh.seams.length,
        colour_mean: across.mean(),
        colour_rms: across.rms(),
        gap_median: gaps.lengths.known(|lengths| lengths.quantile(0.5)),
        gap_p95: gaps.lengths.known(|lengths| lengths.quantile(0.95)),
        gap_texels_median: gaps.texels.known(|texels| texels.quantile(0.5)),
        gap_texels_p95: gaps.texels.known(|texels| texels.quantile(0.95)),
        outside_fraction: share_of_some(gaps.outside, gaps.textured),
    }
}

//! What new textures are baked from: what of the input is kept until then, as steps of the job, and its images.

use std::path::PathBuf;

use super::preflight::Preflight;
#[cfg(feature = "images")]
use crate::bake::{self, OriginalSurface};
#[cfg(feature = "images")]
use crate::base::Findings;
use crate::base::Result;
#[cfg(feature = "images")]
use crate::image::textures::TextureImages;
use crate::job::{StepKey, WorkFolder};
use crate::model::Catalogue;
#[cfg(feature = "images")]
use crate::model::texture_file::TextureReach;

/// Steps whose files stay until textures are baked.
#[cfg(feature = "images")]
pub(super) const KEPT_STEPS: &[StepKey] = &[bake::SURFACE];
/// Steps whose files stay until textures are baked: none.
#[cfg(not(feature = "images"))]
pub(super) const KEPT_STEPS: &[StepKey] = &[];

/// Whether an earlier process kept the surface of the input.
///
/// # Errors
/// Those of the work folder.
#[cfg(feature = "images")]
pub(super) fn has_original(work: &WorkFolder) -> Result<bool> {
    Ok(OriginalSurface::recall(work)?.is_some())
}

/// Whether the surface of the input was kept: nothing needs it.
#[cfg(not(feature = "images"))]
pub(super) fn has_original(_work: &WorkFolder) -> Result<bool> {
    Ok(true)
}

/// The images of the input that new textures may show; notes those that are missing or refused.
#[cfg(feature = "images")]
pub(super) fn find_images(job: &Preflight<'_>, catalogue: &Catalogue, findings: &mut Findings) -> TextureImages {
    TextureImages::find(catalogue, &TextureReach::of(catalogue, job.brings_outside()), findings)
}

/// The files of these images.
#[cfg(feature = "images")]
pub(super) fn baked_images(job: &Preflight<'_>, catalogue: &Catalogue) -> Vec<PathBuf> {
    find_images(job, catalogue, &mut Findings::default()).files.into_iter().map(|file| file.path).collect()
}

/// The files of the images that new textures may show: none.
#[cfg(not(feature = "images"))]
pub(super) fn baked_images(_: &Preflight<'_>, _: &Catalogue) -> Vec<PathBuf> {
    Vec::new()
}

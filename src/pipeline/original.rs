//! What new textures are baked from: what of the input is kept until then, as steps of the job, and its images.

use std::path::PathBuf;

#[cfg(feature = "images")]
use crate::bake::{self, OriginalSurface};
#[cfg(feature = "images")]
use crate::base::Findings;
use crate::base::Result;
#[cfg(feature = "images")]
use crate::image::textures::TextureImages;
use crate::job::{StepKey, WorkFolder};
use crate::model::Catalogue;
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

/// The image files whose texels new textures show.
#[cfg(feature = "images")]
pub(super) fn baked_images(catalogue: &Catalogue, reach: &TextureReach) -> Vec<PathBuf> {
    let images = TextureImages::find(catalogue, reach, &mut Findings::default());
    images.files.into_iter().map(|file| file.path).collect()
}

/// The image files whose texels new textures show: none.
#[cfg(not(feature = "images"))]
pub(super) fn baked_images(_: &Catalogue, _: &TextureReach) -> Vec<PathBuf> {
    Vec::new()
}

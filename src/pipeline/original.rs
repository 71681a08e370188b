//! What of the input is kept until new textures are baked, as steps of the job.

#[cfg(feature = "images")]
use crate::bake::{self, OriginalSurface};
use crate::base::Result;
use crate::job::{StepKey, WorkFolder};

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

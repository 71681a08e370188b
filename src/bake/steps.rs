//! The steps of a bake, by which a work folder knows them.

use crate::job::StepKey;

/// Step that keeps the surface of the input.
pub const SURFACE: StepKey = StepKey::fixed("bake-surface");
/// Prefix of the steps that keep the images of the input.
pub(super) const IMAGE: &str = "bake-image-";
/// Step that cuts the result into patches.
pub(super) const PATCHES: StepKey = StepKey::fixed("bake-patches");
/// Prefix of the steps that bake patches.
pub(super) const PATCH: &str = "bake-patch-";

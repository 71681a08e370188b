//! Stands in for baking where the crate is built without the feature `images`: nothing is baked, and options that ask
//! for it were refused.

use super::admission::Admission;
use super::input::Input;
use super::preflight::Preflight;
use crate::base::{Findings, Progress, Result};
use crate::job::{StepKey, WorkFolder};
use crate::model::{Catalogue, StoredMesh};
use crate::passes::{Passes, ResumePoint};
use crate::report::BakeFigures;

/// Steps whose files stay until textures are baked: none.
pub(super) const KEPT_STEPS: &[StepKey] = &[];

/// Whether the surface of the input was kept: nothing needs it.
pub(super) fn has_original(_work: &WorkFolder) -> Result<bool> {
    Ok(true)
}

/// A result with new textures: there is none.
pub(super) struct TexturedResult {
    pub mesh: StoredMesh,
    pub catalogue: Catalogue,
    pub figures: BakeFigures,
    pub findings: Findings,
}

/// Bakes nothing.
pub(super) struct Texturing<'a> {
    input: &'a Input,
}

impl<'a> Texturing<'a> {
    pub fn prepare(
        _: &'a Preflight<'a>,
        input: &'a Input,
        _: &mut ResumePoint,
        _: &WorkFolder,
        _: &Admission,
        _: &dyn Progress,
    ) -> Result<Self> {
        Ok(Self { input })
    }

    pub fn catalogue(&self) -> &Catalogue {
        &self.input.catalogue
    }

    pub fn bake(self, _: &Passes, _: &WorkFolder, _: &dyn Progress) -> Result<Option<TexturedResult>> {
        Ok(None)
    }
}

//! Stands in for baking where the crate is built without the feature `images`: nothing is baked, and options that ask
//! for it were refused.

use super::admission::Admission;
use super::input::Input;
use super::preflight::Preflight;
use crate::base::{Findings, Progress, Result};
use crate::job::WorkFolder;
use crate::model::{Catalogue, StoredMesh};
use crate::passes::{Passes, ResumePoint};
use crate::report::BakeFigures;

/// A result with new textures: there is none.
pub(super) struct UntexturedResult {
    pub mesh: StoredMesh,
    pub catalogue: Catalogue,
    pub figures: BakeFigures,
    pub work_bytes: u64,
    pub findings: Findings,
}

/// Bakes nothing.
pub(super) struct NoTexturing<'a> {
    input: &'a Input,
}

impl<'a> NoTexturing<'a> {
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

    pub fn bake(self, _: &Passes, _: &WorkFolder, _: &dyn Progress) -> Result<Option<UntexturedResult>> {
        Ok(None)
    }
}

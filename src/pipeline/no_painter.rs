//! Stands in for the painter where the crate is built without the feature `report`: draws nothing.

use std::convert::Infallible;

use super::admission::Admission;
use super::preflight::Preflight;
use super::publish::FinalMesh;
use crate::base::{Findings, Progress, Result};
use crate::job::WorkFolder;
use crate::model::{Catalogue, StoredMesh};
use crate::render::View;

/// Renderings: there are none.
pub(super) type NoShots = Option<Infallible>;

/// Memory of drawing in bytes.
pub(super) fn peak_bytes(_work_bytes: u64) -> u64 {
    0
}

/// Draws nothing.
pub(super) struct NoPainter;

impl NoPainter {
    pub fn new(_: &Preflight<'_>, _: &Catalogue, _: &WorkFolder, _: &Admission, _: &dyn Progress) -> Self {
        Self
    }

    pub fn draw_before(&mut self, _: Option<&StoredMesh>, _: &mut Findings) -> Result<()> {
        Ok(())
    }

    pub fn draw_after(&mut self, _: &FinalMesh<'_>, _: &mut Findings) {}

    pub fn map(&self) -> Option<View> {
        None
    }

    pub fn shots(self) -> NoShots {
        None
    }
}

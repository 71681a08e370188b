//! Admits a job once its input is known, and sets what its phases may take.

use super::input::Input;
use super::original::KEPT_STEPS;
use super::preflight::Preflight;
use crate::base::Result;
use crate::job::WorkFolder;
use crate::model::Catalogue;
use crate::passes::{PassOptions, ResumePoint};
use crate::render::View;

/// Width and height of a map of the clusters, in pixels.
pub(super) const MAP_SIZE: [usize; 2] = [600, 400];
/// Memory that a map takes, in bytes.
const MAP_BYTES: u64 = (MAP_SIZE[0] * MAP_SIZE[1]) as u64 * 16;

/// What a job may take, once its input is known.
pub(super) struct Admission {
    /// Faces wanted; 0 for as few as a bound on the error allows.
    pub target: u64,
    /// Memory in bytes for work in flight, beside what stays resident.
    pub work_bytes: u64,
}

impl Admission {
    /// Admits a job whose input was read.
    ///
    /// # Errors
    /// [`Error::Budget`] and [`Error::NoSpace`], with the size that would suffice.
    pub fn admit(job: &Preflight<'_>, input: &Input, start: &ResumePoint, work: &WorkFolder) -> Result<Self> {
        input.need.check(job.budget, job.options, work.path(), start.needs_scratch())?;
        let work_bytes = job.budget.for_work() - input.need.resident_bytes();
        Ok(Self { target: job.options.target(input.triangles), work_bytes })
    }

    /// Options of the passes; `map` is the viewpoint of the maps of clusters.
    ///
    /// # Errors
    /// [`Error::Usage`] for settings that the metric does not have.
    pub fn pass_options(
        &self,
        job: &Preflight<'_>,
        catalogue: &Catalogue,
        triangles: u64,
        map: Option<View>,
    ) -> Result<PassOptions> {
        let map_bytes = if map.is_some() { MAP_BYTES } else { 0 };
        let work_bytes = self.work_bytes.saturating_sub(map_bytes);
        let options = job.options.pass_options(triangles, catalogue.has_texcoords)?;
        let kept_steps = if job.options.bakes() { KEPT_STEPS } else { &[] };
        Ok(PassOptions { map, threads: job.threads, work_bytes, kept_steps, ..options })
    }
}

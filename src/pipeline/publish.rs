//! Writes the result under its final name, and measures it meanwhile.

use std::time::{Duration, Instant};

use super::input::Input;
use super::output::{self, Earlier, EarlierOutput};
use super::preflight::Preflight;
use crate::base::ordered::both;
use crate::base::{Progress, Result};
use crate::job::{Step, StepKey, WorkFolder};
use crate::measure::gauge::{Gauged, gauge};
use crate::model::{Catalogue, StoredMesh};
use crate::options::{Normals, TextureFiles, UpAxis};
use crate::passes::Passes;
use crate::write::{self, RESULT, WriteOptions, Written};

/// The result, written and measured.
pub(super) struct Published {
    /// Files of the result.
    pub written: Written,
    /// Deviation from the input at some thousand points; `None` if the input or the result has no area.
    pub measured: Option<Gauged>,
    /// Time for writing.
    pub write_time: Duration,
    /// Time that measuring took beyond writing.
    pub measure_time: Duration,
    /// Whether an earlier process had begun the job.
    pub is_resumed: bool,
}

/// The mesh that is written, and its parts and materials.
#[derive(Clone, Copy)]
pub(super) struct FinalMesh<'a> {
    pub mesh: &'a StoredMesh,
    pub catalogue: &'a Catalogue,
}

/// Writes the result of a job.
pub(super) struct Publisher<'a> {
    job: &'a Preflight<'a>,
    input: &'a Input,
    earlier: EarlierOutput,
    options: WriteOptions,
}

impl<'a> Publisher<'a> {
    /// Prepares to write the result. Refuses one whose files cannot be written or would replace others.
    ///
    /// # Errors
    /// Those of [`write::check_output`].
    pub fn prepare(
        job: &'a Preflight<'a>,
        input: &'a Input,
        earlier: EarlierOutput,
        work: &WorkFolder,
    ) -> Result<Self> {
        let options = WriteOptions {
            textures: job.options.textures.into(),
            brings_outside: job.brings_outside(),
            normals: job.options.normals == Normals::Auto && input.catalogue.has_normals,
            turns_z_up: job.options.up == UpAxis::Z,
            force: job.options.job.force,
            replaces_own: earlier.is_own(),
            work_bytes: job.budget.for_work(),
            sources: input.sources(),
            job: work.number(),
        };
        if job.options.bakes() {
            write::check_baked_output(job.output, &options, earlier.was_writing)?;
        } else {
            write::check_output(job.output, &input.catalogue, &options, earlier.was_writing)?;
        }
        Ok(Self { job, input, earlier, options })
    }

    /// Writes the result unless an earlier process did. Writing takes one thread most of the time, so the result is
    /// measured beside it.
    ///
    /// # Errors
    /// Those of [`write::stage`], of [`Staged::commit`](write::Staged::commit) and of the work folder.
    pub fn write_and_measure(
        self,
        result: &FinalMesh<'_>,
        passes: &Passes,
        work: &WorkFolder,
        progress: &dyn Progress,
    ) -> Result<Published> {
        let is_resumed = work.is_resumed();
        let started = Instant::now();
        let write = || {
            let written = match &self.earlier.found {
                // If the job was restarted on the way, nothing shows that the earlier result follows from the input as
                // it is now.
                Earlier::Whole(written) if is_resumed => written.clone(),
                _ => self.write(result, &passes.step, work, progress)?,
            };
            progress.begin("measure", 0, "");
            Ok((written, started.elapsed()))
        };
        let (written, measured) = both(self.job.threads, write, || gauge(&passes.probes, &passes.mesh, progress));
        let ((written, write_time), measured) = (written?, measured?);
        Ok(Published { written, measured, write_time, measure_time: started.elapsed() - write_time, is_resumed })
    }

    /// Writes the result, which follows from the mesh that a step recorded.
    ///
    /// # Errors
    /// Those of [`write::stage`], of [`Staged::commit`](write::Staged::commit) and of the work folder.
    pub fn write(
        &self,
        result: &FinalMesh<'_>,
        step: &StepKey,
        work: &WorkFolder,
        progress: &dyn Progress,
    ) -> Result<Written> {
        let Self { job, input, options, .. } = self;
        output::remember(work, job.output)?;
        let staged = write::stage(result.mesh, result.catalogue, job.output, work.path(), options, progress)?;
        if job.options.textures == TextureFiles::Copy {
            input.check_textures(&staged, options.brings_outside)?;
        }
        progress.check_stopped()?;
        work.wait_until_durable()?;
        let step = Step::new(RESULT).from([step.clone()]).of_size(staged.written().faces);
        work.keep(step, [], staged.written())?;
        // Without this record, a result that has its final name already would be taken for that of another job.
        work.sync()?;
        work.confirm()?;
        staged.commit(progress)
    }
}

//! The phases in order: read, partition and simplify in passes, write.
//!
//! Everything that can be refused is refused first. Each phase records what it finished in the work folder, and the
//! same call resumes after the last record.

mod admission;
#[cfg(feature = "images")]
mod bake_onto;
mod damage;
mod files;
mod input;
mod lend_scan;
mod original;
mod output;
#[cfg(not(feature = "report"))]
mod no_painter;
#[cfg(feature = "report")]
mod painter;
mod paths;
mod preflight;
mod publish;
mod requirements;
mod run_log;
#[cfg(not(feature = "images"))]
mod no_texturing;
mod task;
#[cfg(feature = "images")]
mod texturing;
#[cfg(feature = "images")]
mod tile;
#[cfg(test)]
mod tests;

use std::path::Path;

use self::admission::Admission;
use self::damage::report_damage;
#[cfg(not(feature = "report"))]
use self::no_painter::NoPainter as Painter;
#[cfg(not(feature = "images"))]
use self::no_texturing::NoTexturing as Texturing;
use self::output::EarlierOutput;
#[cfg(feature = "report")]
use self::painter::Painter;
use self::preflight::Preflight;
use self::publish::{FinalMesh, Publisher};
use self::run_log::{FinishedRun, RunLog};
#[cfg(feature = "images")]
use self::texturing::Texturing;
use crate::base::pool::{Durability, durability};
use crate::base::{Progress, Result};
use crate::job::WorkFolder;
use crate::model::Catalogue;
use crate::options::SimplifyOptions;
use crate::os::timeline::Recorder;
use crate::passes::{PassKind, PassOptions, Passes, ResumePoint, Run};
use crate::read::InputChoice;
use crate::report::Report;

#[cfg(feature = "images")]
pub use self::bake_onto::bake_onto;
pub use self::preflight::work_folder;
pub use self::task::{TaskEnd, do_task};
#[cfg(feature = "images")]
pub use self::tile::tile;

/// Simplifies meshes in files, or in all files below folders, into one file.
///
/// # Errors
/// [`Error::Usage`](crate::base::Error::Usage) and [`Error::Budget`](crate::base::Error::Budget) before anything is
/// read; see [`Error`](crate::base::Error) for the rest. Whatever happens, an older output stays whole until the new
/// one is complete. Finished work is kept in the work folder: the same call resumes it.
pub fn simplify(
    input: impl Into<InputChoice>,
    output: &Path,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<Report> {
    simplify_and(input, output, options, progress, |_, _| Ok(()))
}

/// As [`simplify`], but calls `then` with the report and the job's number before it ends the job. If `then` fails, the
/// next call finds the result written and repeats nothing else.
///
/// # Errors
/// Those of [`simplify`] and of `then`.
pub fn simplify_and(
    input: impl Into<InputChoice>,
    output: &Path,
    options: &SimplifyOptions,
    progress: &dyn Progress,
    then: impl FnOnce(&Report, u64) -> Result<()>,
) -> Result<Report> {
    let job = Preflight::check(input.into(), output, options)?;
    let recorder = Recorder::start(progress);
    job.run(progress, |work| {
        let report = run(&job, work, &recorder)?;
        let report = Report { timeline: recorder.finish(), ..report };
        then(&report, work.number())?;
        Ok(report)
    })
}

/// Files → columns → clusters → fewer triangles → file.
fn run(job: &Preflight<'_>, work: &mut WorkFolder, progress: &dyn Progress) -> Result<Report> {
    let mut log = RunLog::start();
    let earlier = EarlierOutput::look(job, work)?;
    let (input, mut start) = log.time(|seconds| &mut seconds.scan, || input::read(job, work, progress))?;
    log.findings.merge(input.findings.clone());
    log.findings.merge(job.idle.clone());
    let admitted = Admission::admit(job, &input, &start, work)
        .and_then(|admission| Ok((admission, Publisher::prepare(job, &input, earlier, work)?)));
    if admitted.is_err() && !work.is_resumed() && durability() == Durability::Result {
        // The scan of a short job is not worth keeping for a command that the user has to change.
        work.give_up();
    }
    let (admission, publisher) = admitted?;

    let mut painter = Painter::new(job, &input.catalogue, work, &admission, progress);
    log.time_with(|seconds| &mut seconds.draw, |log| painter.draw_before(start.unsimplified(), &mut log.findings))?;
    let texturing = Texturing::prepare(job, &input, &mut start, work, &admission, progress)?;
    let options = admission.pass_options(job, texturing.catalogue(), input.triangles, painter.map())?;
    let passes = simplify_in_passes(start, &options, texturing.catalogue(), work, progress);
    report_damage(work, progress);
    let passes = passes?;
    if passes.faces == 0 {
        work.give_up();
        return Err(input::nothing_left(job, &input));
    }

    let baked = log.time(|seconds| &mut seconds.bake, || texturing.bake(&passes, work, progress))?;
    let result = match &baked {
        Some(baked) => FinalMesh { mesh: &baked.mesh, catalogue: &baked.catalogue },
        None => FinalMesh { mesh: &passes.mesh, catalogue: &input.catalogue },
    };
    let published = publisher.write_and_measure(&result, &passes, work, progress)?;
    log.time_with(|seconds| &mut seconds.draw, |log| painter.draw_after(&result, &mut log.findings));
    let bake = baked.map(|baked| {
        log.findings.merge(baked.findings);
        (baked.figures, baked.work_bytes)
    });
    let shots = painter.shots();
    Ok(log.report(FinishedRun { job, input: &input, admission: &admission, passes, bake, published, shots, work }))
}

/// Partitions the mesh and simplifies its clusters, repeatedly.
///
/// # Errors
/// On a full disk, failed reads or writes, and damaged files; [`Error::Stopped`](crate::base::Error::Stopped).
pub fn simplify_in_passes(
    start: ResumePoint,
    options: &PassOptions,
    catalogue: &Catalogue,
    work: &WorkFolder,
    progress: &dyn Progress,
) -> Result<Passes> {
    let mut run = Run::resume(start, options, catalogue, work, progress)?;
    while let Some(pass) = run.next_pass() {
        let partition = run.partition(pass)?;
        match pass.kind {
            PassKind::Remesh(settings) => run.remesh(pass, &settings, &partition)?,
            PassKind::Collapse => {
                let stops = run.choose_stops(pass, &partition)?;
                run.simplify_clusters(pass, &partition, &stops)?;
            }
        }
    }
    run.finish()
}

//! Does a task of a job that another process coordinates.

use std::path::Path;

use super::lend_scan;
#[cfg(feature = "images")]
use crate::bake::lend as bake;
use crate::base::error::escape_path;
use crate::base::pool::Pool;
use crate::base::{Error, Progress, Result, WorkLimits};
use crate::job::stage::{BUILD, Stage, StageTask, note_failure};
use crate::options::{Limits, SimplifyOptions};
use crate::passes::{lend_remesh, lend_sweep};
use crate::plan::memory;
#[cfg(feature = "images")]
use crate::tile::lend as tile;

/// How a task ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TaskEnd {
    /// This process did it.
    Done,
    /// It had results.
    WasDone,
    /// The job does not wait for it any more: nothing was changed.
    Over,
    /// There is no file of the stage: the job is over, or the path is wrong.
    NoStage,
}

/// Does the task `index` of a stage; `stage` is the path of its file.
///
/// # Errors
/// [`Error::Usage`] for an index that the stage does not have, [`Error::Changed`] if this is another program or its
/// results would differ, [`Error::Damaged`] for a damaged file; on a full disk, failed reads and writes.
pub fn do_task(stage: &Path, index: usize, limits: Limits, progress: &dyn Progress) -> Result<TaskEnd> {
    let found = match Stage::open(stage) {
        Ok(Some(found)) => found,
        Ok(None) => return Ok(TaskEnd::NoStage),
        Err(error) => {
            note_failure(stage, index, &error);
            return Err(error);
        }
    };
    let task = found.task(index)?;
    if found.is_done(task) {
        return Ok(TaskEnd::WasDone);
    }
    let done = work(&found, task, limits, progress);
    match &done {
        Ok(()) => found.forget_failure(index),
        Err(_) if !found.is_under_way() => return Ok(TaskEnd::Over),
        Err(error) => note_failure(stage, index, error),
    }
    done.map(|()| TaskEnd::Done)
}

/// What a task of a kind counts.
fn unit_of(kind: &str) -> &'static str {
    match kind {
        #[cfg(feature = "images")]
        tile::TILE => "tiles",
        lend_scan::SCAN => "B",
        _ => "faces",
    }
}

fn work(stage: &Stage, task: &StageTask, limits: Limits, progress: &dyn Progress) -> Result<()> {
    let shown = escape_path(&stage.path());
    if stage.build() != BUILD {
        let message = format!("{shown}: made by drystone {}; this is drystone {BUILD}", stage.build());
        return Err(Error::Changed(message));
    }
    let budget = memory::choose_budget(&SimplifyOptions { limits, ..SimplifyOptions::default() })?;
    let threads = memory::choose_threads(limits.threads, budget);
    let limits = WorkLimits { threads, work_bytes: budget.for_work() };
    progress.begin("task", task.amount, unit_of(stage.kind()));
    Pool::new(threads)?.run(progress, || match stage.kind() {
        #[cfg(feature = "images")]
        bake::BAKE => bake::do_task(stage, task, limits, progress),
        #[cfg(feature = "images")]
        tile::TILE => tile::do_task(stage, task, limits, progress),
        lend_scan::SCAN => lend_scan::do_task(stage, task, memory::scan_options(budget, threads), limits, progress),
        lend_remesh::REMESH => lend_remesh::do_task(stage, task, limits, progress),
        lend_sweep::SWEEP => lend_sweep::do_task(stage, task, limits, progress),
        _ => Err(Error::Damaged { path: stage.path(), message: "it holds tasks of no known kind".into() }),
    })
}

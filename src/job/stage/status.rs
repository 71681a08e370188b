//! How far the tasks of a stage are, as anybody sees who looks at its folder.

use std::path::Path;

use super::folder::{STAGE_FILE, TAKEN, stages};
use super::results::RESULTS;
use super::stage_file::{Stage, StageTask};
use crate::base::Result;

/// State of a stage, readable while its tasks are done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StageStatus {
    /// What is done.
    pub kind: String,
    /// Number of its tasks.
    pub tasks: u64,
    /// Number of those that have results.
    pub tasks_done: u64,
    /// Number of those without results that failed.
    pub tasks_failed: u64,
    /// Why the last of these failed.
    pub failure: Option<String>,
}

/// Looks at the stages in a work folder; there is at most one, unless an old one was left.
///
/// # Errors
/// [`Error::Damaged`](crate::base::Error::Damaged) for a stage that is not as it was written.
pub fn look_at_stages(work: &Path) -> Result<Vec<StageStatus>> {
    let found = stages(work).into_iter().filter_map(|folder| Stage::open(&folder.join(STAGE_FILE)).transpose());
    found.map(|stage| Ok(StageStatus::of(&stage?))).collect()
}

impl StageStatus {
    fn of(stage: &Stage) -> Self {
        let is_done = |task: &&StageTask| stage.file_of(task, RESULTS).exists() || stage.file_of(task, TAKEN).exists();
        let left: Vec<(usize, &StageTask)> =
            stage.tasks().iter().enumerate().filter(|(_, task)| !is_done(task)).collect();
        let failures: Vec<_> = left.iter().filter_map(|&(number, _)| Some((number, stage.failure(number)?))).collect();
        let tasks = stage.tasks().len() as u64;
        Self {
            kind: stage.kind().to_owned(),
            tasks,
            tasks_done: tasks - left.len() as u64,
            tasks_failed: failures.len() as u64,
            failure: failures.last().map(|(number, failure)| failure.clone().into_error(*number).to_string()),
        }
    }
}

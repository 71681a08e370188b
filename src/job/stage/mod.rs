//! Stages: independent tasks of a job that other processes may do, on this machine or on others.
//!
//! ```text
//!  the job                              any process that sees the work folder
//!  stage-<id>/stage.bin  ── Hands ────▶ reads the stage, does a task
//!  (waits)               ◀────────────  <task>.piece, then <task>.results: each synced, then renamed
//!  both move to the work folder; one entry of the journal for each task
//! ```
//! In: the tasks, and an order that says how to do them. Out: their results, as files of the work folder. Invariants: a
//! task depends on the stage alone, so every process that does it writes the same bytes; results count once they have
//! their names; a folder is named for the content of its stage, so that a process that comes late never meets another
//! stage there.
//!
//! # Files
//! In the folder of a stage: `stage.bin`; for each task its files and `<task>.results`; `task-<number>.error` where it
//! failed last; `<task>.taken` once its results are in the work folder. Temporary names carry a number of their process.

mod failure;
mod folder;
mod hands;
mod lend;
mod results;
mod runner;
mod stage_file;
mod status;

pub use failure::note_failure;
pub use folder::stages;
pub(super) use folder::{is_stage_folder, remove_stages, sizes};
pub use hands::{Hands, HandsEnd, Lending, SharedHands};
pub use lend::LentTask;
pub use results::TaskWriter;
pub use runner::TaskRunner;
pub use stage_file::{BUILD, Order, Stage, StageTask};
pub use status::{StageStatus, look_at_stages};

//! Who does the tasks of a stage.

use std::fmt::Debug;
use std::ops::Deref;
use std::sync::Arc;
use std::time::Duration;

use super::stage_file::Stage;
use crate::base::{Progress, Result};

/// Shared file systems show a new file to other machines after this time at the latest.
const PATIENCE: Duration = Duration::from_secs(90);

/// What hands believe of the tasks of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HandsEnd {
    /// All are done; on a shared disk their results may take time to appear.
    Done,
    /// Some may not be done.
    Unsure {
        /// Exit code of what had them done, if that was a program.
        exit_code: Option<i32>,
    },
}

/// Has tasks of stages done, wherever that is: [`do_task`](crate::pipeline::do_task) does one.
///
/// What was done is seen by the results; what this returns says only how long to wait for them.
pub trait Hands: Debug + Send + Sync {
    /// Has the tasks of a stage done that have no results yet; returns once it will have no more of them done. It may do
    /// a task several times, and leave others out: the stage is then lent again.
    ///
    /// # Errors
    /// If no task can be done ever; [`Error::Stopped`](crate::base::Error::Stopped) if `progress` asks for it.
    fn lend(&self, stage: &Stage, progress: &dyn Progress) -> Result<HandsEnd>;

    /// How long names of finished files may take to appear, once all tasks are done.
    fn patience(&self) -> Duration {
        PATIENCE
    }
}

/// Hands that several owners share.
#[derive(Debug, Clone)]
pub struct SharedHands(Arc<dyn Hands>);

impl<H: Hands + 'static> From<Arc<H>> for SharedHands {
    fn from(hands: Arc<H>) -> Self {
        Self(hands)
    }
}

impl Deref for SharedHands {
    type Target = dyn Hands;

    fn deref(&self) -> &Self::Target {
        &*self.0
    }
}

impl PartialEq for SharedHands {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Eq for SharedHands {}

/// How a job has its tasks done elsewhere.
#[derive(Debug, Clone)]
pub struct Lending {
    /// Who does them.
    pub hands: SharedHands,
    /// Tasks of a stage, at most.
    pub tasks: u32,
    /// How often a stage is lent until all of its tasks have results.
    pub tries: u32,
}

impl Lending {
    /// Default of `tasks`.
    pub const TASKS: u32 = 64;
    /// Default of `tries`.
    pub const TRIES: u32 = 3;
}

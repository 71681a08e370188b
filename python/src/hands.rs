//! Tasks of a job that a Python function has done.
//!
//! ```text
//! job's thread: lend ── request ──▶ caller's thread ──▶ start(tasks), which starts a thread of Python's own ──╮
//!       ▲ waits                                                                                               │
//!       ╰──────────────────────────────────────────── tasks.end(…) ◀──────────────────────────────────────────╯
//! ```

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, bounded, unbounded};
use drystone::job::stage::{Hands, HandsEnd, Stage};
use drystone::{Error, Progress, Result};
use pyo3::prelude::*;

/// Time between two looks at whether the job is to stop.
const INTERVAL: Duration = Duration::from_millis(100);
/// Time in which the function may end by itself once the job is to stop.
const GRACE: Duration = Duration::from_secs(3);

/// How a function ends that may have left tasks out.
const UNSURE: HandsEnd = HandsEnd::Unsure { exit_code: None };

/// Hands over the tasks of stages to the thread that called the job.
#[derive(Debug)]
pub struct PythonHands {
    requests: Sender<StageTasks>,
    is_stopped: Arc<AtomicBool>,
    raised: Raised,
}

/// The exception of a function that has tasks done.
pub type Raised = Arc<Mutex<Option<PyErr>>>;

impl PythonHands {
    /// Hands, and what they hand over; both end with the job that `is_stopped` stops.
    pub fn new(is_stopped: Arc<AtomicBool>) -> (Self, Receiver<StageTasks>) {
        let (requests, receiver) = unbounded();
        (Self { requests, is_stopped, raised: Raised::default() }, receiver)
    }

    /// Where the exception will be.
    pub fn raised(&self) -> Raised {
        Arc::clone(&self.raised)
    }
}

impl Hands for PythonHands {
    fn lend(&self, stage: &Stage, progress: &dyn Progress) -> Result<HandsEnd> {
        let (ended, end) = bounded(1);
        let path = std::path::absolute(stage.path()).unwrap_or_else(|_| stage.path());
        let (is_stopped, raised) = (Arc::clone(&self.is_stopped), Arc::clone(&self.raised));
        let tasks = StageTasks { stage: path, count: stage.tasks().len(), is_stopped, raised, ended };
        // Without a receiver nobody waits for the job, which is stopped then.
        let _ = self.requests.send(tasks);
        let mut stopping: Option<Instant> = None;
        loop {
            let received = end.recv_timeout(INTERVAL);
            let is_stopped = progress.is_stopped();
            if is_stopped {
                // The job may also have lost its work folder, which the caller cannot know.
                self.is_stopped.store(true, Ordering::Relaxed);
            }
            return match received {
                Err(RecvTimeoutError::Timeout) if !is_stopped => continue,
                Err(RecvTimeoutError::Timeout) if stopping.get_or_insert_with(Instant::now).elapsed() < GRACE => {
                    continue;
                }
                _ if is_stopped => Err(Error::Stopped),
                Ok(end) => Ok(end),
                Err(_) => Ok(UNSURE),
            };
        }
    }
}

/// Tasks of a stage that are to be done.
#[pyclass(module = "drystone", frozen)]
#[derive(Debug)]
pub struct StageTasks {
    /// The stage's file.
    #[pyo3(get)]
    stage: PathBuf,
    /// Number of its tasks.
    #[pyo3(get)]
    count: usize,
    is_stopped: Arc<AtomicBool>,
    raised: Raised,
    ended: Sender<HandsEnd>,
}

#[pymethods]
impl StageTasks {
    /// Whether the job is to stop.
    fn is_stopped(&self) -> bool {
        self.is_stopped.load(Ordering::Relaxed)
    }

    /// No more tasks will be done: all of them are, maybe not all, or the exception ends the job.
    #[pyo3(signature = (is_done, error=None))]
    fn end(&self, is_done: bool, error: Option<Bound<'_, PyAny>>) {
        if let Some(error) = error {
            *self.raised.lock().unwrap_or_else(PoisonError::into_inner) = Some(PyErr::from_value(error));
            self.is_stopped.store(true, Ordering::Relaxed);
        }
        // The job may be over.
        let _ = self.ended.try_send(if is_done { HandsEnd::Done } else { UNSURE });
    }
}

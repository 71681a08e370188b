//! Runs a job on a thread of its own, while the caller's thread waits without the GIL.
//!
//! The caller's thread wakes ten times a second: it hands events to the listener and looks for signals, so that no
//! thread of the job ever runs Python. If a signal handler or the listener raises, the job is stopped at its next safe place,
//! and the exception comes out.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};
use std::thread::Builder;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, bounded};
use drystone::job::stage::SharedHands;
use drystone::{Progress, Result};
use pyo3::prelude::*;

use crate::errors::{exception, forked, panicked};
use crate::events::{Event, Listener};
use crate::hands::{PythonHands, Raised, StageTasks};

/// Time between two looks.
const INTERVAL: Duration = Duration::from_millis(100);

/// Stops a job from another thread: pass it as `stop=`, and call `set()`.
#[pyclass(module = "drystone", frozen)]
#[derive(Debug, Default)]
pub struct Stop(Arc<AtomicBool>);

#[pymethods]
impl Stop {
    /// A token that is not set.
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// Asks every job that has this token to stop.
    fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether the token is set.
    fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Does the work on a new thread; returns what it returns. `start` starts what has tasks of the job done.
///
/// # Errors
/// The exception for the error or the panic of the work; that of a signal handler, of the listener or of `start`. After a second
/// signal, the thread is left to itself: it stops, too, but nobody waits for it.
pub fn run<T: Send + 'static>(
    py: Python<'_>,
    listener: Option<&Bound<'_, PyAny>>,
    stop: Option<&Stop>,
    start: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(Option<SharedHands>, &dyn Progress) -> Result<T> + Send + 'static,
) -> PyResult<T> {
    let process = std::process::id();
    // The job has a flag of its own: an exception stops this job, and no other that has the same token.
    let is_stopped = Arc::new(AtomicBool::new(stop.is_some_and(Stop::is_set)));
    let events = Arc::new(Listener::new(Arc::clone(&is_stopped)));
    let (hands, requests) = PythonHands::new(Arc::clone(&is_stopped));
    let raised = hands.raised();
    let hands = start.is_some().then(|| SharedHands::from(Arc::new(hands)));
    let (sender, receiver) = bounded(1);
    let theirs = Arc::clone(&events);
    let job = move || {
        let outcome = catch_unwind(AssertUnwindSafe(|| work(hands, &*theirs)));
        if matches!(outcome, Ok(Ok(_))) {
            theirs.finish();
        }
        // Nobody may be waiting any more.
        let _ = sender.send(outcome);
    };
    Builder::new().name("drystone".to_owned()).spawn(job)?;
    let hands = start.map(|start| HandsOfCaller { start, requests, raised });
    let mut waiter = Waiter { events, is_stopped, listener, stop, hands, raised: None };
    loop {
        let received = py.detach(|| receiver.recv_timeout(INTERVAL));
        let looked = waiter.look(py);
        // Only code that was called just now may have forked. The job is its parent's, even where it ended meanwhile.
        if std::process::id() != process {
            let raised = waiter.raised.take();
            // Their locks may be held by threads that are not in this process.
            std::mem::forget((receiver, waiter));
            return Err(raised.unwrap_or_else(|| forked(py)));
        }
        looked?;
        let outcome = match received {
            Err(RecvTimeoutError::Timeout) => continue,
            Err(RecvTimeoutError::Disconnected) => return Err(panicked(py, &"the job's thread is gone")),
            Ok(outcome) => outcome,
        };
        return match (waiter.raised, outcome) {
            (Some(error), outcome) => {
                if matches!(outcome, Ok(Ok(_))) {
                    let _ = error.value(py).call_method1("add_note", ("the job had ended: its result is complete",));
                }
                Err(error)
            }
            (None, Ok(Ok(done))) => Ok(done),
            (None, Ok(Err(error))) => Err(exception(py, &error)),
            (None, Err(panic)) => Err(panicked(py, &*panic)),
        };
    }
}

/// What the caller's thread does while it waits.
struct Waiter<'a, 'py> {
    events: Arc<Listener>,
    is_stopped: Arc<AtomicBool>,
    listener: Option<&'a Bound<'py, PyAny>>,
    stop: Option<&'a Stop>,
    hands: Option<HandsOfCaller<'a, 'py>>,
    /// The first exception of a signal handler, of the listener or of the hands; the job was asked to stop then.
    raised: Option<PyErr>,
}

impl Waiter<'_, '_> {
    /// Looks for signals, and hands over what happened.
    ///
    /// # Errors
    /// The exception for a signal after another exception: then nobody waits any more.
    fn look(&mut self, py: Python<'_>) -> PyResult<()> {
        if self.stop.is_some_and(Stop::is_set) {
            self.is_stopped.store(true, Ordering::Relaxed);
        }
        match (py.check_signals(), &self.raised) {
            (Err(error), Some(_)) => return Err(error),
            (Err(error), None) => self.raise(error),
            (Ok(()), Some(_)) => {}
            (Ok(()), None) => {
                let hands = self.hands.as_ref().map_or(Ok(()), HandsOfCaller::look);
                if let Err(error) = hand_over(self.events.take(), self.listener).and(hands) {
                    self.raise(error);
                }
            }
        }
        Ok(())
    }

    fn raise(&mut self, error: PyErr) {
        self.is_stopped.store(true, Ordering::Relaxed);
        self.raised = Some(error);
    }
}

/// What has tasks of the job done.
struct HandsOfCaller<'a, 'py> {
    start: &'a Bound<'py, PyAny>,
    requests: Receiver<StageTasks>,
    raised: Raised,
}

impl HandsOfCaller<'_, '_> {
    /// Has the tasks done that the job asks for.
    ///
    /// # Errors
    /// The exception of what has them done.
    fn look(&self) -> PyResult<()> {
        if let Some(error) = self.raised.lock().unwrap_or_else(PoisonError::into_inner).take() {
            return Err(error);
        }
        self.requests.try_iter().try_for_each(|tasks| self.start.call1((tasks,)).map(drop))
    }
}

fn hand_over(events: Vec<Event>, listener: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
    let Some(listener) = listener else { return Ok(()) };
    for Event { phase, done, total, unit, message } in events {
        listener.call1((phase, done, total, unit, message))?;
    }
    Ok(())
}

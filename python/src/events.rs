//! Progress of a job on its way to a Python function: noted by the threads of the job, handed over by the caller's.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use drystone::Progress;

/// Most events that wait; of a phase that is over, only its beginning and its end wait.
const WAITING_MAX: usize = 10_000;

/// What happened.
#[derive(Debug, Clone, Default)]
pub struct Event {
    /// The phase; empty for a message outside of phases.
    pub phase: &'static str,
    /// Units that are done.
    pub done: u64,
    /// Units of the phase; 0 if unknown.
    pub total: u64,
    /// What is counted.
    pub unit: &'static str,
    /// A message for the user.
    pub message: Option<String>,
}

/// Listens to a job, and stops it.
#[derive(Debug)]
pub struct Listener {
    is_stopped: Arc<AtomicBool>,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    waiting: VecDeque<Event>,
    phase: Option<Event>,
    /// Units of the phase that were handed over.
    told: u64,
}

impl Listener {
    /// A listener that stops the job once the flag is set.
    pub fn new(is_stopped: Arc<AtomicBool>) -> Self {
        Self { is_stopped, state: Mutex::default() }
    }

    /// Takes what happened since the last call.
    pub fn take(&self) -> Vec<Event> {
        let mut state = self.state();
        let mut events = Vec::from(std::mem::take(&mut state.waiting));
        if let Some(phase) = state.phase.clone().filter(|phase| phase.done > state.told) {
            state.told = phase.done;
            events.push(phase);
        }
        events
    }

    /// Ends the last phase, after the job.
    pub fn finish(&self) {
        self.state().end();
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn push(&mut self, event: Event) {
        if self.waiting.len() < WAITING_MAX {
            self.waiting.push_back(event);
        }
    }

    /// Ends the phase: all of its units are done. Where their number is unknown, nobody else can see that.
    fn end(&mut self) {
        if let Some(phase) = self.phase.take() {
            let done = phase.done.max(phase.total);
            if phase.total == 0 || done > self.told {
                self.push(Event { done, ..phase });
            }
        }
    }
}

impl Progress for Listener {
    fn begin(&self, phase: &'static str, total: u64, unit: &'static str) {
        let mut state = self.state();
        state.end();
        let event = Event { phase, done: 0, total, unit, message: None };
        state.push(event.clone());
        (state.phase, state.told) = (Some(event), 0);
    }

    fn tell(&self, message: &str) {
        let mut state = self.state();
        let phase = state.phase.clone().unwrap_or_default();
        state.push(Event { message: Some(message.to_owned()), ..phase });
    }

    fn is_stopped(&self) -> bool {
        self.is_stopped.load(Ordering::Relaxed)
    }

    fn advance(&self, units: u64) {
        if let Some(phase) = &mut self.state().phase {
            phase.done += units;
            if phase.total > 0 {
                phase.done = phase.done.min(phase.total);
            }
        }
    }
}

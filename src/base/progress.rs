//! Reports the progress of a run, and lets the listener stop it.

use super::{Error, Result};

/// Listener to the progress of a run; calls may come from any thread.
pub trait Progress: Sync + Send {
    /// A phase begins; it has `total` units (bytes, faces, clusters) of work.
    fn begin(&self, phase: &'static str, total: u64, unit: &'static str);
    /// A pass over all clusters begins, counted from 1; `begin` follows for each of its phases.
    fn begin_pass(&self, _number: usize) {}
    /// A message for the user, such as what is resumed.
    fn tell(&self, _message: &str) {}
    /// Whether the run should stop at the next safe point, with [`Error::Stopped`].
    fn is_stopped(&self) -> bool {
        false
    }
    /// `units` more units of the current phase are done.
    fn advance(&self, units: u64);
}

impl dyn Progress + '_ {
    /// Returns an error if the run should stop.
    ///
    /// # Errors
    /// [`Error::Stopped`].
    pub fn check_stopped(&self) -> Result<()> {
        if self.is_stopped() { Err(Error::Stopped) } else { Ok(()) }
    }
}

/// Listener that ignores everything and never stops the run.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _phase: &'static str, _total: u64, _unit: &'static str) {}
    fn advance(&self, _units: u64) {}
}

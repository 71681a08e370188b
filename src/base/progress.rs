//! How a run tells how far it is, and hears that it shall stop.

use super::{Error, Result};

/// Receives the progress of a run; every call may come from any thread.
pub trait Progress: Sync + Send {
    /// A phase begins; it has `total` units (bytes, faces, clusters) to do.
    fn begin(&self, phase: &'static str, total: u64, unit: &'static str);
    /// A pass over all clusters begins, counted from 1; `begin` follows for each of its phases.
    fn begin_pass(&self, _number: usize) {}
    /// Something that a person should know, such as what is gone on with.
    fn tell(&self, _message: &str) {}
    /// Whether the run shall stop at the next safe place; it ends with [`Error::Stopped`].
    fn is_stopped(&self) -> bool {
        false
    }
    /// `units` more units of the current phase are done.
    fn advance(&self, units: u64);
}

impl dyn Progress + '_ {
    /// Ends the work if the run shall stop.
    ///
    /// # Errors
    /// [`Error::Stopped`].
    pub fn check_stopped(&self) -> Result<()> {
        if self.is_stopped() { Err(Error::Stopped) } else { Ok(()) }
    }
}

/// Tells nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _phase: &'static str, _total: u64, _unit: &'static str) {}
    fn advance(&self, _units: u64) {}
}

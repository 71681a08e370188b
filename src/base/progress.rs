//! How a run tells how far it is.

/// Receives the progress of a run; every call may come from any thread.
pub trait Progress: Sync + Send {
    /// A phase begins; it has `total` units (bytes, faces, clusters) to do.
    fn begin(&self, phase: &'static str, total: u64, unit: &'static str);
    /// `units` more units of the current phase are done.
    fn advance(&self, units: u64);
}

/// Tells nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn begin(&self, _phase: &'static str, _total: u64, _unit: &'static str) {}
    fn advance(&self, _units: u64) {}
}

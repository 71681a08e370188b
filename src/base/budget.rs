//! The memory budget that the user sets, and permits that keep the work within it.
//!
//! Who holds what: a worker takes a [`Permit`] for the bytes that a cluster (or a block, or a chunk) will need *before*
//! it allocates them, and returns it by dropping it after they are freed. A worker holds at most one permit and waits
//! for nothing else meanwhile, so there is no deadlock. A request larger than the whole budget is granted once no other
//! permit is held, so that it runs alone instead of never. [`map_within`](super::ordered::map_within) takes permits in
//! the order of its items instead, and a result holds its permit until it is committed.
//!
//! Memory that grows with the input and is never freed, such as names, has an [`Allowance`] instead: if it is exceeded,
//! waiting would not help.

use std::path::Path;
use std::sync::{Condvar, Mutex};

use super::error::escape_path;
use super::lock::lock;
use super::{Error, Result, bytes};

/// Resident memory that the process may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryBudget {
    /// Total bytes, including code and mapped pages.
    pub bytes: u64,
}

impl MemoryBudget {
    /// Smallest accepted budget.
    pub const FLOOR_BYTES: u64 = 128 << 20;
    /// Memory of the process in any case: code, stacks, tables, allocator overhead.
    pub const FIXED_BYTES: u64 = 28 << 20;

    /// Bytes left for work after the fixed part.
    pub fn for_work(&self) -> u64 {
        self.bytes.saturating_sub(Self::FIXED_BYTES)
    }
}

/// What a phase may take of the machine.
#[derive(Debug, Clone, Copy)]
pub struct WorkLimits {
    /// Worker threads.
    pub threads: usize,
    /// Memory in bytes for work in flight.
    pub work_bytes: u64,
}

/// A counting semaphore over bytes.
#[derive(Debug)]
pub struct Permits {
    capacity: u64,
    state: Mutex<PermitState>,
    returned: Condvar,
}

#[derive(Debug, Default)]
struct PermitState {
    held: u64,
    holders: u64,
    peak: u64,
    /// Bytes that are kept without a permit.
    kept: u64,
}

impl Permits {
    /// Permits for `capacity` bytes in total.
    pub fn new(capacity: u64) -> Self {
        Self { capacity, state: Mutex::new(PermitState::default()), returned: Condvar::new() }
    }

    /// Waits until `bytes` are free, and takes them. A request beyond the capacity waits until no permit is held.
    pub fn take(&self, bytes: u64) -> Permit<'_> {
        let mut state = self.lock();
        while state.holders > 0 && state.kept.saturating_add(state.held).saturating_add(bytes) > self.capacity {
            state = self.returned.wait(state).unwrap_or_else(|poisoned| poisoned.into_inner());
        }
        state.held += bytes;
        state.holders += 1;
        state.peak = state.peak.max(state.held);
        Permit { permits: self, bytes }
    }

    /// Sets how many bytes of the capacity are kept without a permit, because what takes them stays.
    pub fn keep(&self, bytes: u64) {
        self.lock().kept = bytes;
    }

    /// Returns the bytes that are lacking for a request beside what is kept; 0 if it fits once it is alone.
    pub fn lacking(&self, bytes: u64) -> u64 {
        self.lock().kept.saturating_add(bytes).saturating_sub(self.capacity)
    }

    /// Largest number of bytes held at once.
    pub fn peak(&self) -> u64 {
        self.lock().peak
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, PermitState> {
        lock(&self.state)
    }
}

/// Bytes taken from [`Permits`]; returned on drop.
#[derive(Debug)]
pub struct Permit<'a> {
    permits: &'a Permits,
    bytes: u64,
}

impl Permit<'_> {
    /// Number of bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

impl Drop for Permit<'_> {
    fn drop(&mut self) {
        let mut state = self.permits.lock();
        state.held -= self.bytes;
        state.holders -= 1;
        self.permits.returned.notify_all();
    }
}

/// Memory for data that grows with the input and is kept.
#[derive(Debug)]
pub struct Allowance {
    most: u64,
    taken: u64,
    /// Bytes of the same memory that something else has for now.
    lent: u64,
}

impl Allowance {
    /// Allows `most` bytes in total.
    pub fn new(most: u64) -> Self {
        Self { most, taken: 0, lent: 0 }
    }

    /// Charges bytes on account of the file `path`.
    ///
    /// # Errors
    /// [`Error::Budget`] that names the file if the allowance is exceeded.
    pub fn take(&mut self, bytes: u64, path: &Path) -> Result<()> {
        self.taken = self.taken.saturating_add(bytes);
        if self.taken.saturating_add(self.lent) <= self.most {
            return Ok(());
        }
        let message = format!(
            "{}: names and materials take more than the {} of memory that there is for them; see `memory`",
            escape_path(path),
            bytes::display(self.most.saturating_sub(self.lent)),
        );
        Err(Error::Budget { needed: None, message })
    }

    /// Sets the bytes of the same memory that something else has for now.
    pub fn lend(&mut self, bytes: u64) {
        self.lent = bytes;
    }

    /// Bytes taken so far.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// Credits bytes that were freed.
    pub fn give_back(&mut self, bytes: u64) {
        self.taken = self.taken.saturating_sub(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ErrorKind;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[test]
    fn permits_never_exceed_the_capacity() {
        let permits = Permits::new(100);
        let held = AtomicU64::new(0);
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..50 {
                        let _permit = permits.take(40);
                        assert!(held.fetch_add(40, Ordering::SeqCst) + 40 <= 100);
                        held.fetch_sub(40, Ordering::SeqCst);
                    }
                });
            }
        });
        assert!(permits.peak() <= 100);
    }

    #[test]
    fn an_allowance_is_refused_once_it_is_used_up() {
        let mut allowance = Allowance::new(10);
        allowance.take(8, Path::new("a.obj")).unwrap();
        allowance.give_back(3);
        allowance.take(5, Path::new("a.obj")).unwrap();
        let error = allowance.take(1, Path::new("a.mtl")).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Budget);
        assert!(error.to_string().contains("a.mtl"), "{error}");
        assert!(allowance.take(u64::MAX, Path::new("a.mtl")).is_err());
    }

    #[test]
    fn what_is_kept_and_lent_leaves_less_for_the_rest() {
        let permits = Permits::new(10);
        permits.keep(4);
        assert_eq!([6, 9, u64::MAX].map(|bytes| permits.lacking(bytes)), [0, 3, u64::MAX - 10]);
        drop(permits.take(9));
        let mut allowance = Allowance::new(10);
        allowance.lend(4);
        allowance.take(6, Path::new("a.obj")).unwrap();
        assert!(allowance.take(1, Path::new("a.obj")).unwrap_err().to_string().contains("than the 6 B"));
        allowance.lend(0);
        allowance.take(3, Path::new("a.obj")).unwrap();
        assert_eq!(allowance.taken(), 10);
    }

    #[test]
    fn a_request_beyond_the_capacity_runs_alone() {
        let permits = Permits::new(10);
        drop(permits.take(50));
        let _small = permits.take(5);
    }
}

//! Locks of which a panic in another thread spoils nothing: whatever a thread changes under one is whole at any time.

use std::sync::{Mutex, MutexGuard};

/// Locks a mutex, even if a thread panicked while it held the lock.
pub fn lock<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
}

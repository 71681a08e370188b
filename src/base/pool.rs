//! The thread pool of a job's data-parallel loops.
//!
//! Each job has a pool of its own; rayon's global pool stays untouched, so that a host program can use it as it likes.
//! The job's thread enters the pool, and the threads that [`threads`](super::threads) starts from there inherit it.

use std::cell::{Cell, RefCell};
use std::path::Path;
use std::sync::{Arc, OnceLock};

use super::{Error, Result};

thread_local! {
    /// The pool that this thread has entered.
    static ENTERED: RefCell<Option<Pool>> = const { RefCell::new(None) };
    /// Whether this thread belongs to a pool whose files need not outlast a power cut.
    static SKIPS_SYNC: Cell<bool> = const { Cell::new(false) };
}

/// A thread pool.
#[derive(Debug, Clone)]
pub struct Pool {
    threads: Arc<rayon::ThreadPool>,
    syncs: bool,
}

/// A thread in a pool, until this is dropped.
#[derive(Debug)]
#[must_use]
pub struct InPool {
    before: Option<Pool>,
}

impl Pool {
    /// Starts `threads` threads; 0 for one per processor.
    ///
    /// # Errors
    /// [`Error::Io`] if the system refuses them.
    pub fn new(threads: usize) -> Result<Self> {
        Self::start(threads, true)
    }

    /// As [`new`](Self::new), for work whose files need not outlast a power cut: see [`skips_sync`].
    ///
    /// # Errors
    /// Those of [`new`](Self::new).
    pub fn without_sync(threads: usize) -> Result<Self> {
        Self::start(threads, false)
    }

    fn start(threads: usize, syncs: bool) -> Result<Self> {
        let begin = move |_| SKIPS_SYNC.set(!syncs);
        match rayon::ThreadPoolBuilder::new().num_threads(threads).start_handler(begin).build() {
            Ok(pool) => Ok(Self { threads: Arc::new(pool), syncs }),
            Err(error) => {
                let error = std::io::Error::other(format!("{error}; `threads: 1` needs fewer"));
                Err(Error::io(Path::new("threads"), "start", error))
            }
        }
    }

    /// Lets the data-parallel loops of this thread run in the pool.
    pub fn enter(self) -> InPool {
        InPool { before: ENTERED.replace(Some(self)) }
    }

    /// The pool that this thread has entered.
    pub fn entered() -> Option<Self> {
        ENTERED.with_borrow(Clone::clone)
    }

    /// The pool of threads that have entered none: tests, benchmarks and single functions called from outside.
    fn fallback() -> Option<Self> {
        static POOL: OnceLock<Option<Pool>> = OnceLock::new();
        POOL.get_or_init(|| Self::new(0).ok()).clone()
    }
}

impl Drop for InPool {
    fn drop(&mut self) {
        ENTERED.set(self.before.take());
    }
}

/// Whether files that this thread writes need not outlast a power cut: they are not synced then.
pub fn skips_sync() -> bool {
    SKIPS_SYNC.get() || ENTERED.with_borrow(|pool| pool.as_ref().is_some_and(|pool| !pool.syncs))
}

/// Runs a data-parallel loop in the pool that this thread has entered.
pub fn in_parallel<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    // A thread of a pool works there.
    if rayon::current_thread_index().is_some() {
        return work();
    }
    match Pool::entered().or_else(Pool::fallback) {
        Some(pool) => pool.threads.install(work),
        None => work(),
    }
}

/// Number of threads of the pool.
pub fn thread_count() -> usize {
    in_parallel(rayon::current_num_threads)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loops_run_in_the_pool_entered_last() {
        let outer = Pool::new(3).unwrap().enter();
        assert_eq!(thread_count(), 3);
        let inner = Pool::new(2).unwrap().enter();
        assert_eq!(thread_count(), 2);
        drop(inner);
        assert_eq!(thread_count(), 3);
        drop(outer);
        assert!(Pool::entered().is_none());
    }

    #[test]
    fn all_threads_of_a_pool_without_sync_skip_it() {
        use crate::base::threads;
        let seen = || {
            let pool = in_parallel(|| rayon::broadcast(|_| skips_sync()));
            let beside = std::thread::scope(|scope| threads::start(scope, skips_sync).unwrap().join().unwrap());
            (skips_sync(), pool, beside)
        };
        let inside = Pool::without_sync(2).unwrap().enter();
        assert_eq!(seen(), (true, vec![true; 2], true));
        drop(inside);
        let _inside = Pool::new(2).unwrap().enter();
        assert_eq!(seen(), (false, vec![false; 2], false));
    }

    #[test]
    fn a_loop_in_a_loop_stays_in_its_pool() {
        let _inside = Pool::new(2).unwrap().enter();
        assert_eq!(in_parallel(thread_count), 2);
    }
}

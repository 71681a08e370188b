//! The thread pool of a job's data-parallel loops.
//!
//! Each job has a pool of its own; rayon's global pool stays untouched, so that a host program can use it as it likes.
//! The job's thread enters the pool, and the threads that [`threads`](super::threads) starts from there inherit it.
//!
//! A job that is to stop tells its pool: [`check_stopped`] fails on all of its threads then. Loops over items look by
//! themselves ([`ordered`](super::ordered)), once an item is committed; long work on one item looks in between.

use std::cell::RefCell;
use std::ops::Range;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use super::ticker::ticking;
use super::{Error, Progress, Result};

/// Time between two looks at whether a job is to stop.
const LOOK_INTERVAL: Duration = Duration::from_millis(50);
/// Items that a loop does between two such looks: some milliseconds of work.
pub const BLOCK_ITEMS: usize = 1 << 16;

thread_local! {
    /// The pool that this thread has entered.
    static ENTERED: RefCell<Option<Pool>> = const { RefCell::new(None) };
    /// What holds for the pool that this thread belongs to.
    static TERMS: RefCell<Option<Arc<Terms>>> = const { RefCell::new(None) };
}

/// A thread pool.
#[derive(Debug, Clone)]
pub struct Pool {
    threads: Arc<rayon::ThreadPool>,
    terms: Arc<Terms>,
}

/// Which files of a job must outlast a power cut; these are synced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Durability {
    /// All that the job needs to be resumed, and its result.
    #[default]
    All,
    /// The result alone: the job is so short that it may as well start over.
    Result,
    /// None.
    None,
}

/// What holds for all threads of a pool.
#[derive(Debug)]
struct Terms {
    durability: Durability,
    is_stopped: AtomicBool,
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
        Self::with(threads, Durability::All)
    }

    /// As [`new`](Self::new), for work of which only some files must outlast a power cut: see [`durability`].
    ///
    /// # Errors
    /// Those of [`new`](Self::new).
    pub fn with(threads: usize, durability: Durability) -> Result<Self> {
        let terms = Arc::new(Terms { durability, is_stopped: AtomicBool::new(false) });
        let theirs = Arc::clone(&terms);
        let begin = move |_| TERMS.set(Some(Arc::clone(&theirs)));
        match rayon::ThreadPoolBuilder::new().num_threads(threads).start_handler(begin).build() {
            Ok(pool) => Ok(Self { threads: Arc::new(pool), terms }),
            Err(error) => {
                let error = std::io::Error::other(format!("{error}; `threads: 1` needs fewer"));
                Err(Error::io(Path::new("threads"), "start", error))
            }
        }
    }

    /// Runs `work` in the pool; its loops fail with [`Error::Stopped`] once `progress` asks for that.
    ///
    /// # Errors
    /// Those of `work`; [`Error::Stopped`].
    pub fn run<T>(self, progress: &dyn Progress, work: impl FnOnce() -> Result<T>) -> Result<T> {
        let terms = Arc::clone(&self.terms);
        let look = move || {
            if progress.is_stopped() {
                terms.is_stopped.store(true, Ordering::Relaxed);
            }
        };
        look();
        // Without a thread for it, the job stops where it asks `progress` itself.
        ticking(LOOK_INTERVAL, look, || {
            let _inside = self.enter();
            work()
        })
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

/// Which files that this thread writes must outlast a power cut.
pub fn durability() -> Durability {
    of_terms(|terms| terms.durability).unwrap_or_default()
}

/// Returns an error if the job of this thread is to stop. Costs some nanoseconds.
///
/// # Errors
/// [`Error::Stopped`].
pub fn check_stopped() -> Result<()> {
    match of_terms(|terms| terms.is_stopped.load(Ordering::Relaxed)) {
        Some(true) => Err(Error::Stopped),
        _ => Ok(()),
    }
}

/// The ranges of [`BLOCK_ITEMS`] that cover `0..count`, for a loop over many items that looks once a block.
///
/// # Errors
/// [`Error::Stopped`] in place of the next range, if the job of this thread is to stop.
pub fn blocks_until_stopped(count: usize) -> impl Iterator<Item = Result<Range<usize>>> {
    (0..count).step_by(BLOCK_ITEMS).map(move |start| {
        check_stopped()?;
        Ok(start..count.min(start + BLOCK_ITEMS))
    })
}

/// What holds for the pool that this thread has entered, or else for the one that it belongs to.
fn of_terms<T>(what: impl Fn(&Terms) -> T) -> Option<T> {
    let entered = ENTERED.with_borrow(|pool| pool.as_ref().map(|pool| what(&pool.terms)));
    entered.or_else(|| TERMS.with_borrow(|terms| terms.as_deref().map(&what)))
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
pub(super) mod tests {
    use super::*;
    use crate::base::threads;

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
    fn all_threads_of_a_pool_know_which_files_must_last() {
        let seen = || {
            let pool = in_parallel(|| rayon::broadcast(|_| durability()));
            let beside = std::thread::scope(|scope| threads::start(scope, durability).unwrap().join().unwrap());
            (durability(), pool, beside)
        };
        for kind in [Durability::All, Durability::Result, Durability::None] {
            let _inside = Pool::with(2, kind).unwrap().enter();
            assert_eq!(seen(), (kind, vec![kind; 2], kind));
        }
    }

    /// Stops the job from the start.
    pub struct AtOnce;

    impl Progress for AtOnce {
        fn begin(&self, _phase: &'static str, _total: u64, _unit: &'static str) {}

        fn advance(&self, _units: u64) {}

        fn is_stopped(&self) -> bool {
            true
        }
    }

    #[test]
    fn all_threads_of_a_pool_learn_that_its_job_is_to_stop() {
        let until_stopped = || {
            while check_stopped().is_ok() {
                std::thread::yield_now();
            }
        };
        let everywhere = || {
            until_stopped();
            in_parallel(|| rayon::broadcast(|_| until_stopped()));
            std::thread::scope(|scope| threads::start(scope, until_stopped).unwrap().join().unwrap());
            check_stopped()
        };
        let outcome = Pool::new(2).unwrap().run(&AtOnce, everywhere);
        assert!(matches!(outcome, Err(Error::Stopped)));
        assert!(check_stopped().is_ok());
    }

    #[test]
    fn a_loop_in_a_loop_stays_in_its_pool() {
        let _inside = Pool::new(2).unwrap().enter();
        assert_eq!(in_parallel(thread_count), 2);
    }
}

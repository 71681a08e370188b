//! Starts threads, which inherit the pool of the thread that starts them. If the system refuses some, fewer do the work, or the caller does it; nothing panics.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle, Scope, ScopedJoinHandle};

use super::pool::Pool;
use super::{Error, Result};

/// Starts a scoped thread.
///
/// # Errors
/// [`Error::Io`] if the system refuses it.
pub fn start<'scope, T: Send + 'scope>(
    scope: &'scope Scope<'scope, '_>,
    work: impl FnOnce() -> T + Send + 'scope,
) -> Result<ScopedJoinHandle<'scope, T>> {
    start_boxed(scope, Box::new(work))
}

fn start_boxed<'scope, T: Send + 'scope>(
    scope: &'scope Scope<'scope, '_>,
    work: Box<dyn FnOnce() -> T + Send + 'scope>,
) -> Result<ScopedJoinHandle<'scope, T>> {
    let refused = |e| Error::io(Path::new("a thread"), "start", e);
    #[cfg(test)]
    tests::give_one().map_err(refused)?;
    Builder::new().spawn_scoped(scope, inheriting(work)).map_err(refused)
}

/// Work of a new thread, in the pool that this thread has entered.
fn inheriting<T>(work: impl FnOnce() -> T) -> impl FnOnce() -> T {
    let pool = Pool::entered();
    move || {
        let _inside = pool.map(Pool::enter);
        work()
    }
}

/// Succeeds if at least one of several threads started.
///
/// # Errors
/// The first error if none started.
pub fn at_least_one(started: impl Iterator<Item = Result<()>>) -> Result<()> {
    // Start all of them before looking at any outcome.
    let outcomes: Vec<Result<()>> = started.collect();
    let any = outcomes.iter().any(Result::is_ok);
    outcomes.into_iter().next().map_or(Ok(()), |first| if any { Ok(()) } else { first })
}

/// Work that one of several threads does.
#[derive(Debug)]
pub struct Task<F>(Mutex<Option<F>>);

impl<T, F: FnOnce() -> T> Task<F> {
    /// Creates work that has not begun.
    pub fn new(work: F) -> Self {
        Self(Mutex::new(Some(work)))
    }

    /// Runs the work; `None` if it has already begun elsewhere.
    pub fn run(&self) -> Option<T> {
        let work = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        work.map(|work| work())
    }
}

/// Runs work on a new thread, or at once if the system refuses one; then returns `None`.
///
/// # Errors
/// Those of the work if it ran at once.
pub fn beside<F: FnOnce() -> Result<()> + Send + 'static>(work: F) -> Result<Option<JoinHandle<Result<()>>>> {
    let task = Arc::new(Task::new(work));
    let theirs = Arc::clone(&task);
    match Builder::new().spawn(inheriting(move || theirs.run().unwrap_or(Ok(())))) {
        Ok(thread) => Ok(Some(thread)),
        Err(_) => task.run().unwrap_or(Ok(())).map(|()| None),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::cell::Cell;

    use super::*;

    thread_local! {
        /// Number of threads that the system grants to this thread.
        static LEFT: Cell<usize> = const { Cell::new(usize::MAX) };
    }

    /// Runs with this many threads available.
    pub fn with_threads<T>(threads: usize, run: impl FnOnce() -> T) -> T {
        LEFT.set(threads);
        let outcome = run();
        LEFT.set(usize::MAX);
        outcome
    }

    pub fn give_one() -> std::io::Result<()> {
        let left = LEFT.get().checked_sub(1).ok_or(std::io::ErrorKind::WouldBlock)?;
        LEFT.set(left);
        Ok(())
    }

    #[test]
    fn one_thread_of_several_is_enough() {
        let refused = || Err(Error::Limit("no".into()));
        assert!(at_least_one([refused(), Ok(()), refused()].into_iter()).is_ok());
        assert!(at_least_one([refused(), refused()].into_iter()).is_err());
    }

    #[test]
    fn a_task_is_done_once() {
        let task = Task::new(|| 7);
        assert_eq!((task.run(), task.run()), (Some(7), None));
    }

    #[test]
    fn work_beside_ends_with_its_own_outcome() {
        let thread = beside(|| Err(Error::Stopped)).unwrap();
        assert!(matches!(thread.unwrap().join().unwrap(), Err(Error::Stopped)));
    }
}

//! Threads, which the system may refuse: then fewer do the work, or the caller does it, and nothing panics.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{Builder, JoinHandle, Scope, ScopedJoinHandle};

use super::{Error, Result};

/// Starts a thread of a scope.
///
/// # Errors
/// [`Error::Io`] if the system refuses one.
pub fn start<'scope, T: Send + 'scope>(
    scope: &'scope Scope<'scope, '_>,
    work: impl FnOnce() -> T + Send + 'scope,
) -> Result<ScopedJoinHandle<'scope, T>> {
    Builder::new().spawn_scoped(scope, work).map_err(|e| Error::io(Path::new("a thread"), "start", e))
}

/// Of threads that were to start: fewer do the work if the system refuses some.
///
/// # Errors
/// The first one if none started.
pub fn at_least_one(started: impl Iterator<Item = Result<()>>) -> Result<()> {
    // All of them are started before one is looked at.
    let outcomes: Vec<Result<()>> = started.collect();
    let any = outcomes.iter().any(Result::is_ok);
    outcomes.into_iter().next().map_or(Ok(()), |first| if any { Ok(()) } else { first })
}

/// A piece of work that one of several does.
#[derive(Debug)]
pub struct Task<F>(Mutex<Option<F>>);

impl<T, F: FnOnce() -> T> Task<F> {
    /// Work that nobody has begun.
    pub fn new(work: F) -> Self {
        Self(Mutex::new(Some(work)))
    }

    /// Does it; nothing if somebody has begun it.
    pub fn run(&self) -> Option<T> {
        let work = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        work.map(|work| work())
    }
}

/// Does work on a thread of its own, or at once where the system refuses one; then there is no thread to wait for.
///
/// # Errors
/// Those of the work if it was done at once.
pub fn beside<F: FnOnce() -> Result<()> + Send + 'static>(work: F) -> Result<Option<JoinHandle<Result<()>>>> {
    let task = Arc::new(Task::new(work));
    let theirs = Arc::clone(&task);
    match Builder::new().spawn(move || theirs.run().unwrap_or(Ok(()))) {
        Ok(thread) => Ok(Some(thread)),
        Err(_) => task.run().unwrap_or(Ok(())).map(|()| None),
    }
}

/// Makes the threads that data-parallel loops share, unless there are some.
///
/// # Errors
/// [`Error::Io`] if the system refuses them.
pub fn make_pool(threads: usize) -> Result<()> {
    match rayon::ThreadPoolBuilder::new().num_threads(threads).build_global() {
        // The other reason is that it is there already.
        Err(error) if std::error::Error::source(&error).is_some() => {
            Err(Error::io(Path::new("threads"), "start", std::io::Error::other(error)))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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

//! Maps items in parallel and commits the results in order.
//!
//! Workers take items one by one; the calling thread commits the results in the order of the items. At most `in_flight`
//! items are taken but not committed yet, which bounds the memory of waiting results. No thread holds a result while it
//! waits for another one: the committer keeps early results in a map of at most that size.
//!
//! Where items differ much in size, [`map_within`] bounds the bytes instead: an item takes a permit for what it and its
//! result need, in the order of the items, and holds it until the result is committed.
//!
//! Work that waits for the disk is *finished* on separate threads, so that workers never sleep while there are items. (A
//! worker that wakes up is often placed on a busy core, and the system takes up to 30 ms to notice that another one is
//! idle.)

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use super::lock::lock;
use super::pool::{check_stopped, thread_count};
use super::threads::{Task, at_least_one, start};
use super::{Permits, Result};

/// Items for each thread that may be taken but not committed, so that unequal items balance.
const ITEMS_PER_THREAD: usize = 4;

/// Maps `items` on `threads` threads and passes the results to `commit` in order.
///
/// The first error, in the order of items, ends the work and is returned.
///
/// # Errors
/// Those of `work` and `commit`; [`Error::Stopped`](super::Error::Stopped) if the job is to stop.
///
/// # Panics
/// Propagates a panic of `work`.
pub fn map_in_order<T: Send, R: Send>(
    items: impl Iterator<Item = T> + Send,
    threads: usize,
    in_flight: usize,
    work: impl Fn(T) -> Result<R> + Sync,
    commit: impl FnMut(R) -> Result<()>,
) -> Result<()> {
    finish_in_order(items, Crew { threads, finishers: 0 }, in_flight, work, Ok, commit)
}

/// Maps `items` like [`map_in_order`] on as many threads as the pool has, within a budget of memory.
///
/// `cost_bytes` returns the memory that an item and its result take, in bytes; an item that takes more than the budget is
/// worked on alone.
///
/// # Errors
/// As [`map_in_order`].
///
/// # Panics
/// Propagates a panic of `work`.
pub fn map_within<T: Send, R: Send>(
    budget_bytes: u64,
    cost_bytes: impl Fn(&T) -> u64 + Sync,
    items: impl Iterator<Item = T> + Send,
    work: impl Fn(T) -> Result<R> + Sync,
    mut commit: impl FnMut(R) -> Result<()>,
) -> Result<()> {
    let (permits, threads) = (Permits::new(budget_bytes), thread_count());
    // Permits are taken in the order of the items: the oldest one, for which the others wait, has its own.
    let (permits, cost_bytes) = (&permits, &cost_bytes);
    let items = items.map(move |item| (permits.take(cost_bytes(&item)), item));
    let work = |(permit, item)| Ok((permit, work(item)?));
    map_in_order(items, threads, threads * ITEMS_PER_THREAD, work, |(_permit, result)| commit(result))
}

/// Numbers of threads that compute and that wait for the disk.
#[derive(Debug, Clone, Copy)]
pub struct Crew {
    /// Threads that compute; with one, everything runs on the calling thread.
    pub threads: usize,
    /// Threads that finish; with none, workers finish.
    pub finishers: usize,
}

/// Maps `items` like [`map_in_order`], in two steps: `work` computes, `finish` waits for the disk.
///
/// # Errors
/// Those of `work`, `finish` and `commit`; as [`map_in_order`].
///
/// # Panics
/// Propagates a panic of `work` or `finish`.
pub fn finish_in_order<T: Send, P: Send, R: Send>(
    items: impl Iterator<Item = T> + Send,
    crew: Crew,
    in_flight: usize,
    work: impl Fn(T) -> Result<P> + Sync,
    finish: impl Fn(P) -> Result<R> + Sync,
    mut commit: impl FnMut(R) -> Result<()>,
) -> Result<()> {
    let places = in_flight.max(crew.threads).max(1);
    let line = Line {
        items: Mutex::new(items.enumerate()),
        slots: (0..places).map(|_| Mutex::new(Slot::Empty)).collect(),
        stopped: AtomicBool::new(false),
        work,
        finish,
    };
    run(&line, crew, places, &mut |place| commit(line.done(place)))
}

/// An item on its way.
enum Slot<T, P, R> {
    Empty,
    Taken(T),
    Worked(P),
    Finished(R),
}

/// Items on their way; the next one takes the place of the one that was committed `slots.len()` items before.
struct Line<I, T, P, R, W, F> {
    items: Mutex<std::iter::Enumerate<I>>,
    slots: Vec<Mutex<Slot<T, P, R>>>,
    stopped: AtomicBool,
    work: W,
    finish: F,
}

impl<I, T, P, R, W, F> Line<I, T, P, R, W, F> {
    fn slot(&self, place: usize) -> std::sync::MutexGuard<'_, Slot<T, P, R>> {
        lock(&self.slots[place % self.slots.len()])
    }

    /// Drops what comes after the loop has stopped: it may hold memory that a worker waits for.
    fn put(&self, place: usize, content: Slot<T, P, R>) {
        let mut slot = self.slot(place);
        if !self.stopped.load(Ordering::SeqCst) {
            *slot = content;
        }
    }

    fn lift(&self, place: usize) -> Slot<T, P, R> {
        std::mem::replace(&mut *self.slot(place), Slot::Empty)
    }

    /// The result of an item that is finished.
    fn done(&self, place: usize) -> R {
        let Slot::Finished(result) = self.lift(place) else { unreachable!("what is committed was finished") };
        result
    }
}

/// The steps of a loop, whatever its items are: each is named by its place. All loops share the code that runs them,
/// which is long.
trait LoopSteps: Sync {
    /// Takes the next item; `None` after the last, or if the loop has stopped.
    fn take(&self) -> Option<usize>;

    /// Computes.
    fn work(&self, place: usize) -> Result<()>;

    /// Waits for the disk.
    fn finish(&self, place: usize) -> Result<()>;

    /// Stops the loop, and drops what is on its way.
    fn stop(&self);
}

/// Stops a loop on drop, however its committer ends.
struct StopOnDrop<'a>(&'a dyn LoopSteps);

impl Drop for StopOnDrop<'_> {
    fn drop(&mut self) {
        self.0.stop();
    }
}

impl<I, T, P, R, W, F> LoopSteps for Line<I, T, P, R, W, F>
where
    I: Iterator<Item = T> + Send,
    T: Send,
    P: Send,
    R: Send,
    W: Fn(T) -> Result<P> + Sync,
    F: Fn(P) -> Result<R> + Sync,
{
    fn take(&self) -> Option<usize> {
        let mut items = lock(&self.items);
        if self.stopped.load(Ordering::SeqCst) {
            return None;
        }
        let (place, item) = items.next()?;
        self.put(place, Slot::Taken(item));
        Some(place)
    }

    fn work(&self, place: usize) -> Result<()> {
        // Nothing is there if the loop has stopped.
        if let Slot::Taken(item) = self.lift(place) {
            let product = (self.work)(item)?;
            self.put(place, Slot::Worked(product));
        }
        Ok(())
    }

    fn finish(&self, place: usize) -> Result<()> {
        if let Slot::Worked(product) = self.lift(place) {
            let result = (self.finish)(product)?;
            self.put(place, Slot::Finished(result));
        }
        Ok(())
    }

    fn stop(&self) {
        self.stopped.store(true, Ordering::SeqCst);
        (0..self.slots.len()).for_each(|place| drop(self.lift(place)));
    }
}

/// Commits an item that is finished.
type Commit<'a> = &'a mut dyn FnMut(usize) -> Result<()>;

/// How a step ended: a panic is caught, and passed on by the committer; otherwise workers that wait for room would wait
/// forever.
type Outcome = std::thread::Result<Result<()>>;

fn run(steps: &dyn LoopSteps, Crew { threads, finishers }: Crew, places: usize, commit: Commit<'_>) -> Result<()> {
    if threads <= 1 {
        return alone(steps, commit);
    }
    let finishing = AtomicBool::new(false);
    let (pending_sender, pending) = crossbeam_channel::unbounded::<usize>();
    let (result_sender, results) = crossbeam_channel::unbounded::<(usize, Outcome)>();
    let (credit_sender, credits) = crossbeam_channel::unbounded::<()>();
    for _ in 0..places {
        let _ = credit_sender.send(());
    }
    std::thread::scope(|scope| {
        let (finishing, credits) = (&finishing, &credits);
        // Takes the next item once there is room for its result.
        let next = move || credits.recv().ok().and_then(|()| steps.take());
        let finish_beside = |_| {
            let (pending, result_sender) = (pending.clone(), result_sender.clone());
            let finisher = move || {
                for place in pending {
                    if result_sender.send((place, guarded(|| steps.finish(place)))).is_err() {
                        break;
                    }
                }
            };
            start(scope, finisher).map(drop)
        };
        let work_beside = |_| {
            let (pending_sender, result_sender) = (pending_sender.clone(), result_sender.clone());
            let worker = move || {
                while let Some(place) = next() {
                    let is_wanted = match guarded(|| steps.work(place)) {
                        Ok(Ok(())) if finishing.load(Ordering::Relaxed) => pending_sender.send(place).is_ok(),
                        Ok(Ok(())) => result_sender.send((place, guarded(|| steps.finish(place)))).is_ok(),
                        fault => result_sender.send((place, fault)).is_ok(),
                    };
                    if !is_wanted {
                        break;
                    }
                }
            };
            start(scope, worker).map(drop)
        };
        // If the system refuses threads: the first one is a worker; without any, the caller does the work.
        let mut is_working = work_beside(0).is_ok();
        if is_working && finishers > 0 {
            finishing.store(at_least_one((0..finishers).map(finish_beside)).is_ok(), Ordering::Relaxed);
        }
        is_working |= at_least_one((1..threads).map(work_beside)).is_ok();
        drop((pending_sender, pending, result_sender));
        if !is_working {
            return alone(steps, commit);
        }
        // Dropped before the threads are waited for: the other ends of the channels, and what is on its way.
        let (results, credit_sender, _stop) = (results, credit_sender, StopOnDrop(steps));
        commit_in_order(&results, &credit_sender, commit)
    })
}

/// Does the same on the calling thread.
fn alone(steps: &dyn LoopSteps, commit: Commit<'_>) -> Result<()> {
    while let Some(place) = steps.take() {
        steps.work(place)?;
        steps.finish(place)?;
        commit(place)?;
        check_stopped()?;
    }
    Ok(())
}

fn guarded(step: impl FnOnce() -> Result<()>) -> Outcome {
    catch_unwind(AssertUnwindSafe(step))
}

fn commit_in_order(
    results: &crossbeam_channel::Receiver<(usize, Outcome)>,
    credits: &crossbeam_channel::Sender<()>,
    commit: Commit<'_>,
) -> Result<()> {
    let mut early = BTreeMap::new();
    let mut next = 0;
    for (place, outcome) in results {
        early.insert(place, outcome);
        while let Some(outcome) = early.remove(&next) {
            outcome.unwrap_or_else(|panic| resume_unwind(panic))?;
            commit(next)?;
            check_stopped()?;
            next += 1;
            let _ = credits.send(());
        }
    }
    Ok(())
}

/// Runs two functions in parallel, or one after the other if `threads` is 1.
///
/// # Panics
/// Propagates a panic of the first one.
pub fn both<A: Send, B>(threads: usize, first: impl FnOnce() -> A + Send, second: impl FnOnce() -> B) -> (A, B) {
    if threads <= 1 {
        return (first(), second());
    }
    let first = Task::new(first);
    std::thread::scope(|scope| {
        let thread = start(scope, || first.run()).ok();
        let second = second();
        let first = match thread {
            Some(thread) => thread.join().unwrap_or_else(|panic| resume_unwind(panic)),
            None => first.run(),
        };
        (first.expect("a task is done by the thread, or else here"), second)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Error;

    #[test]
    fn loops_of_a_job_that_is_to_stop_end_early() {
        use crate::base::pool::{Pool, tests::AtOnce};
        for (threads, finishers) in [(1, 0), (3, 0), (3, 2)] {
            let mut committed = 0;
            let count = |_| {
                committed += 1;
                Ok(())
            };
            let crew = Crew { threads, finishers };
            let outcome = Pool::new(2).unwrap().run(&AtOnce, || finish_in_order(0..1000, crew, 4, Ok, Ok, count));
            assert!(matches!(outcome, Err(Error::Stopped)), "{threads} {finishers}: {outcome:?}");
            assert_eq!(committed, 1);
        }
    }

    #[test]
    fn the_results_are_the_same_with_few_threads_or_none() {
        use crate::base::threads::tests::with_threads;
        for (left, finishers) in (0..6).flat_map(|left| [(left, 0), (left, 3)]) {
            let mut results = Vec::new();
            let crew = Crew { threads: 3, finishers };
            let outcome = with_threads(left, || {
                finish_in_order(
                    0..100,
                    crew,
                    4,
                    |item| Ok(2 * item),
                    |item| Ok(item + 1),
                    |result| {
                        results.push(result);
                        Ok(())
                    },
                )
            });
            assert!(outcome.is_ok());
            assert_eq!(results, (0..100).map(|item| 2 * item + 1).collect::<Vec<_>>(), "{left} threads");
            assert_eq!(with_threads(left, || both(2, || 1, || 2)), (1, 2));
        }
    }

    #[test]
    fn results_arrive_in_order_at_any_thread_count() {
        for threads in [1, 2, 8] {
            let mut seen = Vec::new();
            map_in_order(
                0..500,
                threads,
                4,
                |i| Ok(i * 2),
                |r| {
                    seen.push(r);
                    Ok(())
                },
            )
            .unwrap();
            assert_eq!(seen, (0..500).map(|i| i * 2).collect::<Vec<_>>());
        }
    }

    #[test]
    fn results_come_in_order_and_within_the_budget() {
        use std::sync::atomic::AtomicU64;
        for threads in [1, 3] {
            let _inside = crate::base::pool::Pool::new(threads).unwrap().enter();
            let (now, peak) = (AtomicU64::new(0), AtomicU64::new(0));
            let mut results = Vec::new();
            let cost = |item: &u64| item % 7;
            map_within(
                6,
                cost,
                0..200u64,
                |item| {
                    peak.fetch_max(now.fetch_add(cost(&item), Ordering::SeqCst) + cost(&item), Ordering::SeqCst);
                    Ok(item)
                },
                |item| {
                    now.fetch_sub(cost(&item), Ordering::SeqCst);
                    results.push(item);
                    Ok(())
                },
            )
            .unwrap();
            assert!(results.iter().copied().eq(0..200));
            assert!(peak.into_inner() <= 6);
        }
    }

    #[test]
    fn an_item_larger_than_the_budget_is_worked_on_alone() {
        let mut results = Vec::new();
        let commit = |item| {
            results.push(item);
            Ok(())
        };
        map_within(1, |&item| item, [0, 5, 1, 9, 9, 0].into_iter(), Ok, commit).unwrap();
        assert_eq!(results, [0, 5, 1, 9, 9, 0]);
    }

    /// While the first item is committed, the second one waits with its permit, and the third one for both permits.
    #[test]
    fn a_commit_that_fails_ends_workers_that_wait_for_memory() {
        let _inside = crate::base::pool::Pool::new(3).unwrap().enter();
        let run = |commit: fn() -> Result<()>| {
            let cost = |item: &u64| if *item < 2 { 1 } else { 2 };
            catch_unwind(|| {
                map_within(2, cost, 0..9u64, Ok, |_| {
                    std::thread::sleep(std::time::Duration::from_millis(50));
                    commit()
                })
            })
        };
        assert_eq!(run(|| Err(Error::Usage("full".into()))).unwrap().unwrap_err().to_string(), "full");
        assert!(run(|| panic!("full")).is_err());
    }

    #[test]
    fn what_is_finished_apart_arrives_in_order_and_its_errors_end_the_work() {
        for (threads, finishers) in [(1, 0), (2, 2), (4, 1)] {
            let crew = Crew { threads, finishers };
            let run = |bad: i32| {
                let mut seen = Vec::new();
                let finish = |i: i32| if i == bad { Err(Error::Usage("bad".into())) } else { Ok(-i) };
                let outcome = finish_in_order(
                    0..300,
                    crew,
                    8,
                    |i| Ok(i * 2),
                    finish,
                    |r| {
                        seen.push(r);
                        Ok(())
                    },
                );
                (seen, outcome)
            };
            let (seen, outcome) = run(-1);
            assert_eq!(seen, (0..300).map(|i| i * -2).collect::<Vec<_>>());
            outcome.unwrap();
            let (seen, outcome) = run(100);
            assert_eq!(seen.len(), 50);
            assert_eq!(outcome.unwrap_err().to_string(), "bad");
        }
    }

    #[test]
    fn a_panic_is_passed_on_and_nobody_waits_for_ever() {
        for finishers in [0, 2] {
            let crew = Crew { threads: 2, finishers };
            let run = |at_work: bool| {
                let step = |i, panics: bool| if panics && i == 50 { panic!("fifty") } else { Ok(i) };
                catch_unwind(AssertUnwindSafe(|| {
                    finish_in_order(0..1000, crew, 4, |i| step(i, at_work), |i| step(i, !at_work), |_| Ok(()))
                }))
            };
            assert!(run(true).is_err());
            assert!(run(false).is_err());
        }
    }

    #[test]
    fn two_things_are_both_done_on_any_number_of_threads() {
        for threads in [1, 2] {
            assert_eq!(both(threads, || 1 + 1, || "two"), (2, "two"));
        }
    }

    #[test]
    fn the_first_error_ends_the_work() {
        for threads in [1, 4] {
            let outcome = map_in_order(
                0..1_000_000,
                threads,
                4,
                |i| if i == 7 { Err(Error::Usage("seven".into())) } else { Ok(i) },
                |_| Ok(()),
            );
            assert_eq!(outcome.unwrap_err().to_string(), "seven");
        }
    }
}

//! Work in parallel, results in order.
//!
//! Workers take items as they come; one committer, the calling thread, receives the results in the items' order. At
//! most `in_flight` items are between "handed out" and "committed", which bounds the memory of waiting results. Nobody
//! holds a result while waiting for another: the committer keeps what came early in a map of at most that size.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};

use super::Result;

/// Maps `items` on `threads` threads and hands the results to `commit` in order.
///
/// The first error, in the order of items, ends the work and is returned.
///
/// # Errors
/// What `work` or `commit` returns.
///
/// # Panics
/// If `work` panics, its panic is passed on.
pub fn map_in_order<T: Send, R: Send>(
    items: impl Iterator<Item = T> + Send,
    threads: usize,
    in_flight: usize,
    work: impl Fn(T) -> Result<R> + Sync,
    mut commit: impl FnMut(R) -> Result<()>,
) -> Result<()> {
    if threads <= 1 {
        for item in items {
            commit(work(item)?)?;
        }
        return Ok(());
    }
    let stopped = AtomicBool::new(false);
    let (job_sender, jobs) = crossbeam_channel::bounded::<(usize, T)>(0);
    let (result_sender, results) = crossbeam_channel::unbounded::<(usize, Result<R>)>();
    let (credit_sender, credits) = crossbeam_channel::unbounded::<()>();
    for _ in 0..in_flight.max(threads) {
        let _ = credit_sender.send(());
    }
    std::thread::scope(|scope| {
        let (work, stopped) = (&work, &stopped);
        scope.spawn(move || {
            for job in items.enumerate() {
                let may_go_on = credits.recv().is_ok() && !stopped.load(Ordering::Relaxed);
                if !may_go_on || job_sender.send(job).is_err() {
                    break;
                }
            }
        });
        for _ in 0..threads {
            let (jobs, result_sender) = (jobs.clone(), result_sender.clone());
            scope.spawn(move || {
                for (index, item) in jobs {
                    if result_sender.send((index, work(item))).is_err() {
                        break;
                    }
                }
            });
        }
        drop((jobs, result_sender));
        let outcome = commit_in_order(&results, &credit_sender, &mut commit);
        stopped.store(true, Ordering::Relaxed);
        drop(credit_sender);
        drop(results);
        outcome
    })
}

/// Does two things side by side, or one after the other on a single thread.
///
/// # Panics
/// If the first one panics, its panic is passed on.
pub fn both<A: Send, B>(threads: usize, first: impl FnOnce() -> A + Send, second: impl FnOnce() -> B) -> (A, B) {
    if threads <= 1 {
        return (first(), second());
    }
    std::thread::scope(|scope| {
        let first = scope.spawn(first);
        let second = second();
        (first.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)), second)
    })
}

fn commit_in_order<R>(
    results: &crossbeam_channel::Receiver<(usize, Result<R>)>,
    credits: &crossbeam_channel::Sender<()>,
    commit: &mut impl FnMut(R) -> Result<()>,
) -> Result<()> {
    let mut early = BTreeMap::new();
    let mut next = 0;
    for (index, result) in results {
        early.insert(index, result);
        while let Some(result) = early.remove(&next) {
            commit(result?)?;
            next += 1;
            let _ = credits.send(());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Error;

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

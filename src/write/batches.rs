//! Runs work in parallel and takes the results in order, so that the output does not depend on the number of threads.
//!
//! # Memory
//! The costs of a batch: at most the budget, or one item that exceeds it alone.

use rayon::prelude::*;

use crate::base::Result;
use crate::base::pool::{in_parallel, thread_count};

/// Largest number of items in a batch per thread; several, so that unequal items balance.
const ITEMS_PER_THREAD: usize = 4;

/// Runs `work` on all items in parallel batches, and passes the results to `sink` in the order of the items.
///
/// `cost_bytes` returns the memory that an item and its result take, in bytes.
///
/// # Errors
/// The first error in the order of the items.
pub(super) fn in_order<I: Send, O: Send>(
    items: impl Iterator<Item = I>,
    budget_bytes: u64,
    cost_bytes: impl Fn(&I) -> u64,
    work: impl Fn(I) -> Result<O> + Sync,
    mut sink: impl FnMut(O) -> Result<()>,
) -> Result<()> {
    let most = ITEMS_PER_THREAD * thread_count();
    let mut items = items.peekable();
    let mut batch = Vec::with_capacity(most);
    while let Some(first) = items.next() {
        let mut bytes = cost_bytes(&first);
        batch.push(first);
        while batch.len() < most
            && let Some(item) = items.next_if(|item| bytes + cost_bytes(item) <= budget_bytes)
        {
            bytes += cost_bytes(&item);
            batch.push(item);
        }
        let results: Vec<Result<O>> = in_parallel(|| batch.par_drain(..).map(&work).collect());
        for result in results {
            sink(result?)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[test]
    fn results_come_in_order_and_within_the_budget() {
        let (now, peak) = (AtomicU64::new(0), AtomicU64::new(0));
        let mut results = Vec::new();
        in_order(
            0..100u64,
            3,
            |_| 1,
            |i| {
                peak.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                Ok(i)
            },
            |i| {
                now.fetch_sub(1, Ordering::SeqCst);
                results.push(i);
                Ok(())
            },
        )
        .unwrap();
        assert!(results.iter().copied().eq(0..100));
        assert!(peak.into_inner() <= 3);
    }
}

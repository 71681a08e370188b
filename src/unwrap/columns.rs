//! Columns where a chart is free, all of a row at once.
//!
//! ```text
//! row       . . █ . . . . █ .      a run of 3 cells that begins at a column is free there if none of the row's cells
//! ahead     █ █ █ . . █ █ █ .      from that column on, 3 of them, is taken
//! open      . . . + + . . .        as bits, 64 of them at a time
//! ```

use std::ops::Range;

/// Columns at which a chart may begin, as far as its runs were asked.
#[derive(Debug, Default)]
pub(super) struct OpenColumns {
    /// A bit for each column.
    are_open: Vec<u64>,
    /// Scratch: a bit for each column where one of the next cells is taken.
    ahead: Vec<u64>,
}

impl OpenColumns {
    /// Opens the first `count` columns.
    pub fn begin(&mut self, count: usize) {
        self.are_open.clear();
        self.are_open.resize(count / 64, u64::MAX);
        if !count.is_multiple_of(64) {
            self.are_open.push((1 << (count % 64)) - 1);
        }
    }

    /// Closes the columns at which a run of cells would meet a taken one. `taken` has a bit for each cell of a row, the
    /// run is that of a chart that begins at column 0. Returns whether some column is still open.
    pub fn close(&mut self, taken: &[u64], run: &Range<usize>) -> bool {
        let Self { are_open, ahead } = self;
        ahead.clear();
        ahead.extend_from_slice(&taken[(run.start / 64).min(taken.len())..]);
        let mut reach = 1;
        while reach < run.len() {
            let step = reach.min(run.len() - reach);
            or_shifted(ahead, step);
            reach += step;
        }
        let mut any = 0;
        for (at, open) in are_open.iter_mut().enumerate() {
            *open &= !shifted(ahead, at, run.start % 64);
            any |= *open;
        }
        any != 0
    }

    /// The first open column.
    pub fn first(&self) -> Option<usize> {
        let word = self.are_open.iter().position(|&open| open != 0)?;
        Some(64 * word + self.are_open[word].trailing_zeros() as usize)
    }
}

/// Sets the bits that lie `by` before one that is set.
fn or_shifted(words: &mut [u64], by: usize) {
    // Words are read at and behind the one that changes alone.
    for at in 0..words.len() {
        words[at] |= shifted(words, at + by / 64, by % 64);
    }
}

/// A word of bits that lie `by` columns ahead, less than 64.
#[inline]
fn shifted(words: &[u64], at: usize, by: usize) -> u64 {
    let word = |at: usize| words.get(at).copied().unwrap_or(0);
    if by == 0 { word(at) } else { word(at) >> by | word(at + 1) << (64 - by) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn columns_are_open_where_no_cell_of_a_run_is_taken(
            cells in prop::collection::vec(prop::sample::select(vec![false, false, false, true]), 1..400),
            runs in prop::collection::vec((0_usize..300, 1_usize..200), 1..5),
        ) {
            let mut taken = vec![0_u64; cells.len().div_ceil(64)];
            cells.iter().enumerate().for_each(|(at, &is_taken)| taken[at / 64] |= u64::from(is_taken) << (at % 64));
            let runs: Vec<Range<usize>> = runs.iter().map(|&(start, length)| start..start + length).collect();
            let width = runs.iter().map(|run| run.end).max().unwrap_or(0);
            let count = (cells.len() + 1).saturating_sub(width);
            let mut open = OpenColumns::default();
            open.begin(count);
            let any = runs.iter().map(|run| open.close(&taken, run)).last();
            let is_free = |at: &usize| runs.iter().all(|run| !cells[run.start + at..run.end + at].contains(&true));
            let first = (0..count).find(is_free);
            prop_assert_eq!(open.first(), first);
            prop_assert_eq!(any, Some(first.is_some()));
        }
    }
}

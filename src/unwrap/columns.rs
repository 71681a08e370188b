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
    /// Words of bits, outside of which all columns are closed.
    words: Range<usize>,
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
        self.words = 0..self.are_open.len();
    }

    /// Closes the columns at which a run of cells would meet a taken one. `taken` has a bit for each cell of a row, the
    /// run is that of a chart that begins at column 0 and fits the row at each open one. Returns whether some column is
    /// still open.
    pub fn close(&mut self, taken: &[u64], run: &Range<usize>) -> bool {
        let Self { are_open, words, ahead } = self;
        // The cells of all runs that begin at an open column lie in these words and the one behind them.
        let asked = (words.start + run.start / 64).min(taken.len());
        let end = (words.end + run.end / 64 + 1).min(taken.len());
        ahead.clear();
        ahead.extend_from_slice(&taken[asked..end]);
        ahead.push(0);
        let mut reach = 1;
        while reach < run.len() {
            let step = reach.min(run.len() - reach);
            or_shifted(ahead, step);
            reach += step;
        }
        let open = &mut are_open[words.clone()];
        for (open, ahead) in open.iter_mut().zip(ahead.windows(2)) {
            *open &= !shifted([ahead[0], ahead[1]], run.start % 64);
        }
        let before = open.iter().take_while(|&&open| open == 0).count();
        let behind = open[before..].iter().rev().take_while(|&&open| open == 0).count();
        self.words = self.words.start + before..self.words.end - behind;
        self.words.start < self.words.end
    }

    /// The first open column.
    pub fn first(&self) -> Option<usize> {
        let word = self.words.clone().next()?;
        Some(64 * word + self.are_open[word].trailing_zeros() as usize)
    }
}

/// Sets the bits that lie `by` before one that is set. The last word is to be 0.
fn or_shifted(words: &mut [u64], by: usize) {
    if by < 64 {
        // Mostly; by the distance of words that is known, they are shifted several at a time.
        for at in 1..words.len() {
            words[at - 1] |= shifted([words[at - 1], words[at]], by);
        }
    } else {
        for at in by / 64 + 1..words.len() {
            words[at - by / 64 - 1] |= shifted([words[at - 1], words[at]], by % 64);
        }
    }
}

/// The first of two words, of bits that lie `by` columns ahead, less than 64.
#[inline]
fn shifted(words: [u64; 2], by: usize) -> u64 {
    words[0] >> by | words[1] << 1 << (63 - by)
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

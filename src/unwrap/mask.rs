//! What charts and images take of a grid of cells.

use std::cmp::Reverse;
use std::ops::Range;

use glam::DVec2;

use super::image_size::{CELL, GUTTER};

/// Cells that a chart takes, with its gutter.
#[derive(Debug, Clone)]
pub(super) struct Mask {
    /// Width and height in cells.
    pub size: [usize; 2],
    /// Runs of cells, the longest first: it is most often in the way.
    pub runs: Vec<CellRun>,
    /// Number of cells.
    pub cells: usize,
}

/// Neighbouring cells of a row.
#[derive(Debug, Clone)]
pub(super) struct CellRun {
    pub row: usize,
    pub columns: Range<usize>,
}

impl Mask {
    /// The cells that triangles touch, in texels from 0 on, and those around them; the gutter is part of the texels.
    pub fn of(size: [usize; 2], triangles: impl Iterator<Item = [DVec2; 3]>) -> Self {
        let mut grid = Grid::new(size);
        for corners in triangles {
            grid.touch(corners);
        }
        Self::from_grid(&grid.grown((GUTTER / CELL) as usize))
    }

    fn from_grid(grid: &Grid) -> Self {
        let mut runs = Vec::new();
        for row in 0..grid.size[1] {
            let mut from = 0;
            while let Some(first) = grid.next(row, from, true) {
                let end = grid.next(row, first, false).unwrap_or(grid.size[0]);
                runs.push(CellRun { row, columns: first..end });
                from = end;
            }
        }
        let cells = runs.iter().map(|run| run.columns.len()).sum();
        runs.sort_by_key(|run| Reverse(run.columns.len()));
        Self { size: grid.size, runs, cells }
    }

    /// The mask turned by a quarter, so that its first row becomes the last column.
    pub fn turned(&self) -> Self {
        let [width, height] = self.size;
        let mut grid = Grid::new([height, width]);
        for CellRun { row, columns } in &self.runs {
            columns.clone().for_each(|column| grid.take(column, height - 1 - row..height - row));
        }
        Self::from_grid(&grid)
    }
}

/// Cells, each taken or free.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    size: [usize; 2],
    /// 64-bit words of a row.
    words: usize,
    /// A bit for each cell.
    are_taken: Vec<u64>,
}

impl Grid {
    /// All cells are free.
    pub fn new(size: [usize; 2]) -> Self {
        let words = size[0].div_ceil(64);
        Self { size, words, are_taken: vec![0; words * size[1]] }
    }

    /// Takes cells of a row.
    pub fn take(&mut self, row: usize, columns: Range<usize>) {
        let row = &mut self.are_taken[row * self.words..][..self.words];
        let words = columns.start / 64..columns.end.div_ceil(64);
        row[words.clone()].iter_mut().zip(words).for_each(|(taken, word)| *taken |= bits(&columns, word));
    }

    /// A bit for each cell of a row, set where it is taken.
    #[inline]
    pub fn row(&self, row: usize) -> &[u64] {
        &self.are_taken[row * self.words..][..self.words]
    }

    /// The first cell of a row from `from` on that is taken, or that is free.
    #[inline]
    pub fn next(&self, row: usize, from: usize, is_taken: bool) -> Option<usize> {
        let row = self.row(row);
        let found = (from / 64..self.words).find_map(|word| {
            let wanted = if is_taken { row[word] } else { !row[word] } & bits(&(from..64 * self.words), word);
            (wanted != 0).then(|| 64 * word + wanted.trailing_zeros() as usize)
        });
        found.filter(|&column| column < self.size[0])
    }

    /// The longest run of free cells of a row.
    pub fn longest_free(&self, row: usize) -> usize {
        let (mut longest, mut from) = (0, 0);
        while let Some(first) = self.next(row, from, false) {
            let end = self.next(row, first, true).unwrap_or(self.size[0]);
            longest = longest.max(end - first);
            from = end;
        }
        longest
    }

    /// Takes the cells that a triangle touches.
    fn touch(&mut self, corners: [DVec2; 3]) {
        let [width, height] = self.size;
        touched_rows(corners.map(|corner| corner / f64::from(CELL)), height, |row, [low, high]| {
            let last = (high as usize).min(width - 1);
            self.take(row, (low as usize).min(last)..last + 1);
        });
    }

    /// With the cells that are at most `steps` columns and rows away.
    fn grown(&self, steps: usize) -> Self {
        let [width, height] = self.size;
        let mut grown = Self::new(self.size);
        for row in 0..height {
            let mut from = 0;
            while let Some(first) = self.next(row, from, true) {
                let end = self.next(row, first, false).unwrap_or(width);
                let columns = first.saturating_sub(steps)..(end + steps).min(width);
                for near in row.saturating_sub(steps)..(row + steps + 1).min(height) {
                    grown.take(near, columns.clone());
                }
                from = end;
            }
        }
        grown
    }
}

/// Passes each of `row_count` rows, one unit high, that a triangle touches to `take`, with where the part of the
/// triangle in it begins and ends.
pub fn touched_rows(corners: [DVec2; 3], row_count: usize, mut take: impl FnMut(usize, [f64; 2])) {
    let rows = corners.iter().fold([f64::INFINITY, 0.0], |[low, high], at| [at.y.min(low), at.y.max(high)]);
    for row in rows[0] as usize..=(rows[1] as usize).min(row_count - 1) {
        // Of the part between the row's upper and lower edge, the first and the last place.
        let band = [row as f64, row as f64 + 1.0];
        let mut span = [f64::INFINITY, f64::NEG_INFINITY];
        for k in 0..3 {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let [enter, leave] = band.map(|edge| (edge - from.y) / (to.y - from.y));
            let [enter, leave] = if enter <= leave { [enter, leave] } else { [leave, enter] };
            let is_level = from.y == to.y && (band[0]..=band[1]).contains(&from.y);
            let shares = if is_level { [0.0, 1.0] } else { [enter.max(0.0), leave.min(1.0)] };
            if shares[0] <= shares[1] {
                let ends = shares.map(|share| from.x + (to.x - from.x) * share);
                span = [span[0].min(ends[0]).min(ends[1]), span[1].max(ends[0]).max(ends[1])];
            }
        }
        if span[0] <= span[1] {
            take(row, span);
        }
    }
}

/// The bits of a word that stand for some columns.
#[inline]
fn bits(columns: &Range<usize>, word: usize) -> u64 {
    let first = columns.start.saturating_sub(64 * word).min(64);
    let end = columns.end.saturating_sub(64 * word).min(64);
    let below = |count: usize| if count >= 64 { u64::MAX } else { (1 << count) - 1 };
    below(end) & !below(first)
}

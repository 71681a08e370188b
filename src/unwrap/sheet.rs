//! An image that is filled with charts.

use std::collections::HashMap;
use std::ops::Range;

use foldhash::fast::FixedState;

use super::columns::OpenColumns;
use super::mask::{CellRun, Grid, Mask};

/// Classes of sizes for a factor of two.
const SIZE_CLASSES: f64 = 8.0;
/// A chart of this number of rows or more is tried at every other row alone.
const TALL: usize = 16;
/// Longest runs of a chart for which a row is asked whether it has room for them anywhere.
const LONG_RUNS: usize = 8;

/// An image under way, in cells.
pub(super) struct Sheet {
    size: [usize; 2],
    grid: Grid,
    /// Longest run of free cells of each row.
    free: Vec<usize>,
    /// The row where the last chart of a class of sizes began, above which others of the class are not tried.
    begun: HashMap<[u32; 2], usize, FixedState>,
    /// The columns of the row that is asked.
    open: OpenColumns,
    /// Rows down to the last one that is taken.
    pub height: usize,
}

/// A place for a chart: its first row and column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SheetPlace {
    pub row: usize,
    pub column: usize,
}

impl Sheet {
    /// An empty image.
    pub fn new(size: [usize; 2]) -> Self {
        Self {
            size,
            grid: Grid::new(size),
            free: vec![size[0]; size[1]],
            begun: HashMap::default(),
            open: OpenColumns::default(),
            height: 0,
        }
    }

    /// The uppermost place where a chart is free, of these that on the left, whose first row is no lower than `last`; not
    /// above the last chart of its class of sizes.
    pub fn find(&mut self, mask: &Mask, last: usize) -> Option<SheetPlace> {
        let rows = (self.size[1] + 1).checked_sub(mask.size[1])?.min(last.saturating_add(1));
        let class = mask.size.map(|side| (SIZE_CLASSES * libm::log2(side as f64)) as u32);
        let first = self.begun.get(&class).copied().unwrap_or(0);
        let place = self.find_among(mask, first..rows);
        self.begun.insert(class, place.map_or(rows.max(first), |place| place.row));
        place
    }

    fn find_among(&mut self, mask: &Mask, rows: Range<usize>) -> Option<SheetPlace> {
        let count = (self.size[0] + 1).checked_sub(mask.size[0])?;
        let long = &mask.runs[..mask.runs.len().min(LONG_RUNS)];
        // The run that closed the last column: it mostly does again.
        let mut likely = 0;
        let step = if mask.size[1] >= TALL { 2 } else { 1 };
        for row in rows.step_by(step) {
            if long.iter().any(|run| self.free[row + run.row] < run.columns.len()) {
                continue;
            }
            match self.closing(mask, row, count, likely) {
                Some(run) => likely = run,
                None => return Some(SheetPlace { row, column: self.open.first()? }),
            }
        }
        None
    }

    /// Looks for the columns where a chart is free, if it begins in a row; returns the run that closes the last of them.
    fn closing(&mut self, mask: &Mask, row: usize, count: usize, likely: usize) -> Option<usize> {
        let Self { size, grid, free, open, .. } = self;
        open.begin(count);
        let mut closes = |number: usize| {
            let CellRun { row: own, columns } = &mask.runs[number];
            let row = row + own;
            free[row] < size[0] && !open.close(grid.row(row), columns)
        };
        if closes(likely) {
            return Some(likely);
        }
        (0..mask.runs.len()).find(|&number| number != likely && closes(number))
    }

    /// Frees the memory of an image that gets no more charts.
    pub fn close(&mut self) {
        (self.grid, self.free) = (Grid::new([0; 2]), Vec::new());
        self.begun = HashMap::default();
    }

    /// Takes a place for a chart.
    pub fn take(&mut self, mask: &Mask, place: SheetPlace) {
        for CellRun { row, columns } in &mask.runs {
            self.grid.take(place.row + row, place.column + columns.start..place.column + columns.end);
        }
        for row in place.row..place.row + mask.size[1] {
            self.free[row] = self.grid.longest_free(row);
        }
        self.height = self.height.max(place.row + mask.size[1]);
    }
}

//! Cells of space that a hash chooses, so that all clusters choose the same ones.
//!
//! ```text
//!   ┌───────────┬───────────┐     space in blocks of cells; a block has at most one chosen cell ▒,
//!   │     ▒     │           │     by a hash of its coordinates
//!   │           │         ▒ │
//!   └───────────┴───────────┘
//! ```
//!
//! # Memory
//! 100 KiB for the recent answers.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::base::chance::{INCREMENT, mixed, unit};

/// Expected number of faces of the input in all chosen cells.
pub(super) const CHOSEN_FACES: f64 = 3072.0;
/// Largest binary logarithm of the number of cells along the side of a block.
const BLOCK_BITS_MAX: f64 = 6.0;
/// Units per side of a cell; positions are rounded down to them.
const SIDE_PARTS: i64 = 256;
/// A triangle is small if its bounding box is shorter than this share of a cell's side along each axis. Less than a
/// half.
const SMALL: f64 = 0.49;
/// Largest absolute coordinate, in units; farther positions are clamped to it.
const PLACE_MAX: i64 = 1 << 60;
/// A triangle whose bounding box meets more blocks than this is kept without testing the cells.
const BLOCKS_MAX: i128 = 64;
/// Slots of the caches of blocks and of cells.
const SLOTS: usize = 512;

/// How space is divided into cells, and how many of them are chosen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct CellGrid {
    /// Side of a cell, in units of length.
    pub side: f64,
    /// Binary logarithm of the number of cells along the side of a block.
    block_bits: u32,
    /// Probability that a block has a chosen cell.
    odds: f64,
}

impl CellGrid {
    /// A grid of cells of a side whose chosen cells hold about [`CHOSEN_FACES`] of `faces` faces.
    pub(super) fn new(side: f64, faces: u64) -> Self {
        let share = (CHOSEN_FACES / faces.max(1) as f64).min(1.0);
        let block_bits = (share.recip().log2() / 3.0).clamp(0.0, BLOCK_BITS_MAX) as u32;
        let side = if side.is_normal() { side } else { 1.0 };
        Self { side, block_bits, odds: share * f64::from(1 << (3 * block_bits)) }
    }

    /// Share of space that lies in chosen cells.
    pub fn share(&self) -> f64 {
        self.odds / f64::from(1 << (3 * self.block_bits))
    }
}

/// A position in units of a cell's side / `SIDE_PARTS`.
pub type GridPosition = [i64; 3];

/// Finds chosen cells; caches recent answers.
#[derive(Debug)]
pub struct ChosenCells {
    grid: CellGrid,
    parts: f64,
    /// Cached blocks, each in its slot, with their chosen cells.
    seen: Vec<Option<(GridPosition, Option<GridPosition>)>>,
    /// Cached cells, each in its slot, with the chosen cells around them.
    around: Vec<Option<(GridPosition, CellNeighbourhood)>>,
    /// The last answer: faces come near one another.
    last: LastCell,
}

/// A cell, and the chosen cells around it.
#[derive(Debug, Clone, Copy)]
struct LastCell {
    /// Low and high corner, in units; no position is in the first.
    corners: [DVec3; 2],
    around: CellNeighbourhood,
}

/// Chosen cells among a cell and its 26 neighbours, by their low corners.
#[derive(Debug, Clone, Copy, PartialEq)]
enum CellNeighbourhood {
    None,
    One(GridPosition),
    Many,
}

impl ChosenCells {
    /// The chosen cells of a grid.
    pub fn new(grid: CellGrid) -> Self {
        Self {
            grid,
            parts: SIDE_PARTS as f64 / grid.side,
            seen: vec![None; SLOTS],
            around: vec![None; SLOTS],
            last: LastCell { corners: [DVec3::INFINITY; 2], around: CellNeighbourhood::None },
        }
    }

    /// Low corner of the chosen cell that contains a position, or `None`.
    pub fn holding(&mut self, position: DVec3) -> Option<GridPosition> {
        let (place, mut holding) = (self.place(position), None);
        self.any_between(place, place, |cell| {
            holding = Some(cell);
            true
        });
        holding
    }

    /// Reports whether the bounding box of a triangle meets a chosen cell.
    pub fn are_met(&mut self, triangle: [DVec3; 3]) -> bool {
        self.are_within(triangle, 0)
    }

    /// Reports whether the bounding box of a triangle is within half a side of a chosen cell.
    pub(super) fn are_near(&mut self, [a, b, c]: [DVec3; 3]) -> bool {
        let (low, high, side) = (a.min(b).min(c), a.max(b).max(c), self.grid.side);
        // Most triangles are smaller than half a side; all of their corners are then within one side of the cell.
        let is_small = (high - low).max_element() < SMALL * side;
        let neighbourhood = if is_small { self.around(a) } else { CellNeighbourhood::Many };
        match neighbourhood {
            CellNeighbourhood::None => false,
            CellNeighbourhood::One(cell) => {
                let cell = DVec3::from_array(cell.map(|place| place as f64 / self.parts));
                cell.cmple(high + 0.5 * side).all() && low.cmple(cell + 1.5 * side).all()
            }
            CellNeighbourhood::Many => self.are_within([a, b, c], SIDE_PARTS / 2),
        }
    }

    /// Reports whether no small triangle with this corner is [near](Self::are_near) a chosen cell. A triangle is small
    /// if the square of its longest side is below [`small_sq`](Self::small_sq).
    pub(super) fn are_far_from(&mut self, corner: DVec3) -> bool {
        self.around(corner) == CellNeighbourhood::None
    }

    /// Square of the length that the sides of small triangles stay below.
    pub(super) fn small_sq(&self) -> f64 {
        (SMALL * self.grid.side) * (SMALL * self.grid.side)
    }

    /// Visits the chosen cells near a triangle; visits none if its bounding box meets more than [`BLOCKS_MAX`] blocks.
    pub(super) fn each_near(&mut self, triangle: [DVec3; 3], mut visit: impl FnMut(GridPosition)) {
        let [low, high] = self.places_around(triangle, SIDE_PARTS / 2);
        self.any_between(low, high, |cell| {
            visit(cell);
            false
        });
    }

    /// Chosen cells among the cell of a position and its neighbours.
    fn around(&mut self, position: DVec3) -> CellNeighbourhood {
        let place = position * self.parts;
        let [low, high] = self.last.corners;
        if place.cmpge(low).all() && place.cmplt(high).all() {
            return self.last.around;
        }
        let cell = self.place(position).map(|place| place >> SIDE_PARTS.trailing_zeros());
        let around = self.around_cell(cell);
        let low = DVec3::from_array(cell.map(|place| (place * SIDE_PARTS) as f64));
        self.last = LastCell { corners: [low, low + SIDE_PARTS as f64], around };
        around
    }

    /// Chosen cells among a cell and its neighbours.
    fn around_cell(&mut self, cell: GridPosition) -> CellNeighbourhood {
        let slot = slot_of(cell);
        if let Some((last, around)) = self.around[slot]
            && last == cell
        {
            return around;
        }
        let low = cell.map(|place| (place - 1) * SIDE_PARTS);
        let mut around = CellNeighbourhood::None;
        self.any_between(low, low.map(|place| place + 3 * SIDE_PARTS - 1), |cell| {
            around =
                if around == CellNeighbourhood::None { CellNeighbourhood::One(cell) } else { CellNeighbourhood::Many };
            false
        });
        self.around[slot] = Some((cell, around));
        around
    }

    /// Reports whether a chosen cell meets the bounding box of a triangle, grown by `margin` units.
    fn are_within(&mut self, triangle: [DVec3; 3], margin: i64) -> bool {
        let [low, high] = self.places_around(triangle, margin);
        self.any_between(low, high, |_| true)
    }

    /// Low and high corner of the bounding box of a triangle, grown by `margin` units.
    fn places_around(&self, [a, b, c]: [DVec3; 3], margin: i64) -> [GridPosition; 2] {
        let (low, high) = (self.place(a.min(b).min(c)), self.place(a.max(b).max(c)));
        [low.map(|p| p.saturating_sub(margin)), high.map(|p| p.saturating_add(margin))]
    }

    /// Reports whether `accept` returns true for a chosen cell that meets a box. Also true, without a call, if the box
    /// meets more than [`BLOCKS_MAX`] blocks.
    fn any_between(
        &mut self,
        low: GridPosition,
        high: GridPosition,
        mut accept: impl FnMut(GridPosition) -> bool,
    ) -> bool {
        let shift = self.grid.block_bits + SIDE_PARTS.trailing_zeros();
        let [from, to] = [low, high].map(|place| place.map(|p| p >> shift));
        let mut accept_in = |block: GridPosition| {
            let meets = |cell: &GridPosition| {
                (0..3).all(|axis| cell[axis] <= high[axis] && low[axis] < cell[axis] + SIDE_PARTS)
            };
            self.cell(block).filter(meets).is_some_and(&mut accept)
        };
        if from == to {
            return accept_in(from);
        }
        let counts = [0, 1, 2].map(|axis| i128::from(to[axis]) - i128::from(from[axis]) + 1);
        if counts.iter().product::<i128>() > BLOCKS_MAX {
            return true;
        }
        (from[0]..=to[0]).any(|x| (from[1]..=to[1]).any(|y| (from[2]..=to[2]).any(|z| accept_in([x, y, z]))))
    }

    fn place(&self, position: DVec3) -> GridPosition {
        (position * self.parts).to_array().map(|c| {
            let whole = c as i64;
            whole.saturating_sub(i64::from(whole as f64 > c)).clamp(-PLACE_MAX, PLACE_MAX)
        })
    }

    /// Low corner of the chosen cell of a block, or `None`.
    fn cell(&mut self, block: GridPosition) -> Option<GridPosition> {
        let seen = &mut self.seen[slot_of(block)];
        if let Some((last, cell)) = *seen
            && last == block
        {
            return cell;
        }
        let mut hash = block.iter().fold(0, |hash, &b| mixed(hash ^ b as u64));
        let cell = (unit(hash) < self.grid.odds).then(|| {
            let bits = self.grid.block_bits;
            block.map(|b| {
                hash = mixed(hash);
                ((b << bits) + (hash & ((1 << bits) - 1)) as i64) * SIDE_PARTS
            })
        });
        *seen = Some((block, cell));
        cell
    }
}

/// Cache slot of a block or a cell.
fn slot_of(place: GridPosition) -> usize {
    let hash = place.iter().fold(0, |hash, &p| (hash ^ p as u64).wrapping_mul(INCREMENT));
    (hash >> 32) as usize % SLOTS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chosen_cells_take_their_share_of_space() {
        for faces in [1_000, 100_000, 3_000_000] {
            let grid = CellGrid::new(3.0, faces);
            let mut chosen = ChosenCells::new(grid);
            let mut hash = 1;
            let mut coordinate = || {
                hash = mixed(hash);
                (unit(hash) - 0.5) * 2000.0
            };
            let count = 400_000;
            let held = (0..count)
                .filter(|_| chosen.holding(DVec3::new(coordinate(), coordinate(), coordinate())).is_some())
                .count();
            let quotient = held as f64 / f64::from(count) / grid.share();
            assert!((0.8..1.2).contains(&quotient), "{faces} faces: {quotient}");
        }
    }
}

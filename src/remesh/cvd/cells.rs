//! The first cells: seeds in Morton order, grown breadth-first until their mass reaches D_avg.
//!
//! ```text
//!   masses   1   2   3   4   5     D_avg 3
//!   cells   [1   2] [3] [4] [5]    a cell closes when its mass reaches D_avg
//! ```

use std::collections::VecDeque;

use glam::DVec3;

use crate::base::id::{TiSlice, TiVec, ids};
use crate::mesh::id::LocalVertex;

ids! {
    /// A cell: vertices that shrink to one.
    VoronoiCell;
}

/// The cell of each vertex; [`VoronoiCell::NONE`] where it has none.
pub type VertexCells = TiSlice<LocalVertex, VoronoiCell>;

/// Bits of a Morton code for each axis.
const MORTON_BITS: u32 = 21;

/// Vertices in Morton order of their positions within the box around all `positions`; equal codes in order of ids.
pub fn morton_order(
    positions: &TiSlice<LocalVertex, DVec3>,
    vertices: impl Iterator<Item = LocalVertex>,
) -> Vec<LocalVertex> {
    let low = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let steps = f64::from((1 << MORTON_BITS) - 1) / (high - low).max_element().max(f64::MIN_POSITIVE);
    let code = |vertex: LocalVertex| {
        let cell = (positions[vertex] - low) * steps;
        [cell.x, cell.y, cell.z].iter().enumerate().map(|(axis, &c)| spread(c as u64) << axis).sum::<u64>()
    };
    let mut order: Vec<(u64, LocalVertex)> = vertices.map(|vertex| (code(vertex), vertex)).collect();
    order.sort_unstable();
    order.into_iter().map(|(_, vertex)| vertex).collect()
}

/// Puts two zero bits after each of the lower 21 bits.
fn spread(mut x: u64) -> u64 {
    x &= (1 << MORTON_BITS) - 1;
    x = (x | x << 32) & 0x001f_0000_0000_ffff;
    x = (x | x << 16) & 0x001f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & 0x1249_2492_4924_9249
}

/// Grows cells from the vertices of `order` that have none. New cells are numbered after those in `cells`. Returns the
/// number of all cells.
///
/// A cell closes when its mass reaches `enough`. A cell that cannot grow that far joins the lightest cell next to it;
/// if there is none, it stays.
pub fn grow(
    order: &[LocalVertex],
    masses: &TiSlice<LocalVertex, f64>,
    enough: f64,
    cells: &mut VertexCells,
    mut neighbours: impl FnMut(LocalVertex, &mut Vec<LocalVertex>),
) -> usize {
    let count = cells.iter().filter_map(|cell| cell.some()).max().map_or(0, |last| last.index() + 1);
    let mut weights: TiVec<VoronoiCell, f64> = vec![0.0; count].into();
    for (vertex, cell) in cells.iter_enumerated().filter_map(|(vertex, cell)| Some((vertex, cell.some()?))) {
        weights[cell] += masses[vertex];
    }
    let (mut queue, mut ring, mut members) = (VecDeque::new(), Vec::new(), Vec::new());
    let mut leftovers = Vec::new();
    for &seed in order {
        if cells[seed] != VoronoiCell::NONE {
            continue;
        }
        queue.clear();
        members.clear();
        queue.push_back(seed);
        let own = weights.push_and_get_key(0.0);
        while let Some(vertex) = queue.pop_front() {
            if cells[vertex] != VoronoiCell::NONE {
                continue;
            }
            cells[vertex] = own;
            members.push(vertex);
            weights[own] += masses[vertex];
            if weights[own] >= enough {
                break;
            }
            neighbours(vertex, &mut ring);
            queue.extend(ring.iter().filter(|&&v| cells[v] == VoronoiCell::NONE));
        }
        if weights[own] < enough {
            leftovers.push((own, std::mem::take(&mut members)));
        }
    }
    // In the order of creation: each merge may make a cell heavier for the next.
    let mut joined = false;
    for (own, members) in leftovers {
        let mut lightest: Option<(f64, VoronoiCell)> = None;
        for &vertex in &members {
            neighbours(vertex, &mut ring);
            for cell in ring.iter().filter_map(|&v| cells[v].some()).filter(|&cell| cell != own) {
                let weight = weights[cell];
                if lightest.is_none_or(|(least, at)| (weight, cell) < (least, at)) {
                    lightest = Some((weight, cell));
                }
            }
        }
        if let Some((_, cell)) = lightest {
            members.iter().for_each(|&vertex| cells[vertex] = cell);
            let joining = weights[own];
            weights[cell] += joining;
            joined = true;
        }
    }
    if joined { renumber(cells, weights.len()) } else { weights.len() }
}

/// Renumbers the cells that have vertices without gaps, in order; returns their number.
fn renumber(cells: &mut VertexCells, count: usize) -> usize {
    let mut has_vertices: TiVec<VoronoiCell, bool> = vec![false; count].into();
    cells.iter().filter_map(|cell| cell.some()).for_each(|cell| has_vertices[cell] = true);
    let mut next = 0;
    let mut renumbered: TiVec<VoronoiCell, VoronoiCell> = vec![VoronoiCell::NONE; count].into();
    for cell in has_vertices.keys().filter(|&cell| has_vertices[cell]) {
        renumbered[cell] = VoronoiCell::from(next);
        next += 1;
    }
    cells.iter_mut().filter(|cell| **cell != VoronoiCell::NONE).for_each(|cell| *cell = renumbered[*cell]);
    next
}

#[cfg(test)]
pub(super) mod short {
    //! Short names of ids for tests.

    use super::VoronoiCell;

    /// A cell.
    pub const fn cell(number: u32) -> VoronoiCell {
        VoronoiCell::new(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells of vertices along a line.
    fn in_a_row(masses: &[f64], enough: f64) -> (Vec<u32>, usize) {
        let mut cells: TiVec<_, _> = vec![VoronoiCell::NONE; masses.len()].into();
        let order: Vec<LocalVertex> = LocalVertex::first(masses.len()).collect();
        let neighbours = |vertex: LocalVertex, ring: &mut Vec<LocalVertex>| {
            ring.clear();
            ring.extend(order.iter().filter(|other| other.number().abs_diff(vertex.number()) == 1));
        };
        let count = grow(&order, TiSlice::from_ref(masses), enough, &mut cells, neighbours);
        (cells.iter().map(|cell| cell.number()).collect(), count)
    }

    #[test]
    fn masses_1_to_5_to_the_power_0_1_2_give_5_4_3_cells() {
        for (lambda, expected) in [(0, 5), (1, 4), (2, 3)] {
            let masses: Vec<f64> = (1..=5).map(|i| f64::from(i).powi(lambda)).collect();
            let (_, count) = in_a_row(&masses, masses.iter().sum::<f64>() / 5.0);
            assert_eq!(count, expected, "λ = {lambda}");
        }
    }

    #[test]
    fn what_cannot_grow_joins_the_lightest_neighbour() {
        let (cells, count) = in_a_row(&[3.0, 9.0, 1.0, 4.0], 3.0);
        assert_eq!((cells, count), (vec![0, 1, 2, 2], 3));
        let (cells, count) = in_a_row(&[9.0, 1.0], 3.0);
        assert_eq!((cells, count), (vec![0, 0], 1));
        assert_eq!(in_a_row(&[1.0, 1.0], 3.0).1, 1);
    }

    #[test]
    fn morton_order_walks_quarter_by_quarter() {
        let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let positions = [at(3.0, 3.0), at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(3.0, 0.0), at(1.0, 1.0)];
        let order = morton_order(TiSlice::from_ref(&positions), LocalVertex::first(6));
        assert_eq!(order, [1, 2, 3, 5, 4, 0].map(LocalVertex::new));
    }
}

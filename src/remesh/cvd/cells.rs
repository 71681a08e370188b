//! The first cells: seeds in Morton order, grown breadth-first until their mass reaches D_avg.
//!
//! ```text
//!   masses   1   2   3   4   5     D_avg 3
//!   cells   [1   2] [3] [4] [5]    a cell closes when its mass reaches D_avg
//! ```

use std::collections::VecDeque;

use glam::DVec3;

/// Cell of a vertex without a cell.
pub const NO_CELL: u32 = u32::MAX;
/// Bits of a Morton code for each axis.
const MORTON_BITS: u32 = 21;

/// Vertices in Morton order of their positions within the box around all `positions`; equal codes in order of ids.
pub fn morton_order(positions: &[DVec3], vertices: impl Iterator<Item = u32>) -> Vec<u32> {
    let low = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let steps = f64::from((1 << MORTON_BITS) - 1) / (high - low).max_element().max(f64::MIN_POSITIVE);
    let code = |vertex: u32| {
        let cell = (positions[vertex as usize] - low) * steps;
        [cell.x, cell.y, cell.z].iter().enumerate().map(|(axis, &c)| spread(c as u64) << axis).sum::<u64>()
    };
    let mut order: Vec<(u64, u32)> = vertices.map(|vertex| (code(vertex), vertex)).collect();
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
    order: &[u32],
    masses: &[f64],
    enough: f64,
    cells: &mut [u32],
    mut neighbours: impl FnMut(u32, &mut Vec<u32>),
) -> u32 {
    let mut count = cells.iter().filter(|&&cell| cell != NO_CELL).max().map_or(0, |cell| cell + 1);
    let mut weights = vec![0.0; count as usize];
    for (vertex, &cell) in cells.iter().enumerate().filter(|&(_, &cell)| cell != NO_CELL) {
        weights[cell as usize] += masses[vertex];
    }
    let (mut queue, mut ring, mut members) = (VecDeque::new(), Vec::new(), Vec::new());
    let mut leftovers = Vec::new();
    for &seed in order {
        if cells[seed as usize] != NO_CELL {
            continue;
        }
        queue.clear();
        members.clear();
        queue.push_back(seed);
        let mut weight = 0.0;
        while let Some(vertex) = queue.pop_front() {
            if cells[vertex as usize] != NO_CELL {
                continue;
            }
            cells[vertex as usize] = count;
            members.push(vertex);
            weight += masses[vertex as usize];
            if weight >= enough {
                break;
            }
            neighbours(vertex, &mut ring);
            queue.extend(ring.iter().filter(|&&v| cells[v as usize] == NO_CELL));
        }
        weights.push(weight);
        if weight < enough {
            leftovers.push((count, std::mem::take(&mut members)));
        }
        count += 1;
    }
    // In the order of creation: each merge may make a cell heavier for the next.
    let mut joined = false;
    for (own, members) in leftovers {
        let mut lightest: Option<(f64, u32)> = None;
        for &vertex in &members {
            neighbours(vertex, &mut ring);
            for cell in ring.iter().map(|&v| cells[v as usize]).filter(|&cell| cell != own && cell != NO_CELL) {
                let weight = weights[cell as usize];
                if lightest.is_none_or(|(least, at)| (weight, cell) < (least, at)) {
                    lightest = Some((weight, cell));
                }
            }
        }
        if let Some((_, cell)) = lightest {
            members.iter().for_each(|&vertex| cells[vertex as usize] = cell);
            weights[cell as usize] += weights[own as usize];
            joined = true;
        }
    }
    if joined { renumber(cells, count) } else { count }
}

/// Renumbers the cells that have vertices without gaps, in order; returns their number.
fn renumber(cells: &mut [u32], count: u32) -> u32 {
    let mut numbers = vec![NO_CELL; count as usize];
    cells.iter().filter(|&&cell| cell != NO_CELL).for_each(|&cell| numbers[cell as usize] = 0);
    let mut next = 0;
    for number in numbers.iter_mut().filter(|number| **number == 0) {
        *number = next;
        next += 1;
    }
    cells.iter_mut().filter(|cell| **cell != NO_CELL).for_each(|cell| *cell = numbers[*cell as usize]);
    next
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells of vertices along a line.
    fn in_a_row(masses: &[f64], enough: f64) -> (Vec<u32>, u32) {
        let mut cells = vec![NO_CELL; masses.len()];
        let order: Vec<u32> = (0..masses.len() as u32).collect();
        let last = masses.len() as u32 - 1;
        let neighbours = |v: u32, ring: &mut Vec<u32>| {
            ring.clear();
            ring.extend([v.wrapping_sub(1), v + 1].iter().filter(|&&n| n <= last));
        };
        let count = grow(&order, masses, enough, &mut cells, neighbours);
        (cells, count)
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
        assert_eq!(morton_order(&positions, 0..6), [1, 2, 3, 5, 4, 0]);
    }
}

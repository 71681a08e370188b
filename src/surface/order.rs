//! The order in which cells are searched.

use super::cell::Cell;
use crate::geometry::boxtree::Bounds;

/// Lists the squared distance of each cell from a box, and its number, the nearest first.
pub fn order_by_distance(cells: &[Cell], bounds: Bounds, order: &mut Vec<(f64, u32)>) {
    order.clear();
    order.extend(cells.iter().zip(0..).map(|(cell, number)| (cell.bounds.between_sq(bounds), number)));
    sort_by_distance(order);
}

/// Sorts cells by their squared distance; of equally near ones, the first stays first.
pub fn sort_by_distance(order: &mut [(f64, u32)]) {
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
}

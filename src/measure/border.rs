//! How far the open borders of a result lie from those of its input.
//!
//! ```text
//!   before   .--.--.--.--.--.--.
//!                   d |               points along the border after, each to its nearest place on the border before
//!   after    x----x----x----x
//! ```
//!
//! # Memory
//! About 120 bytes per boundary edge before (four times that if long edges fill space).

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use super::surface::Surface;
use crate::base::pool::in_parallel;
use crate::geometry::boxtree::{Bounds, BoxTree};
use crate::topology::edges::EdgeTable;

/// Maximum number of points taken along the border, beyond its vertices.
const SAMPLE_LIMIT: f64 = 1e6;
/// Spacing of points along the border, in mean lengths of its edges.
const SAMPLE_STEP: f64 = 0.5;
/// Maximum length of an indexed part of an edge, in mean edge lengths: a long edge would have a wide box.
const PIECE_LENGTH_MAX: f64 = 2.0;
/// Minimum length of such a part, in mean edge lengths, so that there are on average at most four parts per edge.
const PIECE_LENGTH_MIN: f64 = 1.0 / 3.0;
/// Edges that a thread takes at a time. Sums are taken per chunk and then in order, whatever the thread count.
const EDGES_AT_ONCE: usize = 4096;

/// Distances from a border to another one, in the mesh's unit of length.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct BorderDeviation {
    /// Largest distance.
    pub max: f64,
    /// Root of the mean squared distance over the border's length.
    pub rms: f64,
}

/// The edges of a surface that have one face.
pub fn border_of(surface: &Surface) -> Vec<[DVec3; 2]> {
    let edges = EdgeTable::new(&surface.faces).boundary();
    edges.into_iter().map(|edge| edge.map(|vertex| surface.positions[vertex])).collect()
}

/// Distances from the boundary edges `after` to the boundary edges `before`.
///
/// Zero if `after` is empty; otherwise infinite if `before` is empty. About O(n log n).
pub fn border_deviation(before: &[[DVec3; 2]], after: &[[DVec3; 2]]) -> BorderDeviation {
    if after.is_empty() {
        return BorderDeviation::default();
    }
    let index = BorderIndex::new(before);
    if index.pieces.is_empty() {
        return BorderDeviation { max: f64::INFINITY, rms: f64::INFINITY };
    }
    let length: f64 = after.iter().map(|[a, b]| a.distance(*b)).sum();
    let step = (SAMPLE_STEP * length / after.len() as f64).max(length / SAMPLE_LIMIT);
    let sum_of = |edges: &[[DVec3; 2]]| {
        let (mut max_sq, mut integral) = (0.0f64, 0.0);
        for &[from, to] in edges {
            let ends = [from, to].map(|end| index.distance_sq(end));
            let parts = piece_count(from.distance(to), step);
            let mut sum = 0.5 * (ends[0] + ends[1]);
            max_sq = max_sq.max(ends[0]).max(ends[1]);
            for part in 1..parts {
                let at_point = index.distance_sq(from.lerp(to, part as f64 / parts as f64));
                max_sq = max_sq.max(at_point);
                sum += at_point;
            }
            integral += sum * from.distance(to) / parts as f64;
        }
        (max_sq, integral)
    };
    let sums: Vec<(f64, f64)> = in_parallel(|| after.par_chunks(EDGES_AT_ONCE).map(sum_of).collect());
    let (max_sq, integral) = sums.into_iter().fold((0.0f64, 0.0), |all, one| (all.0.max(one.0), all.1 + one.1));
    let mean_sq = if length > 0.0 { integral / length } else { max_sq };
    BorderDeviation { max: max_sq.sqrt(), rms: mean_sq.sqrt() }
}

/// Number of parts of at most about `step` that `length` is split into, at least 1; 1 if a length is 0 or not a number.
fn piece_count(length: f64, step: f64) -> usize {
    if step > 0.0 { ((length / step).ceil() as usize).max(1) } else { 1 }
}

struct BorderIndex {
    pieces: Vec<[DVec3; 2]>,
    tree: BoxTree,
}

impl BorderIndex {
    fn new(border: &[[DVec3; 2]]) -> Self {
        let length: f64 = border.iter().map(|[a, b]| a.distance(*b)).sum();
        let mean = length / border.len().max(1) as f64;
        let bounds = Bounds::around(border.iter().flatten().copied());
        // edges that fill space, as those of a triangle soup do, are split to the size of their share of it
        let share = bounds.diagonal() / (border.len().max(1) as f64).cbrt();
        let step = share.max(PIECE_LENGTH_MIN * mean).min(PIECE_LENGTH_MAX * mean);
        let mut pieces = Vec::with_capacity(border.len() + border.len() / 2);
        for &[from, to] in border {
            let parts = piece_count(from.distance(to), step);
            let at = |part: usize| if part == parts { to } else { from.lerp(to, part as f64 / parts as f64) };
            pieces.extend((0..parts).map(|part| [at(part), at(part + 1)]));
        }
        Self { tree: BoxTree::new(pieces.len(), |item| Bounds::around(pieces[item as usize])), pieces }
    }

    fn distance_sq(&self, point: DVec3) -> f64 {
        self.tree.nearest_sq(point, f64::INFINITY, |item| segment_distance_sq(point, self.pieces[item as usize]))
    }
}

fn segment_distance_sq(point: DVec3, [from, to]: [DVec3; 2]) -> f64 {
    let (step, offset) = (to - from, point - from);
    let length_sq = step.length_squared();
    let along = if length_sq > 0.0 { (offset.dot(step) / length_sq).clamp(0.0, 1.0) } else { 0.0 };
    (offset - step * along).length_squared()
}

#[cfg(test)]
mod tests {
    use super::super::surface::tests::bare;
    use super::*;

    fn deviation(before: &Surface, after: &Surface) -> BorderDeviation {
        border_deviation(&border_of(before), &border_of(after))
    }

    fn square(side: f64, height: f64) -> Surface {
        // 2 - 3
        // | \ |
        // 0 - 1
        let positions = [[0.0, 0.0, height], [side, 0.0, height], [0.0, side, height], [side, side, height]];
        bare(&positions, &[[0, 1, 2], [2, 1, 3]])
    }

    #[test]
    fn a_border_lies_on_itself() {
        assert_eq!(deviation(&square(1.0, 0.0), &square(1.0, 0.0)), BorderDeviation::default());
    }

    #[test]
    fn a_lifted_border_is_as_far_as_it_was_lifted() {
        let deviation = deviation(&square(1.0, 0.0), &square(1.0, 0.25));
        assert!((deviation.max - 0.25).abs() < 1e-12 && (deviation.rms - 0.25).abs() < 1e-12);
    }

    #[test]
    fn inside_points_of_a_long_edge_are_seen() {
        // 3 ----- 2        the corner at 2 is cut: the new edge 1 3 passes it at √½
        // |     / |
        // |   /   |
        // 0 ----- 1
        let whole = bare(&[[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2], [0, 2, 3]]);
        let cut = bare(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2]]);
        let deviation = deviation(&whole, &cut);
        assert!(deviation.max > 0.3 && deviation.max <= 0.5 && deviation.rms < deviation.max);
    }

    #[test]
    fn a_border_that_was_not_there_is_infinitely_far() {
        let closed = bare(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[[0, 1, 2], [0, 2, 1]]);
        assert_eq!(deviation(&closed, &square(1.0, 0.0)).max, f64::INFINITY);
        assert_eq!(deviation(&square(1.0, 0.0), &closed), BorderDeviation::default());
    }
}

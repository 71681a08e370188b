//! Distance of a result from its input, measured at some thousand points when a run ends.
//!
//! In: what the passes kept of the input ([`Probes`]), and the result as it is stored. Out: the root of the mean
//! squared distance in each direction. Each distance is exact, and a point whose search takes too long is left out;
//! since the points are few, the figures are estimates of what [`compare`](super::compare) finds with more of them.
//!
//! # Memory
//! One piece of the result at a time: 72 bytes a triangle and about as much for its tree. 24 bytes and a tree for each
//! of up to 65,536 landmarks, 32 bytes for each of some 40,000 points.

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use crate::base::pool::in_parallel;
use crate::base::{Progress, Result};
use crate::geometry::boxtree::{Bounds, BoxTree};
use crate::geometry::closest_point;
use crate::model::StoredMesh;
use crate::model::corners::PieceCorners;
use crate::model::id::PieceVertex;
use crate::passes::chosen_cells::ChosenCells;
use crate::passes::probes::{ProbeTriangle, Probes};
use crate::passes::random_points::RandomPoints;

/// Maximum number of points tried on the result, as a multiple of those that its input would take.
const CANDIDATES_MAX: u64 = 16;
/// One landmark is taken for this many vertices of the result, but no more than [`LANDMARKS_MAX`] in all.
const VERTICES_PER_LANDMARK: u64 = 8;
const LANDMARKS_MAX: u64 = 65_536;
/// Points that are searched for one after the other.
const RUN_POINTS: usize = 128;
/// Items that a search looks at before the point is given up: where triangles lie across each other by the thousand, a
/// tree of boxes does not help.
const LOOKS_MAX: u32 = 4096;
/// Squared distance of a point that was given up.
const GIVEN_UP: f64 = f64::NEG_INFINITY;
/// Largest factor by which the deviation of the whole is taken to exceed, or fall below, that of the cells.
const SCALE_MAX: f64 = 8.0;

/// Distances between input and result, in the mesh's unit of length.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Gauged {
    /// Root of the mean squared distance, both directions with equal weight.
    pub rms: f64,
    /// The same from the result to the input.
    pub to_input: f64,
    /// The same from the input to the result.
    pub to_result: f64,
    /// Points on both surfaces together.
    pub points: u64,
}

/// Measures a result against what was kept of its input; `None` if one of the two has no area.
///
/// # Errors
/// On failed reads and damaged files.
pub fn gauge(probes: &Probes, result: &StoredMesh, progress: &dyn Progress) -> Result<Option<Gauged>> {
    let share = probes.probing.grid.share();
    let spacing = probes.area() * share / probes.probing.cell_points() as f64;
    if probes.triangle_count() == 0 || !spacing.is_normal() {
        return Ok(None);
    }
    let most = CANDIDATES_MAX * (probes.probing.cell_points() as f64 / share) as u64;
    let (mut chosen, mut of_result) = (ChosenCells::new(probes.probing.grid), Vec::new());
    // Points of the input in the cells: they show how well the cells represent the whole.
    let mut of_input = probes.points.clone();
    let mut spread = RandomPoints::new(spacing, most, 1);
    for triangle in ProbeTriangle::first(probes.triangle_count()) {
        spread.over(probes.triangle(triangle), |point| {
            of_input.extend(chosen.holding(point).filter(|&cell| probes.has_all_near(cell)).map(|_| point));
        });
    }
    let mut to_result = at_most_sq(result, &of_input)?;
    let noise_sq = result.rounding_noise().powi(2);
    let mut spread = RandomPoints::new(spacing, most, 0);
    for piece in &result.pieces {
        progress.check_stopped()?;
        let corners = PieceCorners::read(result, piece, false)?;
        let triangle = |&[a, b, c]: &[PieceVertex; 3]| [corners.position(a), corners.position(b), corners.position(c)];
        let triangles: Vec<[DVec3; 3]> = corners.faces.iter().map(triangle).collect();
        drop(corners);
        let targets = MeasuredFaces { count: triangles.len(), triangle: |face| triangles[face as usize], noise_sq };
        let search = || targets.lower(&of_input, &mut to_result);
        let spread_points = || {
            for &triangle in &triangles {
                let are_met = chosen.are_met(triangle);
                let mut is_searched = |point| chosen.holding(point).is_some_and(|cell| probes.has_all_near(cell));
                if are_met {
                    spread.over(triangle, |point| of_result.extend(is_searched(point).then_some(point)))
                } else {
                    spread.pass(triangle)
                }
            }
        };
        in_parallel(|| rayon::join(search, spread_points));
    }
    let mut to_input = vec![f64::INFINITY; of_result.len()];
    let of_input = |triangle| probes.triangle(ProbeTriangle::new(triangle));
    MeasuredFaces { count: probes.triangle_count(), triangle: of_input, noise_sq }.lower(&of_result, &mut to_input);
    if to_result.is_empty() || result.face_count() == 0 {
        return Ok(None);
    }
    Ok(gauged(probes, &to_input, &to_result))
}

/// Figures of squared distances: those of the input's points to the result begin with the points that have weights.
/// `None` if all points with weights were given up.
fn gauged(probes: &Probes, to_input: &[f64], to_result: &[f64]) -> Option<Gauged> {
    let is_found = |distance_sq: &&f64| **distance_sq != GIVEN_UP;
    let found = |distances: &[f64]| distances.iter().filter(is_found).count();
    let mean_of = |distances: &[f64]| match found(distances) {
        0 => 0.0,
        count => distances.iter().filter(is_found).sum::<f64>() / count as f64,
    };
    let (anywhere, in_cells) = to_result.split_at(probes.points.len());
    let weighed = || anywhere.iter().zip(&probes.weights).filter(|(distance_sq, _)| is_found(distance_sq));
    let all: f64 = probes.weights.iter().sum();
    let share =
        if found(anywhere) == anywhere.len() { 1.0 } else { weighed().map(|(_, weight)| weight).sum::<f64>() / all };
    if share == 0.0 {
        return None;
    }
    let sum: f64 = weighed().map(|(distance_sq, weight)| weight * distance_sq).sum();
    let to_result_sq = sum / (probes.area() * share);
    // A result of a few hundred faces may have no point in any cell: both directions then have the input's deviation.
    let to_input_sq =
        if found(to_input) == 0 { to_result_sq } else { scaled(mean_of(to_input), mean_of(in_cells), to_result_sq) };
    Some(Gauged {
        rms: (0.5 * (to_input_sq + to_result_sq)).sqrt(),
        to_input: to_input_sq.sqrt(),
        to_result: to_result_sq.sqrt(),
        points: (found(to_input) + found(to_result)) as u64,
    })
}

/// Deviation in the cells in one direction, scaled by the ratio of the whole to the cells in the other direction: in
/// both directions the surface deviates at the same places.
fn scaled(in_cells: f64, others_in_cells: f64, others: f64) -> f64 {
    match (in_cells > 0.0, others_in_cells > 0.0) {
        (_, true) => in_cells * (others / others_in_cells).clamp(1.0 / SCALE_MAX, SCALE_MAX),
        (true, false) => in_cells,
        // Nothing changed in any cell.
        (false, false) => others,
    }
}

/// Squared distances of points to the nearest of some vertices of the result; faces farther away are skipped.
fn at_most_sq(result: &StoredMesh, points: &[DVec3]) -> Result<Vec<f64>> {
    let own: u64 = result.pieces.iter().map(|piece| piece.positions.len()).sum();
    let step = (own / LANDMARKS_MAX).max(VERTICES_PER_LANDMARK) as usize;
    let mut landmarks = Vec::new();
    for piece in &result.pieces {
        // All of them are at faces.
        landmarks.extend(piece.positions.window(0..piece.positions.len())?.into_iter().step_by(step));
    }
    let tree = BoxTree::new(landmarks.len(), |index| Bounds::around([landmarks[index as usize]]));
    let mut distances_sq = vec![f64::INFINITY; points.len()];
    let noise_sq = result.rounding_noise().powi(2);
    lower(&tree, points, &mut distances_sq, |point, index, _| {
        counted(landmarks[index as usize].distance_squared(point), noise_sq)
    });
    Ok(distances_sq)
}

/// A squared distance, or 0 if it is just rounding.
fn counted(distance_sq: f64, noise_sq: f64) -> f64 {
    if distance_sq <= noise_sq { 0.0 } else { distance_sq }
}

/// Triangles that distances are measured to.
struct MeasuredFaces<T> {
    count: usize,
    triangle: T,
    /// Squared distances up to this are rounding, and count as 0: nothing is nearer, so the search ends.
    noise_sq: f64,
}

impl<T: Fn(u32) -> [DVec3; 3] + Sync> MeasuredFaces<T> {
    /// Lowers the squared distances of points to those from the triangles.
    fn lower(&self, points: &[DVec3], distances_sq: &mut [f64]) {
        let tree = BoxTree::new(self.count, |face| Bounds::around((self.triangle)(face)));
        lower(&tree, points, distances_sq, |point, face, limit| {
            let corners = (self.triangle)(face);
            if Bounds::around(corners).distance_sq(point) >= limit {
                return limit;
            }
            counted(closest_point(point, corners).distance_squared(point), self.noise_sq)
        });
    }
}

/// Lowers the squared distances of points to those from the items of a tree. `distance_sq` is that of a point and an
/// item; it may be the limit, its last argument, if it is not below that. Points that take too many looks become
/// [`GIVEN_UP`].
fn lower(
    tree: &BoxTree,
    points: &[DVec3],
    distances_sq: &mut [f64],
    distance_sq: impl Fn(DVec3, u32, f64) -> f64 + Sync,
) {
    let lower_run = |(points, distances_sq): (&[DVec3], &mut [f64])| {
        // Points in a run are neighbours, so the item nearest to one is near the next.
        let mut last = None;
        for (&point, lowest) in points.iter().zip(distances_sq) {
            if tree.bounds().distance_sq(point) >= *lowest {
                continue;
            }
            let (mut best, mut nearest, mut looks) = (*lowest, last, 0);
            let mut lower_to = |item| {
                looks += 1;
                if looks > LOOKS_MAX {
                    return GIVEN_UP;
                }
                let distance_sq = distance_sq(point, item, best);
                if distance_sq < best {
                    (best, nearest) = (distance_sq, Some(item));
                }
                best
            };
            let limit = last.map_or(*lowest, &mut lower_to);
            *lowest = tree.nearest_sq(point, limit, lower_to);
            last = nearest;
        }
    };
    in_parallel(|| points.par_chunks(RUN_POINTS).zip(distances_sq.par_chunks_mut(RUN_POINTS)).for_each(lower_run));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;
    use crate::partition::ClusterId;
    use crate::passes::probes::Probing;

    #[test]
    fn points_with_too_many_items_around_them_are_given_up() {
        let around = Bounds::around([DVec3::ZERO, DVec3::ONE]);
        for (count, expected) in [(LOOKS_MAX - 1, 0.25), (2 * LOOKS_MAX, GIVEN_UP)] {
            let tree = BoxTree::new(count as usize, |_| around);
            let mut distances_sq = [f64::INFINITY, f64::INFINITY, 0.0];
            lower(&tree, &[DVec3::splat(0.5); 3], &mut distances_sq, |_, _, _| 0.25);
            assert_eq!(distances_sq, [expected, expected, 0.0], "{count} items");
            // A point that was given up is not taken up again.
            let few = BoxTree::new(1, |_| around);
            lower(&few, &[DVec3::splat(0.5); 3], &mut distances_sq, |_, _, _| 0.0);
            assert_eq!(distances_sq[0], expected.min(0.0));
        }
    }

    #[test]
    fn figures_are_those_of_the_points_that_are_left() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE].map(|corner| (corner, glam::DVec2::NAN));
        let mesh = samples::mesh_of(corners, &[[0, 1, 2], [2, 1, 3]]);
        let probes = Probing::new(2, 1, 1.0).take(&mesh, DVec3::ZERO, ClusterId::new(0));
        let count = probes.points.len();
        let whole = gauged(&probes, &[4.0, 4.0], &vec![9.0; count]).unwrap();
        let mut some: Vec<f64> = (0..count).map(|point| if point % 3 == 0 { GIVEN_UP } else { 9.0 }).collect();
        let left = gauged(&probes, &[4.0, GIVEN_UP], &some).unwrap();
        assert!((left.rms - whole.rms).abs() < 1e-12 && (left.to_result - whole.to_result).abs() < 1e-12);
        assert_eq!(left.points as usize, 1 + count - count.div_ceil(3));
        assert_eq!(whole.points as usize, 2 + count);
        some.fill(GIVEN_UP);
        assert_eq!(gauged(&probes, &[4.0], &some), None);
    }

    #[test]
    fn a_point_on_very_many_triangles_is_found() {
        let triangle = |_| [DVec3::ZERO, DVec3::X, DVec3::Y + DVec3::Z];
        let targets = MeasuredFaces { count: 2 * LOOKS_MAX as usize, triangle, noise_sq: 1e-12 };
        let mut distances_sq = [f64::INFINITY; 2];
        let beside = |shift: f64| DVec3::new(0.2, 0.2 - shift, 0.2 + shift);
        targets.lower(&[1e-7, 1e-3].map(beside), &mut distances_sq);
        assert_eq!(distances_sq, [0.0, GIVEN_UP]);
    }
}

//! Distance of a result from its input, measured at some thousand points when a run ends.
//!
//! In: what the passes kept of the input ([`Probes`]), and the result as it is stored. Out: the root of the mean
//! squared distance in each direction. Each distance is exact; since the points are few, the figures are estimates of
//! what [`compare`](super::compare) finds with more of them.
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
    let mut spread = RandomPoints::new(spacing, most, 0);
    for piece in &result.pieces {
        progress.check_stopped()?;
        let corners = PieceCorners::read(result, piece, false)?;
        let triangle = |face: &[PieceVertex; 3]| face.map(|vertex| corners.position(vertex));
        let triangles: Vec<[DVec3; 3]> = corners.faces.iter().map(triangle).collect();
        drop(corners);
        let search = || nearest_sq(triangles.len(), |face| triangles[face as usize], &of_input, &mut to_result);
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
    nearest_sq(probes.triangle_count(), of_input, &of_result, &mut to_input);
    if to_result.is_empty() || result.face_count() == 0 {
        return Ok(None);
    }
    let noise = result.rounding_noise();
    let counted = |distance_sq: &f64| if *distance_sq <= noise * noise { 0.0 } else { *distance_sq };
    let mean_of = |distances: &[f64]| match distances.len() {
        0 => 0.0,
        count => distances.iter().map(counted).sum::<f64>() / count as f64,
    };
    let (anywhere, in_cells) = to_result.split_at(probes.points.len());
    let weighed = anywhere.iter().zip(&probes.weights).map(|(distance_sq, weight)| weight * counted(distance_sq));
    let to_result_sq = weighed.sum::<f64>() / probes.area();
    // A result of a few hundred faces may have no point in any cell: both directions then have the input's deviation.
    let to_input_sq =
        if to_input.is_empty() { to_result_sq } else { scaled(mean_of(&to_input), mean_of(in_cells), to_result_sq) };
    Ok(Some(Gauged {
        rms: (0.5 * (to_input_sq + to_result_sq)).sqrt(),
        to_input: to_input_sq.sqrt(),
        to_result: to_result_sq.sqrt(),
        points: (to_input.len() + to_result.len()) as u64,
    }))
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
    lower(&tree, points, &mut distances_sq, |point, index, _| landmarks[index as usize].distance_squared(point));
    Ok(distances_sq)
}

/// Lowers the squared distances of points to those from `count` triangles.
fn nearest_sq(count: usize, triangle: impl Fn(u32) -> [DVec3; 3] + Sync, points: &[DVec3], distances_sq: &mut [f64]) {
    let tree = BoxTree::new(count, |face| Bounds::around(triangle(face)));
    lower(&tree, points, distances_sq, |point, face, limit| {
        let corners = triangle(face);
        let may_be_nearer = Bounds::around(corners).distance_sq(point) < limit;
        if may_be_nearer { closest_point(point, corners).distance_squared(point) } else { limit }
    });
}

/// Lowers the squared distances of points to those from the items of a tree. `distance_sq` is that of a point and an
/// item; it may be the limit, its last argument, if it is not below that.
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
            let (mut best, mut nearest) = (*lowest, last);
            let mut lower_to = |item| {
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

//! How far a result lies from its input, measured at some thousand points when a run ends.
//!
//! In: what the passes kept of the input ([`Probes`]), and the result as it is stored. Out: the root of the mean squared
//! distance each way. The distances are exact; that they are those of some points makes the figures estimates of what
//! [`compare`](super::compare) finds with more of them.
//!
//! # Memory
//! A piece of the result at a time: 72 bytes a triangle and about as much for its tree.

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use super::compare::closest::closest_point;
use crate::base::{Progress, Result};
use crate::mesh::boxtree::{Bounds, BoxTree};
use crate::stitch::probes::{ChosenCells, Probes, Spread};
use crate::store::StoredMesh;
use crate::store::corners::PieceCorners;

/// Points that are tried on the result, in those that its input would take.
const CANDIDATES_MAX: u64 = 16;

/// Distances between input and result, in the mesh's unit of length.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Gauged {
    /// Root of the mean squared distance, both ways with equal weight.
    pub rms: f64,
    /// The same from the result to the input.
    pub to_input: f64,
    /// The same from the input to the result.
    pub to_result: f64,
    /// Points on both surfaces together.
    pub points: u64,
}

/// Measures a result by what was kept of its input; nothing if one of the two has no area.
///
/// # Errors
/// On failed reads and damaged files.
pub fn gauge(probes: &Probes, result: &StoredMesh, progress: &dyn Progress) -> Result<Option<Gauged>> {
    let share = probes.probing.share();
    let spacing = probes.area() * share / probes.probing.points as f64;
    if probes.triangle_count() == 0 || !spacing.is_normal() {
        return Ok(None);
    }
    let mut to_result: Vec<f64> = probes.points.iter().map(|&point| farthest_sq(result, point)).collect();
    let most = CANDIDATES_MAX * (probes.probing.points as f64 / share) as u64;
    let mut spread = Spread::new(spacing, most, 0);
    let (mut chosen, mut of_result) = (ChosenCells::new(probes.probing), Vec::new());
    for piece in &result.pieces {
        progress.check_stopped()?;
        let corners = PieceCorners::read(result, piece, false)?;
        let triangle = |face: &[u32; 3]| face.map(|vertex| corners.position(vertex));
        let triangles: Vec<[DVec3; 3]> = corners.vertices.as_chunks().0.iter().map(triangle).collect();
        drop(corners);
        let search = || nearest_sq(triangles.len(), |face| triangles[face as usize], &probes.points, &mut to_result);
        rayon::join(search, || {
            for &triangle in &triangles {
                let are_met = chosen.are_met(triangle);
                let mut is_searched = |point| chosen.holding(point).is_some_and(|cell| probes.has_all_near(cell));
                match are_met {
                    true => spread.over(triangle, |point| of_result.extend(is_searched(point).then_some(point))),
                    false => spread.pass(triangle),
                }
            }
        });
    }
    let mut to_input = vec![f64::INFINITY; of_result.len()];
    nearest_sq(probes.triangle_count(), |face| probes.triangle(face), &of_result, &mut to_input);
    if to_input.is_empty() || to_result.is_empty() || result.face_count() == 0 {
        return Ok(None);
    }
    let noise = result.rounding_noise();
    let counted = |distance_sq: &f64| if *distance_sq <= noise * noise { 0.0 } else { *distance_sq };
    let mean_of = |distances: &[f64]| distances.iter().map(counted).sum::<f64>() / distances.len() as f64;
    let to_input_sq = mean_of(&to_input);
    let (mut sum, mut area_sum, mut rest) = (0.0, 0.0, &to_result[..]);
    for &(area, count) in probes.strata.iter().filter(|(_, count)| *count > 0) {
        let (own, others) = rest.split_at(count as usize);
        rest = others;
        sum += area * mean_of(own);
        area_sum += area;
    }
    let to_result_sq = sum / area_sum;
    Ok(Some(Gauged {
        rms: (0.5 * (to_input_sq + to_result_sq)).sqrt(),
        to_input: to_input_sq.sqrt(),
        to_result: to_result_sq.sqrt(),
        points: (to_input.len() + to_result.len()) as u64,
    }))
}

/// No point is farther from the result, squared: each side of the box around a piece's own vertices touches a face.
fn farthest_sq(result: &StoredMesh, point: DVec3) -> f64 {
    let farthest_sq = |bounds: Bounds| bounds.farthest_sq(point);
    let boxes = result.pieces.iter().filter(|piece| !piece.positions.is_empty()).map(|piece| piece.positions.bounds());
    boxes.map(|own| farthest_sq(Bounds { low: own.low.into(), high: own.high.into() })).fold(f64::INFINITY, f64::min)
}

/// Lowers the squared distances of points to those from `count` triangles.
fn nearest_sq(count: usize, triangle: impl Fn(u32) -> [DVec3; 3] + Sync, points: &[DVec3], distances_sq: &mut [f64]) {
    let tree = BoxTree::new(count, |face| Bounds::around(triangle(face)));
    points.par_iter().zip(distances_sq).for_each(|(&point, nearest_sq)| {
        if tree.bounds().distance_sq(point) < *nearest_sq {
            tree.nearest_sq(point, *nearest_sq, |face| {
                let corners = triangle(face);
                if Bounds::around(corners).distance_sq(point) < *nearest_sq {
                    *nearest_sq = nearest_sq.min(closest_point(point, corners).distance_squared(point));
                }
                *nearest_sq
            });
        }
    });
}

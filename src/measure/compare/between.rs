//! Distances between two surfaces, and nothing else.

use glam::DVec3;

use super::distribution::Distribution;
use super::options::Spread;
use super::points::{Batch, PointKind, Sampling};
use super::search::Search;
use crate::base::ordered::map_in_order;
use crate::base::{Progress, Result, WorkLimits};
use crate::surface::cells::SurfaceCells;

/// Points of a batch that are searched to the end where searches are abandoned.
const PROBES: usize = 16;

/// Distances in one direction, in the mesh's unit of length.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct DistanceFigures {
    /// Root of the mean square.
    pub rms: f64,
    /// 99 % of the surface is nearer.
    pub p99: f64,
}

/// Distances from `samples` points by area of one surface to the closest points of another.
///
/// # Errors
/// If the job was stopped, and on failed reads.
pub fn distances_between(
    from: &SurfaceCells,
    to: &SurfaceCells,
    samples: u64,
    limits: WorkLimits,
    progress: &dyn Progress,
) -> Result<DistanceFigures> {
    let sampling = Sampling::new(from, Spread::Area(samples), 1);
    let mut distances = Distribution::new(from.bounds.with(to.bounds).diagonal());
    let batches: Vec<Batch> =
        sampling.batches().into_iter().filter(|batch| batch.kind == PointKind::Area).collect();
    let search_all = |batch: &Batch| {
        let view = from.cells[batch.cell].view()?;
        let positions: Vec<DVec3> = sampling.points(batch, &view).iter().map(|point| point.position).collect();
        let (spoken, _) = Search::new(to).nearest(&positions, PROBES)?;
        Ok(spoken.into_iter().map(|(_, found)| found.distance_sq.sqrt()).collect::<Vec<f64>>())
    };
    map_in_order(batches.iter(), limits.threads, limits.threads + 1, search_all, |found| {
        found.into_iter().filter(|distance| distance.is_finite()).for_each(|distance| distances.add(distance));
        progress.check_stopped()
    })?;
    Ok(DistanceFigures { rms: distances.rms(), p99: distances.quantile(0.99) })
}

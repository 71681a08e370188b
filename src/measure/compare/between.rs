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

/// Two surfaces between which distances are taken.
#[derive(Clone, Copy)]
pub struct SurfacePair<'a> {
    /// The surface with the points.
    pub from: &'a SurfaceCells,
    /// The surface whose closest points are searched.
    pub to: &'a SurfaceCells,
}

impl SurfacePair<'_> {
    /// Distances from `samples` points by area.
    ///
    /// # Errors
    /// If the job was stopped, and on failed reads.
    pub fn distances(&self, samples: u64, limits: WorkLimits, progress: &dyn Progress) -> Result<DistanceFigures> {
        let mut distances = Distribution::new(self.from.bounds.with(self.to.bounds).diagonal());
        self.each_distance(samples, limits, progress, |_, distance| distances.add(distance))?;
        Ok(DistanceFigures { rms: distances.rms(), p99: distances.quantile(0.99) })
    }

    /// Passes `samples` points by area on, in order, each with its distance.
    ///
    /// # Errors
    /// As [`distances`](SurfacePair::distances).
    pub fn each_distance(
        &self,
        samples: u64,
        limits: WorkLimits,
        progress: &dyn Progress,
        mut see: impl FnMut(DVec3, f64),
    ) -> Result<()> {
        let sampling = Sampling::new(self.from, Spread::Area(samples), 1);
        let batches: Vec<Batch> =
            sampling.batches().into_iter().filter(|batch| batch.kind == PointKind::Area).collect();
        let search_all = |batch: &Batch| {
            let view = self.from.cells[batch.cell].view()?;
            let positions: Vec<DVec3> = sampling.points(batch, &view).iter().map(|point| point.position).collect();
            let distances = distances_to(self.to, &positions)?;
            Ok((positions, distances))
        };
        map_in_order(batches.iter(), limits.threads, limits.threads + 1, search_all, |(positions, distances)| {
            let found = positions.into_iter().zip(distances).filter(|(_, distance)| distance.is_finite());
            found.for_each(|(position, distance)| see(position, distance));
            progress.check_stopped()
        })
    }
}

/// The distance of each point from the closest one of a surface; infinite if that has no triangles.
///
/// # Errors
/// On failed reads.
pub fn distances_to(surface: &SurfaceCells, points: &[DVec3]) -> Result<Vec<f64>> {
    let (spoken, _) = Search::new(surface).nearest(points, PROBES)?;
    // Each point has a representative, in order.
    Ok(spoken.into_iter().map(|(_, found)| found.distance_sq.sqrt()).collect())
}

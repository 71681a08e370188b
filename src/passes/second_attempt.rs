//! Runs clusters of a pass a second time when the first attempt shows that their stops were wrong.

use super::outcome::{PassReport, StageReport, StageSums, before_leap};
use super::pass_id::Pass;
use super::records::ClusterResult;
use super::run::Run;
use super::sample;
use super::steps::{PassStep, STATISTICS};
use super::stop_rule::StopRule;
use super::sweep_result::SweepResult;
use super::trim::give_back;
use crate::base::Result;
use crate::base::id::TiVec;
use crate::partition::{ClusterId, Partition};
use crate::render::ClusterMap;

impl Run<'_> {
    /// Simplifies every cluster up to its stop. Does so again for some of them if the first attempt went below the
    /// target, and for a single cluster that ended with collapses that cost far more than those before and removed few
    /// faces.
    pub(super) fn run_attempts(&self, pass: Pass, partition: &Partition, stops: &StopRule) -> Result<SweepResult> {
        *self.map() = self.options.map.map(ClusterMap::new);
        let all: Vec<ClusterId> = partition.clusters().collect();
        let first_attempt = || self.attempt(pass, partition, stops, 0, all.clone());
        let again = PassStep::stops(pass, 1);
        let (better, first) = match self.job.recall::<StopRule>(&again.key(), &partition.cluster_count())? {
            Some(better) => (better, None),
            None => {
                let first = first_attempt()?;
                let Some(better) = self.better_stops(partition, stops, &first) else {
                    return self.sum(pass, partition, first);
                };
                self.job.keep(again.to_record(), [], &better)?;
                (better, Some(first))
            }
        };
        let is_changed = |cluster: &ClusterId| better.of(*cluster) != stops.of(*cluster);
        let changed: Vec<ClusterId> = all.iter().copied().filter(is_changed).collect();
        let results = if changed == all {
            let of_pass = [PassStep::partition(pass), PassStep::stops(pass, 0), again].map(PassStep::key);
            self.job.retain(&[&of_pass[..], &[STATISTICS], &self.kept_steps()].concat())?;
            self.attempt(pass, partition, &better, 1, changed)?
        } else {
            let mut results: TiVec<ClusterId, _> = first.map_or_else(first_attempt, Ok)?.into();
            let second = self.attempt(pass, partition, &better, 1, changed.clone())?;
            changed.into_iter().zip(second).for_each(|(cluster, result)| results[cluster] = result);
            results.raw
        };
        let met_wall = matches!(stops, StopRule::Faces(..));
        Ok(SweepResult { met_wall, ..self.sum(pass, partition, results)? })
    }

    /// Returns where the clusters stop in the second attempt, or `None` if the first attempt stands.
    fn better_stops(&self, partition: &Partition, stops: &StopRule, first: &[ClusterResult]) -> Option<StopRule> {
        let left: TiVec<ClusterId, u64> = first.iter().map(|result| result.counters.faces_out).collect();
        let faces_out: u64 = left.iter().sum();
        match stops {
            StopRule::Costs(_) | StopRule::Deviation(..)
                if faces_out < self.options.target && !partition.is_single() =>
            {
                // The sample did not represent the whole mesh, or the bound allows more than is wanted. A cluster ends one
                // face below its stop, or exactly at it: where that matters, all of them stop above the target, and the
                // trim takes over.
                let is_exact = self.has_large(partition);
                let wanted = if is_exact { self.options.target } else { self.before_trim() };
                let keep = give_back(&partition.face_counts(), &left, wanted);
                let above = |faces: u64| if is_exact || faces == 0 { faces } else { faces + 1 };
                stops.keeping(keep.into_iter().map(above).collect())
            }
            // A target that was met stands, whatever the last collapses cost. In earlier passes, and where the target
            // was missed, preserving the shape comes first.
            StopRule::Faces(_, target) if faces_out <= *target => None,
            // A bound preserves the shape by itself.
            _ if self.options.max_error.is_some() => None,
            StopRule::Faces(..) | StopRule::Shares(_) => {
                let before = self.state.reports.last().map(PassReport::end);
                let (mut stages, mut area) = (StageSums::default(), 0.0);
                for result in first {
                    stages.add(result.counters.faces_in, result.area, &result.milestones);
                    area += result.area;
                }
                let mean_area = area / partition.total_faces().max(1) as f64;
                let costs = costs_before_leap(before, &stages, mean_area)?;
                Some(StopRule::Trim(costs, vec![self.options.target; partition.cluster_count()].into()))
            }
            _ => None,
        }
    }
}

/// Cost thresholds for the stages of a second attempt: those of the first up to the first leap. `None` if costs never
/// leap. `before` is the end of the pass before, `mean_area` that of a face.
pub(super) fn costs_before_leap(before: Option<StageReport>, stages: &StageSums, mean_area: f64) -> Option<Vec<f32>> {
    let least = f64::from(sample::NEGLIGIBLE) * mean_area * mean_area;
    before_leap(before, &stages.reports(0.0), least)
}

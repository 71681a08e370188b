//! Runs a pass a second time when the first attempt shows that its stops were wrong.

use super::outcome::{PassReport, StageReport, StageSums, before_leap};
use super::pass_id::Pass;
use super::run::Run;
use super::sample;
use super::steps::{PassStep, STATISTICS};
use super::stop_rule::StopRule;
use super::sweep_result::SweepResult;
use super::trim::halfway;
use crate::base::Result;
use crate::partition::Partition;

impl Run<'_> {
    /// Simplifies every cluster up to its stop. Does so a second time if the first attempt went below the target, or if
    /// a single cluster ended with collapses that cost far more than those before and removed few faces.
    pub(super) fn run_attempts(&self, pass: Pass, partition: &Partition, stops: &StopRule) -> Result<SweepResult> {
        let again = PassStep::stops(pass, 1);
        let better = match self.job.recall::<StopRule>(&again.key(), &partition.cluster_count())? {
            Some(better) => better,
            None => {
                let result = self.attempt(pass, partition, stops, 0)?;
                let Some(better) = self.better_stops(partition, stops, &result) else { return Ok(result) };
                self.job.keep(again.to_record(), [], &better)?;
                let of_pass = [PassStep::partition(pass), PassStep::stops(pass, 0), again].map(PassStep::key);
                self.job.retain(&[&of_pass[..], &[STATISTICS], &self.kept_steps()].concat())?;
                better
            }
        };
        let result = self.attempt(pass, partition, &better, 1)?;
        Ok(SweepResult { met_wall: matches!(stops, StopRule::Faces(..)), ..result })
    }

    /// Returns where the clusters stop in the second attempt, or `None` if the first attempt stands.
    fn better_stops(&self, partition: &Partition, stops: &StopRule, first: &SweepResult) -> Option<StopRule> {
        let target = self.options.target;
        match stops {
            StopRule::Costs(costs) if first.report.faces_out < target => {
                // The sample did not represent the whole mesh. Keep the thresholds, but stop each cluster above the
                // target, where the trim takes over.
                let keep = halfway(&partition.face_counts(), &first.cluster_faces, self.before_trim());
                // A cluster ends one face below its stop, or exactly at it.
                let keep = keep.into_iter().map(|faces| faces + 1).collect();
                Some(StopRule::Trim(costs.clone(), keep))
            }
            // A target that was met stands, whatever the last collapses cost. In earlier passes, and where the target
            // was missed, preserving the shape comes first.
            StopRule::Faces(_, target) if first.report.faces_out <= *target => None,
            StopRule::Faces(..) | StopRule::Shares(_) => {
                let before = self.state.reports.last().map(PassReport::end);
                let mean_area = first.area / first.report.faces_in.max(1) as f64;
                let costs = costs_before_leap(before, &first.stages, mean_area)?;
                Some(StopRule::Trim(costs, vec![target; partition.cluster_count()].into()))
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

//! Runs a pass a second time when the first attempt shows that its plan was wrong.

use super::outcome::{PassOutcome, PassReport, before_leap};
use super::run::{Run, plan_step};
use super::sample;
use super::state::PassState;
use super::stop_rule::StopRule;
use super::trim::halfway;
use crate::base::Result;
use crate::cost::Metric;
use crate::job::Step;
use crate::partition::Partition;

impl<M: Metric> Run<'_, M> {
    /// Runs a pass by its plan. Runs it a second time if the first attempt went below the target, or if a single
    /// cluster ended with collapses that cost far more than those before and removed few faces.
    pub(super) fn run_plans(&self, state: &PassState, partition: &Partition, plan: &StopRule) -> Result<PassOutcome> {
        let (mesh, pass) = (&state.mesh, state.pass);
        let again = plan_step(pass, 1);
        let better = match self.job.recall_if(again, |plan: &mut StopRule| plan.is_sound(partition.cluster_count()))? {
            Some(better) => better,
            None => {
                let outcome = self.run_pass(mesh, partition, pass, plan, 0)?;
                let Some(better) = self.better_plan(state, partition, plan, &outcome) else { return Ok(outcome) };
                self.job.keep(again, 0, [], &better)?;
                let pass = pass as u32;
                let steps =
                    [Step::Input, Step::Cut { pass }, plan_step(pass as usize, 0), again, Step::Census, Step::Probes];
                self.job.retain(partition.files().chain(partition.files_of(mesh)), &steps)?;
                better
            }
        };
        let outcome = self.run_pass(mesh, partition, pass, &better, 1)?;
        Ok(PassOutcome { is_wall: matches!(plan, StopRule::Faces(..)), ..outcome })
    }

    /// Returns the plan for the second attempt, or `None` if the first attempt stands.
    fn better_plan(
        &self,
        state: &PassState,
        partition: &Partition,
        plan: &StopRule,
        outcome: &PassOutcome,
    ) -> Option<StopRule> {
        let target = self.options.target;
        match plan {
            StopRule::Costs(costs) if outcome.report.faces_out < target => {
                // The sample did not represent the whole mesh. Keep the thresholds, but stop each cluster above the
                // target, where the trim takes over.
                let keep = halfway(&partition.face_counts(), &outcome.cluster_faces, self.before_trim());
                // A cluster ends one face below its stop, or exactly at it.
                let keep = keep.into_iter().map(|faces| faces + 1).collect();
                Some(StopRule::Trim(costs.clone(), keep))
            }
            // A target that was met stands, whatever the last collapses cost. In earlier passes, and where the target
            // was missed, preserving the shape comes first.
            StopRule::Faces(_, target) if outcome.report.faces_out <= *target => None,
            StopRule::Faces(..) | StopRule::Shares(_) => {
                let mean_area = outcome.area / outcome.report.faces_in.max(1) as f64;
                let least = f64::from(sample::NEGLIGIBLE) * mean_area * mean_area;
                let before = state.reports.last().map(PassReport::end);
                let costs = before_leap(before, &outcome.stages.reports(0.0), least)?;
                Some(StopRule::Trim(costs, vec![target; partition.cluster_count()]))
            }
            _ => None,
        }
    }
}

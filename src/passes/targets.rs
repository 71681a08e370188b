//! Chooses where each cluster stops: by shares and thresholds from the schedule and the sample, and in the trim by the
//! costs of all clusters.

use super::clusters::Sweep;
use super::goal::{Aim, Goal, half_first};
use super::options::PassOptions;
use super::pass_id::Pass;
use super::run::Run;
use super::sample::{self, Survey};
use super::stop_rule::StopRule;
use super::sweep_plan::SweepOutput;
use super::trim::{MergedLog, spread_shares};
use crate::base::Result;
use crate::base::id::TiVec;
use crate::mesh::ClusterMesh;
use crate::partition::reading::{self, ClusterFaces};
use crate::partition::weight::ORDINARY_BYTES;
use crate::partition::{ClusterId, Partition};
use crate::simplify::Anchor;

/// Mean faces per cluster at the target from which a trim uses shares instead of costs.
const SHARED_TRIM_FACES: u64 = 5_000;
/// Factor on the sampled threshold up to which a trim by shares may collapse edges. The sampled threshold comes from
/// about twice as many collapses as the trim needs.
const TRIM_SPREAD: f32 = 4.0;
/// A target counts as met up to one face in this many below it, or [`SPARE_MIN`] faces.
const SPARE_SHARE: u64 = 1_000;
/// Smallest number of faces by which a result may be below its target.
const SPARE_MIN: u64 = 2;
/// Trials of a trim by cost after the first one; each uses at least [`TRIM_SPREAD`] times the cost of the previous trial.
const TRIALS_MAX: u32 = 4;

impl Run<'_> {
    /// Reports whether a pass aims at the target itself.
    pub(super) fn is_last(&self, pass: Pass) -> bool {
        self.aim().is_last(pass.turn)
    }

    /// Largest allowed deviation in units of length; `None` if it is unbounded. At least the rounding error of the
    /// mesh.
    pub(super) fn bound(&self) -> Option<f64> {
        self.options.max_error.map(|most| most.max(self.noise))
    }

    pub(super) fn aim(&self) -> Aim {
        let &PassOptions { target, input, passes, .. } = self.options;
        Aim { target, input, passes, bound: self.bound(), lead: self.state.schedule.lead }
    }

    /// Returns the cost thresholds of a pass over `faces` faces in several clusters, measured on a sample of them.
    /// Empty if the pass is bounded by deviation.
    pub(super) fn sample_thresholds(&self, sample: ClusterMesh, pass: Pass, faces: u64) -> Vec<f32> {
        match self.aim().goal(pass.turn, faces) {
            Goal::Deviation(_) => Vec::new(),
            Goal::Trim(share) => self.thresholds(sample, pass, &[share]),
            Goal::Stages(shares) => self.thresholds(sample, pass, &shares),
        }
    }

    /// Returns how the clusters of a pass stop, and whether that meets the target to the face. `faces` and `thresholds`
    /// are those of [`sample_thresholds`](Run::sample_thresholds).
    pub(super) fn plan(
        &self,
        partition: &Partition,
        thresholds: Vec<f32>,
        pass: Pass,
        faces: u64,
    ) -> Result<(StopRule, bool)> {
        let (aim, turn) = (self.aim(), pass.turn);
        let goal = aim.goal(turn, faces);
        if let Goal::Deviation(most) = goal {
            return Ok((aim.within(most, turn, partition.cluster_count()), false));
        }
        if partition.is_single() {
            return Ok((aim.in_one_cluster(turn, faces), aim.is_last(turn)));
        }
        match (goal, thresholds.first()) {
            (Goal::Trim(_), Some(&cost)) if pass.turn <= self.options.passes && self.has_large(partition) => {
                Ok((self.share_trim(partition, cost), true))
            }
            (Goal::Trim(_), Some(&cost)) => Ok((self.plan_trim(partition, cost, pass)?, true)),
            _ => Ok((StopRule::Costs(thresholds), false)),
        }
    }

    /// Faces above which a pass that is stopped by face count leaves the rest to the trim.
    pub(super) fn before_trim(&self) -> u64 {
        self.aim().before_trim()
    }

    /// Returns the thresholds for these shares of the faces, measured on a sample.
    fn thresholds(&self, sample: ClusterMesh, pass: Pass, shares: &[f64]) -> Vec<f32> {
        let _permit = self.permits.take(self.bytes_of_sample(&sample));
        self.engine.thresholds(sample, &self.options.sample_rules(pass, self.aim()), shares)
    }

    /// Memory in bytes of a sample while it is simplified.
    fn bytes_of_sample(&self, sample: &ClusterMesh) -> u64 {
        sample.corners.len() as u64 * (ORDINARY_BYTES + self.options.cost.extra_face_bytes())
    }

    /// Returns the share of the faces that the bound on the deviation alone would leave, measured on a sample; `None`
    /// without a bound. In a single cluster without a target nothing depends on it: it is not measured.
    pub(super) fn left_within_bound(&self, partition: &Partition, pass: Pass) -> Result<Option<f64>> {
        let Some(bound) = self.aim().bound_of(pass.turn) else { return Ok(None) };
        let mut sample = self.state.sample.clone();
        if partition.is_single() {
            let survey = self.first_survey(partition);
            if self.options.target == 0 || survey.clusters().is_empty() {
                return Ok(Some(1.0));
            }
            let only = ClusterId::new(0);
            let _permit = self.permits.take(self.cluster_bytes(partition, only));
            sample = self.patch_of_faces(&survey, partition, reading::read(partition, &self.state.mesh, only)?);
        }
        let _permit = self.permits.take(Anchor::with_room(self.bytes_of_sample(&sample)));
        Ok(Some(self.engine.share_within(sample, &self.options.sample_rules(pass, self.aim()), &half_first(bound))))
    }

    /// Chooses the clusters that give patches during a pass, as the sample for the next pass.
    pub(super) fn survey(&self, partition: &Partition, pass: Pass) -> Survey {
        let faces = self.aim().faces_after(pass.turn);
        Survey::new(&loaded_faces(partition), self.aim().purpose(pass.turn + 1, faces), 1.0)
    }

    /// Chooses the clusters that give patches before the first pass. No other work overlaps this sampling, so it uses
    /// half the faces if later passes can correct its error. That is not so if it says how far a bound reaches.
    pub(super) fn first_survey(&self, partition: &Partition) -> Survey {
        let is_only = self.options.passes <= 1 || self.options.max_error.is_some();
        let purpose = self.aim().purpose(0, partition.total_faces() as f64);
        Survey::new(&loaded_faces(partition), purpose, if is_only { 1.0 } else { 0.5 })
    }

    /// Cuts the patch out of the faces of a cluster before a mesh is built from them.
    pub(super) fn patch_of_faces(&self, survey: &Survey, partition: &Partition, faces: ClusterFaces) -> ClusterMesh {
        survey.patch_of_faces(faces, |faces| faces.into_source(partition, self.catalogue, &self.texture.scale).mesh)
    }

    /// Samples the clusters as they are before a pass.
    pub(super) fn take_sample(&self, partition: &Partition) -> Result<ClusterMesh> {
        let survey = self.first_survey(partition);
        let mut sample = ClusterMesh::default();
        for &cluster in survey.clusters() {
            let _permit = self.permits.take(self.cluster_bytes(partition, cluster));
            let faces = reading::read(partition, &self.state.mesh, cluster)?;
            sample::append(&mut sample, &self.patch_of_faces(&survey, partition, faces));
        }
        Ok(sample)
    }

    /// Reports whether clusters are so large at the target that one face too few in each does not matter.
    pub(super) fn has_large(&self, partition: &Partition) -> bool {
        partition.filled_count() * SHARED_TRIM_FACES <= self.options.target
    }

    /// Plans a trim in which as few clusters as possible lose the same share of their faces, at no more than
    /// [`TRIM_SPREAD`] times `cost`.
    fn share_trim(&self, partition: &Partition, cost: f32) -> StopRule {
        StopRule::Trim(vec![cost * TRIM_SPREAD], spread_shares(&partition.face_counts(), self.options.target))
    }

    /// Highest cost at which a pass so far ended.
    fn highest_cost(&self) -> f32 {
        self.state.reports.iter().map(|pass| pass.threshold as f32).fold(0.0, f32::max)
    }

    /// Plans a trim by cost: simplifies every cluster slightly too far, then picks the cheapest logged collapses of all
    /// clusters. Raises `cost` until enough faces can go.
    fn plan_trim(&self, partition: &Partition, mut cost: f32, pass: Pass) -> Result<StopRule> {
        let excess = partition.total_faces().saturating_sub(self.options.target);
        let spare = (self.options.target / SPARE_SHARE).max(SPARE_MIN);
        let mut trial = 0;
        loop {
            let mut merged = MergedLog::default();
            let mut clusters = partition.clusters();
            let all = partition.clusters().collect();
            let everything = StopRule::Costs(vec![cost]);
            let plan = self.plan_sweep(pass, partition, &everything, SweepOutput::Log);
            let sweep = Sweep { pass, partition, clusters: all, number: trial, plan };
            self.sweep(&sweep, |result| {
                clusters
                    .next()
                    .into_iter()
                    .for_each(|cluster| merged.add(cluster, partition.face_count(cluster), &result.log));
                // The log grows with the mesh, and leaves less for clusters in work.
                self.permits.keep(merged.bytes());
                Ok(())
            })?;
            let quotas = merged.cut(excess, spare, partition.cluster_count());
            self.permits.keep(0);
            if quotas.is_enough || trial == TRIALS_MAX {
                let left = |(cluster, &lost)| partition.face_count(cluster).saturating_sub(lost);
                return Ok(StopRule::Trim(vec![cost], quotas.lost.iter_enumerated().map(left).collect()));
            }
            // A sample without a legal collapse costs nothing; the passes so far know better.
            cost = (cost * TRIM_SPREAD).max(self.highest_cost());
            trial += 1;
        }
    }
}

/// Faces of each cluster; 0 for clusters too heavy to load.
fn loaded_faces(partition: &Partition) -> TiVec<ClusterId, u64> {
    let faces_of = |cluster| partition.weight(cluster).map_or(0, |weight| weight.faces);
    partition.clusters().map(faces_of).collect()
}

#[cfg(test)]
mod tests;

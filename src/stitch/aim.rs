//! Chooses how far each cluster goes: shares and thresholds from the schedule and the sample, the last faces from the
//! costs of all clusters.

use super::options::SeamPolicy;
use super::pass::{Run, is_single};
use super::sample::{self, Survey};
use super::schedule::{pass_target, stage_shares};
use super::stops::Plan;
use super::trim::Notes;
use crate::base::Result;
use crate::cost::Metric;
use crate::job::Step;
use crate::mesh::ClusterMesh;
use crate::partition::Partition;
use crate::partition::weight::ORDINARY_BYTES;
use crate::store::StoredMesh;

/// A pass in many clusters aims this much above the target; the trim removes the rest over all clusters.
const TRIM_SHARE: f64 = 0.03;
/// The trim takes over when no more than this share above the target is left.
const TRIM_SHARE_MAX: f64 = 0.10;
/// Trials of stages are numbered from here, those of the trim from 0: there are fewer than 300, by doubling of doublings.
const FIRST_STAGE_TRIAL: u32 = 1000;
/// Share of the allowed error that is used: positions are rounded afterwards.
const BOUND_SAFETY: f64 = 0.98;

/// What the clusters of a pass are to reach together.
#[derive(Debug, Clone, PartialEq)]
enum Goal {
    /// This bound on the deviation.
    Deviation(f64),
    /// The target to the face, on the way to this share of the faces.
    Trim(f64),
    /// These shares of the faces, stage by stage.
    Stages(Vec<f64>),
}

impl<M: Metric> Run<'_, M> {
    /// Whether a pass is to reach the target.
    pub(super) fn is_last(&self, pass: usize) -> bool {
        self.turn(pass) + 1 >= self.options.passes
    }

    /// What a pass of `faces` faces is to reach.
    fn goal(&self, pass: usize, faces: u64) -> Goal {
        let options = self.options;
        if let Some(most) = options.max_error {
            let left = options.passes.saturating_sub(self.turn(pass) + 1) as i32;
            return Goal::Deviation(most * BOUND_SAFETY * libm::pow(0.5, f64::from(left)));
        }
        let (all, target) = (faces.max(1) as f64, options.target as f64);
        if !self.is_last(pass) {
            let wanted = pass_target(options.input, options.target, self.turn(pass), options.passes);
            return Goal::Stages(stage_shares(wanted / all, self.turn(pass)));
        }
        if faces as f64 <= target * (1.0 + TRIM_SHARE_MAX) {
            let excess = faces.saturating_sub(options.target) as f64;
            return Goal::Trim((target - (2.0 * excess).min(TRIM_SHARE_MAX * target)).max(1.0) / all);
        }
        Goal::Stages(stage_shares(target / all * (1.0 + TRIM_SHARE), self.turn(pass)))
    }

    /// The thresholds that a pass of `faces` faces needs in many clusters, from a sample of them.
    pub(super) fn foresee(&self, sample: ClusterMesh, pass: usize, faces: u64) -> Vec<f32> {
        match self.goal(pass, faces) {
            Goal::Deviation(_) => Vec::new(),
            Goal::Trim(share) => self.thresholds(sample, pass, &[share]),
            Goal::Stages(shares) => self.thresholds(sample, pass, &shares),
        }
    }

    /// Chooses how the clusters of a pass stop, and whether that meets the target to the face; `faces` and thresholds are
    /// those of [`foresee`](Run::foresee).
    pub(super) fn plan(
        &self,
        mesh: &StoredMesh,
        partition: &Partition,
        thresholds: Vec<f32>,
        pass: usize,
        faces: u64,
    ) -> Result<(Plan, bool)> {
        let goal = self.goal(pass, faces);
        if let Goal::Deviation(most) = goal {
            return Ok((Plan::Deviation(most), false));
        }
        if is_single(partition) {
            let (target, faces) = (self.options.target, faces.max(1) as f64);
            let wanted = pass_target(self.options.input, target, self.turn(pass), self.options.passes);
            return Ok(match self.is_last(pass) {
                true => (Plan::Faces(stage_shares(target as f64 / faces, self.turn(pass)), target), true),
                false => (Plan::Shares(stage_shares(wanted / faces, self.turn(pass))), false),
            });
        }
        match (goal, thresholds.first()) {
            (Goal::Trim(_), Some(&cost)) => Ok((self.plan_trim(mesh, partition, cost, pass)?, true)),
            _ => Ok((Plan::Costs(thresholds), false)),
        }
    }

    /// Thresholds for shares of the faces, from a sample.
    fn thresholds(&self, sample: ClusterMesh, pass: usize, shares: &[f64]) -> Vec<f32> {
        let _permit =
            self.permits.take(sample.corners.len() as u64 * (ORDINARY_BYTES + self.options.cost.extra_face_bytes()));
        let mut engine = self.engine(sample, pass);
        engine.lock_seams = self.options.seams == SeamPolicy::Lock;
        sample::thresholds(&mut engine, shares)
    }

    pub(super) fn survey(&self, partition: &Partition) -> Survey {
        let faces_of = |cluster| partition.weight(cluster).map_or(0, |weight| weight.faces);
        Survey::new(&(0..partition.cluster_count()).map(faces_of).collect::<Vec<_>>())
    }

    /// A sample of the clusters as they are before a pass.
    pub(super) fn take_sample(&self, mesh: &StoredMesh, partition: &Partition) -> Result<ClusterMesh> {
        let survey = self.survey(partition);
        let mut sample = ClusterMesh::default();
        for &cluster in survey.clusters() {
            let _permit = self.permits.take(self.cluster_bytes(partition, cluster));
            let source = self.load(mesh, partition, cluster)?;
            survey.patch(cluster, &source.mesh).iter().for_each(|patch| sample::append(&mut sample, patch));
        }
        Ok(sample)
    }

    /// Simplifies every cluster a little too far, up to a cost, and merges what that cost.
    fn plan_trim(&self, mesh: &StoredMesh, partition: &Partition, mut cost: f32, pass: usize) -> Result<Plan> {
        let excess = partition.total_faces().saturating_sub(self.options.target);
        let mut trial = 0;
        loop {
            let mut notes = Notes::default();
            let mut cluster = 0;
            let everything = Plan::Costs(vec![cost]);
            let step = |cluster| Step::Trial { pass: pass as u32, trial, cluster };
            self.each_cluster(mesh, partition, (pass, &everything), None, step, |result| {
                notes.add(cluster, &result.log);
                cluster += 1;
                Ok(())
            })?;
            if notes.died() >= excess || cost == f32::INFINITY {
                let (quota, _) = notes.cut(excess, partition.cluster_count());
                let keep =
                    quota.iter().enumerate().map(|(c, lost)| partition.face_count(c).saturating_sub(*lost)).collect();
                return Ok(Plan::Trim(vec![cost], keep));
            }
            cost = if cost > 0.0 && cost < 1e30 { cost * 4.0 } else { f32::INFINITY };
            trial += 1;
        }
    }

    /// Finds the stage in which thresholds overshoot the target, and where each cluster has to stop in it.
    pub(super) fn trim_stages(
        &self,
        mesh: &StoredMesh,
        partition: &Partition,
        pass: usize,
        costs: &[f32],
    ) -> Result<Plan> {
        let target = self.options.target;
        for stages in (1..=costs.len()).rev() {
            let mut notes = Notes::default();
            let mut left = Vec::new();
            let plan = Plan::Costs(costs[..stages].to_vec());
            let trial = FIRST_STAGE_TRIAL + stages as u32;
            let step = |cluster| Step::Trial { pass: pass as u32, trial, cluster };
            self.each_cluster(mesh, partition, (pass, &plan), None, step, |result| {
                notes.add(left.len(), &result.log);
                left.push(result.faces + result.log.iter().map(|&(_, died)| u64::from(died)).sum::<u64>());
                Ok(())
            })?;
            let before: u64 = left.iter().sum();
            if before >= target || stages == 1 {
                let (quota, _) = notes.cut(before.saturating_sub(target), left.len());
                let keep = left.iter().zip(&quota).map(|(faces, lost)| faces - lost).collect();
                return Ok(Plan::Trim(costs[..stages].to_vec(), keep));
            }
        }
        Ok(Plan::Costs(costs.to_vec()))
    }
}

//! Chooses how far each cluster goes: shares and thresholds from the schedule and the sample, the last faces from the
//! costs of all clusters.

use super::options::SeamPolicy;
use super::pass::{Run, is_single};
use super::sample::{self, Purpose, Survey};
use super::schedule::{TRIM_SHARE, pass_target, stage_shares};
use super::stops::Plan;
use super::trim::{Notes, spread_shares};
use crate::base::Result;
use crate::cost::Metric;
use crate::job::Step;
use crate::mesh::ClusterMesh;
use crate::partition::Partition;
use crate::partition::reading::{self, ClusterFaces};
use crate::partition::weight::ORDINARY_BYTES;
use crate::store::StoredMesh;

/// The trim takes over when no more than this share above the target is left.
const TRIM_SHARE_MAX: f64 = 0.15;
/// Faces of a cluster, on average, from which on a trim goes by shares.
const SHARED_TRIM_FACES: u64 = 5_000;
/// The dearest collapse of a trim by shares may cost this many times what twice as many collapses cost in the sample.
const TRIM_SPREAD: f32 = 4.0;
/// Trials of a trim by cost beyond the first, each at [`TRIM_SPREAD`] times the cost of the one before.
const TRIALS_MAX: u32 = 4;
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

    fn stages(&self, share: f64, pass: usize) -> Vec<f64> {
        stage_shares(share, self.turn(pass), self.options.passes)
    }

    /// Largest deviation allowed, in units of length, if it is bounded: what is asked for, but no less than rounding does.
    pub(super) fn bound(&self) -> Option<f64> {
        self.options.max_error.map(|most| most.max(self.noise))
    }

    /// The deviation that is allowed in a pass, if it is bounded: more from pass to pass.
    pub(super) fn bound_of(&self, pass: usize) -> Option<f64> {
        let left = self.options.passes.saturating_sub(self.turn(pass) + 1) as i32;
        Some(self.bound()? * BOUND_SAFETY * libm::pow(0.5, f64::from(left)))
    }

    /// What a pass of `faces` faces is to reach.
    fn goal(&self, pass: usize, faces: u64) -> Goal {
        let options = self.options;
        if options.target == 0
            && let Some(most) = self.bound_of(pass)
        {
            return Goal::Deviation(most);
        }
        let (all, target) = (faces.max(1) as f64, options.target as f64);
        if !self.is_last(pass) {
            let wanted = pass_target(options.input, options.target, self.turn(pass), options.passes);
            return Goal::Stages(self.stages(wanted / all, pass));
        }
        if faces as f64 <= target * (1.0 + TRIM_SHARE_MAX) {
            let excess = faces.saturating_sub(options.target) as f64;
            return Goal::Trim((target - (2.0 * excess).min(TRIM_SHARE_MAX * target)).max(1.0) / all);
        }
        Goal::Stages(self.stages(target / all * (1.0 + TRIM_SHARE), pass))
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
            // What is nearest goes first; later passes begin with what half of their bound allowed.
            let bounds = if self.turn(pass) == 0 { vec![0.5 * most, most] } else { vec![most] };
            return Ok((Plan::Deviation(bounds), false));
        }
        if is_single(partition) {
            let (target, faces) = (self.options.target, faces.max(1) as f64);
            let wanted = pass_target(self.options.input, target, self.turn(pass), self.options.passes);
            return Ok(match self.is_last(pass) {
                true => (Plan::Faces(self.stages(target as f64 / faces, pass), target), true),
                false => (Plan::Shares(self.stages(wanted / faces, pass)), false),
            });
        }
        match (goal, thresholds.first()) {
            (Goal::Trim(_), Some(&cost)) if self.turn(pass) <= self.options.passes && self.has_large(partition) => {
                Ok((self.share_trim(partition, cost), true))
            }
            (Goal::Trim(_), Some(&cost)) => Ok((self.plan_trim(mesh, partition, cost, pass)?, true)),
            _ => Ok((Plan::Costs(thresholds), false)),
        }
    }

    /// Faces that a pass leaves to the trim when it is stopped by their number.
    pub(super) fn before_trim(&self) -> u64 {
        (self.options.target as f64 * (1.0 + 0.5 * TRIM_SHARE)).ceil() as u64
    }

    /// Thresholds for shares of the faces, from a sample.
    fn thresholds(&self, sample: ClusterMesh, pass: usize, shares: &[f64]) -> Vec<f32> {
        let _permit =
            self.permits.take(sample.corners.len() as u64 * (ORDINARY_BYTES + self.options.cost.extra_face_bytes()));
        let mut engine = self.engine(sample, pass);
        engine.lock_seams = self.options.seams == SeamPolicy::Lock;
        sample::thresholds(&mut engine, shares)
    }

    /// What is sampled while a pass runs, for the next one.
    pub(super) fn survey(&self, partition: &Partition, pass: usize) -> Survey {
        let target = self.options.target;
        let faces = pass_target(self.options.input, target, self.turn(pass), self.options.passes);
        Survey::new(&loaded_faces(partition), self.purpose(faces, pass + 1), 1.0)
    }

    /// What is sampled before the first pass. Nothing else can be done meanwhile, and where passes follow that do not end
    /// exactly where they should, half of the faces will do.
    pub(super) fn first_survey(&self, partition: &Partition) -> Survey {
        let is_only = self.options.passes <= 1;
        let purpose = self.purpose(partition.total_faces() as f64, 0);
        Survey::new(&loaded_faces(partition), purpose, if is_only { 1.0 } else { 0.5 })
    }

    /// What the sample for a pass over about so many faces is for.
    fn purpose(&self, faces: f64, pass: usize) -> Purpose {
        let target = self.options.target as f64;
        let left = if target > 0.0 { target / faces.max(1.0) } else { 1.0 };
        Purpose { left, is_last: self.is_last(pass) }
    }

    /// The patch of a cluster that no mesh was made of.
    pub(super) fn patch_of_faces(&self, survey: &Survey, partition: &Partition, faces: ClusterFaces) -> ClusterMesh {
        survey.patch_of_faces(faces, |faces| faces.into_source(partition, self.catalogue, &self.texture.scale).mesh)
    }

    /// A sample of the clusters as they are before a pass.
    pub(super) fn take_sample(&self, mesh: &StoredMesh, partition: &Partition) -> Result<ClusterMesh> {
        let survey = self.first_survey(partition);
        let mut sample = ClusterMesh::default();
        for &cluster in survey.clusters() {
            let _permit = self.permits.take(self.cluster_bytes(partition, cluster));
            let faces = reading::read(partition, mesh, cluster)?;
            sample::append(&mut sample, &self.patch_of_faces(&survey, partition, faces));
        }
        Ok(sample)
    }

    /// Whether clusters are so large that a face too few in each of them does not matter.
    fn has_large(&self, partition: &Partition) -> bool {
        partition.filled_count() * SHARED_TRIM_FACES <= self.options.target
    }

    /// Lets as few clusters as can lose the same share of their faces, at no more than [`TRIM_SPREAD`] times the cost.
    fn share_trim(&self, partition: &Partition, cost: f32) -> Plan {
        Plan::Trim(vec![cost * TRIM_SPREAD], spread_shares(&partition.face_counts(), self.options.target))
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
            if notes.died() >= excess || trial == TRIALS_MAX {
                let (quota, _) = notes.cut(excess, partition.cluster_count());
                let keep =
                    quota.iter().enumerate().map(|(c, lost)| partition.face_count(c).saturating_sub(*lost)).collect();
                return Ok(Plan::Trim(vec![cost], keep));
            }
            cost *= TRIM_SPREAD;
            trial += 1;
        }
    }
}

/// Faces of the clusters that are loaded; none for those that pass through.
fn loaded_faces(partition: &Partition) -> Vec<u64> {
    let faces_of = |cluster| partition.weight(cluster).map_or(0, |weight| weight.faces);
    (0..partition.cluster_count()).map(faces_of).collect()
}

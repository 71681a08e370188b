//! State carried from one pass to the next, and how a later process resumes it.
//!
//! In: the journal of a job. Out: the state to resume from: the mesh after a pass, or the partition of an unfinished
//! pass. Finished clusters of that pass are recalled one by one.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::floor::Floor;
use super::outcome::{PassReport, PassSeconds, RemeshReport};
use super::schedule::Schedule;
use super::shares::STAGES_MAX;
use super::steps::PassStep;
use super::sweep_result::SweepResult;
use super::texture_traits::TextureTraits;
use crate::base::{Findings, Result, counted};
use crate::cost::mesh_stats::MeshStats;
use crate::job::{Recalled, StepKey, WorkFolder};
use crate::mesh::ClusterMesh;
use crate::model::{Catalogue, StoredMesh};
use crate::partition::Partition;
use crate::read::SCAN;
use crate::simplify::Changes;

/// State of the passes so far.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct PassState {
    /// Which pass is next or under way.
    pub(super) schedule: Schedule,
    /// Mesh at the start of that pass.
    pub mesh: StoredMesh,
    /// Sample for the thresholds of the next pass, until they are computed.
    pub(super) sample: ClusterMesh,
    /// Thresholds of the stages of the partitioned pass, computed from its sample.
    pub(super) thresholds: Option<Vec<f32>>,
    /// Properties of the texture, once measured.
    pub(super) texture: Option<TextureTraits>,
    /// Global statistics of the mesh that the metric is normalised by, once counted.
    pub(super) stats: Option<MeshStats>,
    /// Bounding-box diagonal below which connected components are dropped in the next pass, in units of length; `None`
    /// for none.
    pub(super) min_component_diagonal: Option<f64>,
    /// What was repaired.
    pub(super) findings: Findings,
    /// Changes of topology.
    pub(super) changes: Changes,
    /// Results of the remeshing passes.
    pub(super) remeshed: Vec<RemeshReport>,
    /// Results of the passes that collapse edges.
    pub(super) reports: Vec<PassReport>,
    /// Sum over the passes of the mean squared deviation, in units of length squared.
    pub(super) squared_error: f64,
    /// Faces of clusters that passed through in the last pass.
    pub(super) passed_through: u64,
    /// What prevents further collapses.
    pub(super) floor: Floor,
    /// Time so far.
    pub(super) seconds: PassSeconds,
    /// Largest size of the work folder, in bytes.
    pub scratch_peak: u64,
}

impl PassState {
    /// Number, from 0, of the next or current pass.
    pub fn pass(&self) -> usize {
        self.schedule.pass
    }

    /// Reports whether a recalled value can be the state before pass `pass`. Does not check the mesh.
    fn is_before(&self, pass: u32, catalogue: &Catalogue) -> bool {
        self.schedule.is_sound(pass)
            && self.remeshed.len() <= pass as usize
            && self.seconds.is_sound()
            && self.findings.are_plain()
            && self.thresholds.iter().all(|thresholds| thresholds.len() <= STAGES_MAX)
            && self.texture.iter().all(|texture| texture.scale.is_sound(catalogue))
            && self.sample.is_sound()
    }

    /// Adds the result of a pass that collapsed edges.
    pub(super) fn take(&mut self, result: SweepResult) {
        let SweepResult { mesh, sample, mut report, counters, stages, .. } = result;
        report.stages = stages.reports(self.squared_error);
        counters.note_in(&mut self.findings);
        if self.reports.is_empty() {
            self.findings.count("doubled_faces", counters.floor.doubles);
        }
        self.mesh = mesh;
        self.sample = sample;
        self.squared_error += result.squared_error;
        self.changes += counters.changes;
        self.reports.push(report);
        self.passed_through = counters.passed_through_faces;
        self.floor = counters.floor;
    }
}

/// What the state before a pass must fit.
pub struct PassContext<'a> {
    /// Number of the pass, from 0.
    pass: u32,
    catalogue: &'a Catalogue,
}

impl Recalled for PassState {
    type Context<'a> = PassContext<'a>;

    fn locate(&mut self, folder: &Path, _: &PassContext<'_>) {
        self.mesh.locate(folder, &());
    }

    fn is_sound(&self, context: &PassContext<'_>) -> bool {
        self.is_before(context.pass, context.catalogue) && self.mesh.is_sound(&())
    }
}

/// A partition, with the state of the passes before it.
#[derive(Deserialize)]
struct PartitionedPass {
    state: PassState,
    partition: Partition,
}

/// What they must fit.
struct CutContext<'a> {
    /// Number of the pass, from 0.
    pass: u32,
    catalogue: &'a Catalogue,
    /// Target size of clusters.
    cluster_faces: u64,
}

impl Recalled for PartitionedPass {
    type Context<'a> = CutContext<'a>;

    fn locate(&mut self, folder: &Path, _: &CutContext<'_>) {
        self.state.mesh.locate(folder, &());
        self.partition.locate(folder);
    }

    // Only those files of the mesh remain that the clusters still need.
    fn is_sound(&self, context: &CutContext<'_>) -> bool {
        !self.state.schedule.is_over
            && self.state.is_before(context.pass, context.catalogue)
            && self.partition.is_sound(&self.state.mesh, context.cluster_faces)
    }
}

/// Where the passes begin or resume.
#[derive(Debug)]
pub struct ResumePoint {
    /// State of the passes before.
    pub state: PassState,
    /// Partition of the unfinished pass, if there is one.
    pub(super) partition: Option<Partition>,
}

impl ResumePoint {
    /// The mesh as it was read; `None` once a pass has begun.
    pub fn unsimplified(&self) -> Option<&StoredMesh> {
        (self.state.pass() == 0 && self.partition.is_none()).then_some(&self.state.mesh)
    }
}

impl From<StoredMesh> for ResumePoint {
    fn from(mesh: StoredMesh) -> Self {
        Self { state: PassState { mesh, ..PassState::default() }, partition: None }
    }
}

impl ResumePoint {
    /// Recalls the latest sound state that an earlier process recorded, or `None`. `cluster_faces` is the target size
    /// of clusters.
    ///
    /// # Errors
    /// Those of [`WorkFolder::recall`].
    pub fn recall(job: &WorkFolder, catalogue: &Catalogue, cluster_faces: u64) -> Result<Option<Self>> {
        for key in job.latest() {
            if let Some(point) = Self::at(&key, job, catalogue, cluster_faces)? {
                return Ok(Some(point));
            }
        }
        Ok(None)
    }

    /// Recalls the state that a step recorded; `None` if it is not sound, or the step records none.
    fn at(key: &StepKey, job: &WorkFolder, catalogue: &Catalogue, cluster_faces: u64) -> Result<Option<Self>> {
        if *key == SCAN {
            return Ok(job.recall::<StoredMesh>(key, &())?.map(Self::from));
        }
        Ok(match PassStep::of(key) {
            Some(PassStep::Partition { pass }) => {
                let found = job.recall::<PartitionedPass>(key, &CutContext { pass, catalogue, cluster_faces })?;
                found.map(|PartitionedPass { state, partition }| Self { state, partition: Some(partition) })
            }
            Some(PassStep::Mesh { pass }) => {
                let context = PassContext { pass: pass.saturating_add(1), catalogue };
                job.recall::<PassState>(key, &context)?.map(|state| Self { state, partition: None })
            }
            _ => None,
        })
    }

    /// Reports whether the first pass has yet to allocate its scratch space.
    pub fn needs_scratch(&self) -> bool {
        self.state.pass() == 0 && self.partition.is_none()
    }

    /// Describes what is resumed, for the log.
    pub fn kept(&self, job: &WorkFolder) -> String {
        let pass = self.state.pass();
        let clusters_of = |step: PassStep| match step {
            PassStep::Cluster { pass: of, .. } if of as usize == pass => 1,
            PassStep::Clusters { pass: of, count, .. } if of as usize == pass => u64::from(count),
            _ => 0,
        };
        let clusters: u64 = job.latest().iter().filter_map(PassStep::of).map(clusters_of).sum();
        let passes = match pass {
            0 => "the scan".to_owned(),
            1 => "the scan and 1 pass".to_owned(),
            _ => format!("the scan and {pass} passes"),
        };
        let under_way = match (&self.partition, clusters) {
            (None, _) => String::new(),
            (Some(_), 0) => format!(", and the partition of pass {}", pass + 1),
            (Some(partition), _) => {
                let of = partition.filled_count();
                let clusters = clusters.min(of);
                format!(", and {clusters} of {} of pass {}", counted(of, "cluster"), pass + 1)
            }
        };
        format!("resumed after {passes}{under_way}")
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_state_of_no_pass_is_not_sound() {
        let catalogue = Catalogue::default();
        let whole = || PassState {
            schedule: Schedule::at(2),
            remeshed: vec![RemeshReport::default(); 2],
            thresholds: Some(vec![1.0; STAGES_MAX]),
            texture: Some(TextureTraits::none(&catalogue)),
            ..PassState::default()
        };
        assert!(whole().is_before(2, &catalogue) && !whole().is_before(1, &catalogue));
        let mut sample = ClusterMesh::default();
        sample.corners.push(Default::default());
        let mut findings = Findings::default();
        findings.note("degenerate faces", || "\x1b[2J".into());
        let changed = [
            PassState { schedule: Schedule::at(3), ..whole() },
            PassState { remeshed: vec![RemeshReport::default(); 3], ..whole() },
            PassState { seconds: PassSeconds { stitch: Duration::MAX, ..PassSeconds::default() }, ..whole() },
            PassState { findings, ..whole() },
            PassState { thresholds: Some(vec![1.0; STAGES_MAX + 1]), ..whole() },
            PassState { sample, ..whole() },
        ];
        for (i, state) in changed.into_iter().enumerate() {
            assert!(!state.is_before(2, &catalogue), "change {i}");
        }
    }

    #[test]
    fn a_mesh_is_as_it_was_read_until_the_first_pass_begins() {
        assert!(ResumePoint::from(StoredMesh::default()).unsimplified().is_some());
        let state = PassState { schedule: Schedule::at(1), ..PassState::default() };
        assert!(ResumePoint { state, partition: None }.unsimplified().is_none());
    }
}

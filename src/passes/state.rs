//! State carried from one pass to the next, and how a later process resumes it.
//!
//! In: the journal of a job. Out: the state to resume from: the mesh after a pass, or the partition of an unfinished
//! pass. Finished clusters of that pass are recalled one by one.

use serde::{Deserialize, Serialize};

use super::outcome::{Floor, PassOutcome, PassReport, PassSeconds, RemeshReport};
use super::schedule::STAGES_MAX;
use super::texture_traits::TextureTraits;
use crate::base::{Findings, Result};
use crate::cost::census::Census;
use crate::job::{Step, WorkFolder};
use crate::mesh::ClusterMesh;
use crate::model::{Catalogue, StoredMesh};
use crate::partition::Partition;
use crate::simplify::Changes;

/// State of the passes so far.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct PassState {
    /// Number, from 0, of the next or current pass.
    pub pass: usize,
    /// Mesh at the start of that pass.
    pub mesh: StoredMesh,
    /// Sample for the thresholds of the next pass, until they are computed.
    pub(super) sample: ClusterMesh,
    /// Thresholds of the stages of the partitioned pass, computed from its sample.
    pub(super) thresholds: Option<Vec<f32>>,
    /// Properties of the texture, once measured.
    pub(super) texture: Option<TextureTraits>,
    /// Global statistics of the mesh that the metric is normalised by, once counted.
    pub(super) census: Option<Census>,
    /// Bounding-box diagonal below which connected components are dropped in the next pass, in units of length.
    pub(super) crumb: Option<f64>,
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
    /// Number of consecutive passes that removed almost no faces.
    pub(super) stuck: u32,
    /// Faces of clusters that passed through in the last pass.
    pub(super) passed_through: u64,
    /// What prevents further collapses.
    pub(super) floor: Floor,
    /// Whether the target is met.
    pub(super) reached: bool,
    /// Whether no pass follows.
    pub(super) is_over: bool,
    /// Time so far.
    pub(super) seconds: PassSeconds,
    /// Largest size of the work folder, in bytes.
    pub scratch_peak: u64,
}

impl PassState {
    /// Reports whether a recalled value can be the state before pass `pass`. Does not check the mesh.
    fn is_sound(&self, pass: u32, catalogue: &Catalogue) -> bool {
        let pass = pass as usize;
        self.pass == pass
            && self.remeshed.len() <= pass
            && self.stuck as usize <= pass
            && self.seconds.is_sound()
            && self.findings.are_plain()
            && self.thresholds.iter().all(|thresholds| thresholds.len() <= STAGES_MAX)
            && self.texture.iter().all(|texture| texture.scale.is_sound(catalogue))
            && self.sample.is_sound()
    }

    /// Adds the result of a pass.
    pub(super) fn take(&mut self, mut outcome: PassOutcome) {
        outcome.report.stages = outcome.stages.reports(self.squared_error);
        self.mesh = outcome.mesh;
        self.sample = outcome.sample;
        self.squared_error += outcome.squared_error;
        self.findings.count("degenerate_faces", outcome.degenerate);
        self.findings.count("dropped_doubles", outcome.doubles);
        if self.reports.is_empty() {
            self.findings.count("doubled_faces", outcome.floor.doubles);
        }
        self.findings.count("dropped_pieces", outcome.dropped_pieces);
        self.findings.count("optimized_vertices", outcome.optimized);
        self.findings.count("dropped_piece_faces", outcome.dropped_faces);
        self.changes += outcome.changes;
        self.reports.push(outcome.report);
        self.passed_through = outcome.passed_through;
        self.floor = outcome.floor;
    }
}

/// Where the passes begin or resume.
#[derive(Debug)]
pub struct Start {
    /// State of the passes before.
    pub state: PassState,
    /// Partition of the unfinished pass, if there is one.
    pub(super) partition: Option<Partition>,
}

impl Start {
    /// The mesh as it was read; `None` once a pass has begun.
    pub fn unsimplified(&self) -> Option<&StoredMesh> {
        (self.state.pass == 0 && self.partition.is_none()).then_some(&self.state.mesh)
    }
}

impl From<StoredMesh> for Start {
    fn from(mesh: StoredMesh) -> Self {
        Self { state: PassState { mesh, ..PassState::default() }, partition: None }
    }
}

impl Start {
    /// Recalls the latest sound state that an earlier process recorded, or `None`. `cluster_faces` is the target size
    /// of clusters.
    ///
    /// # Errors
    /// Those of [`WorkFolder::recall`].
    pub fn recall(job: &WorkFolder, catalogue: &Catalogue, cluster_faces: u64) -> Result<Option<Self>> {
        let folder = job.path();
        for step in job.latest() {
            let found = match step {
                Step::Cut { pass } => {
                    let accept = |(state, partition): &mut (PassState, Partition)| {
                        state.mesh.locate(folder);
                        partition.locate(folder);
                        // Only those files of the mesh remain that the clusters still need.
                        !state.is_over
                            && state.is_sound(pass, catalogue)
                            && partition.is_sound(&state.mesh, cluster_faces)
                    };
                    job.recall_if(step, accept)?.map(|(state, partition)| (state, Some(partition)))
                }
                Step::Pass { pass } => {
                    let accept = |state: &mut PassState| {
                        state.mesh.locate(folder);
                        state.is_sound(pass.saturating_add(1), catalogue) && state.mesh.is_sound()
                    };
                    job.recall_if(step, accept)?.map(|state| (state, None))
                }
                Step::Scan => {
                    let accept = |mesh: &mut StoredMesh| {
                        mesh.locate(folder);
                        mesh.is_sound()
                    };
                    job.recall_if(step, accept)?.map(|mesh| (PassState { mesh, ..PassState::default() }, None))
                }
                _ => None,
            };
            if let Some((state, partition)) = found {
                return Ok(Some(Self { state, partition }));
            }
        }
        Ok(None)
    }

    /// Reports whether the first pass has yet to allocate its scratch space.
    pub fn needs_scratch(&self) -> bool {
        self.state.pass == 0 && self.partition.is_none()
    }

    /// Describes what is resumed, for the log.
    pub fn kept(&self, job: &WorkFolder) -> String {
        let pass = self.state.pass;
        let of_pass = |step: &Step| matches!(step, Step::Cluster { pass: of, .. } if *of as usize == pass);
        let clusters = job.latest().filter(of_pass).count();
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
                format!(", and {clusters} of {of} clusters of pass {}", pass + 1)
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
            pass: 2,
            stuck: 2,
            remeshed: vec![RemeshReport::default(); 2],
            thresholds: Some(vec![1.0; STAGES_MAX]),
            texture: Some(TextureTraits::none(&catalogue)),
            ..PassState::default()
        };
        assert!(whole().is_sound(2, &catalogue) && !whole().is_sound(1, &catalogue));
        let mut sample = ClusterMesh::default();
        sample.corners.push([0; 3]);
        let mut findings = Findings::default();
        findings.note("degenerate faces", || "\x1b[2J".into());
        let changed = [
            PassState { pass: 3, ..whole() },
            PassState { stuck: 3, ..whole() },
            PassState { remeshed: vec![RemeshReport::default(); 3], ..whole() },
            PassState { seconds: PassSeconds { stitch: Duration::MAX, ..PassSeconds::default() }, ..whole() },
            PassState { findings, ..whole() },
            PassState { thresholds: Some(vec![1.0; STAGES_MAX + 1]), ..whole() },
            PassState { sample, ..whole() },
        ];
        for (i, state) in changed.into_iter().enumerate() {
            assert!(!state.is_sound(2, &catalogue), "change {i}");
        }
    }

    #[test]
    fn a_mesh_is_as_it_was_read_until_the_first_pass_begins() {
        assert!(Start::from(StoredMesh::default()).unsimplified().is_some());
        let state = PassState { pass: 1, ..PassState::default() };
        assert!(Start { state, partition: None }.unsimplified().is_none());
    }
}

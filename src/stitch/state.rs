//! What a run of passes carries from one pass to the next, and how a later process takes it up.
//!
//! In: the journal of a job. Out: where the passes go on: with the mesh after a pass, or with the partition of the pass
//! that was under way; its finished clusters are found one by one.

use serde::{Deserialize, Serialize};

use super::outcome::{Floor, PassOutcome, PassReport, PassSeconds, RemeshReport};
use super::scale::TextureTraits;
use super::schedule::STAGES_MAX;
use crate::base::{Findings, Result};
use crate::cost::census::Census;
use crate::job::{Step, WorkFolder};
use crate::mesh::ClusterMesh;
use crate::partition::Partition;
use crate::simplify::Changes;
use crate::store::{Catalogue, StoredMesh};

/// The passes so far.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct PassState {
    /// Number of the pass that comes next or is under way.
    pub pass: usize,
    /// The mesh that it begins with.
    pub mesh: StoredMesh,
    /// Patches of the mesh, until they have given the thresholds.
    pub(super) sample: ClusterMesh,
    /// Thresholds of the stages of a pass whose partition is there, from its sample.
    pub(super) thresholds: Option<Vec<f32>>,
    /// What is known of the texture, once it was measured.
    pub(super) texture: Option<TextureTraits>,
    /// Numbers of the whole mesh that the metric divides by, once they are known.
    pub(super) census: Option<Census>,
    /// Diagonal below which pieces are dropped in the next pass, if any are.
    pub(super) crumb: Option<f64>,
    /// What was repaired.
    pub(super) findings: Findings,
    /// What became of the topology.
    pub(super) changes: Changes,
    /// What passes did that made the mesh anew.
    pub(super) remeshed: Vec<RemeshReport>,
    /// What the passes did that collapse edges.
    pub(super) reports: Vec<PassReport>,
    /// Sum of the mean squared deviations.
    pub(super) squared_error: f64,
    /// Passes in a row that removed next to nothing.
    pub(super) stuck: u32,
    /// Faces of clusters that passed through in the last pass.
    pub(super) passed_through: u64,
    /// What stands in the way of further collapses.
    pub(super) floor: Floor,
    /// Whether the target is met.
    pub(super) reached: bool,
    /// Whether no pass follows.
    pub(super) is_over: bool,
    /// Time so far.
    pub(super) seconds: PassSeconds,
    /// Most bytes that the work folder held.
    pub scratch_peak: u64,
}

impl PassState {
    /// Whether it can be the state of a job whose next pass is this one; of its mesh nothing is asked.
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

    /// Takes the outcome of a pass.
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

/// Where passes begin.
#[derive(Debug)]
pub struct Start {
    /// The passes before.
    pub state: PassState,
    /// The partition of the pass that was under way.
    pub(super) partition: Option<Partition>,
}

impl Start {
    /// The mesh as it was read, if no pass has begun on it.
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
    /// The latest state that an earlier process kept and that is whole, if there is one; clusters are to have about so many
    /// faces.
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
                        // Of the mesh's files only those are left that the clusters need.
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

    /// Whether the scratch space of the first pass is still to be taken.
    pub fn needs_scratch(&self) -> bool {
        self.state.pass == 0 && self.partition.is_none()
    }

    /// What is gone on with, in words.
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
        format!("resumed: kept from before are {passes}{under_way}")
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

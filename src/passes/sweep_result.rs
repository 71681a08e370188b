//! Result of a sweep over the clusters: their results, summed.

use super::counters::Counters;
use super::outcome::{PassReport, StageSums};
use super::probes::Probes;
use crate::base::id::TiVec;
use crate::mesh::ClusterMesh;
use crate::model::StoredMesh;
use crate::partition::ClusterId;

/// Result of a sweep over all clusters.
#[derive(Debug, Default)]
pub(super) struct SweepResult {
    pub mesh: StoredMesh,
    /// Sample for the next pass: patches of the mesh.
    pub sample: ClusterMesh,
    pub report: PassReport,
    pub counters: Counters,
    /// Probes of the mesh before the pass, if that is the input.
    pub probes: Probes,
    /// Faces left in each cluster.
    pub cluster_faces: TiVec<ClusterId, u64>,
    pub stages: StageSums,
    /// Mean squared deviation that the pass added, in units of length².
    pub squared_error: f64,
    /// Surface area at the start of the last stages.
    pub area: f64,
    /// Whether this is a second attempt, because collapses that cost far more ended the first.
    pub met_wall: bool,
}

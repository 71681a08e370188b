//! Result of a sweep over the clusters: their results, summed.

use super::counters::Counters;
use super::outcome::{PassReport, StageSums};
use super::probes::Probes;
use crate::mesh::ClusterMesh;
use crate::model::StoredMesh;

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
    pub stages: StageSums,
    /// Mean squared deviation that the pass added, in units of length².
    pub squared_error: f64,
    /// Surface area at the start of the last stages.
    pub area: f64,
    /// Whether collapses that cost far more ended the first attempt.
    pub met_wall: bool,
}

//! What a sweep does to each of its clusters: the same for all, or by cluster.
//!
//! Together with the partition and its mesh this is all that the results depend on, so any process that reads it can do
//! any of the clusters.

use serde::{Deserialize, Serialize};

use super::cluster_task::{ClusterProbing, ClusterTask, TaskOutput};
use super::metric_engine::EngineRules;
use super::sample::Survey;
use super::stop_rule::StopRule;
use crate::job::Recalled;
use crate::partition::{ClusterId, Partition};

/// What a sweep does to its clusters.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct SweepPlan {
    /// What the engine may do.
    pub rules: EngineRules,
    /// Where the clusters stop.
    pub stops: StopRule,
    /// Bounding-box diagonal below which connected components are dropped, in units of length; `None` for none.
    pub min_component_diagonal: Option<f64>,
    /// Faces of all clusters, and faces wanted in the whole mesh.
    pub faces_all: [u64; 2],
    /// Probes to take before anything changes.
    pub probing: ClusterProbing,
    /// Largest distance between result and input, in units of length; `None` for no bound.
    pub max_error: Option<f64>,
    /// What it returns.
    pub output: SweepOutput,
}

/// What a sweep returns of its clusters.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) enum SweepOutput {
    /// The log of their collapses.
    Log,
    /// Their meshes.
    Mesh {
        /// The clusters that give patches for the sample of the next pass.
        survey: Survey,
        /// Whether vertices beside slivers are relocated.
        optimize: bool,
    },
}

impl SweepPlan {
    /// What is done to a cluster.
    pub fn task(&self, cluster: ClusterId) -> ClusterTask {
        ClusterTask {
            cluster,
            rules: self.rules,
            stop: self.stops.of(cluster),
            min_component_diagonal: self.min_component_diagonal,
            faces_all: self.faces_all,
            probing: self.probing,
            output: match &self.output {
                SweepOutput::Log => TaskOutput::Log,
                SweepOutput::Mesh { survey, optimize } => {
                    TaskOutput::Mesh { patch_faces: survey.patch_faces(cluster), optimize: *optimize }
                }
            },
        }
    }

    /// Whether it is run to learn the costs of collapses alone.
    pub fn is_trial(&self) -> bool {
        matches!(self.output, SweepOutput::Log)
    }

    /// Whether a plan that was read back fits a partition.
    pub fn is_sound(&self, partition: &Partition) -> bool {
        let is_probing_sound = match &self.probing {
            ClusterProbing::As(probing) => probing.is_sound(partition.total_faces()),
            ClusterProbing::None | ClusterProbing::Alone => true,
        };
        self.stops.is_sound(&partition.cluster_count()) && is_probing_sound
    }
}

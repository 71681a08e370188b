//! Does the clusters of a sweep: loads one, simplifies it, and returns it as a piece of the next mesh.

use super::metric_engine::MetricEngine;
use super::records::ClusterResult;
use super::sweep_plan::SweepPlan;
use crate::base::Result;
use crate::model::{Catalogue, StoredMesh};
use crate::partition::weight::ClusterWeight;
use crate::partition::{ClusterId, ClusterSource, Partition, PieceContent, TextureScale, cluster};
use crate::simplify::Anchor;

/// Memory in bytes of a cluster that passes through: a block of faces, their texture coordinates and the piece being
/// written.
pub(super) const PASS_BYTES: u64 = 16 << 20;

/// What the clusters of a sweep are done with.
#[derive(Clone, Copy)]
pub(super) struct ClusterWorker<'a> {
    pub engine: &'a dyn MetricEngine,
    pub partition: &'a Partition,
    /// The mesh that was partitioned.
    pub mesh: &'a StoredMesh,
    pub catalogue: &'a Catalogue,
    pub scale: &'a TextureScale,
    pub plan: &'a SweepPlan,
}

impl ClusterWorker<'_> {
    /// Loads a cluster.
    ///
    /// # Errors
    /// On failed reads and damaged files.
    pub fn load(&self, cluster: ClusterId) -> Result<ClusterSource> {
        cluster::load(self.partition, self.mesh, self.catalogue, self.scale, cluster)
    }

    /// Simplifies a cluster; `see` sees it before. The piece is `None` in a trial, and if no face is left.
    ///
    /// # Errors
    /// On failed reads and damaged files.
    pub fn simplify(
        &self,
        cluster: ClusterId,
        see: impl FnOnce(&ClusterSource),
    ) -> Result<(ClusterResult, Option<PieceContent>)> {
        let mut source = self.load(cluster)?;
        see(&source);
        let (result, simplified) = self.plan.task(cluster).run(self.engine, &mut source);
        let piece = match simplified {
            Some(mesh) if !mesh.corners.is_empty() => {
                let bound = self.plan.max_error;
                Some(source.piece_of(&mesh, self.partition, self.catalogue, self.scale, bound)?)
            }
            _ => None,
        };
        Ok((result, piece))
    }

    /// Memory in bytes of a cluster while it is done.
    pub fn bytes(&self, cluster: ClusterId) -> u64 {
        cluster_bytes(self.engine, self.partition, cluster, self.plan.max_error.is_some())
    }
}

/// Memory in bytes of a cluster while it is simplified or passed through.
pub(super) fn cluster_bytes(
    engine: &dyn MetricEngine,
    partition: &Partition,
    cluster: ClusterId,
    is_bounded: bool,
) -> u64 {
    let extra = |weight: &ClusterWeight| engine.extra_bytes(weight.vertices, weight.wedges);
    let weigh = |weight: ClusterWeight| weight.bytes() + extra(&weight);
    let bytes = partition.weight(cluster).map_or(PASS_BYTES, weigh);
    if is_bounded { Anchor::with_room(bytes) } else { bytes }
}

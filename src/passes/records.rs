//! What the journal records of a pass: how it begins and what each cluster yields, so that a resumed job does not
//! recompute them.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::counters::Counters;
use super::probes::{Probes, Probing};
use super::stop_rule::StopRule;
use super::texture_traits::TextureTraits;
use crate::job::Recalled;
use crate::mesh::ClusterMesh;
use crate::model::{Catalogue, StoredPiece};
use crate::partition::{ClusterId, Partition};
use crate::simplify::{LoggedCollapse, Milestone};

/// How a pass that collapses edges begins.
#[derive(Serialize, Deserialize)]
pub(super) struct PassSetup {
    /// Where each cluster stops.
    pub stops: StopRule,
    /// Whether the stops meet the target to the face.
    pub is_exact: bool,
    /// Properties of the texture; the same in all passes.
    pub texture: TextureTraits,
    /// How clusters are probed, if they are those of the input.
    pub probing: Option<Probing>,
    /// Before the first pass under a bound on the deviation: the share of the faces that it alone would leave.
    pub left_within_bound: Option<f64>,
}

impl Recalled for PassSetup {
    type Context<'a> = (&'a Partition, &'a Catalogue);

    fn is_sound(&self, &(partition, catalogue): &(&Partition, &Catalogue)) -> bool {
        self.stops.is_sound(&partition.cluster_count())
            && self.texture.scale.is_sound(catalogue)
            && self.left_within_bound.is_none_or(f64::is_finite)
            && self.probing.iter().all(|probing| probing.is_sound(partition.total_faces()))
    }
}

/// What simplifying one cluster yields.
#[derive(Default, Serialize, Deserialize)]
pub(super) struct ClusterResult {
    pub pieces: Vec<StoredPiece>,
    pub counters: Counters,
    /// Highest cost of a collapse in the last stage that removed faces.
    pub cost: f32,
    /// Area at the start of the last stage, in units of length².
    pub area: f64,
    /// Estimated mean squared deviation, in units of length².
    pub squared_error: f64,
    pub milestones: Vec<Milestone>,
    /// Collapses of a trial.
    pub log: Vec<LoggedCollapse>,
    /// Patch for the sample of the next pass.
    pub patch: Option<ClusterMesh>,
    /// Probes of a cluster of the input.
    pub probes: Option<Probes>,
}

impl Recalled for ClusterResult {
    type Context<'a> = (&'a Partition, ClusterId);

    fn locate(&mut self, folder: &Path, _: &(&Partition, ClusterId)) {
        self.pieces.iter_mut().for_each(|piece| piece.locate(folder));
    }

    fn is_sound(&self, &(partition, cluster): &(&Partition, ClusterId)) -> bool {
        let faces = partition.face_count(cluster);
        let milestones = self.milestones.iter().map(|milestone| milestone.faces as u64);
        milestones.chain([self.counters.faces_in, self.counters.faces_out]).all(|count| count <= faces)
            && self.pieces.iter().all(StoredPiece::is_sound)
            && self.patch.iter().all(ClusterMesh::is_sound)
            && self.probes.iter().all(|probes| probes.fit(partition.total_faces()))
    }
}

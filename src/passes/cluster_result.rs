//! Records in the journal how a pass begins and what each cluster yields, so that a resumed job does not recompute
//! them.

use serde::{Deserialize, Serialize};

use super::outcome::Floor;
use super::probes::{Probes, Probing};
use super::stop_rule::StopRule;
use super::texture_traits::TextureTraits;
use crate::mesh::ClusterMesh;
use crate::model::{Catalogue, StoredPiece};
use crate::partition::Partition;
use crate::simplify::{Changes, Milestone};

/// How a pass begins.
#[derive(Serialize, Deserialize)]
pub(super) struct Opening {
    pub(super) plan: StopRule,
    /// Whether the plan meets the target to the face.
    pub(super) is_exact: bool,
    /// Properties of the texture; the same in all passes.
    pub(super) texture: TextureTraits,
    /// How clusters are probed, if they are those of the input.
    pub(super) probing: Option<Probing>,
}

impl Opening {
    /// Reports whether a recalled value fits this partition.
    pub(super) fn is_sound(&self, partition: &Partition, catalogue: &Catalogue) -> bool {
        self.plan.is_sound(partition.cluster_count())
            && self.texture.scale.is_sound(catalogue)
            && self.probing.iter().all(|probing| probing.is_sound(partition.total_faces()))
    }
}

/// What simplifying one cluster yields.
#[derive(Default, Serialize, Deserialize)]
pub(super) struct ClusterResult {
    pub(super) pieces: Vec<StoredPiece>,
    pub(super) passed_through: bool,
    pub(super) faces_in: u64,
    pub(super) faces: u64,
    pub(super) cost: f32,
    pub(super) area: f64,
    pub(super) squared_error: f64,
    pub(super) milestones: Vec<Milestone>,
    pub(super) seam_vertices: u64,
    pub(super) degenerate: u64,
    pub(super) doubles: u64,
    pub(super) dropped_pieces: u64,
    pub(super) changes: Changes,
    pub(super) optimized: u64,
    pub(super) dropped_faces: u64,
    pub(super) floor: Floor,
    pub(super) log: Vec<(f32, u8)>,
    /// Patch for the sample of the next pass.
    pub(super) patch: Option<ClusterMesh>,
    /// Probes of a cluster of the input.
    pub(super) probes: Option<Probes>,
}

impl ClusterResult {
    /// Reports whether a recalled value fits this cluster. Call it once the pieces are located.
    pub(super) fn is_sound(&self, partition: &Partition, cluster: usize) -> bool {
        let faces = partition.face_count(cluster);
        let milestones = self.milestones.iter().map(|milestone| milestone.faces as u64);
        milestones.chain([self.faces_in, self.faces]).all(|count| count <= faces)
            && self.pieces.iter().all(StoredPiece::is_sound)
            && self.patch.iter().all(ClusterMesh::is_sound)
            && self.probes.iter().all(|probes| probes.is_sound(partition.total_faces()))
    }
}

//! Lends the clusters of a pass that remeshes to other processes, and does them there.

use std::path::Path;

use serde::Deserialize;

use super::arithmetic;
use super::remesh::{RemeshPass, RemeshedCluster, Remesher, remesh_bytes};
use super::run::Run;
use super::steps::PassStep;
use crate::base::{Progress, Result, WorkLimits};
use crate::job::Recalled;
use crate::job::stage::{Stage, StageTask};
use crate::lend::{Lendable, LentItem, LentResult, LentResults, LentWork, details_of, encoded, lend};
use crate::model::{Catalogue, StoredMesh, StoredPiece};
use crate::partition::{ClusterId, Partition, TextureScale};
use crate::remesh::cvd::{CvdSettings, FrozenStatistics};

/// Kind of the stages whose tasks are done by [`do_task`].
pub const REMESH: &str = "remesh";

/// What a process that does tasks of a stage needs.
#[derive(Deserialize)]
struct RemeshDetails {
    settings: CvdSettings,
    frame: FrozenStatistics,
    partition: Partition,
    mesh: StoredMesh,
    catalogue: Catalogue,
    scale: TextureScale,
    cluster_faces: u64,
}

impl Recalled for RemeshDetails {
    type Context<'a> = ();

    fn locate(&mut self, folder: &Path, (): &()) {
        self.partition.locate(folder);
        self.mesh.locate(folder, &());
    }

    fn is_sound(&self, (): &()) -> bool {
        self.partition.is_sound(&self.mesh, self.cluster_faces) && self.scale.is_sound(&self.catalogue)
    }
}

impl Run<'_> {
    /// Has clusters remeshed by other processes, if the job has any; returns what they did, now or before.
    pub(super) fn lend_remesh(&self, pass: &RemeshPass<'_>) -> Result<LentResults<ClusterId>> {
        let RemeshPass { number, settings, frame, partition } = *pass;
        let Remesher { mesh, catalogue, scale, .. } = self.remesher(pass);
        let what = Lendable {
            kind: REMESH,
            items: LentItem::clusters_of(partition),
            prefix: PassStep::prefix_of_clusters(number, 0),
            parent: Some(PassStep::Stops { pass: number, attempt: 0 }.key()),
            arithmetic: &|| Ok(arithmetic::of_remeshing(settings)),
            is_counted: true,
            is_read_whole: mesh.has_colours(),
        };
        let details = (settings, frame, partition, mesh, catalogue, scale, self.options.cluster_faces);
        lend(self.job, &what, || encoded(&details), self.progress)
    }
}

impl LentResult for RemeshedCluster {
    fn add_piece(&mut self, piece: StoredPiece) {
        self.pieces.push(piece);
    }
}

/// Does a task of a stage of clusters that are remeshed, within limits of memory and threads.
///
/// # Errors
/// [`Error::Changed`](crate::base::Error::Changed) on a machine that computes something else.
/// [`Error::Damaged`](crate::base::Error::Damaged) if the stage holds none; on a full disk, failed reads and writes, and
/// damaged files.
pub fn do_task(stage: &Stage, task: &StageTask, limits: WorkLimits, progress: &dyn Progress) -> Result<()> {
    let details: RemeshDetails = details_of(stage)?;
    stage.check_arithmetic(arithmetic::of_remeshing(&details.settings))?;
    let RemeshDetails { settings, frame, partition, mesh, catalogue, scale, .. } = &details;
    let remesher = Remesher { settings, frame, partition, mesh, catalogue, scale };
    let work = LentWork {
        items: LentItem::clusters_of(partition),
        has_pieces: true,
        bytes: &|cluster| remesh_bytes(partition, cluster),
        work: &|cluster| remesher.remesh(cluster),
    };
    work.run(stage, task, limits, progress)
}

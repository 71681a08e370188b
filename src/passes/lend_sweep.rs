//! Lends the clusters of a sweep to other processes, and does them there.
//!
//! A cluster that passes through is not lent: it is only copied.

use std::path::Path;

use serde::Deserialize;

use super::arithmetic;
use super::cluster_worker::ClusterWorker;
use super::clusters::Sweep;
use super::metric_engine::MetricEngine;
use super::options::Cost;
use super::records::ClusterResult;
use super::run::Run;
use super::sweep_plan::SweepPlan;
use super::texture_traits::TextureTraits;
use crate::base::{Progress, Result, WorkLimits};
use crate::cost::mesh_stats::MeshStats;
use crate::job::Recalled;
use crate::job::stage::{Stage, StageTask};
use crate::lend::{Lendable, LentItem, LentResult, LentResults, LentWork, details_of, encoded, lend};
use crate::model::{Catalogue, StoredMesh, StoredPiece};
use crate::partition::{ClusterId, Partition};

/// Kind of the stages whose tasks are done by [`do_task`].
pub const SWEEP: &str = "sweep";

/// What a process that does tasks of a stage needs.
#[derive(Deserialize)]
struct SweepDetails {
    plan: SweepPlan,
    partition: Partition,
    mesh: StoredMesh,
    catalogue: Catalogue,
    texture: TextureTraits,
    cost: Cost,
    stats: Option<MeshStats>,
    cluster_faces: u64,
}

impl Recalled for SweepDetails {
    type Context<'a> = ();

    fn locate(&mut self, folder: &Path, (): &()) {
        self.partition.locate(folder);
        self.mesh.locate(folder, &());
    }

    fn is_sound(&self, (): &()) -> bool {
        self.partition.is_sound(&self.mesh, self.cluster_faces)
            && self.texture.scale.is_sound(&self.catalogue)
            && self.plan.is_sound(&self.partition)
    }
}

impl Run<'_> {
    /// Has clusters of a sweep done by other processes, if the job has any; returns what they did, now or before.
    pub(super) fn lend_sweep(&self, sweep: &Sweep<'_>) -> Result<LentResults<ClusterId>> {
        let what = Lendable {
            kind: SWEEP,
            items: LentItem::among(sweep.partition, sweep.clusters.iter().copied()),
            prefix: sweep.prefix_of_several(),
            parent: Some(sweep.parent()),
            arithmetic: &|| Ok(arithmetic::of_collapses(self.options.cost)),
            is_counted: !sweep.plan.is_trial(),
            is_read_whole: self.state.mesh.has_colours(),
        };
        let (mesh, stats) = (&self.state.mesh, &self.state.stats);
        let (cost, cluster_faces) = (self.options.cost, self.options.cluster_faces);
        let details = (&sweep.plan, sweep.partition, mesh, self.catalogue, &self.texture, cost, stats, cluster_faces);
        lend(self.job, &what, || encoded(&details), self.progress)
    }
}

impl LentResult for ClusterResult {
    fn add_piece(&mut self, piece: StoredPiece) {
        self.pieces.push(piece);
    }
}

/// Does a task of a stage of clusters, within limits of memory and threads.
///
/// # Errors
/// [`Error::Changed`](crate::base::Error::Changed) on a machine that computes something else.
/// [`Error::Damaged`](crate::base::Error::Damaged) if the stage holds none; on a full disk, failed reads and writes, and
/// damaged files.
pub fn do_task(stage: &Stage, task: &StageTask, limits: WorkLimits, progress: &dyn Progress) -> Result<()> {
    let details: SweepDetails = details_of(stage)?;
    stage.check_arithmetic(arithmetic::of_collapses(details.cost))?;
    let mut engine = details.cost.engine();
    engine.learn_seam_density(details.texture.seam_density);
    if let Some(stats) = &details.stats {
        engine.normalise(stats);
    }
    let worker = details.worker(&*engine);
    let work = LentWork {
        items: LentItem::clusters_of(&details.partition),
        has_pieces: !details.plan.is_trial(),
        bytes: &|cluster| worker.bytes(cluster),
        work: &|cluster| worker.simplify(cluster, |_| ()),
    };
    work.run(stage, task, limits, progress)
}

impl SweepDetails {
    fn worker<'a>(&'a self, engine: &'a dyn MetricEngine) -> ClusterWorker<'a> {
        ClusterWorker {
            engine,
            partition: &self.partition,
            mesh: &self.mesh,
            catalogue: &self.catalogue,
            scale: &self.texture.scale,
            plan: &self.plan,
        }
    }
}

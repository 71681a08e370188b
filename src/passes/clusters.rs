//! Runs one sweep over the clusters: reads, simplifies and writes each of them, on several threads.

use super::cluster_task::ClusterProbing;
use super::cluster_worker::{ClusterWorker, cluster_bytes};
use super::counters::Counters;
use super::pass_id::Pass;
use super::probes::{Probes, Probing};
use super::records::ClusterResult;
use super::run::Run;
use super::steps::PassStep;
use super::stop_rule::StopRule;
use super::sweep_plan::{SweepOutput, SweepPlan};
use crate::base::Result;
use crate::base::ordered::{Crew, finish_in_order};
use crate::job::StepKey;
use crate::lend::LentResults;
use crate::model::StoredPiece;
use crate::model::piece::PendingPiece;
use crate::os::mmap;
use crate::partition::{ClusterId, ClusterSource, Partition, heavy};

/// Clusters after which freed memory is returned to the system; by then the heaps of the threads are fragmented.
const CLUSTERS_PER_RELEASE: usize = 64;

/// One run over clusters of a pass.
pub(super) struct Sweep<'a> {
    pub pass: Pass,
    pub partition: &'a Partition,
    /// The clusters, ascending.
    pub clusters: Vec<ClusterId>,
    /// Number of the trial, or of the attempt.
    pub number: u32,
    pub plan: SweepPlan,
}

impl Sweep<'_> {
    /// The step that records a cluster.
    fn step(&self, cluster: ClusterId) -> PassStep {
        let (pass, number) = (self.pass.number as u32, self.number);
        if self.plan.is_trial() {
            PassStep::Trial { pass, trial: number, cluster }
        } else {
            PassStep::Cluster { pass, attempt: number, cluster }
        }
    }

    /// What the keys of steps begin with that record clusters that one process did after another.
    pub fn prefix_of_several(&self) -> String {
        let (pass, number) = (self.pass.number as u32, self.number);
        if self.plan.is_trial() {
            PassStep::prefix_of_trials(pass, number)
        } else {
            PassStep::prefix_of_clusters(pass, number)
        }
    }

    /// The step that its results are computed from.
    pub fn parent(&self) -> StepKey {
        let pass = self.pass.number as u32;
        let step = if self.plan.is_trial() {
            PassStep::Partition { pass }
        } else {
            PassStep::Stops { pass, attempt: self.number }
        };
        step.key()
    }
}

/// A simplified cluster whose piece may not be durable yet.
struct ClusterOutput {
    cluster: ClusterId,
    result: ClusterResult,
    pending: Option<PendingPiece>,
    /// Whether it is recorded in the journal.
    is_recorded: bool,
    /// Whether the progress knows of it.
    is_told: bool,
}

impl Run<'_> {
    /// What a sweep that stops clusters by `stops` does to each of them.
    pub(super) fn plan_sweep(
        &self,
        pass: Pass,
        partition: &Partition,
        stops: &StopRule,
        output: SweepOutput,
    ) -> SweepPlan {
        SweepPlan {
            rules: self.rules(pass),
            stops: stops.clone(),
            min_component_diagonal: self.state.min_component_diagonal,
            faces_all: [partition.total_faces(), self.options.target],
            probing: match self.probing {
                Some(probing) => ClusterProbing::As(probing),
                None if pass.number == 0 && partition.is_single() => ClusterProbing::Alone,
                None => ClusterProbing::None,
            },
            max_error: self.bound(),
            output,
        }
    }

    /// Simplifies the clusters that have faces, and writes them unless this is a trial; passes results to `commit` in
    /// their order. Reuses results that an earlier process recorded.
    pub(super) fn sweep(&self, sweep: &Sweep<'_>, mut commit: impl FnMut(ClusterResult) -> Result<()>) -> Result<()> {
        let mut done = 0;
        let commit = |result| {
            done += 1;
            if done % CLUSTERS_PER_RELEASE == 0 {
                mmap::release_freed_memory();
            }
            commit(result)
        };
        let lent = self.lend_sweep(sweep)?;
        let clusters = sweep.clusters.iter().copied();
        let threads = self.options.threads;
        let crew = Crew { threads, finishers: threads };
        let work = |cluster| self.simplify_or_recall(sweep, &lent, cluster);
        let record = |output| self.record(sweep, output);
        finish_in_order(clusters, crew, threads * 4, work, record, commit)
    }

    /// What the clusters of a sweep are done with.
    pub(super) fn worker<'a>(&'a self, sweep: &'a Sweep<'_>) -> ClusterWorker<'a> {
        ClusterWorker {
            engine: &*self.engine,
            partition: sweep.partition,
            mesh: &self.state.mesh,
            catalogue: self.catalogue,
            scale: &self.texture.scale,
            plan: &sweep.plan,
        }
    }

    fn simplify_or_recall(
        &self,
        sweep: &Sweep<'_>,
        lent: &LentResults<ClusterId>,
        cluster: ClusterId,
    ) -> Result<ClusterOutput> {
        self.progress.check_stopped()?;
        let context = (sweep.partition, cluster);
        if let Some(result) = self.job.recall::<ClusterResult>(&sweep.step(cluster).key(), &context)? {
            return Ok(ClusterOutput { cluster, result, pending: None, is_recorded: true, is_told: false });
        }
        if let Some((result, is_told)) = lent.result(self.job.path(), cluster, &context)? {
            self.draw_lent(sweep, cluster)?;
            return Ok(ClusterOutput { cluster, result, pending: None, is_recorded: true, is_told });
        }
        let _permit = self.permits.take(self.cluster_bytes(sweep.partition, cluster));
        let (result, pending) = match sweep.partition.weight(cluster) {
            None => (self.pass_through(sweep, cluster)?, None),
            Some(_) => self.simplify_cluster(sweep, cluster)?,
        };
        Ok(ClusterOutput { cluster, result, pending, is_recorded: false, is_told: false })
    }

    /// Makes the piece of a cluster durable, and records its result in the journal.
    fn record(&self, sweep: &Sweep<'_>, output: ClusterOutput) -> Result<ClusterResult> {
        let ClusterOutput { cluster, mut result, pending, is_recorded, is_told } = output;
        let faces = sweep.partition.face_count(cluster);
        if let Some(pending) = pending {
            result.pieces.push(pending.commit()?);
        }
        if !is_recorded {
            let files = result.pieces.iter().flat_map(StoredPiece::files);
            self.job.keep(sweep.step(cluster).to_record().of_size(faces), files, &result)?;
        }
        if !sweep.plan.is_trial() && !is_told {
            self.progress.advance(faces);
        }
        Ok(result)
    }

    fn simplify_cluster(&self, sweep: &Sweep<'_>, cluster: ClusterId) -> Result<(ClusterResult, Option<PendingPiece>)> {
        let draw = |source: &ClusterSource| self.draw(sweep, cluster, source);
        let (result, piece) = self.worker(sweep).simplify(cluster, draw)?;
        let path = self.piece_path(sweep.step(cluster), 0);
        Ok((result, piece.map(|piece| piece.write(&path)).transpose()?))
    }

    /// Draws a cluster in the map of the pass, if one is wanted.
    fn draw(&self, sweep: &Sweep<'_>, cluster: ClusterId, source: &ClusterSource) {
        if !sweep.plan.is_trial()
            && let Some(map) = self.map().as_mut()
        {
            map.draw(cluster, &source.mesh, source.origin);
        }
    }

    /// Draws a cluster that another process did.
    fn draw_lent(&self, sweep: &Sweep<'_>, cluster: ClusterId) -> Result<()> {
        if sweep.plan.is_trial() || self.map().is_none() {
            return Ok(());
        }
        let _permit = self.permits.take(self.cluster_bytes(sweep.partition, cluster));
        self.draw(sweep, cluster, &self.worker(sweep).load(cluster)?);
        Ok(())
    }

    /// Memory in bytes of a cluster while it is simplified or passed through.
    pub(super) fn cluster_bytes(&self, partition: &Partition, cluster: ClusterId) -> u64 {
        cluster_bytes(&*self.engine, partition, cluster, self.bound().is_some())
    }

    /// Writes a cluster that is too heavy to load as it is, in blocks.
    fn pass_through(&self, sweep: &Sweep<'_>, cluster: ClusterId) -> Result<ClusterResult> {
        let partition = sweep.partition;
        let unchanged = |faces_in, faces_out, degenerate_faces| Counters {
            faces_in,
            faces_out,
            degenerate_faces,
            passed_through_faces: faces_out,
            ..Counters::default()
        };
        if sweep.plan.is_trial() {
            let counters = unchanged(0, partition.face_count(cluster), 0);
            return Ok(ClusterResult { counters, ..ClusterResult::default() });
        }
        let path = |part| self.piece_path(sweep.step(cluster), part);
        let (pieces, degenerate) = heavy::pass_through(partition, &self.state.mesh, cluster, path)?;
        let faces = pieces.iter().map(|piece| piece.faces.len()).sum();
        let probes = self.probing.map(|probing| self.probe_blocks(&probing, partition, cluster)).transpose()?;
        let counters = unchanged(faces, faces, degenerate);
        Ok(ClusterResult { pieces, counters, probes, ..ClusterResult::default() })
    }

    /// Probes a cluster of the input that is too large to load at once, block by block.
    pub(super) fn probe_blocks(&self, probing: &Probing, partition: &Partition, cluster: ClusterId) -> Result<Probes> {
        let mut probes = Probes::default();
        heavy::load_in_blocks(partition, &self.state.mesh, self.catalogue, &self.texture.scale, cluster, |block| {
            probes.add(probing.take(&block.mesh, block.origin, cluster));
            Ok(())
        })?;
        Ok(probes)
    }
}

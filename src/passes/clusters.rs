//! Runs one sweep over the clusters: reads, simplifies and writes each of them, on several threads.

use super::cluster_task::{ClusterProbing, ClusterTask, TaskOutput};
use super::counters::Counters;
use super::pass_id::Pass;
use super::probes::{Probes, Probing};
use super::records::ClusterResult;
use super::run::Run;
use super::sample::Survey;
use super::steps::PassStep;
use super::stop_rule::StopRule;
use crate::base::Result;
use crate::base::ordered::{Crew, finish_in_order};
use crate::model::StoredPiece;
use crate::model::piece::PendingPiece;
use crate::os::mmap;
use crate::partition::weight::ClusterWeight;
use crate::partition::{ClusterId, Partition, heavy};
use crate::simplify::Anchor;

/// Clusters after which freed memory is returned to the system; by then the heaps of the threads are fragmented.
const CLUSTERS_PER_RELEASE: usize = 64;
/// Memory in bytes of a cluster that passes through: a block of faces, their texture coordinates and the piece being
/// written.
pub(super) const PASS_BYTES: u64 = 16 << 20;

/// One run over all clusters of a pass.
#[derive(Clone, Copy)]
pub(super) struct Sweep<'a> {
    pub pass: Pass,
    pub partition: &'a Partition,
    /// Where the clusters stop.
    pub stops: &'a StopRule,
    pub purpose: SweepPurpose<'a>,
}

/// What the clusters of a sweep are simplified for.
#[derive(Clone, Copy)]
pub(super) enum SweepPurpose<'a> {
    /// The log of their collapses; the number of the trial.
    Trial(u32),
    /// The mesh; the number of the attempt, and the clusters that give patches for the next sample.
    Mesh(u32, &'a Survey),
}

impl Sweep<'_> {
    fn step(&self, cluster: ClusterId) -> PassStep {
        let pass = self.pass.number as u32;
        match self.purpose {
            SweepPurpose::Trial(trial) => PassStep::Trial { pass, trial, cluster },
            SweepPurpose::Mesh(attempt, _) => PassStep::Cluster { pass, attempt, cluster },
        }
    }

    fn is_trial(&self) -> bool {
        matches!(self.purpose, SweepPurpose::Trial(_))
    }
}

/// A simplified cluster whose piece may not be durable yet.
struct ClusterOutput {
    cluster: ClusterId,
    result: ClusterResult,
    pending: Option<PendingPiece>,
    /// Whether an earlier process recorded it in the journal.
    is_recorded: bool,
}

impl Run<'_> {
    /// Simplifies every cluster that has faces, and writes it unless this is a trial; passes results to `commit` in
    /// cluster order. Reuses results that an earlier process recorded.
    pub(super) fn sweep(&self, sweep: Sweep<'_>, mut commit: impl FnMut(ClusterResult) -> Result<()>) -> Result<()> {
        let mut done = 0;
        let commit = |result| {
            done += 1;
            if done % CLUSTERS_PER_RELEASE == 0 {
                mmap::release_freed_memory();
            }
            commit(result)
        };
        let clusters = sweep.partition.clusters();
        let threads = self.options.threads;
        let crew = Crew { threads, finishers: threads };
        let work = |cluster| self.simplify_or_recall(&sweep, cluster);
        let record = |output| self.record(&sweep, output);
        finish_in_order(clusters, crew, threads * 4, work, record, commit)
    }

    fn simplify_or_recall(&self, sweep: &Sweep<'_>, cluster: ClusterId) -> Result<ClusterOutput> {
        self.progress.check_stopped()?;
        let context = (sweep.partition, cluster);
        if let Some(result) = self.job.recall::<ClusterResult>(&sweep.step(cluster).key(), &context)? {
            return Ok(ClusterOutput { cluster, result, pending: None, is_recorded: true });
        }
        let _permit = self.permits.take(self.cluster_bytes(sweep.partition, cluster));
        if sweep.partition.weight(cluster).is_none() {
            let result = self.pass_through(sweep, cluster)?;
            return Ok(ClusterOutput { cluster, result, pending: None, is_recorded: false });
        }
        let (result, pending) = self.simplify_cluster(sweep, cluster)?;
        Ok(ClusterOutput { cluster, result, pending, is_recorded: false })
    }

    /// Makes the piece of a cluster durable, and records its result in the journal.
    fn record(&self, sweep: &Sweep<'_>, output: ClusterOutput) -> Result<ClusterResult> {
        let ClusterOutput { cluster, mut result, pending, is_recorded } = output;
        let faces = sweep.partition.face_count(cluster);
        if let Some(pending) = pending {
            result.pieces.push(pending.commit()?);
        }
        if !is_recorded {
            let files = result.pieces.iter().flat_map(StoredPiece::files);
            self.job.keep(sweep.step(cluster).to_record().of_size(faces), files, &result)?;
        }
        if !sweep.is_trial() {
            self.progress.advance(faces);
        }
        Ok(result)
    }

    fn simplify_cluster(&self, sweep: &Sweep<'_>, cluster: ClusterId) -> Result<(ClusterResult, Option<PendingPiece>)> {
        let mut source = self.load(sweep.partition, cluster)?;
        if !sweep.is_trial()
            && let Some(map) = self.map().as_mut()
        {
            map.draw(cluster, &source.mesh, source.origin);
        }
        let (result, simplified) = self.task(sweep, cluster).run(&*self.engine, &mut source);
        let pending = match simplified {
            Some(mesh) if !mesh.corners.is_empty() => {
                let path = self.piece_path(sweep.step(cluster), 0);
                let (scale, bound) = (&self.texture.scale, self.bound());
                Some(source.write(&mesh, sweep.partition, self.catalogue, scale, bound, &path)?)
            }
            _ => None,
        };
        Ok((result, pending))
    }

    fn task(&self, sweep: &Sweep<'_>, cluster: ClusterId) -> ClusterTask {
        let pass = sweep.pass;
        let output = match sweep.purpose {
            SweepPurpose::Trial(_) => TaskOutput::Log,
            SweepPurpose::Mesh(_, survey) => TaskOutput::Mesh {
                patch_faces: survey.patch_faces(cluster),
                optimize: self.options.optimize && pass.turn + 1 >= self.options.passes,
            },
        };
        let probing = match self.probing {
            Some(probing) => ClusterProbing::As(probing),
            None if pass.number == 0 && sweep.partition.is_single() => ClusterProbing::Alone,
            None => ClusterProbing::None,
        };
        ClusterTask {
            cluster,
            rules: self.rules(pass),
            stop: sweep.stops.of(cluster),
            min_component_diagonal: self.state.min_component_diagonal,
            faces_all: [sweep.partition.total_faces(), self.options.target],
            probing,
            output,
        }
    }

    /// Memory in bytes of a cluster while it is simplified or passed through.
    pub(super) fn cluster_bytes(&self, partition: &Partition, cluster: ClusterId) -> u64 {
        let extra = |weight: &ClusterWeight| self.engine.extra_bytes(weight.vertices, weight.wedges);
        let weigh = |weight: ClusterWeight| weight.bytes() + extra(&weight);
        let bytes = partition.weight(cluster).map_or(PASS_BYTES, weigh);
        if self.bound().is_some() { Anchor::with_room(bytes) } else { bytes }
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
        if sweep.is_trial() {
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

//! Runs one pass over the clusters: reads, simplifies and writes each of them, on several threads.

use super::cluster_result::ClusterResult;
use super::outcome::Floor;
use super::probes::{Probes, Probing};
use super::run::Run;
use super::sample::Survey;
use super::stop_rule::{StopRule, run_plan};
use crate::base::Result;
use crate::base::ordered::{Crew, settle_in_order};
use crate::cost::Metric;
use crate::job::Step;
use crate::mesh::pieces;
use crate::model::piece::PendingPiece;
use crate::model::{StoredMesh, StoredPiece};
use crate::os::mmap;
use crate::partition::weight::ClusterWeight;
use crate::partition::{Partition, cluster};
use crate::remesh;
use crate::simplify::Anchor;

/// Clusters after which freed memory is returned to the system; by then the heaps of the threads are fragmented.
const CLUSTERS_PER_RELEASE: usize = 64;
/// Memory in bytes of a cluster that passes through: a block of faces, their texture coordinates and the piece being
/// written.
pub(super) const PASS_BYTES: u64 = 16 << 20;

/// A simplified cluster whose piece may not be durable yet.
struct Product {
    cluster: usize,
    result: ClusterResult,
    pending: Option<PendingPiece>,
    /// Whether an earlier process recorded it in the journal.
    is_kept: bool,
}

impl<M: Metric> Run<'_, M> {
    /// Loads and simplifies every cluster that has faces, and writes it if `keep` is `Some`; passes results to `commit`
    /// in cluster order. Reuses results that an earlier process recorded.
    pub(super) fn each_cluster(
        &self,
        mesh: &StoredMesh,
        partition: &Partition,
        (pass, plan): (usize, &StopRule),
        keep: Option<&Survey>,
        step: impl Fn(u32) -> Step + Sync,
        mut commit: impl FnMut(ClusterResult) -> Result<()>,
    ) -> Result<()> {
        let mut done = 0;
        let commit = |result| {
            done += 1;
            if done % CLUSTERS_PER_RELEASE == 0 {
                mmap::release_freed_memory();
            }
            commit(result)
        };
        let work = |cluster: usize| {
            self.progress.check_stopped()?;
            let step = step(cluster as u32);
            let accept = |kept: &mut ClusterResult| {
                kept.pieces.iter_mut().for_each(|piece| piece.locate(self.job.path()));
                kept.is_sound(partition, cluster)
            };
            if let Some(result) = self.job.recall_if(step, accept)? {
                return Ok(Product { cluster, result, pending: None, is_kept: true });
            }
            let _permit = self.permits.take(self.cluster_bytes(partition, cluster));
            let (result, pending) = self.simplify_cluster(mesh, partition, step, (pass, plan), keep, cluster)?;
            Ok(Product { cluster, result, pending, is_kept: false })
        };
        let settle = |Product { cluster, mut result, pending, is_kept }| {
            let faces = partition.face_count(cluster);
            if let Some(pending) = pending {
                result.pieces.push(pending.commit()?);
            }
            if !is_kept {
                let files = result.pieces.iter().flat_map(StoredPiece::files);
                self.job.keep(step(cluster as u32), faces, files, &result)?;
            }
            if keep.is_some() {
                self.progress.advance(faces);
            }
            Ok(result)
        };
        let threads = self.options.threads;
        let crew = Crew { threads, settlers: threads };
        settle_in_order(0..partition.cluster_count(), crew, threads * 4, work, settle, commit)
    }

    fn simplify_cluster(
        &self,
        mesh: &StoredMesh,
        partition: &Partition,
        step: Step,
        (pass, plan): (usize, &StopRule),
        keep: Option<&Survey>,
        cluster: usize,
    ) -> Result<(ClusterResult, Option<PendingPiece>)> {
        if partition.weight(cluster).is_none() {
            return Ok((self.pass_through(mesh, partition, step, keep, cluster)?, None));
        }
        let mut source = self.load(mesh, partition, cluster)?;
        if keep.is_some()
            && let Some(map) = self.map().as_mut()
        {
            map.draw(cluster as u32, &source.mesh, source.origin);
        }
        let probing = match self.probing {
            None if pass == 0 && partition.is_single() => Some(self.probing_of(partition, &source.mesh)),
            probing => probing,
        };
        let probes = probing.map(|probing| probing.take(&source.mesh, source.origin, cluster));
        let (dropped_pieces, dropped_faces) = match self.crumb {
            Some(diagonal) => {
                let faces_max = self.spare_faces(source.mesh.face_count as u64, partition.total_faces());
                pieces::drop_small(&mut source.mesh, diagonal, faces_max)
            }
            None => (0, 0),
        };
        let mut engine = self.engine(std::mem::take(&mut source.mesh), pass);
        let faces_in = engine.mesh.face_count as u64;
        let cost = run_plan(&mut engine, plan, cluster, keep.is_none());
        let mut result = ClusterResult {
            pieces: Vec::new(),
            passed_through: false,
            faces_in,
            faces: engine.mesh.face_count as u64,
            cost,
            area: engine.area(),
            squared_error: engine.squared_error,
            milestones: std::mem::take(&mut engine.milestones),
            seam_vertices: engine.seam_vertices,
            degenerate: source.degenerate,
            doubles: source.doubles,
            dropped_pieces,
            changes: engine.changes(),
            optimized: 0,
            dropped_faces,
            floor: Floor::of(&engine),
            log: engine.log.take().unwrap_or_default(),
            patch: None,
            probes,
        };
        let mut pending = None;
        if let Some(keep) = keep {
            let path = self.piece_path(step, 0);
            let mut simplified = engine.finish();
            if self.options.optimize && self.turn(pass) + 1 >= self.options.passes {
                result.optimized = remesh::relax(&mut simplified);
            }
            result.patch = keep.patch(cluster, &simplified);
            if !simplified.corners.is_empty() {
                let (scale, bound) = (&self.texture.scale, self.bound());
                pending = Some(source.write(&simplified, partition, self.catalogue, scale, bound, &path)?);
            }
        }
        Ok((result, pending))
    }

    /// Returns the faces that a cluster with `own` of `all` faces may lose before the mesh falls below the target.
    fn spare_faces(&self, own: u64, all: u64) -> u64 {
        let spare = all.saturating_sub(self.options.target);
        (u128::from(own) * u128::from(spare) / u128::from(all.max(1))) as u64
    }

    /// Memory in bytes of a cluster while it is simplified or passed through.
    pub(super) fn cluster_bytes(&self, partition: &Partition, cluster: usize) -> u64 {
        let weigh =
            |weight: ClusterWeight| weight.bytes() + weight.vertices * M::VERTEX_BYTES + weight.wedges * M::WEDGE_BYTES;
        let bytes = partition.weight(cluster).map_or(PASS_BYTES, weigh);
        if self.bound().is_some() { Anchor::with_room(bytes) } else { bytes }
    }

    fn pass_through(
        &self,
        mesh: &StoredMesh,
        partition: &Partition,
        step: Step,
        keep: Option<&Survey>,
        cluster: usize,
    ) -> Result<ClusterResult> {
        let faces = partition.face_count(cluster);
        let unchanged = ClusterResult { faces, passed_through: true, ..ClusterResult::default() };
        if keep.is_none() {
            return Ok(unchanged);
        }
        let path = |part| self.piece_path(step, part);
        let (pieces, degenerate) = cluster::pass_through(partition, mesh, cluster, path)?;
        let faces = pieces.iter().map(|piece| piece.faces.len()).sum();
        let probes = self.probing.map(|probing| self.probe_blocks(&probing, mesh, partition, cluster)).transpose()?;
        Ok(ClusterResult { pieces, degenerate, faces_in: faces, faces, probes, ..unchanged })
    }

    /// Probes a cluster of the input that is too large to load at once, block by block.
    pub(super) fn probe_blocks(
        &self,
        probing: &Probing,
        mesh: &StoredMesh,
        partition: &Partition,
        cluster: usize,
    ) -> Result<Probes> {
        let mut probes = Probes::default();
        cluster::load_in_blocks(partition, mesh, self.catalogue, &self.texture.scale, cluster, |block| {
            probes.add(probing.take(&block.mesh, block.origin, cluster));
            Ok(())
        })?;
        Ok(probes)
    }
}

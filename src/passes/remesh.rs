//! The remeshing pass, which runs before the others: remeshes every cluster by centroidal Voronoi cells.
//!
//! ```text
//! measure the masses of all clusters ──▶ D_avg ──▶ count their cells and candidates ──▶ threshold ──▶ the pass
//! ```
//! Both surveys precede any change and their results are frozen, so that the output does not depend on the order of
//! clusters. The journal records both as one step. If the target is a number of cells, the pass is repeated on shifted
//! clusters to remesh the rims of earlier ones, too.
//!
//! # Memory
//! A cluster takes [`cvd::GROWTH`] / 2 times its weight in bytes.

use std::path::Path;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::clusters::PASS_BYTES;
use super::outcome::RemeshReport;
use super::probes::{LongestSides, Probes, Probing};
use super::run::{Run, plan_step};
use super::state::PassState;
use crate::base::Result;
use crate::base::ordered::map_in_order;
use crate::cost::Metric;
use crate::job::{Step, folder_bytes};
use crate::model::{StoredMesh, StoredPiece};
use crate::partition::{ClusterSource, Partition, cluster};
use crate::remesh::cvd::mass::MassSums;
use crate::remesh::cvd::{self, CvdSettings, FrozenStatistics, Stock};

/// Remeshing passes for a target in cells, if there are several clusters.
pub const CELL_PASSES: usize = 3;

/// Reports whether no further remeshing pass follows.
pub(super) fn is_remeshed(settings: &CvdSettings, done: &[RemeshReport]) -> bool {
    match (settings.cells, done.last()) {
        (_, None) => false,
        (None, Some(_)) => true,
        (Some(_), Some(last)) => last.clusters <= 1 || done.len() >= CELL_PASSES,
    }
}

/// Result of both surveys.
#[derive(Serialize, Deserialize)]
struct Surveyed {
    frame: FrozenStatistics,
    /// Probes of the input, if this is the first pass.
    probes: Probes,
}

/// Result of remeshing a cluster.
#[derive(Default, Serialize, Deserialize)]
struct Remeshed {
    pieces: Vec<StoredPiece>,
    faces: u64,
    degenerate: u64,
    doubles: u64,
    cells: u64,
    held: u64,
    added: u64,
    junctions: u64,
    kept: u64,
    passed_through: u64,
}

impl<M: Metric> Run<'_, M> {
    /// Remeshes the mesh, cluster by cluster.
    ///
    /// # Errors
    /// On a full disk, failed reads or writes, and damaged files.
    pub(super) fn reconstruct(
        &mut self,
        settings: &CvdSettings,
        state: &mut PassState,
        partition: &Partition,
    ) -> Result<()> {
        let started = Instant::now();
        let pass = state.pass;
        let is_sound = |found: &mut Surveyed| found.probes.is_empty() || found.probes.is_sound(partition.total_faces());
        let Surveyed { frame, probes } = match self.job.recall_if(plan_step(pass, 0), is_sound)? {
            Some(found) => found,
            None => {
                let found = self.find_frame(settings, state, partition)?;
                self.job.keep(plan_step(pass, 0), 0, [], &found)?;
                found
            }
        };
        if !probes.is_empty() {
            self.keep_probes(probes)?;
        }
        self.progress.begin("remesh", partition.total_faces(), "faces");
        let mut report = RemeshReport {
            clusters: partition.filled_count(),
            faces_in: partition.total_faces(),
            wanted: frame.wanted,
            cell_mass: frame.enough,
            threshold: frame.threshold,
            ..RemeshReport::default()
        };
        let mut mesh = StoredMesh::default();
        let run = &*self;
        let work = |cluster: usize| {
            run.progress.check_stopped()?;
            let step = Step::Cluster { pass: pass as u32, attempt: 0, cluster: cluster as u32 };
            let faces = partition.face_count(cluster);
            let accept = |kept: &mut Remeshed| {
                kept.pieces.iter_mut().for_each(|piece| piece.locate(run.job.path()));
                kept.pieces.iter().all(StoredPiece::is_sound)
            };
            let remeshed = match run.job.recall_if(step, accept)? {
                Some(remeshed) => remeshed,
                None => {
                    let _permit = run.permits.take(remesh_bytes(partition, cluster));
                    let remeshed = run.remesh_cluster(settings, &frame, &state.mesh, partition, step, cluster)?;
                    run.job.keep(step, faces, remeshed.pieces.iter().flat_map(StoredPiece::files), &remeshed)?;
                    remeshed
                }
            };
            run.progress.advance(faces);
            Ok(remeshed)
        };
        let (threads, findings) = (self.options.threads, &mut state.findings);
        map_in_order(0..partition.cluster_count(), threads, threads * 4, work, |remeshed| {
            report.faces_out += remeshed.faces;
            report.cells += remeshed.cells;
            report.held += remeshed.held;
            report.added += remeshed.added;
            report.junctions += remeshed.junctions;
            report.kept += remeshed.kept;
            report.passed_through += remeshed.passed_through;
            findings.count("degenerate_faces", remeshed.degenerate);
            findings.count("dropped_doubles", remeshed.doubles);
            mesh.pieces.extend(remeshed.pieces);
            Ok(())
        })?;
        self.write_shared(partition, pass, &mut mesh)?;
        state.findings.count("remesh_kept_vertices", report.kept);
        state.scratch_peak = state.scratch_peak.max(folder_bytes(self.job.path()));
        state.mesh = mesh;
        state.remeshed.push(report);
        state.seconds.remesh += started.elapsed();
        state.is_over = settings.cells.is_some() && is_remeshed(settings, &state.remeshed);
        state.reached = state.is_over;
        state.pass += 1;
        let step = Step::Pass { pass: pass as u32 };
        let faces = state.mesh.face_count();
        self.job.supersede(step, faces, state.mesh.files(), &*state, &[Step::Input, Step::Probes])?;
        self.progress.tell(&format!("remeshed: {faces} triangles"));
        Ok(())
    }

    /// Surveys all clusters twice; probes those of the input in the second survey.
    fn find_frame(&self, settings: &CvdSettings, state: &PassState, partition: &Partition) -> Result<Surveyed> {
        self.progress.begin("weigh", 2 * partition.total_faces(), "faces");
        let is_input = state.pass == 0;
        let (mut sums, mut sides) = (MassSums::default(), LongestSides::default());
        let weigh = |source: &ClusterSource, _: usize| {
            let mut own = MassSums::default();
            cvd::weigh(&source.mesh, settings, &mut own);
            (own, if is_input { LongestSides::of(&source.mesh) } else { LongestSides::default() })
        };
        let skip = |_: usize| Ok(Default::default());
        self.look(&state.mesh, partition, weigh, skip, |(own, own_sides)| {
            sums.merge(&own);
            sides = sides.with(own_sides);
        })?;
        let frame = FrozenStatistics::new(&sums, settings);
        let faces = partition.total_faces();
        // A closed surface has about two faces per cell.
        let target = settings.cells.map_or(self.options.target, |cells| 2 * cells);
        let probing = is_input.then(|| Probing::new(faces, if target > 0 { target } else { faces }, sides.mean_sq()));
        let (mut stock, mut probes) = (Stock::default(), Probes::default());
        let take = |source: &ClusterSource, cluster: usize| {
            let probes = probing.map(|probing| probing.take(&source.mesh, source.origin, cluster));
            (cvd::take_stock(&source.mesh, settings, &frame), probes.unwrap_or_default())
        };
        let take_blocks = |cluster: usize| {
            let probes = probing.map(|probing| self.probe_blocks(&probing, &state.mesh, partition, cluster));
            Ok((Stock::default(), probes.transpose()?.unwrap_or_default()))
        };
        self.look(&state.mesh, partition, take, take_blocks, |(own, own_probes)| {
            stock.merge(&own);
            probes.add(own_probes);
        })?;
        Ok(Surveyed { frame: FrozenStatistics { threshold: stock.threshold(&frame), ..frame }, probes })
    }

    /// Applies `look_at` to every cluster that can be loaded and `look_past` to the others; passes the results to
    /// `take` in cluster order.
    fn look<T: Send>(
        &self,
        mesh: &StoredMesh,
        partition: &Partition,
        look_at: impl Fn(&ClusterSource, usize) -> T + Sync,
        look_past: impl Fn(usize) -> Result<T> + Sync,
        mut take: impl FnMut(T),
    ) -> Result<()> {
        let work = |cluster: usize| {
            self.progress.check_stopped()?;
            if partition.weight(cluster).is_none() {
                return look_past(cluster);
            }
            let _permit = self.permits.take(remesh_bytes(partition, cluster));
            let source = self.load(mesh, partition, cluster)?;
            self.progress.advance(partition.face_count(cluster));
            Ok(look_at(&source, cluster))
        };
        let threads = self.options.threads;
        map_in_order(0..partition.cluster_count(), threads, threads + 1, work, |own| {
            take(own);
            Ok(())
        })
    }

    fn remesh_cluster(
        &self,
        settings: &CvdSettings,
        frame: &FrozenStatistics,
        mesh: &StoredMesh,
        partition: &Partition,
        step: Step,
        cluster: usize,
    ) -> Result<Remeshed> {
        if partition.weight(cluster).is_none() {
            let path = |part| self.piece_path(step, part);
            let (pieces, degenerate) = cluster::pass_through(partition, mesh, cluster, path)?;
            let faces = pieces.iter().map(|piece| piece.faces.len()).sum();
            return Ok(Remeshed { pieces, degenerate, faces, passed_through: faces, ..Remeshed::default() });
        }
        let mut source = self.load(mesh, partition, cluster)?;
        let mut made = std::mem::take(&mut source.mesh);
        let outcome = cvd::reconstruct(&mut made, settings, frame);
        source.adopt(outcome.points);
        let mut remeshed = Remeshed {
            pieces: Vec::new(),
            faces: made.corners.len() as u64,
            degenerate: source.degenerate,
            doubles: source.doubles,
            cells: outcome.cells,
            held: outcome.held,
            added: outcome.added,
            junctions: outcome.shrunk.junctions,
            kept: outcome.shrunk.kept,
            passed_through: 0,
        };
        if !made.corners.is_empty() {
            let path: &Path = &self.piece_path(step, 0);
            remeshed
                .pieces
                .push(source.write(&made, partition, self.catalogue, &self.texture.scale, None, path)?.commit()?);
        }
        Ok(remeshed)
    }
}

/// Memory in bytes of a cluster while it is remeshed or passed through.
fn remesh_bytes(partition: &Partition, cluster: usize) -> u64 {
    partition.weight(cluster).map_or(PASS_BYTES, |weight| weight.bytes() * cvd::GROWTH / 2)
}

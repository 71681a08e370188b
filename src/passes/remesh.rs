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

use super::cluster_worker::PASS_BYTES;
use super::counters::Counters;
use super::outcome::RemeshReport;
use super::pass_id::Pass;
use super::probes::{LongestSides, Probes, Probing};
use super::run::Run;
use super::steps::PassStep;
use crate::base::Result;
use crate::base::ordered::map_in_order;
use crate::job::{Recalled, folder_bytes};
use crate::lend::LentResults;
use crate::model::{Catalogue, StoredMesh, StoredPiece};
use crate::partition::{ClusterId, ClusterSource, Partition, PieceContent, TextureScale, cluster, heavy, write_shared};
use crate::remesh::cvd::mass::MassSums;
use crate::remesh::cvd::{self, CvdSettings, FrozenStatistics, Stock};

/// Result of both surveys.
#[derive(Serialize, Deserialize)]
struct Surveyed {
    frame: FrozenStatistics,
    /// Probes of the input, if this is the first pass.
    probes: Probes,
}

/// Result of remeshing a cluster.
#[derive(Default, Serialize, Deserialize)]
pub(super) struct RemeshedCluster {
    pub pieces: Vec<StoredPiece>,
    counters: Counters,
    cells: u64,
    held: u64,
    added: u64,
    junctions: u64,
    kept: u64,
}

impl Recalled for Surveyed {
    type Context<'a> = Partition;

    fn is_sound(&self, partition: &Partition) -> bool {
        self.probes.is_empty() || self.probes.fit(partition.total_faces())
    }
}

impl Recalled for RemeshedCluster {
    type Context<'a> = ();

    fn locate(&mut self, folder: &Path, (): &()) {
        self.pieces.iter_mut().for_each(|piece| piece.locate(folder));
    }

    fn is_sound(&self, (): &()) -> bool {
        self.pieces.iter().all(StoredPiece::is_sound)
    }
}

impl RemeshReport {
    fn add(&mut self, cluster: &RemeshedCluster) {
        self.faces_out += cluster.counters.faces_out;
        self.passed_through += cluster.counters.passed_through_faces;
        self.cells += cluster.cells;
        self.held += cluster.held;
        self.added += cluster.added;
        self.junctions += cluster.junctions;
        self.kept += cluster.kept;
    }
}

impl Run<'_> {
    /// Remeshes the clusters of a pass; the result is the mesh of the next one.
    ///
    /// # Errors
    /// On a full disk, failed reads or writes, and damaged files.
    pub fn remesh(&mut self, pass: Pass, settings: &CvdSettings, partition: &Partition) -> Result<()> {
        let started = Instant::now();
        let frame = self.recall_or_find_frame(pass, settings, partition)?;
        self.progress.begin("remesh", partition.total_faces(), "faces");
        let mut report = RemeshReport {
            clusters: partition.filled_count(),
            faces_in: partition.total_faces(),
            wanted: frame.wanted,
            cell_mass: frame.enough,
            threshold: frame.threshold,
            ..RemeshReport::default()
        };
        let (mut mesh, mut counters) = (StoredMesh::default(), Counters::default());
        let of_pass = RemeshPass { number: pass.number as u32, settings, frame: &frame, partition };
        let lent = self.lend_remesh(&of_pass)?;
        let work = |cluster| self.remesh_or_recall(&of_pass, &lent, cluster);
        let threads = self.options.threads;
        map_in_order(partition.clusters(), threads, threads * 4, work, |cluster| {
            report.add(&cluster);
            counters += &cluster.counters;
            mesh.pieces.extend(cluster.pieces);
            Ok(())
        })?;
        write_shared(partition, self.job.path(), &format!("pass-{}", pass.number), &mut mesh)?;
        let state = &mut self.state;
        counters.note_in(&mut state.findings);
        state.findings.count("remesh_kept_vertices", report.kept);
        state.scratch_peak = state.scratch_peak.max(folder_bytes(self.job.path()));
        state.mesh = mesh;
        state.schedule.end_remeshing(settings, report.clusters);
        state.remeshed.push(report);
        state.seconds.remesh += started.elapsed();
        self.record_pass(pass)?;
        self.progress.tell(&format!("remeshed: {} triangles", self.state.mesh.face_count()));
        Ok(())
    }

    /// Returns the statistics that all clusters are remeshed by; keeps the probes taken with them.
    fn recall_or_find_frame(
        &mut self,
        pass: Pass,
        settings: &CvdSettings,
        partition: &Partition,
    ) -> Result<FrozenStatistics> {
        let Surveyed { frame, probes } =
            match self.job.recall::<Surveyed>(&PassStep::stops(pass, 0).key(), partition)? {
                Some(found) => found,
                None => {
                    let found = self.find_frame(pass, settings, partition)?;
                    self.job.keep(PassStep::stops(pass, 0).to_record(), [], &found)?;
                    found
                }
            };
        if !probes.is_empty() {
            self.keep_probes(probes)?;
        }
        Ok(frame)
    }

    fn remesh_or_recall(
        &self,
        pass: &RemeshPass<'_>,
        lent: &LentResults<ClusterId>,
        cluster: ClusterId,
    ) -> Result<RemeshedCluster> {
        self.progress.check_stopped()?;
        let step = PassStep::Cluster { pass: pass.number, attempt: 0, cluster };
        let faces = pass.partition.face_count(cluster);
        let mut is_told = false;
        let remeshed = if let Some(remeshed) = self.job.recall::<RemeshedCluster>(&step.key(), &())? {
            remeshed
        } else if let Some((remeshed, is_known)) = lent.result(self.job.path(), cluster, &())? {
            is_told = is_known;
            remeshed
        } else {
            let _permit = self.permits.take(remesh_bytes(pass.partition, cluster));
            let remeshed = match pass.partition.weight(cluster) {
                None => self.copy_cluster(pass.partition, step, cluster)?,
                Some(_) => self.remesh_cluster(pass, step, cluster)?,
            };
            let files = remeshed.pieces.iter().flat_map(StoredPiece::files);
            self.job.keep(step.to_record().of_size(faces), files, &remeshed)?;
            remeshed
        };
        self.progress.advance(if is_told { 0 } else { faces });
        Ok(remeshed)
    }

    /// Surveys all clusters twice; probes those of the input in the second survey.
    fn find_frame(&self, pass: Pass, settings: &CvdSettings, partition: &Partition) -> Result<Surveyed> {
        self.progress.begin("weigh", 2 * partition.total_faces(), "faces");
        let is_input = pass.number == 0;
        let (mut sums, mut sides) = (MassSums::default(), LongestSides::default());
        let weigh = |source: &ClusterSource, _: ClusterId| {
            let mut own = MassSums::default();
            cvd::weigh(&source.mesh, settings, &mut own);
            (own, if is_input { LongestSides::of(&source.mesh) } else { LongestSides::default() })
        };
        let skip = |_: ClusterId| Ok(Default::default());
        self.survey_clusters(partition, weigh, skip, |(own, own_sides)| {
            sums.merge(&own);
            sides = sides.with(own_sides);
        })?;
        let frame = FrozenStatistics::new(&sums, settings);
        let faces = partition.total_faces();
        // A closed surface has about two faces per cell.
        let target = settings.cells.map_or(self.options.target, |cells| 2 * cells);
        let probing = is_input.then(|| Probing::new(faces, if target > 0 { target } else { faces }, sides.mean_sq()));
        let (mut stock, mut probes) = (Stock::default(), Probes::default());
        let take = |source: &ClusterSource, cluster: ClusterId| {
            let probes = probing.map(|probing| probing.take(&source.mesh, source.origin, cluster));
            (cvd::take_stock(&source.mesh, settings, &frame), probes.unwrap_or_default())
        };
        let take_blocks = |cluster: ClusterId| {
            let probes = probing.map(|probing| self.probe_blocks(&probing, partition, cluster));
            Ok((Stock::default(), probes.transpose()?.unwrap_or_default()))
        };
        self.survey_clusters(partition, take, take_blocks, |(own, own_probes)| {
            stock.merge(&own);
            probes.add(own_probes);
        })?;
        Ok(Surveyed { frame: FrozenStatistics { threshold: stock.threshold(&frame), ..frame }, probes })
    }

    /// Applies `of_loaded` to every cluster that can be loaded and `of_heavy` to the others; passes the results to
    /// `take` in cluster order.
    fn survey_clusters<T: Send>(
        &self,
        partition: &Partition,
        of_loaded: impl Fn(&ClusterSource, ClusterId) -> T + Sync,
        of_heavy: impl Fn(ClusterId) -> Result<T> + Sync,
        mut take: impl FnMut(T),
    ) -> Result<()> {
        let work = |cluster: ClusterId| {
            self.progress.check_stopped()?;
            if partition.weight(cluster).is_none() {
                return of_heavy(cluster);
            }
            let _permit = self.permits.take(remesh_bytes(partition, cluster));
            let source = self.load(partition, cluster)?;
            self.progress.advance(partition.face_count(cluster));
            Ok(of_loaded(&source, cluster))
        };
        let threads = self.options.threads;
        map_in_order(partition.clusters(), threads, threads + 1, work, |own| {
            take(own);
            Ok(())
        })
    }

    /// Writes a cluster that is too heavy to load as it is, in blocks.
    fn copy_cluster(&self, partition: &Partition, step: PassStep, cluster: ClusterId) -> Result<RemeshedCluster> {
        let path = |part| self.piece_path(step, part);
        let (pieces, degenerate_faces) = heavy::pass_through(partition, &self.state.mesh, cluster, path)?;
        let faces = pieces.iter().map(|piece| piece.faces.len()).sum();
        let counters =
            Counters { degenerate_faces, faces_out: faces, passed_through_faces: faces, ..Counters::default() };
        Ok(RemeshedCluster { pieces, counters, ..RemeshedCluster::default() })
    }

    fn remesh_cluster(&self, pass: &RemeshPass<'_>, step: PassStep, cluster: ClusterId) -> Result<RemeshedCluster> {
        let (mut remeshed, content) = self.remesher(pass).remesh(cluster)?;
        if let Some(content) = content {
            remeshed.pieces.push(content.write(&self.piece_path(step, 0))?.commit()?);
        }
        Ok(remeshed)
    }

    /// What the clusters of a pass are remeshed with.
    pub(super) fn remesher<'a>(&'a self, pass: &RemeshPass<'a>) -> Remesher<'a> {
        let RemeshPass { settings, frame, partition, .. } = *pass;
        let (mesh, catalogue, scale) = (&self.state.mesh, self.catalogue, &self.texture.scale);
        Remesher { settings, frame, partition, mesh, catalogue, scale }
    }
}

/// A pass that remeshes, once its statistics are known.
#[derive(Clone, Copy)]
pub(super) struct RemeshPass<'a> {
    pub number: u32,
    pub settings: &'a CvdSettings,
    pub frame: &'a FrozenStatistics,
    pub partition: &'a Partition,
}

/// What clusters are remeshed with.
#[derive(Clone, Copy)]
pub(super) struct Remesher<'a> {
    pub settings: &'a CvdSettings,
    pub frame: &'a FrozenStatistics,
    pub partition: &'a Partition,
    /// The mesh that was partitioned.
    pub mesh: &'a StoredMesh,
    pub catalogue: &'a Catalogue,
    pub scale: &'a TextureScale,
}

impl Remesher<'_> {
    /// Remeshes a cluster; returns it as a piece of the next mesh, unless no face is left.
    ///
    /// # Errors
    /// On failed reads and damaged files.
    pub fn remesh(&self, cluster: ClusterId) -> Result<(RemeshedCluster, Option<PieceContent>)> {
        let mut source = cluster::load(self.partition, self.mesh, self.catalogue, self.scale, cluster)?;
        let mut mesh = std::mem::take(&mut source.mesh);
        let outcome = cvd::reconstruct(&mut mesh, self.settings, self.frame);
        source.adopt(outcome.points);
        let content = if mesh.corners.is_empty() {
            None
        } else {
            Some(source.piece_of(&mesh, self.partition, self.catalogue, self.scale, None)?)
        };
        let counters = Counters {
            faces_out: mesh.corners.len() as u64,
            degenerate_faces: source.degenerate,
            dropped_doubles: source.doubles,
            ..Counters::default()
        };
        let remeshed = RemeshedCluster {
            pieces: Vec::new(),
            counters,
            cells: outcome.cells,
            held: outcome.held,
            added: outcome.added,
            junctions: outcome.shrunk.junctions,
            kept: outcome.shrunk.kept,
        };
        Ok((remeshed, content))
    }
}

/// Memory in bytes of a cluster while it is remeshed or passed through.
pub(super) fn remesh_bytes(partition: &Partition, cluster: ClusterId) -> u64 {
    partition.weight(cluster).map_or(PASS_BYTES, |weight| weight.bytes() * cvd::GROWTH / 2)
}

//! Passes over a stored mesh until the target is met, or nothing more can be done.

use std::path::{Path, PathBuf};
use std::time::Instant;

use super::outcome::{Floor, PassReport, PassSeconds, Passes, StageSums};
use super::sample::{self, Survey};
use super::stops::{Plan, run_plan};
use crate::base::ordered::map_in_order;
use crate::base::{Findings, Permits, Progress, Result};
use crate::cost::census::Census;
use crate::cost::{
    ClassicCost, CurvatureCost, Metric, ObliqueCost, SharpnessCost, SurfaceCost, TerrainCost, Weights, classic,
    curvature, oblique, sharpness, terrain,
};
use crate::mesh::ClusterMesh;
use crate::mesh::pieces;
use crate::partition::weight::ClusterWeight;
use crate::partition::{self, ClusterSource, Partition, PartitionOptions, Shared, TextureScale, cluster};
use crate::remesh;
use crate::simplify::{Engine, Milestone};
use crate::store::{Catalogue, ColumnWriter, Segment, StoredMesh, StoredPiece};

/// Passes beyond those asked for, while they still remove faces.
const EXTRA_PASSES: usize = 12;
/// With a bounded error, passes end when one removes less than this share of the faces.
const BOUNDED_LAST_SHARE: f64 = 0.02;
/// A pass that removes less than this share of the faces has come to the floor.
const FLOOR_SHARE: f64 = 1e-4;

/// Memory of a cluster that passes through: a block of faces, their texture coordinates and the piece being written.
const PASS_BYTES: u64 = 16 << 20;

/// When vertices on seams are locked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SeamPolicy {
    /// In the first pass.
    Stitch,
    /// Never.
    Follow,
    /// Always.
    Lock,
}

/// What a collapse costs: a metric and its settings.
#[derive(Debug, Clone, Copy)]
pub enum Cost {
    /// [`SurfaceCost`].
    Surface(Weights),
    /// [`ClassicCost`].
    Classic(classic::Settings),
    /// [`ObliqueCost`].
    Oblique(oblique::Settings),
    /// [`CurvatureCost`].
    Curvature(curvature::Settings),
    /// [`TerrainCost`].
    Terrain(terrain::Settings),
    /// [`SharpnessCost`].
    Sharpness(sharpness::Settings),
}

impl Cost {
    /// Bytes that the metric keeps for an ordinary face beyond those of every cluster.
    pub fn extra_face_bytes(&self) -> u64 {
        match self {
            Self::Surface(_) => face_bytes::<SurfaceCost>(),
            Self::Classic(_) => face_bytes::<ClassicCost>(),
            Self::Oblique(_) => face_bytes::<ObliqueCost>(),
            Self::Curvature(_) => face_bytes::<CurvatureCost>(),
            Self::Terrain(_) => face_bytes::<TerrainCost>(),
            Self::Sharpness(_) => face_bytes::<SharpnessCost>(),
        }
    }
}

/// Bytes of half a vertex and 0.65 wedges.
fn face_bytes<M: Metric>() -> u64 {
    M::VERTEX_BYTES / 2 + M::WEDGE_BYTES * 65 / 100
}

/// What the passes need to know.
#[derive(Debug, Clone, Copy)]
pub struct PassOptions {
    /// Faces wanted; the fewest that `max_error` allows, if that is given.
    pub target: u64,
    /// Largest distance between result and input, either way, in units of length.
    pub max_error: Option<f64>,
    /// Faces of the input, for the schedule.
    pub input: u64,
    /// Passes.
    pub passes: usize,
    /// Faces of a cluster, about.
    pub cluster_faces: u64,
    /// What a collapse costs.
    pub cost: Cost,
    /// Seams.
    pub seams: SeamPolicy,
    /// Whether open borders are locked.
    pub lock_borders: bool,
    /// Whether pieces smaller than the deviation are dropped after the first pass.
    pub drop_pieces: bool,
    /// Whether vertices among slivers are moved after the last passes.
    pub optimize: bool,
    /// Whether duplicates are welded before the first pass.
    pub weld: bool,
    /// Threads.
    pub threads: usize,
    /// Bytes for clusters in work.
    pub work_bytes: u64,
}

/// What simplifying one cluster gave.
#[derive(Default)]
pub(super) struct ClusterResult {
    pieces: Vec<StoredPiece>,
    passed_through: bool,
    faces_in: u64,
    pub(super) faces: u64,
    cost: f32,
    reached: bool,
    area: f64,
    squared_error: f64,
    milestones: Vec<Milestone>,
    seam_vertices: u64,
    degenerate: u64,
    dropped_pieces: u64,
    optimized: u64,
    dropped_faces: u64,
    floor: Floor,
    pub(super) log: Vec<(f32, u8)>,
    /// A patch for the sample of the next pass.
    patch: Option<ClusterMesh>,
}

/// Areas in space and in texture of the materials that a cluster has.
type MaterialAreas = Vec<(usize, (f64, f64))>;

/// A run of passes.
pub struct Run<'a, M: Metric> {
    pub(super) options: &'a PassOptions,
    settings: M::Settings,
    catalogue: &'a Catalogue,
    folder: &'a Path,
    progress: &'a dyn Progress,
    pub(super) permits: Permits,
    scale: TextureScale,
    /// Diagonal below which pieces are dropped in this pass, if any are.
    crumb: Option<f64>,
}

/// Simplifies a mesh to the target, with the metric that the options name.
///
/// # Errors
/// On a full disk, failed reads and writes, and damaged files.
pub fn simplify(
    mesh: StoredMesh,
    options: &PassOptions,
    catalogue: &Catalogue,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<Passes> {
    match options.cost {
        Cost::Surface(weights) => Run::<SurfaceCost>::new(options, weights, catalogue, folder, progress).simplify(mesh),
        Cost::Classic(settings) => {
            Run::<ClassicCost>::new(options, settings, catalogue, folder, progress).simplify(mesh)
        }
        Cost::Oblique(settings) => {
            Run::<ObliqueCost>::new(options, settings, catalogue, folder, progress).simplify(mesh)
        }
        Cost::Curvature(settings) => {
            Run::<CurvatureCost>::new(options, settings, catalogue, folder, progress).simplify(mesh)
        }
        Cost::Terrain(settings) => {
            Run::<TerrainCost>::new(options, settings, catalogue, folder, progress).simplify(mesh)
        }
        Cost::Sharpness(settings) => {
            Run::<SharpnessCost>::new(options, settings, catalogue, folder, progress).simplify(mesh)
        }
    }
}

impl<'a, M: Metric> Run<'a, M> {
    /// Prepares; files go to `folder`.
    fn new(
        options: &'a PassOptions,
        settings: M::Settings,
        catalogue: &'a Catalogue,
        folder: &'a Path,
        progress: &'a dyn Progress,
    ) -> Self {
        let permits = Permits::new(options.work_bytes);
        Self {
            options,
            settings,
            catalogue,
            folder,
            progress,
            permits,
            scale: TextureScale::none(catalogue),
            crumb: None,
        }
    }

    /// Simplifies a mesh to the target.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes, and damaged files.
    fn simplify(mut self, mut mesh: StoredMesh) -> Result<Passes> {
        let mut findings = Findings::default();
        let mut reports: Vec<PassReport> = Vec::new();
        let mut seconds = PassSeconds::default();
        let mut squared_error = 0.0;
        let target = self.options.target;
        let (mut reached, mut floor) = (false, Floor::default());
        let mut sample = ClusterMesh::default();
        let (mut stuck, mut scratch_peak, mut passed_through) = (0, 0, 0);
        for pass in 0..self.options.passes + EXTRA_PASSES {
            let started = Instant::now();
            let partition = self.partition(&mesh, pass, &mut findings)?;
            seconds.partition += started.elapsed();
            let started = Instant::now();
            let faces_in = partition.total_faces();
            if pass == 0 {
                sample = match M::reads_texture(&self.settings) {
                    true => self.measure_texture(&mesh, &partition)?,
                    false if is_single(&partition) => ClusterMesh::default(),
                    false => self.take_sample(&mesh, &partition)?,
                };
                if M::HAS_CENSUS {
                    self.take_census(&mesh, &partition)?;
                }
            }
            let is_last = pass + 1 >= self.options.passes;
            let (plan, is_exact) =
                self.plan(&mesh, &partition, std::mem::take(&mut sample), pass, is_last, faces_in)?;
            let mut outcome = self.run_pass(&mesh, &partition, pass, &plan)?;
            if let Plan::Costs(costs) = &plan
                && is_last
                && outcome.report.faces_out < target
            {
                // The sample was no picture of the whole: the same thresholds again, but stopped at the target.
                let plan = self.trim_stages(&mesh, &partition, pass, costs)?;
                remove_mesh(std::mem::take(&mut outcome.mesh));
                outcome = self.run_pass(&mesh, &partition, pass, &plan)?;
            }
            sample = outcome.sample;
            let single = is_single(&partition);
            outcome.report.stages = outcome.stages.reports(squared_error);
            squared_error += outcome.squared_error;
            findings.count("degenerate_faces", outcome.degenerate);
            findings.count("dropped_pieces", outcome.dropped_pieces);
            findings.count("optimized_vertices", outcome.optimized);
            findings.count("dropped_piece_faces", outcome.dropped_faces);
            if self.options.drop_pieces {
                self.crumb = Some(self.options.max_error.unwrap_or(squared_error.sqrt()));
            }
            reports.push(outcome.report.clone());
            floor = outcome.floor;
            passed_through = outcome.passed_through;
            let next_faces = outcome.report.faces_out;
            scratch_peak = scratch_peak.max(folder_bytes(self.folder));
            remove_mesh(std::mem::replace(&mut mesh, outcome.mesh));
            partition.remove();
            *(if pass == 0 { &mut seconds.simplify } else { &mut seconds.stitch }) += started.elapsed();
            let gained = faces_in - next_faces;
            if self.options.max_error.is_some() {
                reached = is_last && (single || (gained as f64) < faces_in as f64 * BOUNDED_LAST_SHARE);
                if reached {
                    break;
                }
                continue;
            }
            if is_last && next_faces <= target {
                reached = true;
                break;
            }
            stuck = if gained as f64 <= faces_in as f64 * FLOOR_SHARE { stuck + 1 } else { 0 };
            // In one cluster nothing was locked; in many, what was locked in one pass is free in the next.
            if is_last && (stuck > 2 || (single && stuck > 0)) && !is_exact_left(is_exact, gained) {
                break;
            }
        }
        let faces = mesh.face_count();
        findings.count("passed_through_faces", passed_through);
        Ok(Passes {
            mesh,
            reports,
            findings,
            seconds,
            rms_estimate: squared_error.sqrt(),
            faces,
            reached,
            floor,
            scratch_peak,
            permit_peak: self.permits.peak(),
        })
    }

    fn partition(&self, mesh: &StoredMesh, pass: usize, findings: &mut Findings) -> Result<Partition> {
        let options = PartitionOptions {
            cluster_faces: self.options.cluster_faces,
            pass,
            weld: self.options.weld && pass == 0,
            threads: self.options.threads,
            work_bytes: self.options.work_bytes,
        };
        self.progress.begin("partition", 0, "");
        let mut partition = partition::partition(mesh, self.catalogue, self.folder, &format!("pass-{pass}"), &options)?;
        findings.merge(std::mem::take(&mut partition.findings));
        Ok(partition)
    }

    fn run_pass(&self, mesh: &StoredMesh, partition: &Partition, pass: usize, plan: &Plan) -> Result<PassOutcome> {
        let phase = if pass == 0 { "simplify" } else { "stitch" };
        self.progress.begin(phase, partition.total_faces(), "faces");
        let mut outcome = PassOutcome::default();
        outcome.report.clusters =
            (0..partition.cluster_count()).filter(|&c| partition.face_count(c) > 0).count() as u64;
        outcome.report.faces_in = partition.total_faces();
        outcome.report.border_vertices = u64::from(partition.faces.shared.len());
        let (mut area, mut error, mut stages) = (0.0, 0.0, StageSums::default());
        let survey = self.survey(partition);
        let mut sample = ClusterMesh::default();
        let mut pieces = Vec::new();
        outcome.reached = true;
        let PassOutcome {
            report,
            floor,
            degenerate,
            reached,
            passed_through,
            dropped_pieces,
            dropped_faces,
            optimized,
            ..
        } = &mut outcome;
        self.each_cluster(mesh, partition, pass, plan, Some(&survey), |result| {
            report.faces_out += result.faces;
            report.threshold = report.threshold.max(f64::from(result.cost));
            report.seam_vertices += result.seam_vertices;
            area += result.area;
            stages.add(result.faces_in, result.area, &result.milestones);
            error += result.area * result.squared_error;
            *degenerate += result.degenerate;
            *dropped_pieces += result.dropped_pieces;
            *optimized += result.optimized;
            *dropped_faces += result.dropped_faces;
            *reached &= result.reached;
            floor.add(&result.floor);
            if result.passed_through {
                *passed_through += result.faces;
            }
            result.patch.iter().for_each(|patch| sample::append(&mut sample, patch));
            pieces.extend(result.pieces);
            Ok(())
        })?;
        outcome.squared_error = if area > 0.0 { error / area } else { 0.0 };
        outcome.stages = stages;
        outcome.mesh.pieces = pieces;
        outcome.sample = sample;
        self.write_shared(partition, pass, &mut outcome.mesh)?;
        Ok(outcome)
    }

    /// Loads, simplifies and (if `keep`) writes every cluster that has faces; results come in order of clusters.
    pub(super) fn each_cluster(
        &self,
        mesh: &StoredMesh,
        partition: &Partition,
        pass: usize,
        plan: &Plan,
        keep: Option<&Survey>,
        commit: impl FnMut(ClusterResult) -> Result<()>,
    ) -> Result<()> {
        let work = |cluster: usize| {
            let faces = partition.face_count(cluster);
            let _permit = self.permits.take(self.cluster_bytes(partition, cluster));
            let result = self.simplify_cluster(mesh, partition, pass, plan, keep, cluster);
            if keep.is_some() {
                self.progress.advance(faces);
            }
            result
        };
        map_in_order(0..partition.cluster_count(), self.options.threads, self.options.threads * 4, work, commit)
    }

    fn simplify_cluster(
        &self,
        mesh: &StoredMesh,
        partition: &Partition,
        pass: usize,
        plan: &Plan,
        keep: Option<&Survey>,
        cluster: usize,
    ) -> Result<ClusterResult> {
        if partition.weight(cluster).is_none() {
            return self.pass_through(mesh, partition, pass, keep, cluster);
        }
        let mut source = self.load(mesh, partition, cluster)?;
        let (dropped_pieces, dropped_faces) = match self.crumb {
            Some(diagonal) => pieces::drop_small(&mut source.mesh, diagonal),
            None => (0, 0),
        };
        let mut engine = self.engine(std::mem::take(&mut source.mesh), pass);
        let faces_in = engine.mesh.face_count as u64;
        let (cost, reached) = run_plan(&mut engine, plan, cluster);
        let mut result = ClusterResult {
            pieces: Vec::new(),
            passed_through: false,
            faces_in,
            faces: engine.mesh.face_count as u64,
            cost,
            reached,
            area: engine.area(),
            squared_error: engine.squared_error,
            milestones: std::mem::take(&mut engine.milestones),
            seam_vertices: engine.seam_vertices,
            degenerate: source.degenerate,
            dropped_pieces,
            optimized: 0,
            dropped_faces,
            floor: Floor::of(&engine),
            log: engine.log.take().unwrap_or_default(),
            patch: None,
        };
        if let Some(keep) = keep {
            result.log = Vec::new();
            let path = self.piece_path(pass, cluster, 0);
            let mut simplified = engine.finish();
            if self.options.optimize && pass + 1 >= self.options.passes {
                result.optimized = remesh::relax(&mut simplified);
            }
            result.patch = keep.patch(cluster, &simplified);
            if !simplified.corners.is_empty() {
                result.pieces.push(source.write(&simplified, partition, self.catalogue, &self.scale, &path)?);
            }
        }
        Ok(result)
    }

    /// Memory of a cluster while it is in work, or while it passes through.
    pub(super) fn cluster_bytes(&self, partition: &Partition, cluster: usize) -> u64 {
        let weigh =
            |weight: ClusterWeight| weight.bytes() + weight.vertices * M::VERTEX_BYTES + weight.wedges * M::WEDGE_BYTES;
        partition.weight(cluster).map_or(PASS_BYTES, weigh)
    }

    fn pass_through(
        &self,
        mesh: &StoredMesh,
        partition: &Partition,
        pass: usize,
        keep: Option<&Survey>,
        cluster: usize,
    ) -> Result<ClusterResult> {
        let faces = partition.face_count(cluster);
        let unchanged = ClusterResult { faces, passed_through: true, reached: true, ..ClusterResult::default() };
        if keep.is_none() {
            return Ok(unchanged);
        }
        let path = |part| self.piece_path(pass, cluster, part);
        let (pieces, degenerate) = cluster::pass_through(partition, mesh, cluster, path)?;
        let faces = pieces.iter().map(|piece| piece.faces.len()).sum();
        Ok(ClusterResult { pieces, degenerate, faces_in: faces, faces, ..unchanged })
    }

    pub(super) fn engine(&self, mesh: ClusterMesh, pass: usize) -> Engine<M> {
        let mut engine = Engine::new(mesh, &self.settings);
        engine.lock_borders = self.options.lock_borders;
        engine.lock_seams = match self.options.seams {
            SeamPolicy::Stitch => pass == 0 && self.options.passes > 1,
            SeamPolicy::Follow => false,
            SeamPolicy::Lock => true,
        };
        engine
    }

    pub(super) fn load(&self, mesh: &StoredMesh, partition: &Partition, cluster: usize) -> Result<ClusterSource> {
        cluster::load(partition, mesh, self.catalogue, &self.scale, cluster)
    }

    /// Sums areas in space and in texture over all clusters, in order, for the scale of texture coordinates; returns a
    /// sample of the clusters.
    fn measure_texture(&mut self, mesh: &StoredMesh, partition: &Partition) -> Result<ClusterMesh> {
        let mut areas = vec![(0.0, 0.0); self.catalogue.materials.len() + 1];
        let survey = self.survey(partition);
        let mut sample = ClusterMesh::default();
        let this = &*self;
        map_in_order(
            0..partition.cluster_count(),
            self.options.threads,
            self.options.threads + 1,
            |cluster| {
                if partition.weight(cluster).is_none() {
                    return Ok((Vec::new(), None));
                }
                let _permit = this.permits.take(this.cluster_bytes(partition, cluster) / 2);
                let source = this.load(mesh, partition, cluster)?;
                let mut areas = vec![(0.0, 0.0); this.catalogue.materials.len() + 1];
                source.add_areas(this.catalogue, &mut areas);
                let sparse = areas.into_iter().enumerate().filter(|(_, area)| area.0 > 0.0 || area.1 > 0.0);
                let is_needed = !is_single(partition);
                Ok((sparse.collect(), survey.patch(cluster, &source.mesh).filter(|_| is_needed)))
            },
            |(sums, patch): (MaterialAreas, Option<ClusterMesh>)| {
                for (material, (space, texture)) in sums {
                    areas[material].0 += space;
                    areas[material].1 += texture;
                }
                patch.iter().for_each(|patch| sample::append(&mut sample, patch));
                Ok(())
            },
        )?;
        if !M::wants_raw_texture(&self.settings) {
            self.scale = TextureScale::new(&areas);
        }
        sample::scale_texture(&mut sample, |part| self.scale.of(self.catalogue, part));
        Ok(sample)
    }

    /// Counts the numbers of the whole mesh that the metric divides by, and freezes them.
    fn take_census(&mut self, mesh: &StoredMesh, partition: &Partition) -> Result<()> {
        let mut census = Census::default();
        let this = &*self;
        map_in_order(
            0..partition.cluster_count(),
            self.options.threads,
            self.options.threads + 1,
            |cluster| {
                let mut counted = Census::default();
                if partition.weight(cluster).is_none() {
                    return Ok(counted);
                }
                let _permit = this.permits.take(this.cluster_bytes(partition, cluster));
                let source = this.load(mesh, partition, cluster)?;
                source.mesh.positions.iter().for_each(|p| counted.enclose(source.origin + *p));
                Engine::<M>::count(source.mesh, &this.settings, &mut counted);
                Ok(counted)
            },
            |counted| {
                census.merge(&counted);
                Ok(())
            },
        )?;
        M::settle(&mut self.settings, &census);
        Ok(())
    }

    /// Writes the positions (and colours) of the vertices that several pieces use.
    fn write_shared(&self, partition: &Partition, pass: usize, mesh: &mut StoredMesh) -> Result<()> {
        let shared = &partition.faces.shared;
        if shared.is_empty() {
            return Ok(());
        }
        let numbering = &partition.numbering;
        let path = |what: &str| self.folder.join(format!("pass-{pass}-shared-{what}.col"));
        mesh.shared_positions = Some(pick_shared(&numbering.positions, shared, &path("positions"), *b"position")?);
        if let Some(colours) = &numbering.colours {
            mesh.shared_colours = Some(pick_shared(colours, shared, &path("colours"), *b"colour  ")?);
        }
        Ok(())
    }

    fn piece_path(&self, pass: usize, cluster: usize, part: usize) -> PathBuf {
        let part = if part > 0 { format!("-{part}") } else { String::new() };
        self.folder.join(format!("pass-{pass}-cluster-{cluster:06}{part}.piece"))
    }
}

/// Positions that are mapped at once while shared ones are picked.
const SHARED_RECORDS: u64 = 64 << 10;

/// Writes the records of the shared vertices, in order.
fn pick_shared<T: bytemuck::Pod>(
    column: &Segment<T>,
    shared: &Shared,
    path: &Path,
    kind: [u8; 8],
) -> Result<Segment<T>> {
    let mut writer = ColumnWriter::create(path, kind)?;
    for range in column.ranges(SHARED_RECORDS) {
        let window = column.window(range.clone())?;
        let chosen = (range.start..range.end).zip(window.iter()).filter(|(id, _)| shared.contains(*id as u32));
        writer.append(&chosen.map(|(_, record)| *record).collect::<Vec<_>>())?;
    }
    writer.finish()
}

#[derive(Debug, Default)]
struct PassOutcome {
    mesh: StoredMesh,
    /// Patches of the mesh.
    sample: ClusterMesh,
    report: PassReport,
    stages: StageSums,
    squared_error: f64,
    degenerate: u64,
    dropped_pieces: u64,
    optimized: u64,
    dropped_faces: u64,
    passed_through: u64,
    reached: bool,
    floor: Floor,
}

pub(super) fn is_single(partition: &Partition) -> bool {
    (0..partition.cluster_count()).filter(|&cluster| partition.face_count(cluster) > 0).count() <= 1
}

/// Whether an exact plan removed faces and may go on removing in the next pass.
fn is_exact_left(is_exact: bool, gained: u64) -> bool {
    is_exact && gained > 0
}

fn folder_bytes(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.metadata().ok()).map(|meta| meta.len()).sum()
}

/// Removes the files of a mesh that is no longer needed.
pub fn remove_mesh(mesh: StoredMesh) {
    let mut paths: Vec<PathBuf> = Vec::new();
    paths.extend(mesh.shared_positions.iter().map(|s| s.path().to_owned()));
    paths.extend(mesh.shared_colours.iter().map(|s| s.path().to_owned()));
    for piece in &mesh.pieces {
        paths.push(piece.positions.path().to_owned());
        paths.extend(piece.colours.iter().map(|s| s.path().to_owned()));
        paths.push(piece.texcoords.path().to_owned());
        paths.push(piece.faces.path().to_owned());
    }
    paths.dedup();
    for path in paths {
        let _ = std::fs::remove_file(path);
    }
}

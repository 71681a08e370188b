//! Passes over a stored mesh until the target is met, or nothing more can be done.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::sample::{self, Survey};
use super::schedule::{self, pass_target, stage_shares};
use super::trim::Notes;
use crate::base::ordered::map_in_order;
use crate::base::{Findings, Permits, Progress, Result};
use crate::cost::surface::Weights;
use crate::mesh::ClusterMesh;
use crate::mesh::class::Class;
use crate::mesh::pieces;
use crate::partition::weight::ORDINARY_BYTES;
use crate::partition::{self, ClusterSource, Partition, PartitionOptions, TextureScale, cluster};
use crate::simplify::legality::Refusal;
use crate::simplify::{Engine, Stop};
use crate::store::{Catalogue, ColumnWriter, StoredMesh, StoredPiece};

/// A pass in many clusters aims this much above the target; the trim removes the rest over all clusters.
const TRIM_SHARE: f64 = 0.03;
/// The trim takes over when no more than this share above the target is left.
const TRIM_SHARE_MAX: f64 = 0.10;
/// Passes beyond those asked for, while they still remove faces.
const EXTRA_PASSES: usize = 12;
/// With a bounded error, passes end when one removes less than this share of the faces.
const BOUNDED_LAST_SHARE: f64 = 0.02;
/// With a bounded error, stages end when one removes less than this share of the faces.
const BOUNDED_STAGE_SHARE: f64 = 0.02;
/// Share of the allowed error that is used: positions are rounded afterwards.
const BOUND_SAFETY: f64 = 0.98;
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
    /// Weights of the cost.
    pub weights: Weights,
    /// Seams.
    pub seams: SeamPolicy,
    /// Whether open borders are locked.
    pub lock_borders: bool,
    /// Whether pieces smaller than the deviation are dropped after the first pass.
    pub drop_pieces: bool,
    /// Whether duplicates are welded before the first pass.
    pub weld: bool,
    /// Threads.
    pub threads: usize,
    /// Bytes for clusters in work.
    pub work_bytes: u64,
}

/// What one pass did.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct PassReport {
    /// Number of clusters with faces.
    pub clusters: u64,
    /// Faces before.
    pub faces_in: u64,
    /// Faces after.
    pub faces_out: u64,
    /// Highest cost of a collapse, in area × length².
    pub threshold: f64,
    /// Vertices that several clusters use; they were locked.
    pub border_vertices: u64,
    /// Vertices on seams.
    pub seam_vertices: u64,
}

/// Why no more faces could be removed: edges refused in the last pass and vertices that hold still, by cause.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct Floor {
    /// Vertices on open borders.
    pub border: u64,
    /// Vertices on seams and at their corners.
    pub seam: u64,
    /// Refusals by the link condition and by folds.
    pub topology: u64,
    /// Refusals that would have ended a piece.
    pub pieces: u64,
    /// Vertices at non-manifold places.
    pub non_manifold: u64,
}

/// The outcome of all passes.
#[derive(Debug)]
pub struct Passes {
    /// The simplified mesh.
    pub mesh: StoredMesh,
    /// Each pass.
    pub reports: Vec<PassReport>,
    /// What was repaired.
    pub findings: Findings,
    /// Time in partitioning, in the first pass, and in the passes after it.
    pub seconds: PassSeconds,
    /// Estimate of the root of the mean squared deviation, in units of length.
    pub rms_estimate: f64,
    /// Faces of the mesh.
    pub faces: u64,
    /// Whether the target was met.
    pub reached: bool,
    /// What stands in the way, if it was not.
    pub floor: Floor,
    /// Most bytes that the work folder held.
    pub scratch_peak: u64,
    /// Most bytes that clusters in work were granted at once.
    pub permit_peak: u64,
}

/// Time by phase.
#[derive(Debug, Clone, Copy, Default)]
pub struct PassSeconds {
    /// Partitioning.
    pub partition: Duration,
    /// Simplifying in the first pass.
    pub simplify: Duration,
    /// Simplifying in the passes after it.
    pub stitch: Duration,
}

/// What simplifying one cluster gave.
#[derive(Default)]
struct ClusterResult {
    pieces: Vec<StoredPiece>,
    passed_through: bool,
    faces: u64,
    cost: f32,
    reached: bool,
    area: f64,
    squared_error: f64,
    seam_vertices: u64,
    degenerate: u64,
    dropped_pieces: u64,
    dropped_faces: u64,
    floor: Floor,
    log: Vec<(f32, u8)>,
    /// A patch for the sample of the next pass.
    patch: Option<ClusterMesh>,
}

/// How the clusters of a pass are told to stop.
#[derive(Debug, Clone)]
enum Plan {
    /// One cluster: keep these shares of the free faces, stage by stage.
    Shares(Vec<f64>),
    /// One cluster: these shares of the faces, the last one exactly this many.
    Faces(Vec<f64>, u64),
    /// Thresholds, stage by stage.
    Costs(Vec<f32>),
    /// As far as this bound on the deviation allows.
    Deviation(f64),
    /// Thresholds, and each cluster's number of faces, at which the last stage stops.
    Trim(Vec<f32>, Vec<u64>),
}

/// A run of passes.
pub struct Run<'a> {
    options: &'a PassOptions,
    catalogue: &'a Catalogue,
    folder: &'a Path,
    progress: &'a dyn Progress,
    permits: Permits,
    scale: TextureScale,
    /// Diagonal below which pieces are dropped in this pass, if any are.
    crumb: Option<f64>,
}

impl<'a> Run<'a> {
    /// Prepares; files go to `folder`.
    pub fn new(
        options: &'a PassOptions,
        catalogue: &'a Catalogue,
        folder: &'a Path,
        progress: &'a dyn Progress,
    ) -> Self {
        let permits = Permits::new(options.work_bytes);
        Self { options, catalogue, folder, progress, permits, scale: TextureScale::none(catalogue), crumb: None }
    }

    /// Simplifies a mesh to the target.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes, and damaged files.
    pub fn simplify(mut self, mut mesh: StoredMesh) -> Result<Passes> {
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
                sample = match self.options.weights.uv > 0.0 {
                    true => self.measure_texture(&mesh, &partition)?,
                    false if is_single(&partition) => ClusterMesh::default(),
                    false => self.take_sample(&mesh, &partition)?,
                };
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
            squared_error += outcome.squared_error;
            findings.count("degenerate_faces", outcome.degenerate);
            findings.count("dropped_pieces", outcome.dropped_pieces);
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

    /// Chooses how the clusters of a pass stop, and whether that meets the target to the face.
    fn plan(
        &self,
        mesh: &StoredMesh,
        partition: &Partition,
        sample: ClusterMesh,
        pass: usize,
        is_last: bool,
        faces: u64,
    ) -> Result<(Plan, bool)> {
        let options = self.options;
        let wanted = if is_last {
            options.target as f64
        } else {
            pass_target(options.input, options.target, pass, options.passes)
        };
        if let Some(most) = options.max_error {
            let left = options.passes.saturating_sub(pass + 1) as i32;
            return Ok((Plan::Deviation(most * BOUND_SAFETY * libm::pow(0.5, f64::from(left))), false));
        }
        let share = wanted / faces.max(1) as f64;
        if is_single(partition) {
            let shares = stage_shares(share);
            return Ok(match is_last {
                true => (Plan::Faces(shares, options.target), true),
                false => (Plan::Shares(shares), false),
            });
        }
        if is_last && (faces as f64) <= options.target as f64 * (1.0 + TRIM_SHARE_MAX) {
            return Ok((self.plan_trim(mesh, partition, sample, pass, faces)?, true));
        }
        let aim = if is_last { share * (1.0 + TRIM_SHARE) } else { share };
        Ok((Plan::Costs(self.thresholds(sample, pass, &stage_shares(aim))), false))
    }

    /// Thresholds for shares of the faces, from a sample.
    fn thresholds(&self, sample: ClusterMesh, pass: usize, shares: &[f64]) -> Vec<f32> {
        let _permit = self.permits.take(sample.corners.len() as u64 * ORDINARY_BYTES);
        let mut engine = self.engine(sample, pass);
        engine.lock_seams = self.options.seams == SeamPolicy::Lock;
        sample::thresholds(&mut engine, shares)
    }

    fn survey(&self, partition: &Partition) -> Survey {
        let faces_of = |cluster| partition.weight(cluster).map_or(0, |weight| weight.faces);
        Survey::new(&(0..partition.cluster_count()).map(faces_of).collect::<Vec<_>>())
    }

    /// A sample of the clusters as they are before a pass.
    fn take_sample(&self, mesh: &StoredMesh, partition: &Partition) -> Result<ClusterMesh> {
        let survey = self.survey(partition);
        let mut sample = ClusterMesh::default();
        for &cluster in survey.clusters() {
            let _permit = self.permits.take(self.cluster_bytes(partition, cluster));
            let source = self.load(mesh, partition, cluster)?;
            survey.patch(cluster, &source.mesh).iter().for_each(|patch| sample::append(&mut sample, patch));
        }
        Ok(sample)
    }

    /// Simplifies every cluster a little too far and merges what that cost.
    fn plan_trim(
        &self,
        mesh: &StoredMesh,
        partition: &Partition,
        sample: ClusterMesh,
        pass: usize,
        faces: u64,
    ) -> Result<Plan> {
        let excess = faces - self.options.target.min(faces);
        let target = self.options.target as f64;
        let far = (target - (2.0 * excess as f64).min(TRIM_SHARE_MAX * target)).max(1.0) / faces as f64;
        let mut cost = self.thresholds(sample, pass, &[far])[0];
        loop {
            let mut notes = Notes::default();
            let mut cluster = 0;
            let everything = Plan::Costs(vec![cost]);
            self.each_cluster(mesh, partition, pass, &everything, None, |result| {
                notes.add(cluster, &result.log);
                cluster += 1;
                Ok(())
            })?;
            if notes.died() >= excess || cost == f32::INFINITY {
                let (quota, _) = notes.cut(excess, partition.cluster_count());
                let keep =
                    quota.iter().enumerate().map(|(c, lost)| partition.face_count(c).saturating_sub(*lost)).collect();
                return Ok(Plan::Trim(vec![cost], keep));
            }
            cost = if cost > 0.0 && cost < 1e30 { cost * 4.0 } else { f32::INFINITY };
        }
    }

    /// Finds the stage in which thresholds overshoot the target, and where each cluster has to stop in it.
    fn trim_stages(&self, mesh: &StoredMesh, partition: &Partition, pass: usize, costs: &[f32]) -> Result<Plan> {
        let target = self.options.target;
        for stages in (1..=costs.len()).rev() {
            let mut notes = Notes::default();
            let mut left = Vec::new();
            let plan = Plan::Costs(costs[..stages].to_vec());
            self.each_cluster(mesh, partition, pass, &plan, None, |result| {
                notes.add(left.len(), &result.log);
                left.push(result.faces + result.log.iter().map(|&(_, died)| u64::from(died)).sum::<u64>());
                Ok(())
            })?;
            let before: u64 = left.iter().sum();
            if before >= target || stages == 1 {
                let (quota, _) = notes.cut(before.saturating_sub(target), left.len());
                let keep = left.iter().zip(&quota).map(|(faces, lost)| faces - lost).collect();
                return Ok(Plan::Trim(costs[..stages].to_vec(), keep));
            }
        }
        Ok(Plan::Costs(costs.to_vec()))
    }

    fn run_pass(&self, mesh: &StoredMesh, partition: &Partition, pass: usize, plan: &Plan) -> Result<PassOutcome> {
        let phase = if pass == 0 { "simplify" } else { "stitch" };
        self.progress.begin(phase, partition.total_faces(), "faces");
        let mut outcome = PassOutcome::default();
        outcome.report.clusters =
            (0..partition.cluster_count()).filter(|&c| partition.face_count(c) > 0).count() as u64;
        outcome.report.faces_in = partition.total_faces();
        outcome.report.border_vertices = u64::from(partition.faces.shared.len());
        let (mut area, mut error) = (0.0, 0.0);
        let survey = self.survey(partition);
        let mut sample = ClusterMesh::default();
        let mut pieces = Vec::new();
        outcome.reached = true;
        let PassOutcome { report, floor, degenerate, reached, passed_through, dropped_pieces, dropped_faces, .. } =
            &mut outcome;
        self.each_cluster(mesh, partition, pass, plan, Some(&survey), |result| {
            report.faces_out += result.faces;
            report.threshold = report.threshold.max(f64::from(result.cost));
            report.seam_vertices += result.seam_vertices;
            area += result.area;
            error += result.area * result.squared_error;
            *degenerate += result.degenerate;
            *dropped_pieces += result.dropped_pieces;
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
        outcome.mesh.pieces = pieces;
        outcome.sample = sample;
        self.write_shared(partition, pass, &mut outcome.mesh)?;
        Ok(outcome)
    }

    /// Loads, simplifies and (if `keep`) writes every cluster that has faces; results come in order of clusters.
    fn each_cluster(
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
        let (cost, reached) = run_plan(&mut engine, plan, cluster);
        let mut result = ClusterResult {
            pieces: Vec::new(),
            passed_through: false,
            faces: engine.mesh.face_count as u64,
            cost,
            reached,
            area: engine.area(),
            squared_error: engine.squared_error,
            seam_vertices: engine.seam_vertices,
            degenerate: source.degenerate,
            dropped_pieces,
            dropped_faces,
            floor: Floor::of(&engine),
            log: engine.log.take().unwrap_or_default(),
            patch: None,
        };
        if let Some(keep) = keep {
            result.log = Vec::new();
            let path = self.piece_path(pass, cluster, 0);
            let simplified = engine.finish();
            result.patch = keep.patch(cluster, &simplified);
            if !simplified.corners.is_empty() {
                result.pieces.push(source.write(&simplified, partition, self.catalogue, &self.scale, &path)?);
            }
        }
        Ok(result)
    }

    /// Memory of a cluster while it is in work, or while it passes through.
    fn cluster_bytes(&self, partition: &Partition, cluster: usize) -> u64 {
        partition.weight(cluster).map_or(PASS_BYTES, |weight| weight.bytes())
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
        Ok(ClusterResult { pieces, degenerate, faces, ..unchanged })
    }

    fn engine(&self, mesh: ClusterMesh, pass: usize) -> Engine {
        let mut engine = Engine::new(mesh, self.options.weights);
        engine.lock_borders = self.options.lock_borders;
        engine.lock_seams = match self.options.seams {
            SeamPolicy::Stitch => pass == 0 && self.options.passes > 1,
            SeamPolicy::Follow => false,
            SeamPolicy::Lock => true,
        };
        engine
    }

    fn load(&self, mesh: &StoredMesh, partition: &Partition, cluster: usize) -> Result<ClusterSource> {
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
            |(sums, patch): (Vec<(usize, (f64, f64))>, Option<ClusterMesh>)| {
                for (material, (space, texture)) in sums {
                    areas[material].0 += space;
                    areas[material].1 += texture;
                }
                patch.iter().for_each(|patch| sample::append(&mut sample, patch));
                Ok(())
            },
        )?;
        self.scale = TextureScale::new(&areas);
        sample::scale_texture(&mut sample, |part| self.scale.of(self.catalogue, part));
        Ok(sample)
    }

    /// Writes the positions (and colours) of the vertices that several pieces use.
    fn write_shared(&self, partition: &Partition, pass: usize, mesh: &mut StoredMesh) -> Result<()> {
        let shared = &partition.faces.shared;
        if shared.is_empty() {
            return Ok(());
        }
        let numbering = &partition.numbering;
        let path = |what: &str| self.folder.join(format!("pass-{pass}-shared-{what}.col"));
        let mut positions = ColumnWriter::create(&path("positions"), *b"position")?;
        for range in numbering.positions.ranges(SHARED_RECORDS) {
            let window = numbering.positions.window(range.clone())?;
            let chosen = (range.start..range.end).zip(window.iter()).filter(|(id, _)| shared.contains(*id as u32));
            positions.append(&chosen.map(|(_, p)| *p).collect::<Vec<_>>())?;
        }
        mesh.shared_positions = Some(positions.finish()?);
        if let Some(column) = &numbering.colours {
            let mut colours = ColumnWriter::create(&path("colours"), *b"colour  ")?;
            for range in column.ranges(SHARED_RECORDS) {
                let window = column.window(range.clone())?;
                let chosen = (range.start..range.end).zip(window.iter()).filter(|(id, _)| shared.contains(*id as u32));
                colours.append(&chosen.map(|(_, c)| *c).collect::<Vec<_>>())?;
            }
            mesh.shared_colours = Some(colours.finish()?);
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

#[derive(Debug, Default)]
struct PassOutcome {
    mesh: StoredMesh,
    /// Patches of the mesh.
    sample: ClusterMesh,
    report: PassReport,
    squared_error: f64,
    degenerate: u64,
    dropped_pieces: u64,
    dropped_faces: u64,
    passed_through: u64,
    reached: bool,
    floor: Floor,
}

impl Floor {
    fn of(engine: &Engine) -> Self {
        let classes = engine.class_counts();
        let count = |class: Class| classes[class as usize];
        let refused = |refusal: Refusal| engine.refusals[refusal as usize];
        Self {
            border: count(Class::Border) + count(Class::BorderSeam) + count(Class::BorderCorner),
            seam: count(Class::Seam) + count(Class::Corner),
            topology: refused(Refusal::Topology) + refused(Refusal::Fold) + refused(Refusal::UvFold),
            pieces: refused(Refusal::Piece),
            non_manifold: count(Class::Fixed),
        }
    }

    fn add(&mut self, other: &Floor) {
        self.border += other.border;
        self.seam += other.seam;
        self.topology += other.topology;
        self.pieces += other.pieces;
        self.non_manifold += other.non_manifold;
    }
}

/// Runs the stages of a plan; returns the highest cost of the last stage that did anything, and whether it was reached.
fn run_plan(engine: &mut Engine, plan: &Plan, cluster: usize) -> (f32, bool) {
    let faces = engine.mesh.face_count;
    let stops: Vec<Stop> = match plan {
        Plan::Deviation(most) => return run_bounded(engine, *most),
        Plan::Costs(costs) => costs.iter().map(|&cost| Stop::Cost(cost, 0)).collect(),
        Plan::Trim(costs, keep) => {
            let floor = |i: usize| if i + 1 == costs.len() { keep[cluster] as usize } else { 0 };
            costs.iter().enumerate().map(|(i, &cost)| Stop::Cost(cost, floor(i))).collect()
        }
        Plan::Shares(shares) => {
            let (free, _) = engine.count_free();
            shares.iter().map(|share| Stop::Faces(sample::face_goal(faces, free, *share))).collect()
        }
        Plan::Faces(shares, target) => {
            let (last, before) = shares.split_last().unwrap_or((&1.0, &[]));
            let goal = |share: &f64| ((faces as f64 * share).round() as usize).max(*target as usize);
            let _ = last;
            before.iter().map(|share| Stop::Faces(goal(share))).chain([Stop::Faces(*target as usize)]).collect()
        }
    };
    let (mut cost, mut reached) = (0.0, true);
    for (i, &stop) in stops.iter().enumerate() {
        if i + 1 == stops.len() && matches!(plan, Plan::Costs(_)) {
            engine.log = Some(Vec::new());
        }
        let result = engine.run(stop);
        cost = if result.cost > 0.0 { result.cost } else { cost };
        reached = result.reached;
    }
    (cost, reached)
}

/// Runs stages until the bound on the deviation stops them.
fn run_bounded(engine: &mut Engine, most: f64) -> (f32, bool) {
    engine.bound_deviation(most);
    let mut highest = 0f32;
    loop {
        let before = engine.mesh.face_count;
        let goal = (before as f64 * schedule::STAGE_SHARE) as usize;
        highest = highest.max(engine.run(Stop::Cost(f32::INFINITY, goal)).cost);
        if (before - engine.mesh.face_count) as f64 <= before as f64 * BOUNDED_STAGE_SHARE {
            return (highest, true);
        }
    }
}

fn is_single(partition: &Partition) -> bool {
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

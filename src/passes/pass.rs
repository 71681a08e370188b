//! Runs passes over a stored mesh until the target is met or no further face can be removed.

use std::time::Instant;

use super::cluster_result::Opening;
use super::options::{Cost, PassOptions};
use super::outcome::{PassOutcome, Passes, StageSums};
use super::probes::Probes;
use super::remesh::is_remeshed;
use super::run::{Run, plan_step};
use super::sample;
use super::state::{PassState, Start};
use super::stop_rule::StopRule;
use super::texture_traits::TextureTraits;
use crate::base::ordered::{both, map_in_order};
use crate::base::{Error, Progress, Result, counted};
use crate::cost::census::Census;
use crate::cost::{ClassicCost, CurvatureCost, Metric, ObliqueCost, SharpnessCost, SurfaceCost, TerrainCost};
use crate::job::{Step, WorkFolder, folder_bytes};
use crate::mesh::ClusterMesh;
use crate::model::{Catalogue, StoredMesh};
use crate::os::mmap;
use crate::partition::cells::fits_one;
use crate::partition::{self, Partition, PartitionOptions};
use crate::render::ClusterMap;
use crate::simplify::Engine;

/// Largest number of passes beyond those asked for.
const EXTRA_PASSES: usize = 12;
/// With a bound on the error and no target, the passes end when one removes less than this share of the faces.
const BOUNDED_LAST_SHARE: f64 = 0.02;
/// Threshold of an extra pass, as a factor on the threshold of the pass before it.
const EXTRA_PASS_RISE: f32 = 4.0;
/// An extra pass at that threshold which removes less than this share of the faces is the last: another one would cost
/// far more and remove little.
const WALL_SHARE: f64 = 0.08;
/// A pass that removes at most this share of the faces counts as stuck.
const FLOOR_SHARE: f64 = 1e-4;

/// Simplifies a mesh to the target, or resumes an earlier run, with the metric that the options name.
///
/// # Errors
/// On a full disk, failed reads or writes, and damaged files.
pub fn simplify(
    start: Start,
    options: &PassOptions,
    catalogue: &Catalogue,
    job: &WorkFolder,
    progress: &dyn Progress,
) -> Result<Passes> {
    match options.cost {
        Cost::Surface(weights) => Run::<SurfaceCost>::new(options, weights, catalogue, job, progress).simplify(start),
        Cost::Classic(settings) => Run::<ClassicCost>::new(options, settings, catalogue, job, progress).simplify(start),
        Cost::Oblique(settings) => Run::<ObliqueCost>::new(options, settings, catalogue, job, progress).simplify(start),
        Cost::Curvature(settings) => {
            Run::<CurvatureCost>::new(options, settings, catalogue, job, progress).simplify(start)
        }
        Cost::Terrain(settings) => Run::<TerrainCost>::new(options, settings, catalogue, job, progress).simplify(start),
        Cost::Sharpness(settings) => {
            Run::<SharpnessCost>::new(options, settings, catalogue, job, progress).simplify(start)
        }
    }
}

impl<'a, M: Metric> Run<'a, M> {
    /// Simplifies a mesh to the target, or resumes an earlier run.
    ///
    /// # Errors
    /// On a full disk, failed reads or writes, and damaged files.
    fn simplify(mut self, start: Start) -> Result<Passes> {
        let Start { mut state, mut partition } = start;
        self.crumb = state.crumb;
        if state.pass > 0 {
            self.probes = self
                .job
                .recall_if(Step::Probes, |probes: &mut Probes| probes.is_sound(probes.faces()))?
                .unwrap_or_default();
        }
        if let Some(texture) = &state.texture {
            self.learn(texture.clone());
        }
        if let Some(census) = &state.census {
            M::settle(&mut self.settings, census);
        }
        let target = self.options.target;
        self.lead = state.remeshed.len();
        while !state.is_over && state.pass < self.lead + self.options.passes + EXTRA_PASSES {
            let pass = state.pass;
            self.progress.begin_pass(pass + 1);
            self.noise = state.mesh.rounding_noise();
            let partition = match partition.take() {
                Some(partition) => partition,
                None => self.partition(&mut state)?,
            };
            if let Some(settings) = &self.options.remesh
                && !is_remeshed(settings, &state.remeshed)
            {
                self.reconstruct(settings, &mut state, &partition)?;
                self.lead = state.remeshed.len();
                continue;
            }
            let started = Instant::now();
            let faces_in = partition.total_faces();
            let Opening { plan, is_exact, .. } = self.open_pass(&mut state, &partition)?;
            let steepest = self.steepest(&state);
            let is_last = self.is_last(pass);
            let mut outcome = self.run_plans(&state, &partition, &plan)?;
            let single = partition.is_single();
            let next_faces = outcome.report.faces_out;
            let met_wall = outcome.is_wall;
            state.scratch_peak = state.scratch_peak.max(folder_bytes(self.job.path()));
            let probes = std::mem::take(&mut outcome.probes);
            if !probes.is_empty() {
                self.keep_probes(probes)?;
            }
            state.take(outcome);
            if self.options.drop_pieces {
                self.crumb = Some(state.squared_error.sqrt());
                state.crumb = self.crumb;
            }
            let gained = faces_in.saturating_sub(next_faces);
            if self.options.max_error.is_some() && target == 0 {
                state.reached = is_last && (single || (gained as f64) < faces_in as f64 * BOUNDED_LAST_SHARE);
                state.is_over = state.reached;
            } else {
                state.reached = is_last && next_faces <= target;
                state.stuck = if gained as f64 <= faces_in as f64 * FLOOR_SHARE { state.stuck + 1 } else { 0 };
                // A single cluster has no locked rim, so one stuck pass is final. With several, vertices locked in one
                // pass are free in the next. An exact plan that removed faces may remove more.
                let is_stuck = state.stuck > 2 || (single && state.stuck > 0);
                let is_steep = plan.costs().is_some_and(|costs| costs.iter().copied().reduce(f32::max) == steepest);
                let is_wall = met_wall || (is_steep && (gained as f64) < faces_in as f64 * WALL_SHARE);
                state.is_over = state.reached || is_wall || (is_last && is_stuck && !(is_exact && gained > 0));
                // With both a target and a bound, the one that stops the passes first counts as reached.
                state.reached |= state.is_over && self.options.max_error.is_some();
            }
            *(if self.turn(pass) == 0 { &mut state.seconds.simplify } else { &mut state.seconds.stitch }) +=
                started.elapsed();
            state.pass += 1;
            let step = Step::Pass { pass: pass as u32 };
            self.job.supersede(step, next_faces, state.mesh.files(), &state, &[Step::Input, Step::Probes])?;
            self.progress.tell(&format!("pass {} is done: {}", pass + 1, counted(next_faces, "triangle")));
        }
        mmap::release_freed_memory();
        if partition.is_some() {
            let message = format!("pass {} is partitioned, but the passes end before it", state.pass + 1);
            return Err(Error::Damaged { path: self.job.path().to_owned(), message });
        }
        state.findings.count("passed_through_faces", state.passed_through);
        Ok(Passes {
            faces: state.mesh.face_count(),
            mesh: state.mesh,
            reports: state.reports,
            remeshed: state.remeshed,
            findings: state.findings,
            seconds: state.seconds,
            probes: self.probes,
            seam_crowding: state.texture.map(|texture| texture.crowding).filter(|crowding| crowding.is_finite()),
            changes: state.changes,
            reached: state.reached,
            floor: state.floor,
            scratch_peak: state.scratch_peak,
            permit_peak: self.permits.peak(),
        })
    }

    /// Returns how a partitioned pass begins: as recorded by an earlier process, or computed from the sample.
    fn open_pass(&mut self, state: &mut PassState, partition: &Partition) -> Result<Opening> {
        let (pass, is_first) = (state.pass, self.turn(state.pass) == 0);
        let step = plan_step(pass, 0);
        let is_sound = |opening: &mut Opening| opening.is_sound(partition, self.catalogue);
        let kept = self.job.recall_if(step, is_sound)?;
        self.probing = None;
        if is_first {
            let texture = match &kept {
                Some(opening) => {
                    self.probing = opening.probing;
                    opening.texture.clone()
                }
                None => {
                    let (texture, sample) = self.first_sample(&state.mesh, partition)?;
                    let is_input = pass == 0 && !sample.corners.is_empty();
                    self.probing = is_input.then(|| self.probing_of(partition, &sample));
                    state.sample = sample;
                    texture
                }
            };
            self.learn(texture);
            state.texture = Some(self.texture.clone());
            if M::HAS_CENSUS {
                let census = self.job.once(Step::Census, || self.take_census(&state.mesh, partition))?;
                M::settle(&mut self.settings, &census);
                state.census = Some(census);
            }
        }
        let (sample, thresholds) = (std::mem::take(&mut state.sample), state.thresholds.take());
        if let Some(opening) = kept {
            return Ok(opening);
        }
        // Before the first pass the mesh still contains faces that repeat a vertex.
        let faces = if is_first { partition.total_faces() } else { state.mesh.face_count() };
        let mut thresholds = thresholds.unwrap_or_else(|| self.foresee(sample, pass, faces));
        if let Some(most) = self.steepest(state) {
            thresholds.iter_mut().for_each(|cost| *cost = cost.min(most));
        }
        let (plan, is_exact) = self.plan(&state.mesh, partition, thresholds, pass, faces)?;
        let opening = Opening { plan, is_exact, texture: self.texture.clone(), probing: self.probing };
        self.job.keep(step, 0, [], &opening)?;
        Ok(opening)
    }

    /// Highest allowed threshold of an extra pass; `None` in an ordinary pass, or if the previous pass had no
    /// threshold.
    fn steepest(&self, state: &PassState) -> Option<f32> {
        let before = state.reports.last().map(|pass| pass.threshold as f32).filter(|&cost| cost > 0.0)?;
        (self.turn(state.pass) >= self.options.passes).then_some(before * EXTRA_PASS_RISE)
    }

    /// Partitions the mesh for the next pass. Computes the thresholds of the pass meanwhile, if the previous pass left
    /// a sample.
    fn partition(&self, state: &mut PassState) -> Result<Partition> {
        let started = Instant::now();
        let pass = state.pass;
        let options = PartitionOptions {
            cluster_faces: self.options.cluster_faces,
            pass,
            weld: self.options.weld && pass == 0,
            drop_doubles: self.options.drop_doubles,
            threads: self.options.threads,
            work_bytes: self.options.work_bytes,
        };
        self.progress.begin("partition", 0, "");
        // Return the memory freed by the clusters of the previous pass.
        mmap::release_freed_memory();
        let (mesh, folder) = (&state.mesh, self.job.path());
        let sample = std::mem::take(&mut state.sample);
        // A single cluster needs no threshold.
        let is_sampled = !sample.corners.is_empty() && self.turn(pass) > 0;
        let is_wanted = is_sampled && !fits_one(mesh, self.options.cluster_faces);
        let name = format!("pass-{pass}");
        let cut = || partition::partition(mesh, self.catalogue, folder, &name, &options);
        // The thresholds take one thread, and partitioning leaves one idle at times.
        let foresee = || is_wanted.then(|| self.foresee(sample, pass, mesh.face_count()));
        let fits = sample::fits_beside_cutting(mesh.vertex_count(), self.options.work_bytes);
        let (thresholds, partition) = both(if fits { self.options.threads } else { 1 }, foresee, cut);
        state.thresholds = thresholds;
        let mut partition = partition?;
        mmap::release_freed_memory();
        state.findings.merge(std::mem::take(&mut partition.findings));
        state.scratch_peak = state.scratch_peak.max(partition.scratch_peak);
        state.seconds.partition += started.elapsed();
        let step = Step::Cut { pass: pass as u32 };
        let files = partition.files().chain(partition.files_of(&state.mesh));
        let clusters = partition.filled_count();
        self.job.supersede(step, clusters, files, &(&*state, &partition), &[Step::Input, Step::Probes])?;
        self.progress.tell(&format!("pass {}: {}", pass + 1, counted(clusters, "cluster")));
        Ok(partition)
    }

    pub(super) fn run_pass(
        &self,
        mesh: &StoredMesh,
        partition: &Partition,
        pass: usize,
        plan: &StopRule,
        attempt: u32,
    ) -> Result<PassOutcome> {
        let phase = if self.turn(pass) == 0 { "simplify" } else { "stitch" };
        self.progress.begin(phase, partition.total_faces(), "faces");
        let mut outcome = PassOutcome::default();
        outcome.report.clusters = partition.filled_count();
        outcome.report.faces_in = partition.total_faces();
        outcome.report.border_vertices = u64::from(partition.faces.shared.len());
        let (mut area, mut error, mut stages) = (0.0, 0.0, StageSums::default());
        let survey = self.survey(partition, pass);
        let mut sample = ClusterMesh::default();
        let mut pieces = Vec::new();
        *self.map() = self.options.map.map(ClusterMap::new);
        let PassOutcome {
            report,
            cluster_faces,
            floor,
            degenerate,
            doubles,
            passed_through,
            dropped_pieces,
            dropped_faces,
            changes,
            optimized,
            probes,
            ..
        } = &mut outcome;
        let step = |cluster| Step::Cluster { pass: pass as u32, attempt, cluster };
        self.each_cluster(mesh, partition, (pass, plan), Some(&survey), step, |result| {
            report.faces_out += result.faces;
            cluster_faces.push(result.faces);
            report.threshold = report.threshold.max(f64::from(result.cost));
            report.seam_vertices += result.seam_vertices;
            area += result.area;
            stages.add(result.faces_in, result.area, &result.milestones);
            error += result.area * result.squared_error;
            *degenerate += result.degenerate;
            *doubles += result.doubles;
            *dropped_pieces += result.dropped_pieces;
            *changes += result.changes;
            *optimized += result.optimized;
            *dropped_faces += result.dropped_faces;
            floor.add(&result.floor);
            if result.passed_through {
                *passed_through += result.faces;
            }
            result.patch.iter().for_each(|patch| sample::append(&mut sample, patch));
            result.probes.into_iter().for_each(|of_cluster| probes.add(of_cluster));
            pieces.extend(result.pieces);
            Ok(())
        })?;
        outcome.squared_error = if area > 0.0 { error / area } else { 0.0 };
        outcome.area = area;
        outcome.stages = stages;
        outcome.report.map = self.map().take().and_then(|map| map.to_png());
        outcome.mesh.pieces = pieces;
        outcome.sample = sample;
        self.write_shared(partition, pass, &mut outcome.mesh)?;
        Ok(outcome)
    }

    /// Returns the properties of the texture that the metric reads, and a sample of the clusters of the first pass.
    fn first_sample(&self, mesh: &StoredMesh, partition: &Partition) -> Result<(TextureTraits, ClusterMesh)> {
        let none = || TextureTraits::none(self.catalogue);
        match M::reads_texture(&self.settings) {
            true => self.measure_texture(mesh, partition),
            false if partition.is_single() => Ok((none(), ClusterMesh::default())),
            false => Ok((none(), self.take_sample(mesh, partition)?)),
        }
    }

    /// Sums the global statistics of the mesh that the metric is normalised by.
    fn take_census(&self, mesh: &StoredMesh, partition: &Partition) -> Result<Census> {
        let mut census = Census::default();
        map_in_order(
            0..partition.cluster_count(),
            self.options.threads,
            self.options.threads + 1,
            |cluster| {
                let mut counted = Census::default();
                if partition.weight(cluster).is_none() {
                    return Ok(counted);
                }
                self.progress.check_stopped()?;
                let _permit = self.permits.take(self.cluster_bytes(partition, cluster));
                let source = self.load(mesh, partition, cluster)?;
                source.mesh.positions.iter().for_each(|p| counted.enclose(source.origin + *p));
                Engine::<M>::count(source.mesh, &self.settings, &mut counted);
                Ok(counted)
            },
            |counted| {
                census.merge(&counted);
                Ok(())
            },
        )?;
        Ok(census)
    }
}

//! One pass that collapses edges: partition, choose where the clusters stop, simplify them, decide what follows.

use std::time::Instant;

use super::cluster_task::probing_of;
use super::clusters::Sweep;
use super::pass_id::Pass;
use super::records::{ClusterResult, PassSetup};
use super::run::Run;
use super::sample;
use super::schedule::PassEnd;
use super::steps::{PROBES, PassStep, STATISTICS};
use super::stop_rule::StopRule;
use super::sweep_plan::SweepOutput;
use super::sweep_result::SweepResult;
use super::texture_traits::TextureTraits;
use crate::base::ordered::{both, map_in_order};
use crate::base::{Result, counted};
use crate::cost::mesh_stats::MeshStats;
use crate::job::{Step, StepKey, folder_bytes};
use crate::mesh::ClusterMesh;
use crate::os::mmap;
use crate::partition::cells::fits_one;
use crate::partition::{self, ClusterId, Partition, PartitionOptions, write_shared};
use crate::read::INPUT;

/// Threshold of an extra pass, as a factor on the threshold of the pass before it.
const EXTRA_PASS_RISE: f32 = 4.0;

/// Where the clusters of a pass stop.
#[derive(Debug)]
pub struct Stops {
    pub(super) rule: StopRule,
    /// Whether they meet the target to the face.
    is_exact: bool,
    /// Highest threshold allowed; `None` if any is.
    steepest: Option<f32>,
}

impl Run<'_> {
    /// Partitions the mesh for a pass, or returns the partition that an earlier process recorded. Computes the
    /// thresholds of the pass meanwhile, if the previous pass left a sample.
    ///
    /// # Errors
    /// On a full disk, failed reads or writes, and damaged files.
    pub fn partition(&mut self, pass: Pass) -> Result<Partition> {
        if let Some(partition) = self.recalled.take() {
            return Ok(partition);
        }
        let started = Instant::now();
        let options = PartitionOptions {
            cluster_faces: self.options.cluster_faces,
            pass: pass.number,
            weld: self.options.weld && pass.number == 0,
            drop_doubles: self.options.drop_doubles,
            drop_texcoords: self.options.drop_texcoords && pass.number == 0,
            threads: self.options.threads,
            work_bytes: self.options.work_bytes,
        };
        self.progress.begin("partition", 0, "");
        // Return the memory freed by the clusters of the previous pass.
        mmap::release_freed_memory();
        let sample = std::mem::take(&mut self.state.sample);
        let (mesh, folder) = (&self.state.mesh, self.job.path());
        // A single cluster needs no threshold.
        let is_sampled = !sample.corners.is_empty() && !pass.is_first_turn();
        let is_wanted = is_sampled && !fits_one(mesh, self.options.cluster_faces);
        let name = format!("pass-{}", pass.number);
        let cut = || partition::partition(mesh, self.catalogue, folder, &name, &options);
        // The thresholds take one thread, and partitioning leaves one idle at times.
        let sample_costs = || is_wanted.then(|| self.sample_thresholds(sample, pass, mesh.face_count()));
        let fits = sample::fits_beside_cutting(mesh.vertex_count(), self.options.work_bytes);
        let (thresholds, partition) = both(if fits { self.options.threads } else { 1 }, sample_costs, cut);
        let mut partition = partition?;
        self.state.thresholds = thresholds;
        mmap::release_freed_memory();
        self.state.findings.merge(std::mem::take(&mut partition.findings));
        self.state.scratch_peak = self.state.scratch_peak.max(partition.scratch_peak);
        self.state.seconds.partition += started.elapsed();
        let files = partition.files().chain(partition.files_of(&self.state.mesh));
        let clusters = partition.filled_count();
        let step = PassStep::partition(pass).to_record().of_size(clusters);
        self.job.supersede(step, files, &(&self.state, &partition), &self.kept_steps())?;
        self.progress.tell(&format!("pass {}: {}", pass.number + 1, counted(clusters, "cluster")));
        Ok(partition)
    }

    /// Chooses where the clusters of a pass stop: as recorded by an earlier process, or computed from the sample.
    ///
    /// # Errors
    /// On a full disk, failed reads or writes, and damaged files.
    pub fn choose_stops(&mut self, pass: Pass, partition: &Partition) -> Result<Stops> {
        let started = Instant::now();
        let step = PassStep::stops(pass, 0);
        let recorded = self.job.recall::<PassSetup>(&step.key(), &(partition, self.catalogue))?;
        self.probing = None;
        let mut left_within_bound = None;
        if pass.is_first_turn() {
            self.study_input(pass, partition, recorded.as_ref())?;
            left_within_bound = match &recorded {
                Some(setup) => setup.left_within_bound,
                None => self.left_within_bound(partition, pass)?,
            };
            if let Some(left) = left_within_bound {
                self.state.schedule.choose_lead(left, partition.is_single(), self.options);
            }
        }
        let (sample, thresholds) = (std::mem::take(&mut self.state.sample), self.state.thresholds.take());
        let steepest = self.steepest(pass);
        let setup = match recorded {
            Some(setup) => setup,
            None => {
                // Before the first pass the mesh still contains faces that repeat a vertex.
                let is_input = pass.is_first_turn();
                let faces = if is_input { partition.total_faces() } else { self.state.mesh.face_count() };
                let mut thresholds = thresholds.unwrap_or_else(|| self.sample_thresholds(sample, pass, faces));
                if let Some(most) = steepest {
                    thresholds.iter_mut().for_each(|cost| *cost = cost.min(most));
                }
                let (stops, is_exact) = self.plan(partition, thresholds, pass, faces)?;
                let texture = self.texture.clone();
                let setup = PassSetup { stops, is_exact, texture, probing: self.probing, left_within_bound };
                self.job.keep(step.to_record(), [], &setup)?;
                setup
            }
        };
        self.state.seconds.add(pass, started.elapsed());
        Ok(Stops { rule: setup.stops, is_exact: setup.is_exact, steepest })
    }

    /// Learns from the mesh before its first edge collapses what the metric needs of it as a whole, takes the sample,
    /// and decides how it is probed.
    fn study_input(&mut self, pass: Pass, partition: &Partition, recorded: Option<&PassSetup>) -> Result<()> {
        let texture = match recorded {
            Some(setup) => {
                self.probing = setup.probing;
                setup.texture.clone()
            }
            None => {
                let (texture, sample) = self.first_sample(partition)?;
                let is_input = pass.number == 0 && !sample.corners.is_empty();
                self.probing = is_input.then(|| probing_of([partition.total_faces(), self.options.target], &sample));
                self.state.sample = sample;
                texture
            }
        };
        self.learn(texture);
        self.state.texture = Some(self.texture.clone());
        if self.engine.needs_statistics() {
            let step = Step::new(STATISTICS).from([PassStep::partition(pass).key()]);
            let stats = self.job.once(step, &(), || self.gather_stats(partition))?;
            self.engine.normalise(&stats);
            self.state.stats = Some(stats);
        }
        Ok(())
    }

    /// Highest allowed threshold of an extra pass; `None` in an ordinary pass, or if the previous pass had no
    /// threshold.
    fn steepest(&self, pass: Pass) -> Option<f32> {
        let before = self.state.reports.last().map(|pass| pass.threshold as f32).filter(|&cost| cost > 0.0)?;
        (pass.turn >= self.options.passes).then_some(before * EXTRA_PASS_RISE)
    }

    /// Simplifies the clusters of a pass; the result is the mesh of the next one.
    ///
    /// # Errors
    /// On a full disk, failed reads or writes, and damaged files.
    pub fn simplify_clusters(&mut self, pass: Pass, partition: &Partition, stops: &Stops) -> Result<()> {
        let started = Instant::now();
        let mut result = self.run_attempts(pass, partition, &stops.rule)?;
        let end = PassEnd {
            faces_in: partition.total_faces(),
            faces_out: result.report.faces_out,
            is_last: self.is_last(pass),
            is_single: partition.is_single(),
            is_exact: stops.is_exact,
            is_steepest: stops.rule.highest_cost().is_some_and(|highest| Some(highest) == stops.steepest),
            met_wall: result.met_wall,
        };
        self.state.scratch_peak = self.state.scratch_peak.max(folder_bytes(self.job.path()));
        let probes = std::mem::take(&mut result.probes);
        if !probes.is_empty() {
            self.keep_probes(probes)?;
        }
        self.state.take(result);
        if self.options.drop_pieces {
            self.state.min_component_diagonal = Some(self.state.squared_error.sqrt());
        }
        self.state.schedule.end_collapsing(end, self.options);
        self.state.seconds.add(pass, started.elapsed());
        self.record_pass(pass)?;
        let faces = counted(end.faces_out, "triangle");
        self.progress.tell(&format!("pass {} is done: {faces}", pass.number + 1));
        Ok(())
    }

    /// Records the mesh after a pass; the files of earlier steps are deleted.
    pub(super) fn record_pass(&self, pass: Pass) -> Result<()> {
        let mesh = &self.state.mesh;
        let step = PassStep::mesh(pass).to_record().of_size(mesh.face_count());
        self.job.supersede(step, mesh.files(), &self.state, &self.kept_steps())
    }

    /// Steps whose files stay although a later one replaces the mesh.
    pub(super) fn kept_steps(&self) -> Vec<StepKey> {
        [&[INPUT, PROBES], self.options.kept_steps, &self.kept].concat()
    }

    /// Simplifies clusters once, up to their stops; returns their results in the same order.
    pub(super) fn attempt(
        &self,
        pass: Pass,
        partition: &Partition,
        stops: &StopRule,
        number: u32,
        clusters: Vec<ClusterId>,
    ) -> Result<Vec<ClusterResult>> {
        let phase = if pass.is_first_turn() { "simplify" } else { "stitch" };
        self.progress.begin(phase, clusters.iter().map(|&cluster| partition.face_count(cluster)).sum(), "faces");
        let output = SweepOutput::Mesh {
            survey: self.survey(partition, pass),
            optimize: self.options.optimize && pass.turn + 1 >= self.options.passes,
        };
        let plan = self.plan_sweep(pass, partition, stops, output);
        let mut results = Vec::with_capacity(clusters.len());
        let sweep = Sweep { pass, partition, clusters, number, plan };
        self.sweep(&sweep, |result| {
            results.push(result);
            Ok(())
        })?;
        Ok(results)
    }

    /// Sums the results of all clusters, and writes the vertices that they share.
    pub(super) fn sum(&self, pass: Pass, partition: &Partition, results: Vec<ClusterResult>) -> Result<SweepResult> {
        let mut sum = SweepResult::default();
        let mut squared_error = 0.0;
        for result in results {
            sum.counters += &result.counters;
            sum.report.threshold = sum.report.threshold.max(f64::from(result.cost));
            sum.stages.add(result.counters.faces_in, result.area, &result.milestones);
            sum.area += result.area;
            squared_error += result.area * result.squared_error;
            result.patch.iter().for_each(|patch| sample::append(&mut sum.sample, patch));
            result.probes.into_iter().for_each(|probes| sum.probes.add(probes));
            sum.mesh.pieces.extend(result.pieces);
        }
        sum.squared_error = if sum.area > 0.0 { squared_error / sum.area } else { 0.0 };
        sum.report.clusters = partition.filled_count();
        sum.report.faces_in = partition.total_faces();
        sum.report.border_vertices = u64::from(partition.faces.shared.len());
        sum.report.faces_out = sum.counters.faces_out;
        sum.report.seam_vertices = sum.counters.seam_vertices;
        sum.report.map = self.map().take().and_then(|map| map.to_png());
        write_shared(partition, self.job.path(), &format!("pass-{}", pass.number), &mut sum.mesh)?;
        Ok(sum)
    }

    /// Returns the properties of the texture that the metric reads, and a sample of the clusters of the first pass.
    fn first_sample(&self, partition: &Partition) -> Result<(TextureTraits, ClusterMesh)> {
        if self.engine.reads_texture() {
            return self.measure_texture(partition);
        }
        let sample = if partition.is_single() { ClusterMesh::default() } else { self.take_sample(partition)? };
        Ok((TextureTraits::none(self.catalogue), sample))
    }

    /// Sums the global statistics of the mesh that the metric is normalised by.
    fn gather_stats(&self, partition: &Partition) -> Result<MeshStats> {
        let mut stats = MeshStats::default();
        let count = |cluster| {
            let mut counted = MeshStats::default();
            if partition.weight(cluster).is_none() {
                return Ok(counted);
            }
            self.progress.check_stopped()?;
            let _permit = self.permits.take(self.cluster_bytes(partition, cluster));
            let source = self.load(partition, cluster)?;
            source.mesh.positions.iter().for_each(|p| counted.enclose(source.origin + *p));
            self.engine.count(source.mesh, &mut counted);
            Ok(counted)
        };
        let threads = self.options.threads;
        map_in_order(partition.clusters(), threads, threads + 1, count, |counted| {
            stats.merge(&counted);
            Ok(())
        })?;
        Ok(stats)
    }
}

//! The passes of a job under way: what they share, and what they learn on the way.
//!
//! In: a [`ResumePoint`]. Out: the simplified mesh. A caller repeats
//! [`next_pass`](Run::next_pass), [`partition`](Run::partition) and then [`remesh`](Run::remesh), or
//! [`choose_stops`](Run::choose_stops) and [`simplify_clusters`](Run::simplify_clusters), until no pass is left.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};

use super::metric_engine::{EngineRules, MetricEngine};
use super::options::PassOptions;
use super::outcome::Passes;
use super::pass_id::Pass;
use super::probes::{Probes, Probing};
use super::state::{PassState, ResumePoint};
use super::steps::{PROBES, PassStep};
use super::texture_traits::TextureTraits;
use crate::base::{Error, Permits, Progress, Result, lock};
use crate::job::{Step, StepKey, WorkFolder};
use crate::model::{Catalogue, StoredMesh};
use crate::os::mmap;
use crate::partition::{ClusterId, ClusterSource, Partition, cluster};
use crate::render::ClusterMap;

/// The passes of a job under way.
pub struct Run<'a> {
    pub(super) options: &'a PassOptions,
    pub(super) catalogue: &'a Catalogue,
    pub(super) job: &'a WorkFolder,
    pub(super) progress: &'a dyn Progress,
    pub(super) permits: Permits,
    pub(super) engine: Box<dyn MetricEngine>,
    pub(super) state: PassState,
    /// Partition of the pass that an earlier process left unfinished.
    pub(super) recalled: Option<Partition>,
    pub(super) texture: TextureTraits,
    /// How the clusters of the input are probed, in the pass over the input if it has several clusters.
    pub(super) probing: Option<Probing>,
    /// Probes of the input.
    pub(super) probes: Probes,
    /// Deviation caused by rounding alone in the mesh at the start of the pass, in units of length.
    pub(super) noise: f64,
    /// Steps whose files stay, beside those of the options.
    pub(super) kept: Vec<StepKey>,
    /// Map of the current pass, if one is wanted. A worker holds the lock while it draws one cluster.
    pub(super) map: Mutex<Option<ClusterMap>>,
}

impl<'a> Run<'a> {
    /// Begins or resumes the passes of `job`, in whose folder their files are.
    ///
    /// # Errors
    /// On failed reads and damaged files.
    pub fn resume(
        point: ResumePoint,
        options: &'a PassOptions,
        catalogue: &'a Catalogue,
        job: &'a WorkFolder,
        progress: &'a dyn Progress,
    ) -> Result<Self> {
        let ResumePoint { state, partition: recalled } = point;
        let mut probes = Probes::default();
        if state.pass() > 0 {
            probes = job.recall(&PROBES, &())?.unwrap_or_default();
        }
        let mut run = Self {
            options,
            catalogue,
            job,
            progress,
            permits: Permits::new(options.work_bytes),
            engine: options.cost.engine(),
            texture: TextureTraits::none(catalogue),
            recalled,
            probing: None,
            probes,
            noise: 0.0,
            kept: Vec::new(),
            map: Mutex::new(None),
            state,
        };
        if let Some(texture) = run.state.texture.clone() {
            run.learn(texture);
        }
        if let Some(stats) = &run.state.stats {
            run.engine.normalise(stats);
        }
        Ok(run)
    }

    /// Returns the next pass over the clusters; `None` once the target is met or no further face can be removed.
    pub fn next_pass(&mut self) -> Option<Pass> {
        let pass = self.state.schedule.next(self.options)?;
        self.progress.begin_pass(pass.number + 1);
        self.noise = self.state.mesh.rounding_noise();
        Some(pass)
    }

    /// The mesh at the start of the next pass.
    pub fn mesh(&self) -> &StoredMesh {
        &self.state.mesh
    }

    /// Number of passes that are done.
    pub fn passes_done(&self) -> usize {
        self.state.pass()
    }

    /// From now on the files of these steps stay, too, when those of earlier passes go.
    pub fn keep_steps(&mut self, steps: Vec<StepKey>) {
        self.kept = steps;
    }

    /// Returns the simplified mesh, once no pass is left.
    ///
    /// # Errors
    /// [`Error::Damaged`] if the work folder holds the partition of a further pass.
    pub fn finish(self) -> Result<Passes> {
        mmap::release_freed_memory();
        let mut state = self.state;
        if self.recalled.is_some() {
            let message = format!("pass {} is partitioned, but the passes end before it", state.pass() + 1);
            return Err(Error::Damaged { path: self.job.path().to_owned(), message });
        }
        state.findings.count("passed_through_faces", state.passed_through);
        Ok(Passes {
            faces: state.mesh.face_count(),
            step: PassStep::mesh_after(state.pass()),
            mesh: state.mesh,
            reports: state.reports,
            remeshed: state.remeshed,
            findings: state.findings,
            seconds: state.seconds,
            probes: self.probes,
            seam_density: state
                .texture
                .map(|texture| texture.seam_density)
                .filter(|seam_density| seam_density.is_finite()),
            changes: state.changes,
            reached: state.schedule.reached,
            floor: state.floor,
            scratch_peak: state.scratch_peak,
            permit_peak: self.permits.peak(),
        })
    }

    /// Records the probes of the input in the journal and keeps them until the result is measured.
    pub(super) fn keep_probes(&mut self, probes: Probes) -> Result<()> {
        let step = Step::new(PROBES).from([PassStep::Partition { pass: 0 }.key()]);
        self.job.keep(step, [], &probes)?;
        self.probes = probes;
        self.probes.shrink();
        Ok(())
    }

    pub(super) fn learn(&mut self, texture: TextureTraits) {
        self.engine.learn_seam_density(texture.seam_density);
        self.texture = texture;
    }

    /// What the engine may do in a pass.
    pub(super) fn rules(&self, pass: Pass) -> EngineRules {
        self.options.rules(pass, self.aim())
    }

    pub(super) fn load(&self, partition: &Partition, cluster: ClusterId) -> Result<ClusterSource> {
        cluster::load(partition, &self.state.mesh, self.catalogue, &self.texture.scale, cluster)
    }

    pub(super) fn map(&self) -> MutexGuard<'_, Option<ClusterMap>> {
        lock(&self.map)
    }

    /// Path of a piece of a cluster; each step has its own file names.
    pub(super) fn piece_path(&self, step: PassStep, part: usize) -> PathBuf {
        let part = if part > 0 { format!("-{part}") } else { String::new() };
        self.job.path().join(format!("{}{part}.piece", step.key().name()))
    }
}

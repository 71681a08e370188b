//! What the passes of a job share: its options, its metric, its budget, and what they learn on the way.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};

use super::options::{PassOptions, SeamPolicy};
use super::probes::{Probes, Probing};
use super::texture_traits::TextureTraits;
use crate::base::{Permits, Progress, Result};
use crate::cost::Metric;
use crate::job::{Step, WorkFolder};
use crate::mesh::ClusterMesh;
use crate::model::{Catalogue, StoredMesh};
use crate::partition::{ClusterSource, Partition, cluster};
use crate::render::ClusterMap;
use crate::simplify::Engine;

/// A run of all passes.
pub struct Run<'a, M: Metric> {
    pub(super) options: &'a PassOptions,
    pub(super) settings: M::Settings,
    pub(super) catalogue: &'a Catalogue,
    pub(super) job: &'a WorkFolder,
    pub(super) progress: &'a dyn Progress,
    pub(super) permits: Permits,
    pub(super) texture: TextureTraits,
    /// How the clusters of the input are probed, in the pass over the input if it has several clusters.
    pub(super) probing: Option<Probing>,
    /// Probes of the input.
    pub(super) probes: Probes,
    /// Number of remeshing passes, which come first.
    pub(super) lead: usize,
    /// Bounding-box diagonal below which connected components are dropped in this pass, in units of length; `None` for
    /// none.
    pub(super) crumb: Option<f64>,
    /// Deviation caused by rounding alone in the mesh at the start of the pass, in units of length.
    pub(super) noise: f64,
    /// Map of the current pass, if one is wanted. A worker holds the lock while it draws one cluster.
    pub(super) map: Mutex<Option<ClusterMap>>,
}

impl<'a, M: Metric> Run<'a, M> {
    /// Prepares a run whose files go to the folder of `job` and whose finished steps go to its journal.
    pub(super) fn new(
        options: &'a PassOptions,
        settings: M::Settings,
        catalogue: &'a Catalogue,
        job: &'a WorkFolder,
        progress: &'a dyn Progress,
    ) -> Self {
        let permits = Permits::new(options.work_bytes);
        Self {
            options,
            settings,
            catalogue,
            job,
            progress,
            permits,
            texture: TextureTraits::none(catalogue),
            probing: None,
            probes: Probes::default(),
            lead: 0,
            crumb: None,
            noise: 0.0,
            map: Mutex::new(None),
        }
    }

    /// Records the probes of the input in the journal and keeps them until the result is measured.
    pub(super) fn keep_probes(&mut self, probes: Probes) -> Result<()> {
        self.job.keep(Step::Probes, 0, [], &probes)?;
        self.probes = probes;
        self.probes.shrink();
        Ok(())
    }

    /// Returns how the input is probed; `patch` is a representative part of it.
    pub(super) fn probing_of(&self, partition: &Partition, patch: &ClusterMesh) -> Probing {
        let faces = partition.total_faces();
        Probing::of([faces, if self.options.target > 0 { self.options.target } else { faces }], patch)
    }

    pub(super) fn learn(&mut self, texture: TextureTraits) {
        M::learn_crowding(&mut self.settings, texture.crowding);
        self.texture = texture;
    }

    /// Index of a pass among those that collapse edges.
    pub(super) fn turn(&self, pass: usize) -> usize {
        pass.saturating_sub(self.lead)
    }

    pub(super) fn engine(&self, mesh: ClusterMesh, pass: usize) -> Engine<M> {
        let mut engine = Engine::new(mesh, &self.settings);
        engine.lock_borders = self.options.lock_borders;
        engine.frees_topology = self.options.frees_topology;
        engine.one_by_one = self.options.one_by_one;
        engine.seeks_handles = self.turn(pass) > 0;
        engine.welds = self.options.weld;
        if let Some(most) = self.bound_of(pass) {
            engine.bound_deviation(most);
        }
        engine.lock_seams = match self.options.seams {
            SeamPolicy::Stitch => self.turn(pass) == 0 && self.options.passes > 1,
            SeamPolicy::Follow => false,
            SeamPolicy::Lock => true,
        };
        engine
    }

    pub(super) fn load(&self, mesh: &StoredMesh, partition: &Partition, cluster: usize) -> Result<ClusterSource> {
        cluster::load(partition, mesh, self.catalogue, &self.texture.scale, cluster)
    }

    pub(super) fn map(&self) -> MutexGuard<'_, Option<ClusterMap>> {
        self.map.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Path of a piece of a cluster; each step has its own file names.
    pub(super) fn piece_path(&self, step: Step, part: usize) -> PathBuf {
        let part = if part > 0 { format!("-{part}") } else { String::new() };
        self.job.path().join(format!("{}{part}.piece", step.stem()))
    }
}

pub(super) fn plan_step(pass: usize, attempt: u32) -> Step {
    Step::Plan { pass: pass as u32, attempt }
}

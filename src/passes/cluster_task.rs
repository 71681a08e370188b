//! Work on one cluster as a value.
//!
//! In: a [`ClusterTask`] and the loaded cluster. Out: a [`ClusterResult`] and the simplified mesh. Invariant: the
//! result depends on the task and the cluster alone.

use serde::{Deserialize, Serialize};

use super::counters::Counters;
use super::metric_engine::{EngineRules, MetricEngine};
use super::probes::Probing;
use super::records::ClusterResult;
use super::sample;
use super::stop_rule::{ClusterStop, Wanted};
use crate::mesh::{ClusterMesh, pieces};
use crate::partition::{ClusterId, ClusterSource};
use crate::remesh;

/// What to do to a cluster.
#[derive(Debug, Clone)]
pub(super) struct ClusterTask {
    /// The cluster of its partition.
    pub cluster: ClusterId,
    /// What the engine may do.
    pub rules: EngineRules,
    /// Where it stops.
    pub stop: ClusterStop,
    /// Bounding-box diagonal below which connected components are dropped, in units of length; `None` for none.
    pub min_component_diagonal: Option<f64>,
    /// Faces of all clusters, and faces wanted in the whole mesh.
    pub faces_all: [u64; 2],
    /// Probes to take before anything changes.
    pub probing: ClusterProbing,
    /// What to return of the cluster.
    pub output: TaskOutput,
}

/// Probes to take of a cluster.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) enum ClusterProbing {
    /// None: the cluster is not one of the input.
    None,
    /// As all other clusters of the input.
    As(Probing),
    /// As the cluster itself requires, since it is the whole input.
    Alone,
}

/// What a task returns of its cluster.
#[derive(Debug, Clone, Copy)]
pub(super) enum TaskOutput {
    /// The log of the collapses.
    Log,
    /// The mesh.
    Mesh {
        /// Faces of the patch for the sample of the next pass; `None` for no patch.
        patch_faces: Option<usize>,
        /// Whether vertices beside slivers are relocated.
        optimize: bool,
    },
}

impl ClusterTask {
    /// Simplifies the cluster. Takes the mesh out of `source`, which can then store the simplified one.
    pub fn run(&self, engine: &dyn MetricEngine, source: &mut ClusterSource) -> (ClusterResult, Option<ClusterMesh>) {
        let probing = match self.probing {
            ClusterProbing::None => None,
            ClusterProbing::As(probing) => Some(probing),
            ClusterProbing::Alone => Some(probing_of(self.faces_all, &source.mesh)),
        };
        let probes = probing.map(|probing| probing.take(&source.mesh, source.origin, self.cluster));
        let mut mesh = std::mem::take(&mut source.mesh);
        let faces_before = mesh.face_count;
        let spare_faces = self.spare_faces(faces_before as u64);
        let (dropped_pieces, dropped_piece_faces) = match self.min_component_diagonal {
            Some(diagonal) => pieces::drop_small(&mut mesh, diagonal, spare_faces),
            None => (0, 0),
        };
        let wanted = if matches!(self.output, TaskOutput::Log) { Wanted::Log } else { Wanted::Mesh };
        let stop = self.stop.of_rest(faces_before, mesh.face_count);
        let mut simplified = engine.simplify(mesh, &self.rules, &stop, wanted);
        let mut counters = Counters {
            faces_in: simplified.faces_in,
            faces_out: simplified.faces_out,
            seam_vertices: simplified.seam_vertices,
            degenerate_faces: source.degenerate,
            dropped_doubles: source.doubles,
            dropped_pieces,
            dropped_piece_faces,
            changes: simplified.changes,
            floor: simplified.floor,
            ..Counters::default()
        };
        let mut patch = None;
        if let (TaskOutput::Mesh { patch_faces, optimize }, Some(mesh)) = (self.output, &mut simplified.mesh) {
            if optimize {
                counters.optimized_vertices = remesh::relax(mesh);
            }
            patch = patch_faces.map(|faces| sample::patch(mesh, faces));
        }
        let result = ClusterResult {
            pieces: Vec::new(),
            counters,
            cost: simplified.cost,
            area: simplified.area,
            squared_error: simplified.squared_error,
            milestones: simplified.milestones,
            log: simplified.log,
            patch,
            probes,
        };
        (result, simplified.mesh)
    }

    /// Returns the faces that a cluster of `own` faces may lose before the mesh falls below the target.
    fn spare_faces(&self, own: u64) -> u64 {
        let [all, target] = self.faces_all;
        let spare = all.saturating_sub(target);
        let share = (u128::from(own) * u128::from(spare) / u128::from(all.max(1))) as u64;
        match self.stop {
            ClusterStop::Costs(_, keep) => share.min(own.saturating_sub(keep)),
            _ => share,
        }
    }
}

/// Returns how the input is probed. `faces_all`: its faces, and those wanted, 0 for no target. `patch` is a
/// representative part of it.
pub(super) fn probing_of(faces_all: [u64; 2], patch: &ClusterMesh) -> Probing {
    let [faces, target] = faces_all;
    Probing::of([faces, if target > 0 { target } else { faces }], patch)
}

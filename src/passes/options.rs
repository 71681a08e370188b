//! Options of the passes.

use serde::{Deserialize, Serialize};

use super::goal::{Aim, Lead};
use super::metric_engine::{EngineOf, EngineRules, MetricEngine};
use super::pass_id::Pass;
use crate::cost::{
    ClassicCost, CurvatureCost, ObliqueCost, SharpnessCost, SurfaceCost, TerrainCost, Weights, classic, curvature,
    oblique, sharpness, terrain,
};
use crate::job::StepKey;
use crate::remesh::cvd;
use crate::render::View;

/// In which passes vertices on seams are locked.
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
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub enum Cost {
    /// [`SurfaceCost`].
    Surface(Weights),
    /// [`ClassicCost`].
    Classic(classic::ClassicSettings),
    /// [`ObliqueCost`].
    Oblique(oblique::ObliqueSettings),
    /// [`CurvatureCost`].
    Curvature(curvature::CurvatureSettings),
    /// [`TerrainCost`].
    Terrain(terrain::TerrainSettings),
    /// [`SharpnessCost`].
    Sharpness(sharpness::SharpnessSettings),
}

impl Cost {
    /// The engine with this metric.
    pub(super) fn engine(self) -> Box<dyn MetricEngine> {
        match self {
            Self::Surface(settings) => Box::new(EngineOf::<SurfaceCost> { settings }),
            Self::Classic(settings) => Box::new(EngineOf::<ClassicCost> { settings }),
            Self::Oblique(settings) => Box::new(EngineOf::<ObliqueCost> { settings }),
            Self::Curvature(settings) => Box::new(EngineOf::<CurvatureCost> { settings }),
            Self::Terrain(settings) => Box::new(EngineOf::<TerrainCost> { settings }),
            Self::Sharpness(settings) => Box::new(EngineOf::<SharpnessCost> { settings }),
        }
    }

    /// Bytes that the metric adds to the memory of an ordinary face, which has half a vertex and 0.65 wedges.
    pub fn extra_face_bytes(&self) -> u64 {
        let engine = self.engine();
        engine.extra_bytes(1, 0) / 2 + engine.extra_bytes(0, 1) * 65 / 100
    }
}

/// Options of the passes.
#[derive(Debug, Clone, Copy)]
pub struct PassOptions {
    /// Faces wanted; 0 for the fewest that `max_error` allows.
    pub target: u64,
    /// Largest distance between result and input, in both directions, in units of length; `None` for no bound.
    pub max_error: Option<f64>,
    /// Faces of the input, for the schedule.
    pub input: u64,
    /// Passes that collapse edges, without extra passes.
    pub passes: usize,
    /// Target number of faces per cluster.
    pub cluster_faces: u64,
    /// Metric and its settings.
    pub cost: Cost,
    /// In which passes vertices on seams are locked.
    pub seams: SeamPolicy,
    /// Whether open borders are locked.
    pub lock_borders: bool,
    /// Whether connected components smaller than the deviation are dropped after the first pass.
    pub drop_pieces: bool,
    /// Whether collapses may change the topology where that is cheap.
    pub frees_topology: bool,
    /// Whether edges collapse one at a time in order of cost.
    pub one_by_one: bool,
    /// Whether only the first of several faces with the same three vertices is kept.
    pub drop_doubles: bool,
    /// Whether the texture coordinates of the input are left out.
    pub drop_texcoords: bool,
    /// Steps whose files stay when those of earlier passes go.
    pub kept_steps: &'static [StepKey],
    /// Settings of the remeshing before the first pass; `None` for no remeshing.
    pub remesh: Option<cvd::CvdSettings>,
    /// Whether vertices beside slivers are relocated in the last passes.
    pub optimize: bool,
    /// Whether duplicate vertices are welded before the first pass.
    pub weld: bool,
    /// Viewpoint for a map of the clusters of each pass; `None` for no map. Does not change the result.
    pub map: Option<View>,
    /// Worker threads.
    pub threads: usize,
    /// Memory in bytes for clusters in work.
    pub work_bytes: u64,
}

impl PassOptions {
    /// What the engine may do in a pass; `deviation_max` is the deviation allowed in it, in units of length.
    pub(super) fn rules(&self, pass: Pass, aim: Aim) -> EngineRules {
        EngineRules {
            lock_borders: self.lock_borders,
            lock_seams: match self.seams {
                SeamPolicy::Stitch => pass.is_first_turn() && self.passes > 1 && aim.lead == Lead::Target,
                SeamPolicy::Follow => false,
                SeamPolicy::Lock => true,
            },
            frees_topology: self.frees_topology,
            one_by_one: self.one_by_one,
            seeks_handles: !pass.is_first_turn(),
            welds: self.weld,
            deviation_max: aim.bound_of(pass.turn),
        }
    }

    /// What the engine may do to a sample: seams are free unless they are locked in all passes.
    pub(super) fn sample_rules(&self, pass: Pass, aim: Aim) -> EngineRules {
        EngineRules { lock_seams: self.seams == SeamPolicy::Lock, ..self.rules(pass, aim) }
    }
}

#[cfg(test)]
pub(super) mod samples {
    use super::*;

    /// Three passes from `input` to `target` faces, in clusters of 100, and nothing else asked for.
    pub fn three_passes(input: u64, target: u64) -> PassOptions {
        PassOptions {
            target,
            max_error: None,
            input,
            passes: 3,
            cluster_faces: 100,
            cost: Cost::Surface(Default::default()),
            seams: SeamPolicy::Stitch,
            lock_borders: false,
            drop_pieces: false,
            frees_topology: false,
            one_by_one: false,
            drop_doubles: false,
            drop_texcoords: false,
            kept_steps: &[],
            remesh: None,
            optimize: false,
            weld: false,
            map: None,
            threads: 1,
            work_bytes: 64 << 20,
        }
    }
}

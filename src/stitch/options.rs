//! What the passes need to know.

use crate::cost::{
    ClassicCost, CurvatureCost, Metric, ObliqueCost, SharpnessCost, SurfaceCost, TerrainCost, Weights, classic,
    curvature, oblique, sharpness, terrain,
};
use crate::remesh::cvd;
use crate::render::View;

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
    /// Faces wanted; 0 for the fewest that `max_error` allows.
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
    /// Whether the topology may change where that is cheap.
    pub frees_topology: bool,
    /// Whether edges collapse one at a time, the cheapest first.
    pub one_by_one: bool,
    /// Whether of faces with the same three vertices the first alone is kept.
    pub drop_doubles: bool,
    /// How the mesh is made anew before the first pass, if it is.
    pub remesh: Option<cvd::Settings>,
    /// Whether vertices among slivers are moved after the last passes.
    pub optimize: bool,
    /// Whether duplicates are welded before the first pass.
    pub weld: bool,
    /// From where the clusters of each pass are drawn, if a map is wanted; it changes nothing else.
    pub map: Option<View>,
    /// Threads.
    pub threads: usize,
    /// Bytes for clusters in work.
    pub work_bytes: u64,
}

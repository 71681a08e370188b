//! Figures of a run: the content of the JSON report.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Serialize;

#[cfg(feature = "report")]
use super::gallery::Shot;
use crate::base::json_path;
use crate::measure::figures::Comparison;
use crate::measure::gauge::Gauged;
use crate::options::SimplifyOptions;
use crate::os::timeline::Timeline;
use crate::passes::{Floor, PassReport, RemeshReport};
use crate::simplify::Changes;

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// The target was met.
    Done,
    /// The result was written, with more faces than the target.
    TargetMissed,
}

/// Numbers of triangles.
#[derive(Debug, Clone, Serialize)]
pub struct FaceFigures {
    /// Triangles of the input, after triangulation.
    pub input: u64,
    /// Target.
    pub target: u64,
    /// Triangles of the result.
    pub output: u64,
}

/// Deviation of the result from the input.
#[derive(Debug, Clone, Serialize)]
pub struct ErrorFigures {
    /// Highest cost of a collapse in the last pass, in area × length².
    pub threshold: f64,
    /// Deviation measured at some thousand points; `None` if the input or the result has no area.
    pub measured: Option<Gauged>,
}

/// Times of the phases in seconds.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SecondFigures {
    /// The whole run.
    pub total: f64,
    /// Reading the input.
    pub scan: f64,
    /// Partitioning, in all passes.
    pub partition: f64,
    /// Remeshing.
    pub remesh: f64,
    /// Simplifying in the first pass.
    pub simplify: f64,
    /// Simplifying in the passes after it.
    pub stitch: f64,
    /// Baking new textures.
    pub bake: f64,
    /// Writing the result.
    pub write: f64,
    /// Measuring the deviation.
    pub measure: f64,
    /// Drawing input and result for a page.
    pub draw: f64,
}

/// New textures.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct BakeFigures {
    /// Images.
    pub images: u64,
    /// Texels of all images.
    pub texels: u64,
    /// Share of the texels that charts cover.
    pub fill: f64,
    /// Texels that charts cover where the input has no colour.
    pub colourless: u64,
    /// Charts.
    pub charts: u64,
    /// Length of a texel's side, in the mesh's unit of length.
    pub texel: f64,
}

/// Memory in bytes.
#[derive(Debug, Clone, Serialize)]
pub struct MemoryFigures {
    /// Budget that the user allowed.
    pub budget: u64,
    /// Peak that the formulas predict.
    pub predicted_peak: u64,
    /// Peak resident memory that the system measured; `None` if the process [is not the job's
    /// alone](crate::claim_process).
    pub peak_resident: Option<u64>,
}

/// Bytes read and written.
#[derive(Debug, Clone, Serialize)]
pub struct IoFigures {
    /// Length of the mesh files that were read.
    pub input: u64,
    /// Read by system calls of the process since the run began.
    pub read: u64,
    /// Written by system calls of the process since the run began.
    pub written: u64,
    /// Length of the mesh file that was written.
    pub output: u64,
    /// Largest size of the work folder.
    pub scratch_peak: u64,
}

/// Materials and textures.
#[derive(Debug, Clone, Serialize)]
pub struct FileFigures {
    /// Materials that faces of the input name.
    pub materials: u64,
    /// Of these, materials on a face of the result.
    pub materials_left: u64,
    /// Textures that these materials name in the input.
    pub textures: u64,
    /// Of these, textures on a face of the result.
    pub textures_left: u64,
    /// Texture images beside the result, copied or linked.
    pub images: u64,
    /// Bytes of the images that were copied.
    pub image_bytes: u64,
    /// Millions of pixels of the input's texture images that may be copied, and of the images beside the result; `None`
    /// if nothing was drawn.
    pub megapixels: Option<[f64; 2]>,
}

/// Everything about a run.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Version of the program.
    pub program: &'static str,
    /// The command line, if the run was started by one.
    pub command: Option<String>,
    /// Start time, in seconds since 1970.
    pub began: u64,
    /// How the run ended.
    pub status: Status,
    /// Whether the run resumed the work of an earlier process. Times and bytes are then of this process alone, except
    /// the times of the passes.
    pub resumed: bool,
    /// The mesh file or folder that was read.
    #[serde(serialize_with = "json_path::lossy")]
    pub input: PathBuf,
    /// All inputs as the user named them.
    #[serde(serialize_with = "json_path::lossy_list")]
    pub inputs: Vec<PathBuf>,
    /// Number of mesh files in it.
    pub input_files: u64,
    /// The options of the run.
    pub options: SimplifyOptions,
    /// Number of threads.
    pub threads: usize,
    /// The mesh file that was written.
    #[serde(serialize_with = "json_path::lossy")]
    pub output: PathBuf,
    /// Triangles.
    pub faces: FaceFigures,
    /// Error.
    pub error: ErrorFigures,
    /// Changes of the topology.
    pub topology: Changes,
    /// Share of the triangles below which a new texture is better: seams need more vertices than the mesh has.
    /// `None` if the result has more triangles, or no texture.
    pub new_texture_below: Option<f64>,
    /// Share of the result's vertices that seams would take if all edges were equally long; `None` without texture or
    /// target.
    pub seam_density: Option<f64>,
    /// Time.
    pub seconds: SecondFigures,
    /// Memory.
    pub memory: MemoryFigures,
    /// Bytes read and written.
    pub io: IoFigures,
    /// Materials and textures.
    pub files: FileFigures,
    /// The new textures; `None` if the result keeps its own.
    pub bake: Option<BakeFigures>,
    /// Memory and bytes read and written over time.
    pub timeline: Timeline,
    /// Each pass that remeshed.
    pub remesh: Vec<RemeshReport>,
    /// Each pass that collapsed edges.
    pub passes: Vec<PassReport>,
    /// Renderings of the input and of the result from [`VANTAGES`](super::gallery::VANTAGES), if they were drawn.
    #[serde(skip)]
    #[cfg(feature = "report")]
    pub shots: Option<[Vec<Shot>; 2]>,
    /// Vertices and edges that keep the mesh above its target, if it was missed.
    pub floor: Option<Floor>,
    /// Comparison of the result with the input, if asked for.
    pub comparison: Option<Comparison>,
    /// Number of repaired or dropped elements, by kind.
    pub repairs: BTreeMap<String, u64>,
    /// Messages about them, where there are any.
    pub warnings: Vec<String>,
}

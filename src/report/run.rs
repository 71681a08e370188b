//! The figures of a run: what the JSON report holds.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Serialize;

use super::gallery::Shot;
use crate::base::json_path;
use crate::measure::compare::Comparison;
use crate::measure::gauge::Gauged;
use crate::options::SimplifyOptions;
use crate::os::timeline::Timeline;
use crate::passes::outcome::{Floor, PassReport, RemeshReport};
use crate::simplify::Changes;

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// The target was met.
    Done,
    /// The result was written, with more faces than asked for.
    TargetMissed,
}

/// Numbers of triangles.
#[derive(Debug, Clone, Serialize)]
pub struct FaceFigures {
    /// Of the input, after triangulation.
    pub input: u64,
    /// Asked for.
    pub target: u64,
    /// Of the result.
    pub output: u64,
}

/// How far the result lies from the input.
#[derive(Debug, Clone, Serialize)]
pub struct ErrorFigures {
    /// Highest cost of a collapse in the last pass, in area × length².
    pub threshold: f64,
    /// What was measured at some thousand points; nothing if it or the result has no area.
    pub measured: Option<Gauged>,
}

/// Times of the phases in seconds.
#[derive(Debug, Clone, Serialize)]
pub struct SecondFigures {
    /// Of the whole run.
    pub total: f64,
    /// Reading the input.
    pub scan: f64,
    /// Cutting, in all passes.
    pub partition: f64,
    /// Making the mesh anew.
    pub remesh: f64,
    /// Simplifying in the first pass.
    pub simplify: f64,
    /// Simplifying in the passes after it.
    pub stitch: f64,
    /// Writing the result.
    pub write: f64,
    /// Measuring the deviation.
    pub measure: f64,
    /// Drawing input and result for a page.
    pub draw: f64,
}

/// Memory in bytes.
#[derive(Debug, Clone, Serialize)]
pub struct MemoryFigures {
    /// What the user allowed.
    pub budget: u64,
    /// What the formulas say.
    pub predicted_peak: u64,
    /// What the system measured.
    pub peak_resident: u64,
}

/// Bytes moved.
#[derive(Debug, Clone, Serialize)]
pub struct IoFigures {
    /// Length of the OBJ input.
    pub input: u64,
    /// Read by system calls.
    pub read: u64,
    /// Written by system calls.
    pub written: u64,
    /// Length of the OBJ that was written.
    pub output: u64,
    /// Most that the work folder held.
    pub scratch_peak: u64,
}

/// Materials and textures.
#[derive(Debug, Clone, Serialize)]
pub struct FileFigures {
    /// Materials that faces of the input name.
    pub materials: u64,
    /// Those that are on a face of the result.
    pub materials_left: u64,
    /// Textures that these materials name in the input.
    pub textures: u64,
    /// Those that are on a face of the result.
    pub textures_left: u64,
    /// Texture images beside the result, copied or linked.
    pub images: u64,
    /// Bytes of those that were copied.
    pub image_bytes: u64,
    /// Millions of pixels of the input's texture images that may be copied, and of those beside the result; none if
    /// nothing was drawn.
    pub megapixels: Option<[f64; 2]>,
}

/// Everything about a run.
#[derive(Debug, Serialize)]
pub struct Report {
    /// Version of the program.
    pub program: &'static str,
    /// The command line, if the run was started by one.
    pub command: Option<String>,
    /// When it began, in seconds since 1970.
    pub began: u64,
    /// How it ended.
    pub status: Status,
    /// Whether it went on with what an earlier process had finished; times and bytes are then this process's alone,
    /// but for the times of the passes.
    pub resumed: bool,
    /// The OBJ file or folder that was read.
    #[serde(serialize_with = "json_path::lossy")]
    pub input: PathBuf,
    /// All inputs as the user named them.
    #[serde(serialize_with = "json_path::lossy_list")]
    pub inputs: Vec<PathBuf>,
    /// Number of OBJ files in it.
    pub input_files: u64,
    /// What was asked for.
    pub options: SimplifyOptions,
    /// Threads that worked.
    pub threads: usize,
    /// The OBJ that was written.
    #[serde(serialize_with = "json_path::lossy")]
    pub output: PathBuf,
    /// Triangles.
    pub faces: FaceFigures,
    /// Error.
    pub error: ErrorFigures,
    /// What became of the topology.
    pub topology: Changes,
    /// Share of the triangles below which a new texture would pay: seams would take more vertices than there are. None
    /// where the result has more, or has no texture.
    pub new_texture_below: Option<f64>,
    /// Share of the result's vertices that seams would take if all edges were equally long; none without texture or target.
    pub seam_crowding: Option<f64>,
    /// Time.
    pub seconds: SecondFigures,
    /// Memory.
    pub memory: MemoryFigures,
    /// Input and output.
    pub io: IoFigures,
    /// Materials and textures.
    pub files: FileFigures,
    /// Memory and bytes moved over time.
    pub timeline: Timeline,
    /// Each pass that made the mesh anew.
    pub remesh: Vec<RemeshReport>,
    /// Each pass that collapsed edges.
    pub passes: Vec<PassReport>,
    /// Pictures of the input and of the result from [`gallery::VANTAGES`], if they were drawn.
    #[serde(skip)]
    pub shots: Option<[Vec<Shot>; 2]>,
    /// What stands in the way of the target, if it was missed.
    pub floor: Option<Floor>,
    /// The result against the input, if asked for.
    pub comparison: Option<Comparison>,
    /// What was repaired or dropped, by kind.
    pub repairs: BTreeMap<String, u64>,
    /// The same in words, where there are words.
    pub warnings: Vec<String>,
}

impl Report {
    /// Exit code of the process: 1 if a measured distance passes `--max-error`, else 3 if the target was missed, else 0.
    pub fn exit_code(&self) -> u8 {
        match self.status {
            _ if self.broken_bound().is_some() => 1,
            Status::Done => 0,
            Status::TargetMissed => 3,
        }
    }
}

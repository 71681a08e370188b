//! Every option, once: the struct is the library's, the flags and `docs/reference/options.md` come from it.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::base::{Error, Result, bytes, json_path, quantity};
use crate::cost::{Weights, classic, curvature, knob, oblique, sharpness, terrain, weights};
use crate::job::Resume;
use crate::passes::{Cost, SeamPolicy, schedule};
use crate::remesh::cvd;
use crate::write::Textures;

/// How texture seams are simplified.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Seams {
    /// Lock seams in the first pass, then collapse them along their own line
    Stitch,
    /// Collapse seams along their own line in every pass
    Follow,
    /// Keep every seam vertex where it is
    Lock,
}

/// How open borders are simplified.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Borders {
    /// Collapse borders along their own line
    Simplify,
    /// Keep every border vertex where it is
    Lock,
}

/// Whether vertices at the same position are merged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Weld {
    /// Merge vertices whose positions are identical to the bit
    Exact,
    /// Merge nothing
    Off,
}

/// Whether the topology may change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Topology {
    /// Where that costs no more than another collapse: holes close, pieces vanish, non-manifold vertices collapse
    Simplify,
    /// It stays: no hole closes, no piece vanishes, non-manifold vertices stay where they are
    Keep,
}

/// What happens to connected components that are smaller than the error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pieces {
    /// Keep every component
    Keep,
    /// Remove components whose bounding-box diagonal is below the error so far, the smallest first, but not below the
    /// target; not with --max-error
    Drop,
}

/// What happens to faces that lie on each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Doubles {
    /// Keep all; their vertices hold still
    Keep,
    /// Keep the first of the faces that have the same three vertices, whichever way they face
    Drop,
}

/// The cost of a collapse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MetricChoice {
    /// Distance to the surface
    Qem,
    /// Distance to the surface, and texture drift
    QemAttributes,
    /// Distance to planes of equal weight; open borders erode (Garland & Heckbert 1997, the papers' baseline)
    #[value(name = "qem-1997")]
    Qem1997,
    /// Oblique photogrammetry: thins rough ground first; corners of seams stay where they are (Wang et al. 2024)
    Oblique,
    /// Keeps thin and bent parts longer than flat ones (Quan et al. 2015)
    Curvature,
    /// Terrain: position, texture and normal; keeps open borders edge for edge (Li, Shi & Zhu 2018)
    Terrain,
    /// Keeps sharp and richly textured parts longest, and open borders (Li, Jiang & Tang 2020)
    Sharpness,
}

/// How normals are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Normals {
    /// Recompute normals (60° crease) if the input has any
    Auto,
    /// Write no normals
    Drop,
}

/// What is drawn for the page of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Drawing {
    /// No page is wanted
    #[default]
    Nothing,
    /// Input and result
    Pictures,
    /// The same, and the result is to be coloured by error afterwards
    PicturesAndErrors,
}

/// How texture images reach the output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TextureFiles {
    /// Copy them beside the output
    Copy,
    /// Link to them beside the output
    Link,
    /// Leave them; the MTL names their paths
    Reference,
}

/// How texture images outside of the folder of their MTL reach the output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TexturesOutside {
    /// Leave them; the MTL names their paths
    Refer,
    /// Copy or link them as the others; for input that you trust
    Copy,
}

/// What to do with an unfinished job in the work folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ResumeChoice {
    /// Resume it if the input and options match, otherwise stop with exit code 5
    Auto,
    /// Resume it; fail if it is missing, different or damaged
    Require,
    /// Delete it and start over
    Never,
}

/// Triangles of a cluster, about, unless given.
const CLUSTER_FACES: u64 = 50_000;

/// Headings of `--help`, in the order in which it prints them.
pub mod heading {
    /// How far to simplify.
    pub const TARGET: &str = "Target";
    /// What is read, and what holds while it is simplified.
    pub const INPUT: &str = "Input";
    /// Texture seams and images.
    pub const TEXTURE: &str = "Texture";
    /// Memory, threads, files.
    pub const JOB: &str = "Job";
    /// What is said afterwards.
    pub const REPORT: &str = "Report";
    /// Published methods and their parameters.
    pub const PAPERS: &str = "Methods of papers";
}

/// Options of `drystone simplify`.
#[derive(Debug, Clone, PartialEq, Args, Serialize)]
pub struct SimplifyOptions {
    /// Share of the triangles to keep, above 0 and up to 1, such as 0.1 or 10%
    #[arg(long, value_name = "SHARE", group = "target", allow_negative_numbers = true, help_heading = heading::TARGET)]
    #[arg(value_parser = quantity::parse_share)]
    pub ratio: Option<f64>,

    /// Number of triangles to keep, such as 50000, 50k or 1.5M
    #[arg(long, value_name = "COUNT", group = "target", allow_negative_numbers = true, help_heading = heading::TARGET)]
    #[arg(value_parser = quantity::parse_count)]
    pub faces: Option<u64>,

    /// Largest distance between result and input, in the mesh's unit of length
    ///
    /// Holds for every point of both surfaces. The result has as few triangles as it allows; 0 removes only what changes
    /// nothing. With --ratio or --faces, whichever comes first
    #[arg(long, value_name = "LENGTH", allow_negative_numbers = true, help_heading = heading::TARGET)]
    #[arg(value_parser = quantity::parse_length)]
    pub max_error: Option<f64>,

    /// How to simplify open borders
    #[arg(long, value_enum, default_value_t = Borders::Simplify, value_name = "HOW", hide_short_help = true, help_heading = heading::INPUT)]
    pub borders: Borders,

    /// Whether to merge vertices at the same position
    #[arg(long, value_enum, default_value_t = Weld::Exact, value_name = "HOW", hide_short_help = true, help_heading = heading::INPUT)]
    pub weld: Weld,

    /// What to do with connected components smaller than the error
    #[arg(long, value_enum, default_value_t = Pieces::Keep, value_name = "HOW", hide_short_help = true, help_heading = heading::INPUT)]
    pub pieces: Pieces,

    /// Whether the surface keeps its holes, handles and pieces; it does where borders or seams are locked
    #[arg(long, value_enum, default_value_t = Topology::Simplify, value_name = "HOW", hide_short_help = true, help_heading = heading::TARGET)]
    pub topology: Topology,

    /// What to do with copies and back sides of faces
    #[arg(long, value_enum, default_value_t = Doubles::Keep, value_name = "HOW", hide_short_help = true, help_heading = heading::INPUT)]
    pub doubles: Doubles,

    /// How to write normals
    #[arg(long, value_enum, default_value_t = Normals::Auto, value_name = "HOW", help_heading = heading::INPUT, hide_short_help = true)]
    pub normals: Normals,

    /// How to simplify texture seams
    ///
    /// [default: stitch, but follow with the metrics of papers]
    #[arg(long, value_enum, value_name = "HOW", help_heading = heading::TEXTURE)]
    pub seams: Option<Seams>,

    /// How to write texture images
    #[arg(long, value_enum, value_name = "HOW", default_value_t = TextureFiles::Copy, help_heading = heading::TEXTURE)]
    pub textures: TextureFiles,

    /// How to write textures outside of the MTL's folder
    ///
    /// How to write texture images that an MTL names outside of its own folder, absolute names too
    #[arg(long, value_enum, value_name = "HOW", default_value_t = TexturesOutside::Refer, help_heading = heading::TEXTURE)]
    #[arg(hide_short_help = true)]
    pub textures_outside: TexturesOutside,

    /// Weight of texture drift, 0 to 1000; at 1 a metre of drift costs as much as a metre of distance
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.7, allow_negative_numbers = true, help_heading = heading::TEXTURE)]
    #[arg(value_parser = quantity::parse_number, hide_short_help = true)]
    pub uv_weight: f64,

    /// Memory that the program may use
    ///
    /// At least 128MiB [default: half of the machine's or cgroup's]
    #[arg(long, value_name = "SIZE", value_parser = bytes::parse, help_heading = heading::JOB)]
    pub memory: Option<u64>,

    /// Number of threads
    ///
    /// The result does not depend on it [default: one per processor]
    #[arg(long, value_name = "COUNT", value_parser = quantity::parse_whole::<usize>, help_heading = heading::JOB)]
    pub threads: Option<usize>,

    /// Folder for intermediate files [default: OUTPUT.work]
    #[arg(long, value_name = "DIR", help_heading = heading::JOB)]
    #[serde(serialize_with = "json_path::lossy_option")]
    pub work: Option<PathBuf>,

    /// What to do with an unfinished job in the work folder
    #[arg(long, value_enum, default_value_t = ResumeChoice::Auto, value_name = "HOW", hide_short_help = true, help_heading = heading::JOB)]
    pub resume: ResumeChoice,

    /// Keep the work folder after success; the same command then ends at once
    #[arg(long, help_heading = heading::JOB, hide_short_help = true)]
    pub keep_work: bool,

    /// Replace an existing output
    #[arg(long, help_heading = heading::JOB)]
    pub force: bool,

    /// Triangles per cluster, about; 1000 to 10 million. Changes memory a lot and the result slightly
    #[arg(long, value_name = "COUNT", default_value_t = CLUSTER_FACES, help_heading = heading::JOB, hide_short_help = true)]
    #[arg(value_parser = quantity::parse_count)]
    pub cluster_faces: u64,

    /// Passes over shifted clusters, 1 to 16; more where the target is far below the input, or borders of clusters hold it
    #[arg(long, value_name = "COUNT", default_value_t = 3, help_heading = heading::JOB, hide_short_help = true)]
    #[arg(value_parser = quantity::parse_whole::<usize>)]
    pub passes: usize,

    /// Cost of a collapse [default: qem-attributes with texture, else qem]
    #[arg(long, value_enum, help_heading = heading::PAPERS, hide_short_help = true)]
    pub metric: Option<MetricChoice>,

    /// Set a parameter of the metric, such as border=2; may be repeated. docs/guide/choosing.md lists the parameters
    #[arg(long, value_name = "NAME=VALUE", help_heading = heading::PAPERS, hide_short_help = true)]
    pub metric_option: Vec<String>,

    /// Before simplifying, remesh by centroidal Voronoi cells, denser where the surface bends (Liu, Chen & Wang 2020).
    /// cvd:2 sets the power of the curvature; cvd:cells=5000 stops at 5000 cells. docs/guide/choosing.md lists the settings
    #[arg(long, value_name = "cvd[:SETTINGS]", help_heading = heading::PAPERS, hide_short_help = true)]
    pub remesh: Option<cvd::CvdSettings>,

    /// After simplifying, move the vertices of slivers to the middle of their neighbours (Li, Jiang & Tang 2020).
    /// Triangles get rounder, the error grows
    #[arg(long, help_heading = heading::PAPERS, hide_short_help = true)]
    pub optimize: bool,

    /// Collapse one edge at a time, always the cheapest, as the heaps of the papers do. The time grows with the square of
    /// the triangles of a cluster
    #[arg(long, help_heading = heading::PAPERS, hide_short_help = true)]
    pub one_by_one: bool,

    /// Renderings of the input and of the result; `--report FILE.html` asks for them
    #[arg(skip)]
    #[serde(skip)]
    pub drawing: Drawing,

    /// Patterns of what was left out of the input, for the report
    #[arg(skip)]
    pub exclude: Vec<String>,

    /// Whether the result is to be compared with the input, for the report
    #[arg(skip)]
    pub measure: bool,

    /// Sample points of the comparison, for the report
    #[arg(skip)]
    pub samples: Option<u64>,

    /// Seed of the places of these points, for the report
    #[arg(skip)]
    pub seed: Option<u64>,

    /// The command line, for the report
    #[arg(skip)]
    #[serde(skip)]
    pub command: Option<String>,
}

impl Default for SimplifyOptions {
    fn default() -> Self {
        Self {
            ratio: None,
            faces: None,
            max_error: None,
            borders: Borders::Simplify,
            weld: Weld::Exact,
            pieces: Pieces::Keep,
            topology: Topology::Simplify,
            doubles: Doubles::Keep,
            normals: Normals::Auto,
            seams: None,
            textures: TextureFiles::Copy,
            textures_outside: TexturesOutside::Refer,
            uv_weight: 0.7,
            memory: None,
            threads: None,
            work: None,
            resume: ResumeChoice::Auto,
            keep_work: false,
            force: false,
            cluster_faces: CLUSTER_FACES,
            passes: 3,
            metric: None,
            metric_option: Vec::new(),
            remesh: None,
            optimize: false,
            one_by_one: false,
            drawing: Drawing::Nothing,
            exclude: Vec::new(),
            measure: false,
            samples: None,
            seed: None,
            command: None,
        }
    }
}

impl SimplifyOptions {
    /// Checks ranges.
    ///
    /// # Errors
    /// [`Error::Usage`] naming the option, what was found and what is accepted.
    pub fn check(&self) -> Result<()> {
        let fail = |message: String| Err(Error::Usage(message));
        let has_cells = self.cells().is_some();
        match (self.ratio, self.faces, self.max_error) {
            (None, None, None) if has_cells => {}
            (None, None, None) => return fail("give a target: --ratio, --faces or --max-error".into()),
            _ if has_cells => return fail("--remesh cvd:cells=… is the target: give no other".into()),
            (Some(_), Some(_), _) => return fail("give one of --ratio and --faces".into()),
            (Some(ratio), _, _) if !(ratio > 0.0 && ratio <= 1.0) => {
                return fail(format!("--ratio {ratio}: expected a share above 0 and up to 1"));
            }
            (_, Some(0), _) => return fail("--faces 0: expected at least 1".into()),
            (_, _, Some(length)) if !(length >= 0.0 && length.is_finite()) => {
                return fail(format!("--max-error {length}: expected a length of 0 or more"));
            }
            _ => {}
        }
        if !(1000..=10_000_000).contains(&self.cluster_faces) {
            return fail(format!("--cluster-faces {}: expected 1000 to 10000000", self.cluster_faces));
        }
        if !(1..=16).contains(&self.passes) {
            return fail(format!("--passes {}: expected 1 to 16", self.passes));
        }
        if !(0.0..=1000.0).contains(&self.uv_weight) {
            return fail(format!("--uv-weight {}: expected 0 to 1000", self.uv_weight));
        }
        self.cost(true)?;
        if self.optimize && self.max_error.is_some() {
            return fail("--optimize moves vertices without a bound: leave it out with --max-error".into());
        }
        if self.pieces == Pieces::Drop && self.max_error.is_some() {
            return fail("--pieces drop removes surface without a bound: leave it out with --max-error".into());
        }
        if self.remesh.is_some() && self.max_error.is_some() {
            return fail("--remesh moves the surface without a bound: leave it out with --max-error".into());
        }
        if self.threads == Some(0) {
            return fail("--threads 0: expected at least 1".into());
        }
        Ok(())
    }

    /// Cells that are asked for instead of triangles.
    fn cells(&self) -> Option<u64> {
        self.remesh.and_then(|remesh| remesh.cells)
    }

    /// Whether a number of triangles is asked for, and not an error or a number of cells.
    pub fn has_target(&self) -> bool {
        self.ratio.is_some() || self.faces.is_some()
    }

    /// Whether the topology may change: not where borders or seams are locked; the metrics of papers go by their own rules.
    pub fn frees_topology(&self) -> bool {
        let is_locked = self.borders == Borders::Lock || self.seam_policy() == SeamPolicy::Lock;
        self.topology == Topology::Simplify
            && !is_locked
            && matches!(self.metric, None | Some(MetricChoice::Qem | MetricChoice::QemAttributes))
    }

    /// Passes over an input with so many triangles: those asked for, or as many as a far target takes.
    pub fn pass_count(&self, triangles: u64) -> usize {
        if self.frees_topology() {
            schedule::pass_count(self.passes, triangles, self.most_faces(triangles))
        } else {
            self.passes
        }
    }

    /// Faces to keep of an input with so many triangles: at least one, or 0, as few as possible, with a bounded error only.
    pub fn target(&self, triangles: u64) -> u64 {
        match (self.ratio, self.faces) {
            (Some(ratio), _) => ((ratio * triangles as f64).round() as u64).max(1),
            (None, Some(faces)) => faces.min(triangles),
            (None, None) if self.max_error.is_some() => 0,
            (None, None) => self.cells().map_or(triangles, |cells| triangles.min(cells.saturating_mul(2))),
        }
    }

    /// Faces that the result may have at most: the target, or all where a deviation decides.
    pub fn most_faces(&self, triangles: u64) -> u64 {
        if self.max_error.is_some() { triangles } else { self.target(triangles) }
    }

    /// The metric and its settings, for a mesh with or without texture.
    ///
    /// # Errors
    /// [`Error::Usage`] for a setting that the metric does not have or accept.
    pub fn cost(&self, has_texture: bool) -> Result<Cost> {
        let given = &self.metric_option;
        let metric = self.metric.unwrap_or(if has_texture { MetricChoice::QemAttributes } else { MetricChoice::Qem });
        let cost = match metric {
            MetricChoice::Qem => knob::read(&weights::KNOBS, given)
                .map(|values| Cost::Surface(Weights { uv: 0.0, ..Weights::from(values) })),
            MetricChoice::QemAttributes => knob::read(&weights::KNOBS, given).map(|values| {
                let uv = if has_texture { self.uv_weight } else { 0.0 };
                Cost::Surface(Weights { uv, ..Weights::from(values) })
            }),
            MetricChoice::Qem1997 => knob::read(&classic::KNOBS, given).map(|values| Cost::Classic(values.into())),
            MetricChoice::Oblique => knob::read(&oblique::KNOBS, given).map(|values| Cost::Oblique(values.into())),
            MetricChoice::Curvature => {
                knob::read(&curvature::KNOBS, given).map(|values| Cost::Curvature(values.into()))
            }
            MetricChoice::Terrain => knob::read(&terrain::KNOBS, given).map(|values| Cost::Terrain(values.into())),
            MetricChoice::Sharpness => {
                knob::read(&sharpness::KNOBS, given).map(|values| Cost::Sharpness(values.into()))
            }
        };
        cost.map_err(|words| Error::Usage(format!("--metric-option {words}")))
    }

    /// What becomes of seams: by the metric's own rules, unless something else is asked for.
    pub fn seam_policy(&self) -> SeamPolicy {
        self.seams_or_default().into()
    }

    fn seams_or_default(&self) -> Seams {
        match self.seams {
            Some(seams) => seams,
            None if matches!(self.metric, None | Some(MetricChoice::Qem | MetricChoice::QemAttributes)) => {
                Seams::Stitch
            }
            None => Seams::Follow,
        }
    }

    /// The options that shape the result, as JSON; memory, threads and folders do not.
    pub fn fingerprint(&self) -> String {
        let shaping = Self {
            memory: None,
            threads: None,
            work: None,
            resume: ResumeChoice::Auto,
            keep_work: false,
            drawing: Drawing::Nothing,
            exclude: Vec::new(),
            measure: false,
            samples: None,
            seed: None,
            force: false,
            seams: Some(self.seams_or_default()),
            ..self.clone()
        };
        serde_json::to_string(&shaping).unwrap_or_default()
    }
}

impl From<ResumeChoice> for Resume {
    fn from(choice: ResumeChoice) -> Self {
        match choice {
            ResumeChoice::Auto => Resume::Auto,
            ResumeChoice::Require => Resume::Require,
            ResumeChoice::Never => Resume::Never,
        }
    }
}

impl From<Seams> for SeamPolicy {
    fn from(seams: Seams) -> Self {
        match seams {
            Seams::Stitch => SeamPolicy::Stitch,
            Seams::Follow => SeamPolicy::Follow,
            Seams::Lock => SeamPolicy::Lock,
        }
    }
}

impl From<TextureFiles> for Textures {
    fn from(files: TextureFiles) -> Self {
        match files {
            TextureFiles::Copy => Textures::Copy,
            TextureFiles::Link => Textures::Link,
            TextureFiles::Reference => Textures::Reference,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_target_is_rounded_from_the_triangles() {
        let options = SimplifyOptions { ratio: Some(0.1), ..SimplifyOptions::default() };
        assert_eq!(options.target(248_438), 24_844);
        let least = SimplifyOptions { ratio: Some(1e-9), ..options };
        assert_eq!(least.target(248_438), 1);
    }

    #[test]
    fn one_target_is_needed_and_ranges_are_kept() {
        let none = SimplifyOptions::default();
        assert!(none.check().is_err());
        for ratio in [0.0, -1.0, 1.5, f64::NAN] {
            assert!(SimplifyOptions { ratio: Some(ratio), ..none.clone() }.check().is_err());
        }
        assert!(SimplifyOptions { ratio: Some(1.0), ..none.clone() }.check().is_ok());
        assert!(SimplifyOptions { ratio: Some(0.5), faces: Some(3), ..none }.check().is_err());
    }

    #[test]
    fn memory_and_threads_leave_no_trace_in_the_fingerprint() {
        let one = SimplifyOptions { ratio: Some(0.5), threads: Some(1), ..SimplifyOptions::default() };
        let two = SimplifyOptions { threads: Some(2), memory: Some(1 << 30), ..one.clone() };
        assert_eq!(one.fingerprint(), two.fingerprint());
        // Nor does how the result is measured.
        let measured = SimplifyOptions { measure: true, samples: Some(5000), seed: Some(2), ..one.clone() };
        assert_eq!(one.fingerprint(), measured.fingerprint());
        // Nor does what is said that holds anyway.
        let said = SimplifyOptions { seams: Some(Seams::Stitch), ..one.clone() };
        assert_eq!(one.fingerprint(), said.fingerprint());
        let other = SimplifyOptions { seams: Some(Seams::Lock), ..one.clone() };
        assert_ne!(one.fingerprint(), other.fingerprint());
    }
}

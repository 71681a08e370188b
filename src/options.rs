//! Every option, once: the struct is the library's, the flags and `docs/options.md` come from it.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::base::{Error, Result, bytes, json_path};
use crate::cost::{Weights, classic, curvature, knob, oblique, sharpness, terrain, weights};
use crate::job::Resume;
use crate::remesh::cvd;
use crate::stitch::{Cost, SeamPolicy};
use crate::write::Textures;

/// What becomes of vertices on texture seams.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Seams {
    /// Locked in the first pass, then collapsed along themselves
    Stitch,
    /// Collapsed along themselves in every pass
    Follow,
    /// Never touched
    Lock,
}

/// What becomes of open borders.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Borders {
    /// Collapsed along themselves
    Simplify,
    /// Never touched
    Lock,
}

/// Whether vertices at the same place become one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Weld {
    /// Those at bit-identical positions
    Exact,
    /// None
    Off,
}

/// What becomes of whole pieces that are smaller than the error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Pieces {
    /// Kept
    Keep,
    /// Dropped where the diagonal of their bounding box is below the deviation so far; not with --max-error
    Drop,
}

/// The cost of a collapse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Metric {
    /// Distance to the surface
    Qem,
    /// Distance to the surface and slide of the picture
    QemAttributes,
    /// Distance to planes of equal weight; borders wear away (Garland & Heckbert 1997, the papers' baseline)
    #[value(name = "qem-1997")]
    Qem1997,
    /// Oblique photogrammetry: rough ground goes first, pictures keep their shape (Wang et al. 2024)
    Oblique,
    /// Thin and bent parts outlast flat ones (Quan et al. 2015)
    Curvature,
    /// Terrain: position, picture and normal; borders are kept edge for edge (Li, Shi & Zhu 2018)
    Terrain,
    /// Sharp and richly painted parts outlast the rest; borders stay (Li, Jiang & Tang 2020)
    Sharpness,
}

/// What becomes of normals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Normals {
    /// Computed anew (60° crease) if the input had any
    Auto,
    /// Left out
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

/// What becomes of texture images.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum TextureFiles {
    /// Copied beside the output
    Copy,
    /// Linked beside the output
    Link,
    /// Left where they are
    Reference,
}

/// Whether a job that the work folder holds is gone on with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ResumeChoice {
    /// If input and options are the same; otherwise it is refused
    Auto,
    /// It must be there, the same, and undamaged
    Require,
    /// Never: what it holds is removed
    Never,
}

/// Triangles of a cluster, about, unless given.
const CLUSTER_FACES: u64 = 50_000;

/// Options of `drystone simplify`.
#[derive(Debug, Clone, PartialEq, Args, Serialize)]
pub struct SimplifyOptions {
    /// Share of the triangles to keep, above 0 and up to 1
    #[arg(long, value_name = "SHARE", group = "target", allow_negative_numbers = true)]
    pub ratio: Option<f64>,

    /// Number of triangles to keep
    #[arg(long, value_name = "COUNT", group = "target", allow_negative_numbers = true)]
    pub faces: Option<u64>,

    /// Largest distance between any point of the result and the input, and the other way round, in the mesh's unit of length; as few
    /// triangles as it allows. 0 removes only what changes nothing
    #[arg(long, value_name = "LENGTH", group = "target", allow_negative_numbers = true)]
    pub max_error: Option<f64>,

    /// Memory that the program may use, at least 128MiB [default: half of the machine's or cgroup's]
    #[arg(long, value_name = "SIZE", value_parser = bytes::parse)]
    pub memory: Option<u64>,

    /// Threads; the result does not depend on them [default: one for each processor]
    #[arg(long, value_name = "COUNT")]
    pub threads: Option<usize>,

    /// Folder for intermediate files [default: beside the output]
    #[arg(long, value_name = "DIR")]
    #[serde(serialize_with = "json_path::lossy_option")]
    pub work: Option<PathBuf>,

    /// Whether a job that the work folder holds is gone on with
    #[arg(long, value_enum, default_value_t = ResumeChoice::Auto)]
    pub resume: ResumeChoice,

    /// Keep the work folder after success: the same command then finds its result there
    #[arg(long)]
    pub keep_work: bool,

    /// What becomes of vertices on texture seams [default: stitch; follow with the metrics of papers, by their own rules]
    #[arg(long, value_enum)]
    pub seams: Option<Seams>,

    /// What becomes of open borders
    #[arg(long, value_enum, default_value_t = Borders::Simplify)]
    pub borders: Borders,

    /// Whether vertices at the same place become one
    #[arg(long, value_enum, default_value_t = Weld::Exact)]
    pub weld: Weld,

    /// What becomes of whole pieces that are smaller than the error
    #[arg(long, value_enum, default_value_t = Pieces::Keep)]
    pub pieces: Pieces,

    /// Cost of a collapse [default: qem-attributes with texture, else qem]
    #[arg(long, value_enum)]
    pub metric: Option<Metric>,

    /// Constant of the metric, as name=value, such as border=2; may be repeated (docs/choosing.md lists them)
    #[arg(long, value_name = "NAME=VALUE")]
    pub metric_option: Vec<String>,

    /// Before, make the mesh anew by centroidal Voronoi cells, dense where the surface bends (Liu, Chen & Wang 2020): cvd, or
    /// cvd:2 with the power of curvature; cvd:cells=5000 leaves it at so many cells (docs/choosing.md lists the settings)
    #[arg(long, value_name = "cvd[:SETTINGS]")]
    pub remesh: Option<cvd::Settings>,

    /// Afterwards, move vertices among slivers to the middle of their ring (Li, Jiang & Tang 2020): rounder triangles, more error
    #[arg(long)]
    pub optimize: bool,

    /// Weight of the picture's slide against distance, 0 to 1000: at 1 a metre of slide costs as much as a metre of distance
    #[arg(long, value_name = "WEIGHT", default_value_t = 0.7, allow_negative_numbers = true)]
    pub uv_weight: f64,

    /// What becomes of normals
    #[arg(long, value_enum, default_value_t = Normals::Auto)]
    pub normals: Normals,

    /// What becomes of texture images
    #[arg(long, value_enum, default_value_t = TextureFiles::Copy)]
    pub textures: TextureFiles,

    /// Triangles of a cluster, about; 1000 to 10 million. Changes the result slightly, the memory much
    #[arg(long, value_name = "COUNT", default_value_t = CLUSTER_FACES)]
    pub cluster_faces: u64,

    /// Passes over shifted clusters, 1 to 16; more are made while clusters still lock what could go
    #[arg(long, value_name = "COUNT", default_value_t = 3)]
    pub passes: usize,

    /// Pictures of the input and of the result; `--report FILE.html` asks for them
    #[arg(skip)]
    #[serde(skip)]
    pub drawing: Drawing,

    /// Replace an existing output
    #[arg(long)]
    pub force: bool,
}

impl Default for SimplifyOptions {
    fn default() -> Self {
        Self {
            ratio: None,
            faces: None,
            max_error: None,
            memory: None,
            threads: None,
            work: None,
            resume: ResumeChoice::Auto,
            keep_work: false,
            seams: None,
            borders: Borders::Simplify,
            weld: Weld::Exact,
            pieces: Pieces::Keep,
            metric: None,
            metric_option: Vec::new(),
            remesh: None,
            optimize: false,
            uv_weight: 0.7,
            normals: Normals::Auto,
            textures: TextureFiles::Copy,
            cluster_faces: CLUSTER_FACES,
            passes: 3,
            drawing: Drawing::Nothing,
            force: false,
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
            (Some(ratio), None, None) if !(ratio > 0.0 && ratio <= 1.0) => {
                return fail(format!("--ratio {ratio}: expected a share above 0 and up to 1"));
            }
            (None, Some(0), None) => return fail("--faces 0: expected at least 1".into()),
            (None, None, Some(length)) if !(length >= 0.0 && length.is_finite()) => {
                return fail(format!("--max-error {length}: expected a length of 0 or more"));
            }
            (Some(_), None, None) | (None, Some(_), None) | (None, None, Some(_)) => {}
            _ => return fail("give one target: --ratio, --faces or --max-error".into()),
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

    /// Memory of the heaviest cluster, if it takes `bytes` while its edges collapse.
    pub fn cluster_bytes(&self, bytes: u64) -> u64 {
        if self.remesh.is_some() { bytes * cvd::GROWTH / 2 } else { bytes }
    }

    /// Faces to keep of an input with so many triangles; 0, as few as possible, with a bounded error.
    pub fn target(&self, triangles: u64) -> u64 {
        match (self.ratio, self.faces) {
            _ if self.max_error.is_some() => 0,
            (Some(ratio), _) => (ratio * triangles as f64).round() as u64,
            (None, Some(faces)) => faces.min(triangles),
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
        let metric = self.metric.unwrap_or(if has_texture { Metric::QemAttributes } else { Metric::Qem });
        let cost = match metric {
            Metric::Qem => knob::read(&weights::KNOBS, given)
                .map(|values| Cost::Surface(Weights { uv: 0.0, ..Weights::from(values) })),
            Metric::QemAttributes => knob::read(&weights::KNOBS, given).map(|values| {
                let uv = if has_texture { self.uv_weight } else { 0.0 };
                Cost::Surface(Weights { uv, ..Weights::from(values) })
            }),
            Metric::Qem1997 => knob::read(&classic::KNOBS, given).map(|values| Cost::Classic(values.into())),
            Metric::Oblique => knob::read(&oblique::KNOBS, given).map(|values| Cost::Oblique(values.into())),
            Metric::Curvature => knob::read(&curvature::KNOBS, given).map(|values| Cost::Curvature(values.into())),
            Metric::Terrain => knob::read(&terrain::KNOBS, given).map(|values| Cost::Terrain(values.into())),
            Metric::Sharpness => knob::read(&sharpness::KNOBS, given).map(|values| Cost::Sharpness(values.into())),
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
            None if matches!(self.metric, None | Some(Metric::Qem | Metric::QemAttributes)) => Seams::Stitch,
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
        // Nor does what is said that holds anyway.
        let said = SimplifyOptions { seams: Some(Seams::Stitch), ..one.clone() };
        assert_eq!(one.fingerprint(), said.fingerprint());
        let other = SimplifyOptions { seams: Some(Seams::Lock), ..one.clone() };
        assert_ne!(one.fingerprint(), other.fingerprint());
    }
}

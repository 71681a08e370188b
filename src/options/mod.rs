//! Options of a run, as plain values: what they are called here, the command line and the reports call them, too.

mod choices;
mod target;
mod tile;

use std::path::PathBuf;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::base::{Error, Result, json_path};
use crate::cost::{Weights, classic, curvature, oblique, parameter, sharpness, terrain, weights};
use crate::job::Resume;
use crate::job::stage::{Lending, SharedHands, TaskRunner};
use crate::passes::{Cost, PassOptions, SeamPolicy, shares};

use crate::write::Textures;

pub use self::choices::{
    Borders, Choice, Doubles, MetricChoice, Normals, Pieces, ResumeChoice, Seams, TextureFiles, TexturesOutside,
    TileCompression, Topology, UpAxis, Weld,
};
pub use self::target::{FaceTarget, Target};
pub use self::tile::{GeoPlace, TileOptions};
pub use crate::model::image_format::ImageFormat;
pub use crate::remesh::cvd::CvdSettings;

/// Triangles of a cluster, about, unless given.
pub const CLUSTER_FACES: u64 = 50_000;

/// What a run may take of the machine; the result does not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Limits {
    /// Memory in bytes, at least 128 MiB; `None` for half of the machine's or cgroup's.
    pub memory: Option<u64>,
    /// Threads, at least 1; `None` for one per processor.
    pub threads: Option<usize>,
}

/// Where a run keeps its intermediate files, and what it may replace.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct JobOptions {
    /// Folder for intermediate files; `None` for `OUTPUT.work`.
    #[serde(serialize_with = "json_path::lossy_option")]
    pub work: Option<PathBuf>,
    /// What to do with an unfinished job in that folder.
    pub resume: ResumeChoice,
    /// Whether the folder stays after success; the same call then returns at once.
    pub keep_work: bool,
    /// Whether files are left to the system to write: faster on slow disks. A power cut may then cost the job and
    /// damage the result; a killed job still resumes.
    pub no_sync: bool,
    /// Whether an existing output may be replaced.
    pub force: bool,
    /// Command that has tasks done on other machines; `None` to do them all in this process.
    ///
    /// The shell runs it once for each stage of the job. In it, `{stage}` stands for the path of the stage's file,
    /// `{count}` for the number of its tasks, `{last}` for the number of the last task. It runs
    /// `drystone task STAGE INDEX` for each INDEX from 0 to `{last}`, and exits when all tasks have ended, also those
    /// that failed. The result has the same bytes.
    pub task_runner: Option<String>,
    /// Who has tasks done instead of a command, for a program that does so itself.
    #[serde(skip)]
    pub hands: Option<SharedHands>,
    /// Tasks of a stage, at most.
    pub tasks: u32,
    /// How often a stage is handed out while tasks of it have no result.
    pub task_tries: u32,
}

impl JobOptions {
    /// How tasks are done elsewhere; `None` if they are not.
    ///
    /// # Errors
    /// [`Error::Usage`] for a command that does not name its stage, both a command and hands, or numbers of 0.
    pub fn lending(&self) -> Result<Option<Lending>> {
        for (number, name) in [(self.tasks, "tasks"), (self.task_tries, "task_tries")] {
            if number == 0 {
                return Err(Error::Usage(format!("`{name}: 0`: expected 1 or more")));
            }
        }
        let hands: SharedHands = match (&self.task_runner, &self.hands) {
            (None, None) => return Ok(None),
            (None, Some(hands)) => hands.clone(),
            (Some(command), None) => Arc::new(TaskRunner::new(command)?).into(),
            (Some(_), Some(_)) => return Err(Error::Usage("expected `task_runner` or `hands`, found both".into())),
        };
        Ok(Some(Lending { hands, tasks: self.tasks, tries: self.task_tries }))
    }
}

impl Default for JobOptions {
    /// A folder beside the output, which is removed after success; an unfinished job is resumed; nothing is replaced.
    fn default() -> Self {
        Self {
            work: None,
            resume: ResumeChoice::Auto,
            keep_work: false,
            no_sync: false,
            force: false,
            task_runner: None,
            hands: None,
            tasks: Lending::TASKS,
            task_tries: Lending::TRIES,
        }
    }
}

/// What is drawn for the page of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Drawing {
    /// Nothing.
    #[default]
    Nothing,
    /// Input and result.
    Renderings,
    /// The same, and the result coloured by error.
    RenderingsAndErrors,
}

/// What a report mentions of a run beyond its options.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct ReportNotes {
    /// What is drawn.
    #[serde(skip)]
    pub drawing: Drawing,
    /// Patterns of what was left out of the input.
    pub exclude: Vec<String>,
    /// Whether the result is compared with the input afterwards.
    pub measure: bool,
    /// Sample points of the comparison.
    pub samples: Option<u64>,
    /// Seed of the places of these points.
    pub seed: Option<u64>,
    /// The command line.
    #[serde(skip)]
    pub command: Option<String>,
}

/// Options of a run. As JSON, all fields are on one level; those that are left out have their defaults.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SimplifyOptions {
    /// How far to simplify.
    #[serde(flatten)]
    pub target: Target,
    /// How to simplify open borders.
    pub borders: Borders,
    /// Whether to merge vertices at the same position.
    pub weld: Weld,
    /// What to do with connected components smaller than the error.
    pub pieces: Pieces,
    /// Whether holes, handles and components may go; where borders or seams are locked they stay.
    pub topology: Topology,
    /// What to do with copies and back sides of faces.
    pub doubles: Doubles,
    /// How to write normals.
    pub normals: Normals,
    /// Which axis points up, for a GLB.
    pub up: UpAxis,
    /// How to simplify texture seams; `None`: stitch, but follow with the metrics of papers.
    pub seams: Option<Seams>,
    /// How to write texture images.
    pub textures: TextureFiles,
    /// What to do with images that an MTL names outside its own folder.
    pub textures_outside: TexturesOutside,
    /// Texels of baked textures, as a share of those that the input shows.
    pub texels: f64,
    /// Largest side of a baked image, in texels: a power of two from 256 to 16384.
    pub atlas: u32,
    /// Format of baked images.
    pub image: ImageFormat,
    /// Weight of texture drift, 0 to 1000; at 1 a metre of drift costs as much as a metre of distance.
    pub uv_weight: f64,
    /// Memory and threads.
    #[serde(flatten)]
    pub limits: Limits,
    /// Intermediate files, and what may be replaced.
    #[serde(flatten)]
    pub job: JobOptions,
    /// Triangles of a cluster, about; 1000 to 10 million. Changes memory a lot and the result slightly.
    pub cluster_faces: u64,
    /// Passes over shifted clusters, 1 to 16; more where the target is far below the input.
    pub passes: usize,
    /// Cost of a collapse; `None`: `qem-attributes` with texture, else `qem`.
    pub metric: Option<MetricChoice>,
    /// Parameters of the metric, each as `name=value`; `docs/guide/choosing.md` lists them.
    pub metric_option: Vec<String>,
    /// Remeshing by centroidal Voronoi cells before simplifying; `None` for none.
    pub remesh: Option<CvdSettings>,
    /// Whether vertices of slivers move to the middle of their neighbours afterwards; the error grows.
    pub optimize: bool,
    /// Whether edges collapse one at a time, always the cheapest; the time grows with the square of a cluster's
    /// triangles.
    pub one_by_one: bool,
    /// What the report mentions.
    #[serde(flatten)]
    pub notes: ReportNotes,
}

impl Default for SimplifyOptions {
    /// No target yet; everything else as the command line has it.
    fn default() -> Self {
        Self {
            target: Target::default(),
            borders: Borders::Simplify,
            weld: Weld::Exact,
            pieces: Pieces::Keep,
            topology: Topology::Simplify,
            doubles: Doubles::Keep,
            normals: Normals::Auto,
            up: UpAxis::Z,
            seams: None,
            textures: TextureFiles::Copy,
            textures_outside: TexturesOutside::Refer,
            texels: 1.0,
            atlas: 4096,
            image: ImageFormat::Png,
            uv_weight: 0.7,
            limits: Limits::default(),
            job: JobOptions::default(),
            cluster_faces: CLUSTER_FACES,
            passes: 3,
            metric: None,
            metric_option: Vec::new(),
            remesh: None,
            optimize: false,
            one_by_one: false,
            notes: ReportNotes::default(),
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
        match (self.target.is_none(), self.cells()) {
            (true, None) => return fail("give a target: `ratio`, `faces` or `max_error`".into()),
            (false, Some(_)) => return fail("`remesh: cvd:cells=…` is the target: give no other".into()),
            _ => self.target.check()?,
        }
        if !(1000..=10_000_000).contains(&self.cluster_faces) {
            return fail(format!("`cluster_faces: {}`: expected 1000 to 10000000", self.cluster_faces));
        }
        if !(1..=16).contains(&self.passes) {
            return fail(format!("`passes: {}`: expected 1 to 16", self.passes));
        }
        if !(0.0..=1000.0).contains(&self.uv_weight) {
            return fail(format!("`uv_weight: {}`: expected 0 to 1000", self.uv_weight));
        }
        self.cost(true)?;
        if !(1e-6..=16.0).contains(&self.texels) {
            return fail(format!("`texels: {}`: expected 0.000001 to 16", self.texels));
        }
        if !self.atlas.is_power_of_two() || !(256..=16384).contains(&self.atlas) {
            return fail(format!("`atlas: {}`: expected a power of two from 256 to 16384", self.atlas));
        }
        if self.image.extension().is_some() {
            return fail(format!("`image: {}`: for tiles alone; readers of MTL files expect png or jpeg", self.image));
        }
        self.image.check().map_err(|words| Error::Usage(format!("`image: {}`: {words}", self.image)))?;
        if self.bakes() && !cfg!(feature = "images") {
            return fail("`textures: bake`: the crate is built without its feature `images`".into());
        }
        if self.bakes() && self.seams.is_some() {
            return fail("`seams`: of textures that `textures: bake` replaces: leave it out".into());
        }
        if self.optimize && self.target.max_error.is_some() {
            return fail("`optimize` moves vertices without a bound: leave it out with `max_error`".into());
        }
        if self.pieces == Pieces::Drop && self.target.max_error.is_some() {
            return fail("`pieces: drop` removes surface without a bound: leave it out with `max_error`".into());
        }
        if self.remesh.is_some() && self.target.max_error.is_some() {
            return fail("`remesh` moves the surface without a bound: leave it out with `max_error`".into());
        }
        if self.limits.threads == Some(0) {
            return fail("`threads: 0`: expected at least 1".into());
        }
        Ok(())
    }

    /// Whether the result gets new textures.
    pub fn bakes(&self) -> bool {
        self.textures == TextureFiles::Bake
    }

    /// Cells that are asked for instead of triangles.
    fn cells(&self) -> Option<u64> {
        self.remesh.and_then(|remesh| remesh.cells)
    }

    /// Whether a number of triangles is asked for, and not an error or a number of cells.
    pub fn has_target(&self) -> bool {
        self.target.faces.is_some()
    }

    /// Whether the topology may change: not where borders or seams are locked; the metrics of papers go by their own rules.
    pub fn frees_topology(&self) -> bool {
        let is_locked = self.borders == Borders::Lock || self.seam_policy() == SeamPolicy::Lock;
        self.topology == Topology::Simplify
            && !is_locked
            && matches!(self.metric, None | Some(MetricChoice::Qem | MetricChoice::QemAttributes))
    }

    /// Passes over an input of `triangles`: those asked for, or as many as a far target takes.
    pub fn pass_count(&self, triangles: u64) -> usize {
        if self.frees_topology() {
            shares::pass_count(self.passes, triangles, self.most_faces(triangles))
        } else {
            self.passes
        }
    }

    /// Faces to keep of an input of `triangles`: at least one, or 0, as few as possible, with a bounded error only.
    pub fn target(&self, triangles: u64) -> u64 {
        match self.target.count(triangles) {
            Some(count) => count,
            None if self.target.max_error.is_some() => 0,
            None => self.cells().map_or(triangles, |cells| triangles.min(cells.saturating_mul(2))),
        }
    }

    /// Faces that the result may have at most: the target, or all where a deviation decides.
    pub fn most_faces(&self, triangles: u64) -> u64 {
        if self.target.max_error.is_some() { triangles } else { self.target(triangles) }
    }

    /// The metric and its settings, for a mesh with or without texture.
    ///
    /// # Errors
    /// [`Error::Usage`] for a setting that the metric does not have or accept.
    pub fn cost(&self, has_texture: bool) -> Result<Cost> {
        let given = &self.metric_option;
        let metric = self.metric.unwrap_or(if has_texture { MetricChoice::QemAttributes } else { MetricChoice::Qem });
        let cost = match metric {
            MetricChoice::Qem => parameter::read(&weights::PARAMETERS, given)
                .map(|values| Cost::Surface(Weights { uv: 0.0, ..Weights::from(values) })),
            MetricChoice::QemAttributes => parameter::read(&weights::PARAMETERS, given).map(|values| {
                let uv = if has_texture { self.uv_weight } else { 0.0 };
                Cost::Surface(Weights { uv, ..Weights::from(values) })
            }),
            MetricChoice::Qem1997 => {
                parameter::read(&classic::PARAMETERS, given).map(|values| Cost::Classic(values.into()))
            }
            MetricChoice::Oblique => {
                parameter::read(&oblique::PARAMETERS, given).map(|values| Cost::Oblique(values.into()))
            }
            MetricChoice::Curvature => {
                parameter::read(&curvature::PARAMETERS, given).map(|values| Cost::Curvature(values.into()))
            }
            MetricChoice::Terrain => {
                parameter::read(&terrain::PARAMETERS, given).map(|values| Cost::Terrain(values.into()))
            }
            MetricChoice::Sharpness => {
                parameter::read(&sharpness::PARAMETERS, given).map(|values| Cost::Sharpness(values.into()))
            }
        };
        cost.map_err(|words| Error::Usage(format!("`metric_option` {words}")))
    }

    /// Options of the passes over an input of `triangles`: on one thread, without memory for clusters, without a map.
    ///
    /// # Errors
    /// [`Error::Usage`] for a setting that the metric does not have or accept.
    pub fn pass_options(&self, triangles: u64, has_texture: bool) -> Result<PassOptions> {
        Ok(PassOptions {
            target: self.target(triangles),
            max_error: self.target.max_error,
            input: triangles,
            passes: self.pass_count(triangles),
            cluster_faces: self.cluster_faces,
            cost: self.cost(has_texture)?,
            seams: self.seam_policy(),
            lock_borders: self.borders == Borders::Lock,
            drop_pieces: self.pieces == Pieces::Drop,
            frees_topology: self.frees_topology(),
            one_by_one: self.one_by_one,
            drop_doubles: self.doubles == Doubles::Drop,
            drop_texcoords: self.textures == TextureFiles::Bake,
            kept_steps: &[],
            remesh: self.remesh,
            optimize: self.optimize,
            weld: self.weld == Weld::Exact,
            map: None,
            threads: 1,
            work_bytes: 0,
        })
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
            limits: Limits::default(),
            job: JobOptions::default(),
            notes: ReportNotes::default(),
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
            TextureFiles::Bake => Textures::Copy,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_target_is_needed() {
        let none = SimplifyOptions::default();
        assert!(none.check().is_err());
        let cells = CvdSettings { cells: Some(50), ..CvdSettings::default() };
        assert!(SimplifyOptions { remesh: Some(cells), ..none.clone() }.check().is_ok());
        let both = SimplifyOptions { remesh: Some(cells), target: Target::ratio(0.5), ..none.clone() };
        assert!(both.check().is_err());
        assert!(SimplifyOptions { target: Target::ratio(1.0), ..none }.check().is_ok());
    }

    #[test]
    fn what_does_not_shape_the_result_leaves_no_trace_in_the_fingerprint() {
        let one = SimplifyOptions { target: Target::ratio(0.5), ..SimplifyOptions::default() };
        let limits = Limits { threads: Some(2), memory: Some(1 << 30) };
        let job = JobOptions { keep_work: true, force: true, work: Some("work".into()), ..JobOptions::default() };
        let notes = ReportNotes { measure: true, samples: Some(5000), seed: Some(2), ..ReportNotes::default() };
        let other = SimplifyOptions { limits, job, notes, ..one.clone() };
        assert_eq!(one.fingerprint(), other.fingerprint());
        // Nor does what is said that holds anyway.
        let said = SimplifyOptions { seams: Some(Seams::Stitch), ..one.clone() };
        assert_eq!(one.fingerprint(), said.fingerprint());
        let other = SimplifyOptions { seams: Some(Seams::Lock), ..one.clone() };
        assert_ne!(one.fingerprint(), other.fingerprint());
    }

    #[test]
    fn options_are_read_back_as_written() {
        let options = SimplifyOptions {
            target: Target::faces(500).within(0.5),
            metric: Some(MetricChoice::Qem1997),
            limits: Limits { threads: Some(3), memory: None },
            ..SimplifyOptions::default()
        };
        let text = serde_json::to_string(&options).unwrap();
        assert_eq!(serde_json::from_str::<SimplifyOptions>(&text).unwrap(), options, "{text}");
    }
}

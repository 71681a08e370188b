//! Predicts clusters, memory, scratch space and time of a run, from one streaming read of the input.
//!
//! In: the input and the options of a run. Out: a [`Plan`]. Invariant: nothing is written, and the memory comes from
//! the formulas that the run itself reports and checks.
//!
//! # Memory
//! That of [`count`](crate::read::count), and that of a [`TextureSample`] if textures are baked.

#[cfg(feature = "images")]
pub mod bake;
mod bake_forecast;
mod machines;
pub mod memory;
mod output;
pub mod passes;
pub mod scratch;
#[cfg(feature = "images")]
mod tiles;
pub mod time;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::Serialize;

pub use self::bake_forecast::{BakeForecast, BakeTask};
pub use self::machines::MachinesForecast;
use self::machines::PlannedRun;
use self::memory::{MemoryForecast, Sizes};
use self::passes::PassForecast;
#[cfg(feature = "images")]
pub use self::tiles::{LevelForecast, PyramidPlan, plan_tiles};
use self::time::{InputSize, TimeForecast};
use crate::base::error::escape_path;
use crate::base::{Findings, Progress, Result, bytes, counted, duration, grouped};
use crate::options::SimplifyOptions;
use crate::os::system;
use crate::read;
use crate::read::{Counts, InputChoice, ShownTexture, TextureSample};

/// Counts of the input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct InputFigures {
    /// Mesh files.
    pub files: u64,
    /// Bytes of the mesh files.
    pub bytes: u64,
    /// Vertices, before duplicates are welded.
    pub vertices: u64,
    /// Texture coordinates.
    pub texcoords: u64,
    /// Polygons of three or more corners.
    pub polygons: u64,
    /// Triangles, after triangulation.
    pub triangles: u64,
}

impl InputFigures {
    fn of(counts: &Counts, files: usize) -> Self {
        Self {
            files: files as u64,
            bytes: counts.bytes,
            vertices: counts.vertices,
            texcoords: counts.texcoords,
            polygons: counts.polygons,
            triangles: counts.triangles,
        }
    }

    /// Puts the rows that tell them into a table for people.
    fn put_rows(&self, text: &mut String) {
        row(text, "input", &format!("{}, {}", counted(self.files, "file"), bytes::display(self.bytes)));
        row(text, "", &format!("{}, {} vertices", counted(self.triangles, "triangle"), grouped(self.vertices)));
    }
}

/// Scratch space.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ScratchFigures {
    /// Largest size of the work folder in bytes, approximately.
    pub bytes: u64,
    /// Free bytes on the disk of the work folder, if the system reports them.
    pub free: Option<u64>,
    /// The folder whose disk was examined.
    pub folder: PathBuf,
}

impl ScratchFigures {
    /// Returns an error if the disk is too small for the run.
    ///
    /// # Errors
    /// [`Error::NoSpace`](crate::base::Error::NoSpace).
    pub fn refuse_small_disk(&self) -> Result<()> {
        scratch::refuse_less_than(self.bytes, &self.folder)
    }

    /// For people, with a word before the size.
    fn words(&self, about: &str) -> String {
        let free = self.free.map_or("unknown".to_owned(), bytes::display);
        format!("{about} {}, {free} free in {}", bytes::display(self.bytes), escape_path(&self.folder))
    }
}

/// Prediction for a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plan {
    /// Counts of the input.
    pub input: InputFigures,
    /// Target number of triangles; `None` if a bounded error decides: all that follows is then for a mesh that loses
    /// nothing.
    pub target: Option<u64>,
    /// Threads that the run would use.
    pub threads: u64,
    /// Approximate number of triangles of a cluster.
    pub cluster_faces: u64,
    /// Forecast of each pass.
    pub passes: Vec<PassForecast>,
    /// Memory that the user allows, in bytes.
    pub budget: u64,
    /// New textures; `None` if the result keeps its own.
    pub bake: Option<BakeForecast>,
    /// Memory by phase.
    pub memory: MemoryForecast,
    /// Scratch space.
    pub scratch: ScratchFigures,
    /// Approximate size of the mesh file to be written, as an OBJ, in bytes.
    pub output_bytes: u64,
    /// Time by phase.
    pub seconds: TimeForecast,
    /// What several machines would bring; `None` if that was not asked for.
    pub machines: Option<MachinesForecast>,
    /// Warnings: inputs that may hold one surface twice, and patterns that exclude nothing.
    pub warnings: Vec<String>,
}

/// Plans a run. The work folder's disk is that of `options.job.work`, else that of the current folder.
///
/// # Errors
/// As [`pipeline::simplify`](crate::pipeline::simplify) for options, an impossible budget and inputs that are no meshes;
/// [`ScratchFigures::refuse_small_disk`] reports a disk that is too small.
pub fn plan(input: impl Into<InputChoice>, options: &SimplifyOptions, progress: &dyn Progress) -> Result<Plan> {
    options.check()?;
    let (inputs, mut findings) = read::find_inputs_and_idle(&input.into())?;
    let budget = memory::choose_budget(options)?;
    let threads = memory::choose_threads(options.limits.threads, budget);
    let mut sample = options.bakes().then(|| TextureSample::new(budget.for_work()));
    let (counts, boxes) = read::count(&inputs, threads, sample.as_mut(), progress)?;
    read::note_twin_boxes(&inputs, &boxes, &mut findings);
    let target = options.most_faces(counts.triangles);
    let of = Sizes::of(counts.triangles, counts.vertices, options);
    let sizes = Sizes { is_textured: counts.texcoords > 0, ..of };
    let passes = passes::forecast(&sizes, options.pass_count(counts.triangles));
    let bake = sample.and_then(|sample| {
        let task = BakeTask { faces: counts.triangles, target, threads, work_bytes: budget.for_work() };
        bake_forecast(sample.finish(), &task, options, &mut findings)
    });
    let folder = scratch::existing_folder(options.job.work.as_deref().unwrap_or(Path::new(".")));
    Ok(Plan {
        input: InputFigures::of(&counts, inputs.len()),
        target: (options.has_target() || options.target.max_error.is_none())
            .then_some(options.target(counts.triangles)),
        threads: threads as u64,
        cluster_faces: options.cluster_faces,
        memory: memory::forecast(&sizes, budget, threads).with_bake(bake.map(|bake| bake.work_bytes)),
        budget: budget.bytes,
        scratch: ScratchFigures {
            bytes: {
                let passes = scratch::forecast(&counts, &sizes, options.pass_count(counts.triangles), budget);
                bake.map_or(passes, |bake| bake.surface_bytes + passes.max(bake.baking_bytes))
            },
            free: system::free_disk_bytes(&folder).ok(),
            folder,
        },
        output_bytes: output::obj_bytes(&counts, &boxes, target),
        seconds: time::forecast(
            InputSize { files: inputs.len() as u64, bytes: counts.bytes },
            &passes,
            target,
            threads,
        )
        .with_bake(bake.map_or(0.0, |bake| bake.core_seconds), threads),
        bake,
        passes,
        machines: None,
        warnings: findings.warnings(),
    })
}

#[cfg(feature = "images")]
fn bake_forecast(
    shown: ShownTexture,
    task: &BakeTask,
    options: &SimplifyOptions,
    findings: &mut Findings,
) -> Option<BakeForecast> {
    let forecast = bake::forecast(&shown, task, options, findings);
    findings.merge(shown.findings);
    Some(forecast)
}

/// Without images, options that ask for a bake were refused.
#[cfg(not(feature = "images"))]
fn bake_forecast(_: ShownTexture, _: &BakeTask, _: &SimplifyOptions, _: &mut Findings) -> Option<BakeForecast> {
    None
}

impl Plan {
    /// The plan with a prediction for several machines; `bandwidth` is what their shared disk moves in a second, in bytes.
    pub fn on_machines(self, machines: u32, bandwidth: Option<u64>) -> Self {
        let run = PlannedRun {
            input_files: self.input.files,
            input_bytes: self.input.bytes,
            target: self.target.unwrap_or(self.input.triangles),
            passes: &self.passes,
            seconds: self.seconds,
            threads: self.threads as usize,
        };
        Self { machines: Some(MachinesForecast::of(&run, machines, bandwidth)), ..self }
    }

    /// The plan as a table for people.
    pub fn table(&self) -> String {
        let mut text = String::new();
        let input = &self.input;
        input.put_rows(&mut text);
        let about = match self.target {
            Some(target) => {
                let share = 100.0 * target as f64 / input.triangles as f64;
                row(&mut text, "result", &format!("{} ({share:.3} %)", counted(target, "triangle")));
                "about"
            }
            None => {
                row(&mut text, "result", "as few triangles as the error allows, which only the run finds out;");
                row(&mut text, "", "sizes are those if none can go, and smaller otherwise");
                "at most about"
            }
        };
        row(&mut text, "", &format!("{about} {} as an OBJ, textures not counted", bytes::display(self.output_bytes)));
        if let Some(bake) = &self.bake {
            row(&mut text, "textures", &bake.words());
        }
        for (number, pass) in self.passes.iter().enumerate() {
            let name = match pass {
                PassForecast { is_trim: true, .. } => "trim".to_owned(),
                PassForecast { is_remesh: true, .. } => "remesh".to_owned(),
                _ => format!("pass {}", number + 1),
            };
            let (before, after) = (grouped(pass.faces_in), grouped(pass.faces_out));
            let about = if pass.clusters == 1 { "" } else { "about " };
            let clusters = counted(pass.clusters, "cluster");
            row(&mut text, &name, &format!("{about}{clusters}, {before} -> {after} triangles"));
        }
        let memory = &self.memory;
        let of = [("scan", memory.scan), ("partition", memory.partition), ("simplify", memory.simplify)];
        let bake = memory.bake.map(|bake| ("bake", bake));
        let phases = of.into_iter().chain(bake).chain([("write", memory.write)]);
        let phases: Vec<_> = phases.map(|(name, size)| format!("{name} {}", bytes::display(size))).collect();
        let allowed = bytes::display(self.budget);
        row(&mut text, "memory", &format!("{} of {allowed} allowed", bytes::display(memory.peak)));
        row(&mut text, "", &phases.join(", "));
        row(&mut text, "scratch", &self.scratch.words(about));
        let seconds = &self.seconds;
        let threads = counted(self.threads, "thread");
        row(&mut text, "time", &format!("{} on {threads} with a core each", duration::about(seconds.total)));
        let of = [("scan", seconds.scan), ("partition", seconds.partition), ("simplify", seconds.simplify)];
        let bake = self.bake.map(|_| ("bake", seconds.bake));
        let phases = of.into_iter().chain(bake).chain([("write", seconds.write)]);
        let phases: Vec<_> = phases.map(|(name, seconds)| format!("{name} {}", duration::rough(seconds))).collect();
        row(&mut text, "", &phases.join(", "));
        self.machines.iter().for_each(|machines| put_machines(&mut text, machines));
        text
    }
}

fn put_machines(text: &mut String, forecast: &MachinesForecast) {
    let MachinesForecast { machines, bandwidth, seconds, seconds_of_one, seconds_with_own_disk } = *forecast;
    let disk = bandwidth.map_or("a fast shared disk".to_owned(), |bandwidth| {
        format!("a shared disk of {}/s", bytes::display(bandwidth))
    });
    let (all, one) = (counted(u64::from(machines), "machine"), duration::rough(seconds_of_one));
    row(text, "machines", &format!("{all} on {disk}: {}; one alone: {one}", duration::rough(seconds)));
    let own = duration::rough(seconds_with_own_disk);
    let verdict = if forecast.is_one_as_fast() { ", about as fast as all of them" } else { "" };
    row(text, "", &format!("one with --work on a disk of its own: {own}{verdict}"));
}

fn row(text: &mut String, name: &str, words: &str) {
    let _ = writeln!(text, "{name:10}{words}");
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Silent;
    use crate::options::Target;

    #[test]
    fn the_town_is_planned_as_one_cluster() {
        let options = SimplifyOptions { target: Target::ratio(0.1), ..SimplifyOptions::default() };
        let plan = plan(Path::new("fixtures/town/town.obj"), &options, &Silent).unwrap();
        assert_eq!(plan.input.triangles, 18_218);
        assert_eq!(plan.target, Some(1_822));
        assert!(plan.passes.iter().all(|pass| pass.clusters == 1));
        let table = plan.table();
        assert!(table.contains("18 218 triangles") && table.contains("memory"), "{table}");
    }

    #[test]
    fn a_bounded_error_is_planned_for_a_mesh_that_loses_nothing() {
        let options = SimplifyOptions { target: Target::max_error(0.1), ..SimplifyOptions::default() };
        let plan = plan(Path::new("fixtures/town/town.obj"), &options, &Silent).unwrap();
        assert_eq!(plan.target, None);
        assert!(plan.passes.iter().all(|pass| pass.faces_out == 18_218), "{:?}", plan.passes);
        assert!(plan.table().contains("at most about"), "{}", plan.table());
    }

    #[test]
    fn a_folder_with_a_backup_is_planned_with_a_warning() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("backup")).unwrap();
        for name in ["town.obj", "backup/town.obj"] {
            std::fs::copy("fixtures/town/town.obj", folder.path().join(name)).unwrap();
        }
        let options = SimplifyOptions { target: Target::ratio(0.1), ..SimplifyOptions::default() };
        let choice = |exclude: &[&str]| InputChoice {
            paths: vec![folder.path().to_owned()],
            exclude: exclude.iter().map(|&pattern| pattern.to_owned()).collect(),
        };
        let warnings = |exclude: &[&str]| plan(choice(exclude), &options, &Silent).unwrap().warnings;
        assert!(warnings(&[])[0].contains("fill the same space"), "{:?}", warnings(&[]));
        assert_eq!(warnings(&["./backup"]), [""; 0]);
        assert_eq!(warnings(&["backup", "*_lod*"]), ["unused exclude: --exclude '*_lod*' leaves nothing out"]);
    }
}

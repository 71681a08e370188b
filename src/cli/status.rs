//! `drystone status`: what a job has done and what is left of it.

use std::collections::HashSet;
use std::fmt::Write as _;
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use clap::Args;
use serde::Serialize;
use serde_json::json;

use super::answer::CommandAnswer;
use super::print::{print, print_json};
use crate::bake::BakeStep;
use crate::base::error::{escape, escape_path};
use crate::base::{Result, bytes, counted, duration, grouped, json_path};
use crate::job::stage::StageStatus;
use crate::job::{Entry, StepRecord, WorkStatus, look};
use crate::model::array_file;
use crate::passes::steps::PassStep;
use crate::read::SCAN;
use crate::tile::{TILESET, TileStep};
use crate::write::RESULT;

/// First bytes of the meshes that the program writes: an OBJ, a PLY, an array file.
const OWN_BEGINNINGS: [&[u8]; 3] =
    [b"# drystone ", b"ply\nformat binary_little_endian 1.0\ncomment drystone ", &array_file::MAGIC];
/// What stands near the beginning of the JSON that the program writes: of a GLB, of a pyramid.
const OWN_GENERATOR: &[u8] = b"\"generator\":\"drystone ";
/// First bytes of a GLB.
const GLB: &[u8] = b"glTF";
/// Bytes of a file in which one of these stands.
const BEGINNING_BYTES: u64 = 512;

/// Arguments of `drystone status`.
#[derive(Debug, Args)]
pub struct StatusArguments {
    /// Work folder: OUTPUT.work, or the folder of --work
    workdir: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Status of a job.
#[derive(Debug, Serialize)]
struct JobStatus {
    /// Whether a process is working on the job.
    running: bool,
    /// Seconds since the job began, and since its latest process began.
    seconds: u64,
    seconds_of_process: u64,
    /// Number of processes that worked on the job.
    processes: u64,
    /// The first input file, how many there are, and their bytes.
    #[serde(serialize_with = "json_path::lossy_option")]
    input: Option<PathBuf>,
    input_files: usize,
    input_bytes: u64,
    /// Triangles of the input, once it is scanned.
    triangles: Option<u64>,
    /// Number of passes asked for; more may follow.
    passes: u64,
    /// Number of passes that are done.
    passes_done: u64,
    /// Triangles after the last of these passes.
    triangles_left: Option<u64>,
    /// The current pass, once its partition is done.
    pass: Option<PassStatus>,
    /// The stage whose tasks other processes do, if there is one.
    stage: Option<StageProgress>,
    /// New textures, once something of them is done.
    bake: Option<BakeStatus>,
    /// The level of a pyramid that tiles are made of, once it is cut into them.
    level: Option<LevelStatus>,
    /// Whether the result is written.
    written: bool,
    /// Error that ended a process early, if one was recorded; the latest one.
    last_error: Option<String>,
    /// Number of that process, counted from 1.
    last_error_of_process: Option<u64>,
    /// Bytes in the work folder.
    bytes: u64,
}

/// Status of the current pass.
#[derive(Debug, Serialize)]
struct PassStatus {
    /// Counted from 1.
    number: u32,
    /// Number of clusters, and of those that are done.
    clusters: u64,
    clusters_done: u64,
    /// Triangles of the clusters that are done, before they were simplified.
    triangles_done: u64,
}

/// Status of a stage.
#[derive(Debug, Serialize)]
struct StageProgress {
    /// What is done: `scan`, `sweep`, `remesh`, `bake` or `tile`.
    kind: String,
    /// Number of tasks, of those that have results, and of those that failed last.
    tasks: u64,
    tasks_done: u64,
    tasks_failed: u64,
    /// Why the last of these failed.
    last_failure: Option<String>,
}

impl StageProgress {
    fn of(stage: &StageStatus) -> Self {
        let StageStatus { kind, tasks, tasks_done, tasks_failed, failure } = stage.clone();
        let plain = |text: String| escape(text.as_bytes());
        Self { kind: plain(kind), tasks, tasks_done, tasks_failed, last_failure: failure.map(plain) }
    }
}

/// Status of new textures.
#[derive(Debug, Default, Serialize)]
struct BakeStatus {
    /// Images of the input that were decoded.
    images_decoded: u64,
    /// Number of patches, once the result is cut into them, and of those that are done.
    patches: Option<u64>,
    patches_done: u64,
}

/// Status of a level of a pyramid.
#[derive(Debug, Serialize)]
struct LevelStatus {
    /// Number of the level; 0 is the finest.
    number: u32,
    /// Number of its tiles, and of those that are written.
    tiles: u64,
    tiles_done: u64,
}

/// Prints the status.
///
/// # Errors
/// Those of [`look`].
pub fn run(arguments: &StatusArguments) -> Result<u8> {
    let found = JobOrResult::look(&arguments.workdir)?;
    if arguments.json {
        print_json(&found.json())?
    } else {
        print(&found.words(&arguments.workdir))?
    }
    Ok(0)
}

/// Looks for a program that calls the command.
///
/// # Errors
/// Those of [`look`].
pub fn answer(arguments: &StatusArguments) -> Result<CommandAnswer> {
    CommandAnswer::new(0, &JobOrResult::look(&arguments.workdir)?.json())
}

/// What is found where a work folder is or was.
enum JobOrResult {
    Job(Box<JobStatus>),
    /// The result of a job whose folder was removed.
    Result(PathBuf),
}

impl JobOrResult {
    fn look(work: &Path) -> Result<Self> {
        if let Some(output) = finished(work) {
            return Ok(Self::Result(output));
        }
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        Ok(Self::Job(Box::new(JobStatus::of(&look(work)?, now))))
    }

    fn json(&self) -> serde_json::Value {
        match self {
            Self::Job(status) => json!(status),
            Self::Result(output) => json!({ "running": false, "written": true, "output": escape_path(output) }),
        }
    }

    fn words(&self, work: &Path) -> String {
        match self {
            Self::Job(status) => status.table(work),
            Self::Result(output) => format!(
                "{}: finished: {} is written, and the work folder was removed (--keep-work would keep it)\n",
                escape_path(work),
                escape_path(output)
            ),
        }
    }
}

/// The result beside a work folder `OUTPUT.work` that was removed at the end of its job; `None` for anything else.
fn finished(work: &Path) -> Option<PathBuf> {
    if work.exists() || work.extension()? != "work" {
        return None;
    }
    let output = work.with_extension("");
    let is_pyramid = output.is_dir();
    let first = if is_pyramid { output.join(TILESET) } else { output.clone() };
    let mut beginning = Vec::new();
    File::open(first).and_then(|file| file.take(BEGINNING_BYTES).read_to_end(&mut beginning)).ok()?;
    let has_json = is_pyramid || beginning.starts_with(GLB);
    let is_own = OWN_BEGINNINGS.iter().any(|own| beginning.starts_with(own))
        || (has_json && beginning.windows(OWN_GENERATOR.len()).any(|part| part == OWN_GENERATOR));
    is_own.then_some(output)
}

impl JobStatus {
    fn of(work: &WorkStatus, now: u64) -> Self {
        let mut status = Self {
            running: work.is_running,
            seconds: now.saturating_sub(work.manifest.began),
            seconds_of_process: 0,
            processes: 0,
            input: work.manifest.inputs.first().map(|file| file.path.clone()),
            input_files: work.manifest.inputs.len(),
            input_bytes: work.manifest.inputs.iter().fold(0, |sum, file| sum.saturating_add(file.bytes)),
            triangles: None,
            passes: work.manifest.passes,
            passes_done: 0,
            triangles_left: None,
            pass: None,
            stage: work.stage.as_ref().map(StageProgress::of),
            bake: None,
            level: None,
            written: false,
            last_error: None,
            last_error_of_process: None,
            bytes: work.bytes,
        };
        let (mut clusters, mut baked, mut made) = (HashSet::new(), HashSet::new(), HashSet::new());
        for entry in &work.entries {
            match entry {
                Entry::Began { time } => {
                    status.processes += 1;
                    status.seconds_of_process = now.saturating_sub(*time);
                }
                Entry::Failed { message, .. } => {
                    (status.last_error, status.last_error_of_process) = (Some(message.clone()), Some(status.processes));
                }
                // A damaged cluster that was recomputed is recorded a second time.
                Entry::Kept(record) => match PassStep::of(&record.key) {
                    Some(step @ (PassStep::Cluster { .. } | PassStep::Clusters { .. })) if !clusters.insert(step) => {}
                    Some(step) => {
                        if matches!(step, PassStep::Partition { .. }) {
                            clusters.clear();
                        }
                        status.see_pass(step, record.amount);
                    }
                    None => match BakeStep::of(&record.key) {
                        Some(step) if baked.insert(step) => status.see_bake(step, record.amount),
                        Some(_) => {}
                        None => match TileStep::of(&record.key) {
                            Some(step) if made.insert(step) => status.see_tiles(step, record.amount),
                            Some(_) => {}
                            None => status.see(record),
                        },
                    },
                },
                Entry::Wanted { .. } => {}
            }
        }
        status
    }

    fn see(&mut self, record: &StepRecord) {
        if record.key == SCAN {
            self.triangles = Some(record.amount);
        }
        self.written |= record.key == RESULT;
    }

    fn see_pass(&mut self, step: PassStep, amount: u64) {
        match (step, &mut self.pass) {
            (PassStep::Partition { pass }, _) => {
                let (number, clusters) = (pass.saturating_add(1), amount);
                self.pass = Some(PassStatus { number, clusters, clusters_done: 0, triangles_done: 0 });
            }
            (PassStep::Stops { attempt: 1.., .. }, Some(pass)) => (pass.clusters_done, pass.triangles_done) = (0, 0),
            (PassStep::Cluster { .. }, Some(pass)) => {
                pass.clusters_done += 1;
                pass.triangles_done = pass.triangles_done.saturating_add(amount);
            }
            (PassStep::Mesh { pass }, _) => {
                self.passes_done = u64::from(pass) + 1;
                self.triangles_left = Some(amount);
                self.pass = None;
            }
            (PassStep::Clusters { count, .. }, Some(pass)) => {
                pass.clusters_done = pass.clusters_done.saturating_add(u64::from(count)).min(pass.clusters);
                pass.triangles_done = pass.triangles_done.saturating_add(amount);
            }
            _ => {}
        }
    }

    fn see_bake(&mut self, step: BakeStep, amount: u64) {
        let bake = self.bake.get_or_insert_default();
        match step {
            BakeStep::Surface => {}
            BakeStep::Image(_) => bake.images_decoded += 1,
            BakeStep::Patches => bake.patches = Some(amount),
            BakeStep::Patch(_) => bake.patches_done += 1,
            BakeStep::Several { count, .. } => {
                let most = bake.patches.unwrap_or(u64::MAX);
                bake.patches_done = bake.patches_done.saturating_add(u64::from(count)).min(most);
            }
        }
    }

    fn see_tiles(&mut self, step: TileStep, amount: u64) {
        match (step, &mut self.level) {
            (TileStep::Cut { level }, _) => {
                self.level = Some(LevelStatus { number: level, tiles: amount, tiles_done: 0 });
            }
            (TileStep::Tile { .. }, Some(level)) => level.tiles_done += 1,
            _ => {}
        }
    }

    fn table(&self, path: &Path) -> String {
        let mut text = format!("{}: ", escape_path(path));
        let _ = if self.running {
            writeln!(text, "running for {} (process {})", duration::whole(self.seconds_of_process), self.processes)
        } else if self.written {
            writeln!(text, "idle; the result is written; run the original command again to finish")
        } else {
            writeln!(text, "idle; run the original command again to resume")
        };
        if let Some(path) = &self.input {
            let more = match self.input_files {
                0 | 1 => String::new(),
                files => format!(", and {} more", grouped(files as u64 - 1)),
            };
            let _ = writeln!(text, "input      {}{more}", escape_path(path));
        }
        let input = bytes::display(self.input_bytes);
        let processes = if self.processes == 1 { "process" } else { "processes" };
        let ago = duration::whole(self.seconds);
        let _ = writeln!(text, "begun      {ago} ago, by {} {processes} so far", self.processes);
        let _ = match self.triangles {
            Some(triangles) => writeln!(text, "scan       done: {} triangles in {input}", grouped(triangles)),
            None => {
                let files = counted(self.input_files as u64, "file");
                writeln!(text, "scan       of {files}, {input}: not done")
            }
        };
        let left = self.triangles_left.map_or(String::new(), |left| format!(", {} triangles left", grouped(left)));
        let _ = writeln!(text, "passes     {} done of {} or more{left}", self.passes_done, self.passes);
        if let Some(pass) = &self.pass {
            let clusters = counted(pass.clusters, "cluster");
            let _ = writeln!(text, "pass {}     {} of {clusters} done", pass.number, grouped(pass.clusters_done));
        }
        if let Some(stage) = &self.stage {
            let failed =
                if stage.tasks_failed > 0 { format!(", {} failed", stage.tasks_failed) } else { String::new() };
            let tasks = counted(stage.tasks, "task");
            let _ = writeln!(text, "stage      {}, {} of {tasks} done{failed}", stage.kind, stage.tasks_done);
            if let Some(failure) = &stage.last_failure {
                let _ = writeln!(text, "           {failure}");
            }
        }
        if let Some(bake) = self.bake.as_ref().filter(|bake| bake.images_decoded > 0 || bake.patches.is_some()) {
            let images = counted(bake.images_decoded, "image");
            let _ = match bake.patches {
                None => writeln!(text, "textures   {images} decoded"),
                Some(patches) => {
                    let noun = if patches == 1 { "patch" } else { "patches" };
                    writeln!(text, "textures   {images} decoded, {} of {patches} {noun} done", bake.patches_done)
                }
            };
        }
        if let Some(level) = &self.level {
            let LevelStatus { number, tiles, tiles_done } = level;
            let _ =
                writeln!(text, "tiles      level {number}: {} of {} written", grouped(*tiles_done), grouped(*tiles));
        }
        let _ = writeln!(text, "result     {}", if self.written { "written" } else { "not written" });
        if let Some(error) = &self.last_error {
            let error: Vec<String> = error.lines().map(|line| escape(line.as_bytes())).collect();
            let of = match self.last_error_of_process {
                Some(process) if process < self.processes => format!(", of process {process}"),
                _ => String::new(),
            };
            let _ = writeln!(text, "last error {}{of}", error.join("\n"));
        }
        let _ = writeln!(text, "space      {}", bytes::display(self.bytes));
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_removed_work_folder_beside_a_result_of_ours_is_a_finished_job() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("ours.obj"), "# drystone 0.1.0\nv 0 0 0\n").unwrap();
        std::fs::write(path("theirs.obj"), "# Blender\nv 0 0 0\n").unwrap();
        std::fs::write(path("short.obj"), "#").unwrap();
        std::fs::write(path("ours.ply"), "ply\nformat binary_little_endian 1.0\ncomment drystone 0.1.0\n").unwrap();
        for ours in ["ours.obj", "ours.ply"] {
            assert_eq!(finished(&path(&format!("{ours}.work"))), Some(path(ours)));
        }
        for other in ["theirs.obj.work", "short.obj.work", "none.obj.work", "ours.obj", "ours.obj.other", ".work", ""] {
            assert_eq!(finished(&path(other)), None, "{other}");
        }
        std::fs::create_dir(path("ours.obj.work")).unwrap();
        assert_eq!(finished(&path("ours.obj.work")), None);
    }
}

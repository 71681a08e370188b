//! Tasks that are done elsewhere: the result has the same bytes, whoever does them, in whatever order and how often.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::meshes::{contents, copy_town, files, fixture, in_many_clusters, noise, ratio, terrain, town};
use drystone::base::{ErrorKind, Progress, Result, Silent};
use drystone::file::header::seal;
use drystone::job::stage::{Hands, HandsEnd, SharedHands, Stage, note_failure, stages};
use drystone::options::{CvdSettings, JobOptions, Limits, MetricChoice, SimplifyOptions, Target, TileOptions};
use drystone::pipeline::{self, TaskEnd, do_task};

const LIMITS: Limits = Limits { memory: Some(128 << 20), threads: Some(1) };

/// Does tasks in random order and some of them twice at once; leaves some out at first.
#[derive(Debug, Default)]
struct Careless {
    seed: usize,
    lent: AtomicUsize,
    done: AtomicUsize,
    /// Tasks left out at first, and stages lent again.
    left_out: AtomicUsize,
    lent_again: AtomicUsize,
    seen: Mutex<HashSet<u64>>,
    kinds: Mutex<HashSet<String>>,
    /// Name of a task of each stage.
    names: Mutex<Vec<String>>,
}

impl Careless {
    fn chance(&self, index: usize, of: usize) -> f64 {
        noise(self.seed + index, self.lent.load(Ordering::Relaxed), of as u64)
    }
}

impl Hands for Careless {
    fn lend(&self, stage: &Stage, _progress: &dyn Progress) -> Result<HandsEnd> {
        let is_first = self.seen.lock().unwrap().insert(stage.id());
        self.kinds.lock().unwrap().insert(stage.kind().to_owned());
        self.names.lock().unwrap().push(stage.tasks()[0].key.name().to_owned());
        let mut tasks: Vec<usize> = (0..stage.tasks().len()).collect();
        tasks.sort_by(|&a, &b| self.chance(a, 1).total_cmp(&self.chance(b, 1)));
        self.lent.fetch_add(1, Ordering::Relaxed);
        self.lent_again.fetch_add(usize::from(!is_first), Ordering::Relaxed);
        for task in tasks {
            if is_first && self.chance(task, 2) < 0.2 {
                self.left_out.fetch_add(1, Ordering::Relaxed);
                continue;
            }
            let work = || do_task(&stage.path(), task, LIMITS, &Silent);
            std::thread::scope(|scope| {
                let twin = (self.chance(task, 3) > 0.7).then(|| scope.spawn(work));
                let ends = [Some(work()), twin.map(|twin| twin.join().unwrap())];
                for end in ends.into_iter().flatten() {
                    assert!(!matches!(end, Ok(TaskEnd::Over | TaskEnd::NoStage)));
                }
            });
            self.done.fetch_add(1, Ordering::Relaxed);
        }
        Ok(HandsEnd::Done)
    }

    fn patience(&self) -> Duration {
        Duration::from_millis(1)
    }
}

impl Careless {
    /// What was left out has been asked for again.
    fn check_attempts(&self) {
        let [left_out, again] = [&self.left_out, &self.lent_again].map(|count| count.load(Ordering::Relaxed));
        assert_eq!(left_out > 0, again > 0, "{left_out} tasks were left out, {again} stages were lent again");
    }
}

fn by(hands: impl Into<SharedHands>, tasks: u32) -> JobOptions {
    JobOptions { hands: Some(hands.into()), tasks, ..JobOptions::default() }
}

/// The result and its other files, without the work folder.
fn result(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    contents(folder).into_iter().filter(|(path, _)| !path.to_string_lossy().contains(".work")).collect()
}

/// Simplifies by this process alone, and with the help of others; the bytes must be the same. Returns the others.
fn help(input: &Path, options: &SimplifyOptions, tasks: u32, seed: usize) -> Arc<Careless> {
    let [alone, helped] = [(), ()].map(|()| tempfile::tempdir().unwrap());
    let expected = pipeline::simplify(input, &alone.path().join("out.obj"), options, &Silent).unwrap();
    let hands = Arc::new(Careless { seed, ..Careless::default() });
    let options = SimplifyOptions { job: by(hands.clone(), tasks), ..options.clone() };
    let report = pipeline::simplify(input, &helped.path().join("out.obj"), &options, &Silent).unwrap();
    assert_eq!(report.faces.output, expected.faces.output);
    assert!(result(alone.path()) == result(helped.path()), "{options:?}");
    hands.check_attempts();
    assert_eq!(std::fs::read_dir(helped.path()).unwrap().count(), std::fs::read_dir(alone.path()).unwrap().count());
    hands
}

/// [`help`] that returns the number of tasks that were done elsewhere.
fn same_bytes(input: &Path, options: &SimplifyOptions, tasks: u32, seed: usize) -> usize {
    help(input, options, tasks, seed).done.load(Ordering::Relaxed)
}

#[test]
fn tasks_in_any_order_done_twice_or_late_give_the_same_bytes() {
    let mut stages = Vec::new();
    for (seed, tasks) in [(1, 3), (2, 7), (3, 64)] {
        for share in [0.5, 0.1] {
            let hands = help(&town(), &in_many_clusters(ratio(share)), tasks, seed);
            stages.append(&mut hands.names.lock().unwrap());
        }
    }
    for of in ["-clusters-0-", "-clusters-1-", "-trials-0-"] {
        assert!(stages.iter().any(|name| name.contains(of)), "no stage of a second attempt, or of trials: {stages:?}");
    }
}

#[test]
fn every_metric_gives_the_same_bytes() {
    use MetricChoice::{Curvature, Oblique, Qem, Qem1997, QemAttributes, Sharpness, Terrain};
    for metric in [Qem, QemAttributes, Qem1997, Oblique, Curvature, Terrain, Sharpness] {
        let options = in_many_clusters(SimplifyOptions { metric: Some(metric), optimize: true, ..ratio(0.3) });
        assert!(same_bytes(&town(), &options, 5, 4) > 0, "{metric:?}");
    }
}

#[test]
fn a_bound_a_remeshing_and_a_bake_give_the_same_bytes() {
    let bounded = SimplifyOptions { target: Target::max_error(0.05), ..ratio(1.0) };
    let remeshed = SimplifyOptions { remesh: Some(CvdSettings::default()), ..ratio(0.3) };
    let baked = SimplifyOptions { textures: drystone::options::TextureFiles::Bake, atlas: 256, ..ratio(0.2) };
    for options in [bounded, remeshed, baked] {
        assert!(same_bytes(&town(), &in_many_clusters(options), 5, 5) > 0);
    }
}

/// A folder of meshes: labels that several use, normals, colours, polygons, an own library, a PLY.
fn tiles(folder: &Path) -> PathBuf {
    let tiles = folder.join("tiles");
    std::fs::create_dir(&tiles).unwrap();
    copy_town(&tiles.join("town"));
    for path in files(&fixture("miniatures")) {
        std::fs::copy(fixture("miniatures").join(&path), tiles.join(&path)).unwrap();
    }
    std::fs::write(tiles.join("named.obj"), format!("o hill\ng grass\n{}g rock\nf 1 2 3\n", terrain(20).text()))
        .unwrap();
    std::fs::write(tiles.join("other.obj"), format!("g rock\no hill\n{}", terrain(10).text())).unwrap();
    std::fs::write(tiles.join("lacking.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/2 3/3\n").unwrap();
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
               element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 5\n1 0 5\n0 1 5\n3 0 1 2\n";
    std::fs::write(tiles.join("triangle.ply"), ply).unwrap();
    tiles
}

#[test]
fn files_are_read_elsewhere_as_here() {
    let folder = tempfile::tempdir().unwrap();
    let input = tiles(folder.path());
    for (tasks, seed) in [(3, 10), (64, 11)] {
        let [alone, helped] = ["alone", "helped"].map(|name| folder.path().join(format!("{name}-{tasks}")));
        let options = in_many_clusters(ratio(0.5));
        let expected = pipeline::simplify(&*input, &alone.join("out.obj"), &options, &Silent).unwrap();
        let hands = Arc::new(Careless { seed, ..Careless::default() });
        let options = SimplifyOptions { job: by(hands.clone(), tasks), ..options };
        let report = pipeline::simplify(&*input, &helped.join("out.obj"), &options, &Silent).unwrap();
        assert!(contents(&alone) == contents(&helped));
        hands.check_attempts();
        assert!(hands.kinds.lock().unwrap().contains("scan"));
        assert_eq!(report.warnings, expected.warnings);
        assert!(!report.warnings.is_empty());
    }
}

#[test]
fn a_file_that_cannot_be_read_elsewhere_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let input = tiles(folder.path());
    std::fs::write(input.join("named.obj"), "v 0 0 0\nf 1 2 3\n").unwrap();
    let options = SimplifyOptions { job: by(Arc::new(Careless::default()), 3), ..ratio(0.5) };
    let error = pipeline::simplify(&*input, &folder.path().join("out.obj"), &options, &Silent).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Input, "{error}");
    assert!(error.to_string().contains("named.obj:2: "), "{error}");
}

#[test]
fn a_pyramid_has_the_same_bytes() {
    for (colours, seed) in [(true, 8), (false, 9)] {
        let folder = tempfile::tempdir().unwrap();
        let input = if colours { town() } else { folder.path().join("terrain.obj") };
        if !colours {
            std::fs::write(&input, terrain(80).text()).unwrap();
        }
        let options = TileOptions { tile_faces: 400, tile_side: 256, ..TileOptions::default() };
        let [alone, helped] = ["alone", "helped"].map(|name| folder.path().join(name));
        let expected = pipeline::tile(&*input, &alone, &options, &Silent).unwrap();
        let hands = Arc::new(Careless { seed, ..Careless::default() });
        let report = pipeline::tile(&*input, &helped, &TileOptions { job: by(hands.clone(), 5), ..options }, &Silent);
        assert_eq!(report.unwrap().levels, expected.levels);
        assert!(contents(&alone) == contents(&helped));
        hands.check_attempts();
        assert!(hands.kinds.lock().unwrap().contains("tile"));
    }
}

/// Counts what a phase is told to have done.
#[derive(Debug, Default)]
struct Counting {
    phases: Mutex<Vec<(&'static str, u64, u64)>>,
}

impl Progress for Counting {
    fn begin(&self, phase: &'static str, total: u64, _unit: &'static str) {
        self.phases.lock().unwrap().push((phase, total, 0));
    }

    fn advance(&self, units: u64) {
        self.phases.lock().unwrap().last_mut().unwrap().2 += units;
    }
}

#[test]
fn progress_counts_every_task_once() {
    let folder = tempfile::tempdir().unwrap();
    let (hands, progress) = (Arc::new(Careless { seed: 3, ..Careless::default() }), Counting::default());
    let options = SimplifyOptions { job: by(hands.clone(), 6), ..in_many_clusters(ratio(0.3)) };
    pipeline::simplify(town(), &folder.path().join("out.obj"), &options, &progress).unwrap();
    assert!(hands.lent.load(Ordering::Relaxed) > hands.seen.lock().unwrap().len(), "no stage was lent twice");
    let phases = progress.phases.into_inner().unwrap();
    let simplified: Vec<_> = phases.into_iter().filter(|&(phase, ..)| phase == "simplify").collect();
    assert!(!simplified.is_empty());
    for (phase, total, done) in simplified {
        assert_eq!(done, total, "{phase}");
    }
}

/// Breaks down.
#[derive(Debug)]
struct Broken;

impl Hands for Broken {
    fn lend(&self, _stage: &Stage, _progress: &dyn Progress) -> Result<HandsEnd> {
        panic!("these hands are broken")
    }
}

#[test]
fn a_panic_of_the_hands_comes_out() {
    let folder = tempfile::tempdir().unwrap();
    let panic = std::panic::catch_unwind(|| town_elsewhere(folder.path(), Arc::new(Broken))).unwrap_err();
    assert_eq!(panic.downcast_ref::<&str>(), Some(&"these hands are broken"));
}

#[test]
fn trials_and_clusters_that_pass_through_give_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("terrain.obj");
    std::fs::write(&input, terrain(80).text()).unwrap();
    for faces in [6_000, 1_501] {
        let options = SimplifyOptions { target: Target::faces(faces), ..SimplifyOptions::default() };
        assert!(same_bytes(&input, &in_many_clusters(options), 6, 6) > 0, "{faces}");
    }
    // Copies of one face, which no cut divides.
    std::fs::write(&input, terrain(50).text() + &"f 1 2 3\n".repeat(6_000)).unwrap();
    assert!(same_bytes(&input, &in_many_clusters(ratio(0.5)), 6, 7) > 0);
}

/// Does nothing, or fails, as it is told.
#[derive(Debug)]
struct Idle(Option<ErrorKind>);

impl Hands for Idle {
    fn lend(&self, stage: &Stage, _progress: &dyn Progress) -> Result<HandsEnd> {
        if let Some(kind) = self.0 {
            let error = drystone::Error::Elsewhere { kind, message: "of no use".into() };
            note_failure(&stage.path(), 1, &error);
            let seen = drystone::job::look(stage.work()).unwrap().stage.unwrap();
            assert_eq!((seen.tasks, seen.tasks_done, seen.tasks_failed), (6, 0, 1));
            assert!(seen.failure.unwrap().ends_with("of no use"));
        }
        Ok(HandsEnd::Unsure { exit_code: Some(7) })
    }

    fn patience(&self) -> Duration {
        Duration::from_millis(1)
    }
}

fn town_elsewhere(folder: &Path, hands: impl Into<SharedHands>) -> Result<drystone::Report> {
    let options = SimplifyOptions { job: by(hands, 6), ..in_many_clusters(ratio(0.3)) };
    pipeline::simplify(town(), &folder.join("out.obj"), &options, &Silent)
}

#[test]
fn a_task_without_a_result_ends_the_job_and_the_same_call_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let error = town_elsewhere(folder.path(), Arc::new(Idle(None))).unwrap_err();
    assert!(error.to_string().contains("task 0 of 6 tasks has no result after 3 tries"), "{error}");
    assert_eq!(error.kind(), ErrorKind::Task);
    assert!(matches!(error, drystone::Error::Task { task: 0, exit_code: Some(7), .. }), "{error:?}");
    let work = folder.path().join("out.obj.work");
    assert_eq!(stages(&work).len(), 1);
    let hands = Arc::new(Careless::default());
    let report = town_elsewhere(folder.path(), hands.clone()).unwrap();
    assert!(report.resumed && hands.done.load(Ordering::Relaxed) > 0 && !work.exists());
}

#[test]
fn a_task_that_fails_everywhere_is_not_tried_again() {
    for kind in [ErrorKind::Changed, ErrorKind::Damaged, ErrorKind::NoSpace, ErrorKind::Budget] {
        let folder = tempfile::tempdir().unwrap();
        let error = town_elsewhere(folder.path(), Arc::new(Idle(Some(kind)))).unwrap_err();
        assert!(error.kind() == kind && error.to_string().starts_with("task 1 failed on "), "{error}");
        assert!(error.to_string().ends_with(": of no use"), "{error}");
    }
    let folder = tempfile::tempdir().unwrap();
    let error = town_elsewhere(folder.path(), Arc::new(Idle(Some(ErrorKind::Io)))).unwrap_err();
    assert!(error.to_string().contains("after 3 tries; task 1 failed on"), "{error}");
}

/// Waits until the job is to stop, which another process takes over meanwhile.
#[derive(Debug, Default)]
struct Overtaken {
    is_told: AtomicBool,
}

impl Hands for Overtaken {
    fn lend(&self, stage: &Stage, progress: &dyn Progress) -> Result<HandsEnd> {
        let [lease, theirs] = ["lease", "lease.theirs"].map(|name| stage.work().join(name));
        std::fs::write(&theirs, "00000000000000aa 0000000000000001 another-machine 7").unwrap();
        std::fs::rename(&theirs, &lease).unwrap();
        let began = Instant::now();
        while !progress.is_stopped() && began.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(10));
        }
        self.is_told.store(progress.is_stopped(), Ordering::Relaxed);
        Err(drystone::Error::Stopped)
    }
}

#[test]
fn tasks_of_a_job_that_another_process_took_over_are_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let hands = Arc::new(Overtaken::default());
    let error = town_elsewhere(folder.path(), hands.clone()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Locked, "{error}");
    assert!(hands.is_told.load(Ordering::Relaxed));
}

/// Finds a full disk, or a stage of another format.
#[derive(Debug)]
struct Unlucky {
    is_full: bool,
}

impl Hands for Unlucky {
    fn lend(&self, stage: &Stage, _progress: &dyn Progress) -> Result<HandsEnd> {
        if self.is_full {
            // What a process leaves that has no room to say why it failed.
            for name in ["task-2.error", "task-2.full"] {
                std::fs::write(stage.path().with_file_name(name), "").unwrap();
            }
            return Ok(HandsEnd::Unsure { exit_code: None });
        }
        let mut bytes = std::fs::read(stage.path()).unwrap();
        bytes[16] = bytes[16].wrapping_add(1);
        seal(bytes.first_chunk_mut().unwrap());
        std::fs::write(stage.path(), bytes).unwrap();
        let error = do_task(&stage.path(), 2, LIMITS, &Silent).unwrap_err();
        assert!(error.to_string().contains("made by another drystone"), "{error}");
        Ok(HandsEnd::Unsure { exit_code: Some(7) })
    }

    fn patience(&self) -> Duration {
        Duration::from_millis(1)
    }
}

/// Leaves the traces of results that were taken, but not the results: what a power cut may leave.
#[derive(Debug)]
struct Forgetful;

impl Hands for Forgetful {
    fn lend(&self, stage: &Stage, _progress: &dyn Progress) -> Result<HandsEnd> {
        stage.tasks().iter().for_each(|task| std::fs::write(stage.file_of(task, "taken"), "").unwrap());
        Ok(HandsEnd::Unsure { exit_code: Some(7) })
    }

    fn patience(&self) -> Duration {
        Duration::from_millis(1)
    }
}

#[test]
fn a_task_that_was_taken_and_lost_is_done_again() {
    let folder = tempfile::tempdir().unwrap();
    town_elsewhere(folder.path(), Arc::new(Forgetful)).unwrap_err();
    let report = town_elsewhere(folder.path(), Arc::new(Careless::default())).unwrap();
    assert!(report.resumed);
}

#[test]
fn a_full_disk_and_another_program_are_told_at_once() {
    for (is_full, kind) in [(true, ErrorKind::NoSpace), (false, ErrorKind::Changed)] {
        let folder = tempfile::tempdir().unwrap();
        let error = town_elsewhere(folder.path(), Arc::new(Unlucky { is_full })).unwrap_err();
        assert!(error.kind() == kind && error.to_string().starts_with("task 2 failed on "), "{error}");
        let report = town_elsewhere(folder.path(), Arc::new(Careless::default())).unwrap();
        assert!(report.resumed);
    }
}

#[test]
fn a_task_of_a_file_that_is_no_stage_leaves_nothing_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stage.bin");
    std::fs::write(&path, "mine").unwrap();
    assert_eq!(do_task(&path, 0, LIMITS, &Silent).unwrap_err().kind(), ErrorKind::Damaged);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// Does all tasks, then spoils some results: cut short, changed, of another stage.
#[derive(Debug, Default)]
struct Spoiler {
    lent: AtomicU64,
}

impl Hands for Spoiler {
    fn lend(&self, stage: &Stage, _progress: &dyn Progress) -> Result<HandsEnd> {
        for task in 0..stage.tasks().len() {
            let end = do_task(&stage.path(), task, LIMITS, &Silent).unwrap();
            assert!(matches!(end, TaskEnd::Done | TaskEnd::WasDone), "{end:?}");
        }
        if self.lent.fetch_add(1, Ordering::Relaxed).is_multiple_of(2) {
            for (task, ending) in [(0, "results"), (1, "piece")] {
                let path = stage.file_of(&stage.tasks()[task], ending);
                let bytes = std::fs::read(&path).unwrap_or_default();
                std::fs::write(&path, &bytes[..bytes.len() * 2 / 3]).unwrap();
            }
            let path = stage.file_of(&stage.tasks()[2], "results");
            let mut bytes = std::fs::read(&path).unwrap();
            let at = bytes.len() / 2;
            bytes[at] ^= 1;
            std::fs::write(&path, bytes).unwrap();
            std::fs::copy(stage.file_of(&stage.tasks()[4], "results"), stage.file_of(&stage.tasks()[3], "results"))
                .unwrap();
        }
        Ok(HandsEnd::Done)
    }

    fn patience(&self) -> Duration {
        Duration::from_millis(1)
    }
}

#[test]
fn spoilt_results_count_as_none() {
    let [alone, helped] = [(), ()].map(|()| tempfile::tempdir().unwrap());
    let options = in_many_clusters(ratio(0.3));
    pipeline::simplify(town(), &alone.path().join("out.obj"), &options, &Silent).unwrap();
    let options = SimplifyOptions { job: by(Arc::new(Spoiler::default()), 8), ..options };
    pipeline::simplify(town(), &helped.path().join("out.obj"), &options, &Silent).unwrap();
    assert!(result(alone.path()) == result(helped.path()));
}

/// Does all tasks; then changes a byte in the middle of every file of pieces, once for each stage.
#[derive(Debug, Default)]
struct PieceSpoiler {
    seen: Mutex<HashSet<u64>>,
    spoilt: AtomicUsize,
}

impl Hands for PieceSpoiler {
    fn lend(&self, stage: &Stage, _progress: &dyn Progress) -> Result<HandsEnd> {
        for (index, task) in stage.tasks().iter().enumerate() {
            do_task(&stage.path(), index, LIMITS, &Silent).unwrap();
            let path = stage.file_of(task, "piece");
            let Ok(mut bytes) = std::fs::read(&path) else { continue };
            if self.seen.lock().unwrap().insert(stage.id() ^ index as u64) {
                let at = bytes.len() / 2;
                bytes[at] ^= 1;
                std::fs::write(&path, bytes).unwrap();
                self.spoilt.fetch_add(1, Ordering::Relaxed);
            }
        }
        Ok(HandsEnd::Done)
    }

    fn patience(&self) -> Duration {
        Duration::from_millis(1)
    }
}

#[test]
fn a_piece_that_changed_on_a_disk_ends_the_job_and_the_same_call_goes_on() {
    let [alone, helped] = [(), ()].map(|()| tempfile::tempdir().unwrap());
    pipeline::simplify(town(), &alone.path().join("out.obj"), &in_many_clusters(ratio(0.3)), &Silent).unwrap();
    let hands = Arc::new(PieceSpoiler::default());
    let error = town_elsewhere(helped.path(), hands.clone()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Damaged, "{error}");
    assert!(hands.spoilt.load(Ordering::Relaxed) > 0 && !helped.path().join("out.obj").exists());
    town_elsewhere(helped.path(), Arc::new(Careless::default())).unwrap();
    assert!(result(alone.path()) == result(helped.path()));
}

#[test]
fn colours_that_changed_on_a_disk_are_computed_again() {
    let [alone, helped] = [(), ()].map(|()| tempfile::tempdir().unwrap());
    let coloured = |(number, line): (usize, &str)| {
        let colour = if line.starts_with("v ") { format!(" {} 0.5 0.25", noise(number, 1, 7)) } else { String::new() };
        format!("{line}{colour}\n")
    };
    let text: String = terrain(80).text().lines().enumerate().map(coloured).collect();
    let input = alone.path().join("coloured.obj");
    std::fs::write(&input, text).unwrap();
    let options = in_many_clusters(ratio(0.3));
    let [expected, found] = [&alone, &helped].map(|folder| folder.path().join("out.obj"));
    pipeline::simplify(input.as_path(), &expected, &options, &Silent).unwrap();
    let hands = Arc::new(PieceSpoiler::default());
    let options = SimplifyOptions { job: by(hands.clone(), 8), ..options };
    pipeline::simplify(input.as_path(), &found, &options, &Silent).unwrap();
    assert!(hands.spoilt.load(Ordering::Relaxed) > 8);
    assert!(std::fs::read(expected).unwrap() == std::fs::read(found).unwrap());
}

/// Keeps the paths of stages, and does their tasks.
#[derive(Debug, Default)]
struct Late {
    stages: Mutex<Vec<PathBuf>>,
}

impl Hands for Late {
    fn lend(&self, stage: &Stage, progress: &dyn Progress) -> Result<HandsEnd> {
        for path in self.stages.lock().unwrap().iter() {
            assert_eq!(do_task(path, 0, LIMITS, &Silent).unwrap(), TaskEnd::NoStage);
        }
        self.stages.lock().unwrap().push(stage.path());
        Careless::default().lend(stage, progress)
    }

    fn patience(&self) -> Duration {
        Duration::from_millis(1)
    }
}

#[test]
fn who_comes_late_changes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let hands = Arc::new(Late::default());
    town_elsewhere(folder.path(), hands.clone()).unwrap();
    let before = contents(folder.path());
    let stages = hands.stages.lock().unwrap();
    assert!(stages.len() >= 3);
    for path in stages.iter() {
        assert_eq!(do_task(path, 0, LIMITS, &Silent).unwrap(), TaskEnd::NoStage);
    }
    assert!(before == contents(folder.path()));
}

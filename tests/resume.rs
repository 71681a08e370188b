//! Interrupted jobs: whatever happens to the process, its files or its disk, the result is that of an undisturbed run, or
//! there is a message and no result.

mod meshes;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use drystone::base::{Error, ErrorKind, Progress, Result, Silent, chance};
use drystone::options::{
    ImageFormat, JobOptions, Limits, MetricChoice, Pieces, ResumeChoice, SimplifyOptions, Target, TextureFiles,
    Topology,
};
use drystone::pipeline;
use drystone::report::Report;
use meshes::{StopAfter, contents, copy_town, files, in_many_clusters, noise, ratio};

/// A copy of the town, so that it can be changed, and a place for the result.
struct Job {
    folder: tempfile::TempDir,
}

impl Job {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        copy_town(&folder.path().join("in"));
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn work(&self) -> PathBuf {
        self.path("out/town.obj.work")
    }

    fn options(&self) -> SimplifyOptions {
        SimplifyOptions {
            limits: Limits { threads: Some(2), ..in_many_clusters(ratio(0.1)).limits },
            ..in_many_clusters(ratio(0.1))
        }
    }

    fn run_with(&self, options: &SimplifyOptions, progress: &dyn Progress) -> Result<Report> {
        pipeline::simplify(self.path("in/town.obj"), &self.path("out/town.obj"), options, progress)
    }

    fn run(&self) -> Result<Report> {
        self.run_with(&self.options(), &Silent)
    }

    /// Stops after so many units; whether that came before the end.
    fn stop_after(&self, units: u64) -> bool {
        match self.run_with(&self.options(), &StopAfter::units(units)) {
            Err(Error::Stopped) => true,
            outcome => outcome.map(|_| false).unwrap(),
        }
    }

    /// Every file of the result.
    fn result(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        contents(&self.path("out"))
    }

    fn command(&self) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_drystone"));
        command.arg("simplify").arg(self.path("in/town.obj")).arg("-o").arg(self.path("out/town.obj"));
        command.args(["--ratio", "0.1", "--cluster-faces", "1000", "--threads", "2", "--memory", "256MiB", "--force"]);
        command.stdin(Stdio::null());
        command
    }
}

fn undisturbed() -> BTreeMap<PathBuf, Vec<u8>> {
    let job = Job::new();
    job.run().unwrap();
    job.result()
}

#[test]
fn a_job_that_is_stopped_again_and_again_ends_with_the_same_bytes() {
    let expected = undisturbed();
    for units in [2, 7, 40] {
        let job = Job::new();
        let mut stops = 0;
        // What is kept is told again on the way to where the work goes on.
        while job.stop_after(units + 2 * stops) {
            stops += 1;
            assert!(stops < 500, "no progress from stop to stop");
            assert!(!job.path("out/town.obj").exists());
        }
        assert!(stops > 0, "{units}");
        assert_eq!(job.result(), expected);
        assert!(!job.work().exists());
    }
}

/// Stops once a pass is run for the second time.
#[derive(Default)]
struct StopInSecondRun {
    runs: AtomicU64,
}

impl Progress for StopInSecondRun {
    fn begin_pass(&self, _: usize) {
        self.runs.store(0, Ordering::SeqCst);
    }

    fn begin(&self, phase: &'static str, _: u64, _: &'static str) {
        if phase == "simplify" || phase == "stitch" {
            self.runs.fetch_add(1, Ordering::SeqCst);
        }
    }

    fn advance(&self, _: u64) {}

    fn is_stopped(&self) -> bool {
        self.runs.load(Ordering::SeqCst) > 1
    }
}

#[test]
fn a_job_that_was_stopped_measures_what_an_undisturbed_one_does() {
    let mut second_runs = 0;
    for (share, topology) in
        [(0.2, Topology::Simplify), (0.1, Topology::Keep), (0.03, Topology::Keep), (0.005, Topology::Keep)]
    {
        let options = SimplifyOptions {
            limits: Limits { threads: Some(2), ..in_many_clusters(ratio(share)).limits },
            topology,
            ..in_many_clusters(ratio(share))
        };
        let undisturbed = Job::new().run_with(&options, &Silent).unwrap();
        let job = Job::new();
        let mut stops = 0;
        let resumed = loop {
            match job.run_with(&options, &StopAfter::units(2 + 2 * stops)) {
                Err(Error::Stopped) => stops += 1,
                outcome => break outcome.unwrap(),
            }
        };
        assert!(stops > 0 && undisturbed.error.measured.is_some());
        assert_eq!(resumed.error.measured, undisturbed.error.measured, "{share}");

        let job = Job::new();
        let resumed = match job.run_with(&options, &StopInSecondRun::default()) {
            Err(Error::Stopped) => {
                second_runs += 1;
                job.run_with(&options, &Silent).unwrap()
            }
            outcome => outcome.unwrap(),
        };
        assert_eq!(resumed.error.measured, undisturbed.error.measured, "{share}");
    }
    assert!(second_runs > 0, "no pass was run twice");
}

#[test]
fn a_job_that_makes_the_mesh_anew_goes_on_with_the_same_bytes() {
    let remeshed = |job: &Job| SimplifyOptions { remesh: Some(Default::default()), ..job.options() };
    let undisturbed = Job::new();
    let expected = undisturbed.run_with(&remeshed(&undisturbed), &Silent).unwrap();
    for units in [10, 60] {
        let job = Job::new();
        let mut stops = 0;
        let report = loop {
            match job.run_with(&remeshed(&job), &StopAfter::units(units + 4 * stops)) {
                Err(Error::Stopped) => stops += 1,
                outcome => break outcome.unwrap(),
            }
            assert!(stops < 200, "no progress from stop to stop");
        };
        assert!(stops > 0, "{units}");
        assert_eq!(job.result(), undisturbed.result());
        assert!(report.error.measured.is_some());
        assert_eq!(report.error.measured, expected.error.measured);
    }
}

#[test]
fn what_is_finished_is_not_done_again() {
    let job = Job::new();
    assert!(job.stop_after(30));
    let piece = files(&job.work()).into_iter().find(|path| path.extension().is_some_and(|e| e == "piece")).unwrap();
    let written = fs::metadata(job.work().join(&piece)).unwrap().modified().unwrap();
    assert!(job.stop_after(8));
    assert_eq!(fs::metadata(job.work().join(&piece)).unwrap().modified().unwrap(), written);
    let report = job.run().unwrap();
    assert!(report.resumed);
    assert!((report.faces.target - 1..=report.faces.target).contains(&report.faces.output), "{:?}", report.faces);
}

/// Ways to damage a file.
fn damaged(bytes: &[u8], way: usize, seed: usize) -> Option<Vec<u8>> {
    let at = ((noise(seed, way, 7) * bytes.len() as f64) as usize).min(bytes.len().saturating_sub(1));
    if bytes.is_empty() {
        return None;
    }
    let mut out = bytes.to_vec();
    match way {
        0 => out[at] ^= 1 << (seed % 8),
        1 => out[at.min(63)] ^= 0x41,
        2 => out.truncate(at),
        3 => out.extend_from_slice(&[0; 100]),
        4 => out.clear(),
        5 => out[at / 4096 * 4096..].iter_mut().take(4096).for_each(|byte| *byte = 0),
        6 => out.iter_mut().rev().take(17).for_each(|byte| *byte = 0),
        _ => return None,
    }
    Some(out)
}

#[test]
fn damaged_files_are_done_again_or_reported() {
    let expected = undisturbed();
    let ways = std::env::var("DRYSTONE_DAMAGES").ok().and_then(|ways| ways.parse().ok()).unwrap_or(1);
    for units in [9, 45] {
        let job = Job::new();
        assert!(job.stop_after(units));
        let half_done: Vec<(PathBuf, Vec<u8>)> = files(&job.work())
            .into_iter()
            .map(|name| (name.clone(), fs::read(job.work().join(name)).unwrap()))
            .collect();
        let (mut healed, mut reported) = (0, 0);
        for (seed, (name, whole)) in half_done.iter().enumerate() {
            // Each file in turn, in one of eight ways; `DRYSTONE_DAMAGES=8` in all of them.
            for way in (0..ways).map(|way| (seed + 3 * way) % 8) {
                fs::remove_dir_all(job.path("out")).unwrap();
                fs::create_dir_all(job.work()).unwrap();
                half_done.iter().for_each(|(name, bytes)| fs::write(job.work().join(name), bytes).unwrap());
                let shown = format!("{} in way {way}", name.display());
                match damaged(whole, way, seed) {
                    Some(bytes) => fs::write(job.work().join(name), bytes).unwrap(),
                    None => fs::remove_file(job.work().join(name)).unwrap(),
                }
                match job.run() {
                    Ok(_) => {
                        healed += 1;
                        assert_eq!(job.result(), expected, "{shown}");
                    }
                    Err(error) => {
                        reported += 1;
                        assert!([ErrorKind::Changed, ErrorKind::Damaged].contains(&error.kind()), "{shown}: {error}");
                        assert!(!job.path("out/town.obj").exists());
                    }
                }
            }
        }
        assert!(healed > reported, "{healed} {reported}");
    }
}

#[test]
fn a_damaged_file_is_an_error_where_resuming_is_required() {
    let job = Job::new();
    assert!(job.stop_after(30));
    for name in
        files(&job.work()).into_iter().filter(|name| name.extension().is_some_and(|e| e == "col" || e == "buckets"))
    {
        let path = job.work().join(&name);
        let mut bytes = fs::read(&path).unwrap();
        bytes[100] ^= 1;
        fs::write(&path, bytes).unwrap();
    }
    let required =
        SimplifyOptions { job: JobOptions { resume: ResumeChoice::Require, ..job.options().job }, ..job.options() };
    let error = job.run_with(&required, &Silent).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Damaged, "{error}");
    assert!(error.to_string().contains("checksum"), "{error}");
}

#[test]
fn another_input_or_other_options_are_refused_with_what_differs() {
    type Change = fn(&Job);
    let changes: [(&str, Change, &str); 4] = [
        ("in/town.obj", |job| edit(&job.path("in/town.obj"), b"v ", b"v -"), "bytes long"),
        ("in/town.obj", |job| edit(&job.path("in/town.obj"), b"# ", b"#!"), "has changed"),
        ("in/town.mtl", |job| edit(&job.path("in/town.mtl"), b"Kd 1", b"Kd 0"), "has changed"),
        ("in/roof.jpg", |job| fs::remove_file(job.path("in/roof.jpg")).unwrap(), "is missing now"),
    ];
    for (name, change, words) in changes {
        let job = Job::new();
        assert!(job.stop_after(30));
        change(&job);
        let error = job.run().unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Changed, "{error}");
        let (text, name) = (error.to_string(), Path::new(name).file_name().unwrap().to_str().unwrap().to_owned());
        assert!(text.contains(words) && text.contains(&name) && text.contains("`resume: never`"), "{text}");
        let afresh =
            SimplifyOptions { job: JobOptions { resume: ResumeChoice::Never, ..job.options().job }, ..job.options() };
        assert!(!job.run_with(&afresh, &Silent).unwrap().resumed);
    }
    let job = Job::new();
    assert!(job.stop_after(30));
    let other = SimplifyOptions { target: Target::ratio(0.2), ..job.options() };
    let error = job.run_with(&other, &Silent).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Changed);
    assert!(error.to_string().contains("`ratio` was 0.1, is 0.2"), "{error}");
    let same = SimplifyOptions { limits: Limits { threads: Some(1), memory: Some(200 << 20) }, ..job.options() };
    assert!(job.run_with(&same, &Silent).unwrap().resumed);
    assert_eq!(job.result(), undisturbed());
}

#[test]
fn libraries_that_the_names_lead_to_now_count() {
    // A file named like the whole statement comes before those named by its words.
    let job = Job::new();
    edit(&job.path("in/town.obj"), b"mtllib town.mtl", b"mtllib town.mtl b.mtl");
    assert!(job.stop_after(9));
    fs::copy(job.path("in/town.mtl"), job.path("in/town.mtl b.mtl")).unwrap();
    let error = job.run().unwrap_err();
    assert!(
        error.kind() == ErrorKind::Changed && error.to_string().contains("was missing and is there now"),
        "{error}"
    );
    fs::remove_file(job.path("in/town.mtl b.mtl")).unwrap();
    // A folder of that name is no library.
    fs::create_dir(job.path("in/b.mtl")).unwrap();
    assert!(job.run().unwrap().resumed);
}

#[cfg(unix)]
#[test]
fn a_library_in_a_folder_that_is_another_one_now_is_told() {
    let job = Job::new();
    let link = |folder: &str| {
        let _ = fs::remove_file(job.path("in/library"));
        std::os::unix::fs::symlink(job.path(folder), job.path("in/library")).unwrap();
    };
    copy_town(&job.path("in/one"));
    copy_town(&job.path("in/other"));
    edit(&job.path("in/town.obj"), b"mtllib town.mtl", b"mtllib library/town.mtl");
    link("in/one");
    assert!(job.stop_after(9));
    link("in/other");
    let error = job.run().unwrap_err();
    assert!(error.kind() == ErrorKind::Changed && error.to_string().contains("leads to another place"), "{error}");
    link("in/one");
    assert!(job.run().unwrap().resumed);
}

#[test]
fn a_job_is_done_only_when_what_comes_after_it_is() {
    let job = Job::new();
    let [input, output] = ["in/town.obj", "out/town.obj"].map(|name| job.path(name));
    let run =
        |then: fn() -> Result<()>| pipeline::simplify_and(&input, &output, &job.options(), &Silent, |_, _| then());
    assert!(matches!(run(|| Err(Error::Stopped)), Err(Error::Stopped)));
    let written = fs::metadata(&output).unwrap().modified().unwrap();
    assert!(run(|| Ok(())).unwrap().resumed);
    assert_eq!(fs::metadata(&output).unwrap().modified().unwrap(), written);
    assert_eq!(job.result(), undisturbed());
}

#[test]
fn a_job_that_is_refused_removes_nothing() {
    let job = Job::new();
    assert!(job.stop_after(20));
    fs::write(job.path("out/town.obj"), "of the user").unwrap();
    let before = contents(&job.work());
    let never =
        SimplifyOptions { job: JobOptions { resume: ResumeChoice::Never, ..job.options().job }, ..job.options() };
    assert_eq!(job.run_with(&never, &Silent).unwrap_err().kind(), ErrorKind::Usage);
    assert_eq!(contents(&job.work()), before);
    fs::remove_file(job.path("out/town.obj")).unwrap();
    assert!(job.run().unwrap().resumed);
}

#[test]
fn a_work_folder_of_the_users_stays() {
    let job = Job::new();
    let work = job.path("scratch");
    fs::create_dir(&work).unwrap();
    let options =
        SimplifyOptions { job: JobOptions { work: Some(work.clone()), ..job.options().job }, ..job.options() };
    assert!(matches!(job.run_with(&options, &StopAfter::units(9)), Err(Error::Stopped)));
    job.run_with(&options, &Silent).unwrap();
    assert_eq!(fs::read_dir(&work).unwrap().count(), 0);
}

/// Replaces the first occurrence of some bytes; a file of the same length keeps its date.
fn edit(path: &Path, from: &[u8], to: &[u8]) {
    let date = fs::metadata(path).unwrap().modified().unwrap();
    let mut bytes = fs::read(path).unwrap();
    let at = bytes.windows(from.len()).position(|window| window == from).unwrap();
    bytes.splice(at..at + from.len(), to.iter().copied());
    fs::write(path, bytes).unwrap();
    fs::File::options().write(true).open(path).unwrap().set_modified(date).unwrap();
}

#[test]
fn a_second_process_is_refused_at_once_and_a_dead_one_is_no_obstacle() {
    let job = Job::new();
    let mut first = job.command().spawn().unwrap();
    let began = Instant::now();
    while !job.work().join("journal.bin").exists() && began.elapsed() < Duration::from_secs(20) {
        std::thread::sleep(Duration::from_millis(2));
    }
    let second = job.command().output().unwrap();
    if first.try_wait().unwrap().is_none() {
        assert_eq!(second.status.code(), Some(6), "{}", words(&second));
    }
    let _ = first.kill();
    first.wait().unwrap();
    assert!(job.command().status().unwrap().success());
    assert_eq!(job.result(), undisturbed());
}

fn words(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Kills of the test of kills; `DRYSTONE_KILLS` asks for more.
const KILLS: usize = 12;

fn kill_count(usual: usize) -> usize {
    std::env::var("DRYSTONE_KILLS").ok().and_then(|kills| kills.parse().ok()).unwrap_or(usual)
}

/// Kills the program at places drawn at random, up to five times on the way to one result, until so many kills came before the end.
fn kill_with(more: &[&str], kills: usize) {
    let calm = Job::new();
    let began = Instant::now();
    assert!(calm.command().args(more).status().unwrap().success(), "{more:?}");
    let (whole, expected) = (began.elapsed(), calm.result());
    let mut killed = 0;
    for chain in 0..20 * kills {
        let job = Job::new();
        for link in 0..1 + chain % 5 {
            let mut process = job.command().args(more).stderr(Stdio::null()).spawn().unwrap();
            std::thread::sleep(whole.mul_f64(noise(chain, link, 11)));
            let _ = process.kill();
            if process.wait().unwrap().success() {
                break;
            }
            killed += 1;
            let result = fs::read(job.path("out/town.obj")).ok();
            assert!(result.is_none() || result == expected.get(Path::new("town.obj")).cloned(), "a partial result");
        }
        assert!(job.command().args(more).stderr(Stdio::null()).status().unwrap().success(), "{more:?}");
        assert!(job.result() == expected, "{more:?}: other bytes after {killed} kills");
        if killed >= kills {
            return;
        }
    }
    panic!("{more:?}: only {killed} of {kills} kills came before the end");
}

#[test]
fn a_job_that_is_killed_at_any_time_ends_with_the_same_bytes() {
    let calm = Job::new();
    assert!(calm.command().status().unwrap().success());
    assert_eq!(calm.result(), undisturbed());
    kill_with(&[], kill_count(KILLS));
}

/// Kills with each of the papers' systems.
const KILLS_OF_A_SYSTEM: usize = 4;

#[test]
fn a_job_of_any_papers_metric_that_is_killed_ends_with_the_same_bytes() {
    for metric in ["qem-1997", "oblique", "curvature", "terrain", "sharpness"] {
        kill_with(&["--metric", metric, "--optimize"], kill_count(KILLS_OF_A_SYSTEM));
    }
}

#[test]
fn a_job_that_remeshes_and_is_killed_ends_with_the_same_bytes() {
    kill_with(&["--remesh", "cvd"], kill_count(KILLS_OF_A_SYSTEM));
    kill_with(&["--remesh", "cvd", "--metric", "qem-1997", "--optimize"], kill_count(KILLS_OF_A_SYSTEM));
}

/// What one process leaves for the next differs from option to option.
fn stop_with(options: &SimplifyOptions) {
    let calm = Job::new();
    calm.run_with(options, &Silent).unwrap();
    for units in [3, 11, 40] {
        let job = Job::new();
        let mut stops = 0;
        while let Err(error) = job.run_with(options, &StopAfter::units(units + 2 * stops)) {
            assert!(matches!(error, Error::Stopped), "{error}");
            stops += 1;
        }
        assert!(stops > 0);
        assert_eq!(job.result(), calm.result(), "{units} units");
    }
}

#[test]
fn a_stopped_job_that_drops_small_pieces_ends_with_the_same_bytes() {
    stop_with(&SimplifyOptions { pieces: Pieces::Drop, ..in_many_clusters(ratio(0.05)) });
}

#[test]
fn a_stopped_job_with_a_bound_ends_with_the_same_bytes() {
    stop_with(&SimplifyOptions { target: Target::max_error(0.3), ..in_many_clusters(ratio(0.5)) });
}

#[test]
fn a_stopped_job_whose_metric_counts_first_ends_with_the_same_bytes() {
    stop_with(&SimplifyOptions {
        metric: Some(MetricChoice::Curvature),
        optimize: true,
        ..in_many_clusters(ratio(0.3))
    });
}

#[test]
fn a_stopped_job_that_takes_one_edge_at_a_time_ends_with_the_same_bytes() {
    let metric_option = vec!["carry=0".into()];
    let options =
        SimplifyOptions { metric: Some(MetricChoice::Terrain), metric_option, one_by_one: true, ..ratio(0.3) };
    stop_with(&in_many_clusters(options));
}

#[test]
fn a_stopped_job_that_remeshes_ends_with_the_same_bytes() {
    stop_with(&SimplifyOptions { remesh: Some("cvd".parse().unwrap()), ..in_many_clusters(ratio(0.3)) });
}

#[test]
fn a_result_that_has_its_name_is_not_written_again() {
    let job = Job::new();
    let kept = SimplifyOptions { job: JobOptions { keep_work: true, ..job.options().job }, ..job.options() };
    job.run_with(&kept, &Silent).unwrap();
    let written = fs::metadata(job.path("out/town.obj")).unwrap().modified().unwrap();
    job.run().unwrap();
    assert_eq!(fs::metadata(job.path("out/town.obj")).unwrap().modified().unwrap(), written);
    assert!(!job.work().exists());
    let error = job.run().unwrap_err();
    assert!(error.to_string().contains("`force`"), "{error}");
}

#[cfg(unix)]
#[test]
fn signals_stop_a_job_that_goes_on_later() {
    let expected = undisturbed();
    for (name, code) in [("INT", 130), ("TERM", 143), ("HUP", 129)] {
        let job = Job::new();
        let process = job.command().stderr(Stdio::piped()).spawn().unwrap();
        let began = Instant::now();
        while !job.work().join("scan-mesh.state").exists()
            && !has_pieces(&job)
            && began.elapsed() < Duration::from_secs(20)
        {
            std::thread::sleep(Duration::from_millis(1));
        }
        let kill = Command::new("kill").args(["-s", name, &process.id().to_string()]).status().unwrap();
        let sent = Instant::now();
        let output = process.wait_with_output().unwrap();
        assert!(sent.elapsed() < Duration::from_secs(5));
        if kill.success() && !output.status.success() {
            assert_eq!(output.status.code(), Some(code), "{}", words(&output));
            let text = words(&output);
            assert!(text.contains(&format!("stopped by SIG{name}")) && text.contains("--cluster-faces 1000"), "{text}");
            assert!(!job.path("out/town.obj").exists());
        }
        assert!(job.command().status().unwrap().success());
        assert_eq!(job.result(), expected);
    }
}

fn has_pieces(job: &Job) -> bool {
    files(&job.work()).iter().any(|path| path.extension().is_some_and(|extension| extension == "piece"))
}

#[test]
fn the_status_of_a_stopped_job_says_what_is_done_and_why_it_ended() {
    let job = Job::new();
    assert!(job.stop_after(30));
    let mut command = Command::new(env!("CARGO_BIN_EXE_drystone"));
    let output = command.arg("status").arg(job.work()).arg("--json").output().unwrap();
    assert!(output.status.success(), "{}", words(&output));
    let status: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(status["running"], false);
    assert_eq!(status["triangles"], 18_218);
    assert_eq!(status["last_error"], "stopped");
    assert!(status["pass"]["number"].as_u64().unwrap() >= 1);
    let done = status["pass"]["clusters_done"].as_u64().unwrap();
    assert!(done > 0 && done < status["pass"]["clusters"].as_u64().unwrap(), "{status}");
    assert!(status["bytes"].as_u64().unwrap() > 100_000);
}

/// A file system of a few bytes, where the system and the user allow it.
#[cfg(target_os = "linux")]
struct SmallDisk {
    folder: tempfile::TempDir,
}

#[cfg(target_os = "linux")]
impl SmallDisk {
    fn mount(bytes: u64) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let mut command = Command::new("mount");
        command.args(["-t", "tmpfs", "-o", &format!("size={bytes}"), "drystone-test"]).arg(folder.path());
        command.stderr(Stdio::null()).status().is_ok_and(|status| status.success()).then_some(Self { folder })
    }

    fn grow(&self, bytes: u64) {
        let mut command = Command::new("mount");
        command.args(["-o", &format!("remount,size={bytes}")]).arg(self.folder.path());
        assert!(command.status().unwrap().success());
    }
}

#[cfg(target_os = "linux")]
impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.folder.path()).status();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_an_error_and_the_job_goes_on_when_there_is_space() {
    let expected = undisturbed();
    for which in ["work", "out"] {
        for kib in [64, 300, 700, 1200, 1700] {
            let Some(disk) = SmallDisk::mount(kib << 10) else {
                eprintln!("skipped: this user may not mount a small disk");
                return;
            };
            let job = Job::new();
            let options = SimplifyOptions {
                job: JobOptions { work: Some(disk.folder.path().join("work")), ..job.options().job },
                ..job.options()
            };
            if which == "out" {
                fs::create_dir_all(disk.folder.path().join("out")).unwrap();
                std::os::unix::fs::symlink(disk.folder.path().join("out"), job.path("out")).unwrap();
            }
            let options = if which == "out" {
                SimplifyOptions { job: JobOptions { work: Some(job.path("work")), ..options.job.clone() }, ..options }
            } else {
                options
            };
            if let Err(error) = job.run_with(&options, &Silent) {
                assert_eq!(error.kind(), ErrorKind::NoSpace, "{which} {kib} KiB: {error}");
                assert!(error.to_string().contains("space"), "{error}");
                assert!(!job.path("out/town.obj").exists());
            }
            disk.grow(64 << 20);
            let again = SimplifyOptions { job: JobOptions { force: true, ..options.job.clone() }, ..options };
            job.run_with(&again, &Silent).unwrap();
            assert_eq!(job.result(), expected, "{which} {kib} KiB");
        }
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_disk_that_a_new_image_fills_is_told_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // Three bytes a pixel, however they are packed.
    let channel = |x: u32, y: u32, channel: u64| (256.0 * chance::of_stream(x.into(), y.into(), channel)) as u8;
    let noise = |x: u32, y: u32| image::Rgb([0, 1, 2].map(|number| channel(x, y, number)));
    image::RgbImage::from_fn(1024, 1024, noise).save(path("a.png")).unwrap();
    fs::write(path("a.mtl"), "newmtl a\nmap_Kd a.png\n").unwrap();
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n";
    fs::write(path("a.obj"), format!("mtllib a.mtl\nusemtl a\n{square}")).unwrap();
    for kib in [4600, 5200, 5800] {
        let Some(disk) = SmallDisk::mount(kib << 10) else {
            eprintln!("skipped: this user may not mount a small disk");
            return;
        };
        let work = Some(disk.folder.path().join("work"));
        let options = SimplifyOptions {
            target: Target::ratio(1.0),
            textures: TextureFiles::Bake,
            image: ImageFormat::Png,
            job: JobOptions { work, ..JobOptions::default() },
            ..SimplifyOptions::default()
        };
        let run = || pipeline::simplify(path("a.obj"), &path(&format!("out-{kib}.obj")), &options, &Silent);
        let error = run().unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NoSpace, "{kib} KiB: {error}");
        assert_eq!(error.to_string().matches("bake-").count(), 1, "{error}");
        disk.grow(64 << 20);
        run().unwrap();
    }
}

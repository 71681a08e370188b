//! What lies where a job reads and writes: nothing of the user's is replaced, removed or taken for the job's own, and a
//! result is one only with all of its files.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::meshes::{contents, copy_town, in_many_clusters, ratio};
use drystone::base::ErrorKind;
use drystone::base::{Result, Silent};
use drystone::options::{JobOptions, Limits, SimplifyOptions, Target, TextureFiles};
use drystone::pipeline;
use drystone::report::Report;

/// A copy of the town in `in/`.
struct Town {
    folder: tempfile::TempDir,
}

impl Town {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        copy_town(&folder.path().join("in"));
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn simplify(&self, input: &str, output: &str, options: SimplifyOptions) -> Result<Report> {
        pipeline::simplify(self.path(input), &self.path(output), &options, &Silent)
    }

    /// The message of a refusal, which changed no file that was there.
    fn refusal(&self, input: &str, output: &str, options: SimplifyOptions) -> String {
        let before = contents(self.folder.path());
        let error = self.simplify(input, output, options).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Usage, "{error}");
        let after = contents(self.folder.path());
        let is_job =
            |path: &Path| path.components().any(|folder| folder.as_os_str().to_string_lossy().ends_with(".work"));
        assert!(before.iter().all(|(path, bytes)| is_job(path) || after.get(path) == Some(bytes)), "{error}");
        error.to_string()
    }
}

fn options() -> SimplifyOptions {
    SimplifyOptions {
        limits: Limits { threads: Some(2), ..in_many_clusters(ratio(0.1)).limits },
        job: JobOptions { force: true, ..in_many_clusters(ratio(0.1)).job },
        ..in_many_clusters(ratio(0.1))
    }
}

#[test]
fn files_that_are_named_like_temporary_ones_stay() {
    let town = Town::new();
    fs::create_dir(town.path("out")).unwrap();
    for name in ["town.obj.tmp", "town.mtl.tmp", "town.json.tmp"] {
        fs::write(town.path("out").join(name), "of the user").unwrap();
    }
    fs::rename(town.path("in/town.obj"), town.path("out/new.obj.tmp")).unwrap();
    for file in fs::read_dir(town.path("in")).unwrap().flatten() {
        fs::copy(file.path(), town.path("out").join(file.file_name())).unwrap();
    }
    let before = contents(&town.path("out"));
    let report = town.simplify("out/new.obj.tmp", "out/new.obj", options()).unwrap();
    report.save(&town.path("out/town.json"), 1).unwrap();
    let after = contents(&town.path("out"));
    assert!(before.iter().all(|(path, bytes)| after.get(path) == Some(bytes)));
    let new = after.keys().filter(|path| !before.contains_key(*path)).map(|path| path.file_name().unwrap());
    assert!(new.clone().all(|name| !name.to_string_lossy().ends_with(".tmp")), "{:?}", new.collect::<Vec<_>>());
}

#[test]
fn two_jobs_with_one_output_leave_a_whole_result() {
    let town = Town::new();
    town.simplify("in/town.obj", "calm/town.obj", options()).unwrap();
    let expected: Vec<Vec<u8>> = contents(&town.path("calm")).into_values().collect();
    let job = |work: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_drystone"));
        command.arg("simplify").arg(town.path("in/town.obj")).arg("-o").arg(town.path("out/town.obj"));
        command.args(["--ratio", "0.1", "--cluster-faces", "1000", "--threads", "1", "--memory", "256MiB", "--force"]);
        command.arg("--quiet").arg("--work").arg(town.path(work)).stdin(Stdio::null()).spawn().unwrap()
    };
    for _ in 0..3 {
        let mut jobs = [job("one"), job("other"), job("third")];
        jobs[2].kill().unwrap();
        let codes = jobs.map(|mut job| job.wait().unwrap().code());
        assert_eq!(codes[..2], [Some(0), Some(0)]);
        let result: Vec<Vec<u8>> = contents(&town.path("out"))
            .into_iter()
            .filter(|(path, _)| path.extension() != Some("tmp".as_ref()))
            .map(|(_, bytes)| bytes)
            .collect();
        assert!(result == expected);
    }
}

#[test]
fn a_result_of_which_files_are_missing_or_old_is_completed() {
    let town = Town::new();
    let kept = || SimplifyOptions { job: JobOptions { keep_work: true, force: false, ..options().job }, ..options() };
    town.simplify("in/town.obj", "out/town.obj", kept()).unwrap();
    let expected = contents(&town.path("out"));
    let companions =
        || expected.keys().filter(|path| !path.starts_with("town.obj.work") && !path.ends_with("town.obj"));
    assert!(companions().count() > 1);
    for name in companions() {
        let path = &town.path("out").join(name);
        fs::remove_file(path).unwrap();
        town.simplify("in/town.obj", "out/town.obj", kept()).unwrap();
        assert!(fs::read(path).unwrap() == expected[name], "{}", path.display());
        // One that was changed may be the user's work.
        fs::write(path, "of the user").unwrap();
        assert!(town.refusal("in/town.obj", "out/town.obj", kept()).contains("`force` replaces it"));
        assert_eq!(fs::read(path).unwrap(), b"of the user");
        let force = SimplifyOptions { job: JobOptions { force: true, ..kept().job }, ..kept() };
        town.simplify("in/town.obj", "out/town.obj", force).unwrap();
        assert!(fs::read(path).unwrap() == expected[name], "{}", path.display());
    }
}

#[test]
fn no_file_of_the_input_is_replaced() {
    let town = Town::new();
    // The library of the input bears the name that the new one would get.
    fs::rename(town.path("in/town.obj"), town.path("in/city.obj")).unwrap();
    let words = town.refusal("in/city.obj", "in/town.obj", options());
    assert!(words.contains("town.mtl: a file of the input would be replaced"), "{words}");
}

#[test]
fn a_short_job_that_is_refused_leaves_no_work_folder() {
    let town = Town::new();
    fs::create_dir(town.path("out")).unwrap();
    fs::write(town.path("out/town.mtl"), "of the user").unwrap();
    let words =
        town.refusal("in/town.obj", "out/town.obj", SimplifyOptions { job: JobOptions::default(), ..options() });
    assert!(words.contains("`force` replaces it") && !town.path("out/town.obj.work").exists(), "{words}");
}

#[cfg(unix)]
#[test]
fn a_texture_of_the_input_that_is_a_link_is_not_replaced() {
    let town = Town::new();
    fs::create_dir_all(town.path("in/new_textures")).unwrap();
    fs::create_dir_all(town.path("in/store")).unwrap();
    fs::write(town.path("in/store/x.png"), "picture").unwrap();
    fs::write(town.path("in/wall.png"), "other picture").unwrap();
    std::os::unix::fs::symlink("../store/x.png", town.path("in/new_textures/wall.png")).unwrap();
    fs::write(town.path("in/a.mtl"), "newmtl a\nmap_Kd wall.png\nnewmtl b\nmap_Kd new_textures/wall.png\n").unwrap();
    let mesh = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl a\nf 1 2 3\nusemtl b\nf 1 2 4\n";
    fs::write(town.path("in/a.obj"), mesh).unwrap();
    let words = town.refusal("in/a.obj", "in/new.obj", SimplifyOptions { target: Target::ratio(1.0), ..options() });
    assert!(words.contains("wall.png: a texture of the input would be replaced"), "{words}");
}

/// Two tiles that share a picture, named from each of their folders.
fn tiles(town: &Town) {
    for (tile, texture) in [("a", "wall.png"), ("b", "../a/wall.png")] {
        let folder = town.path("tiles").join(tile);
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("t.mtl"), format!("newmtl {tile}\nmap_Kd {texture}\n")).unwrap();
        let mesh = format!("mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl {tile}\nf 1 2 3\n");
        fs::write(folder.join("t.obj"), mesh).unwrap();
    }
    fs::write(town.path("tiles/a/wall.png"), "picture").unwrap();
}

#[test]
fn tiles_may_share_a_picture() {
    let town = Town::new();
    tiles(&town);
    for textures in [TextureFiles::Copy, TextureFiles::Link, TextureFiles::Reference] {
        let options = SimplifyOptions { target: Target::ratio(1.0), textures, ..options() };
        town.simplify("tiles", "out/new.obj", options.clone()).unwrap();
        town.simplify("tiles", "out/new.obj", options).unwrap();
    }
    assert_eq!(fs::read(town.path("out/new_textures/wall.png")).unwrap(), b"picture");
}

#[cfg(unix)]
#[test]
fn an_input_that_is_a_link_has_its_textures_beside_it() {
    let town = Town::new();
    tiles(&town);
    fs::create_dir(town.path("store")).unwrap();
    fs::rename(town.path("tiles/a/t.obj"), town.path("store/1234.obj")).unwrap();
    std::os::unix::fs::symlink("../../store/1234.obj", town.path("tiles/a/t.obj")).unwrap();
    town.simplify("tiles/a/t.obj", "out/new.obj", SimplifyOptions { target: Target::ratio(1.0), ..options() }).unwrap();
    assert_eq!(fs::read(town.path("out/new_textures/wall.png")).unwrap(), b"picture");
}

#[test]
fn places_that_are_in_the_way_of_each_other_are_refused() {
    let town = Town::new();
    fs::create_dir(town.path("out")).unwrap();
    let work =
        |name: &str| SimplifyOptions { job: JobOptions { work: Some(town.path(name)), ..options().job }, ..options() };
    for (output, work, expected) in [
        ("out/town.obj", work("out"), "the work folder lie in each other"),
        ("out/below/town.obj", work("out"), "the work folder lie in each other"),
        ("new/town.obj", work("new"), "the work folder lie in each other"),
        ("out/town.obj", work("out/town_textures"), "the work folder lie in each other"),
        ("out/town.obj", work("in"), "the input lies in the work folder"),
        ("in/town.obj", options(), "the output is the input"),
        ("out/../in/./town.obj", options(), "the output is the input"),
    ] {
        let words = town.refusal("in/town.obj", output, work);
        assert!(words.contains(expected), "{words}");
    }
    let words = town.refusal("in", "in/deep/new.obj", options());
    assert!(words.contains("lies below the input"), "{words}");
}

/// Stops nothing, but lets something happen when a phase begins.
struct When<F>(&'static str, F);

impl<F: Fn() + Sync + Send> drystone::base::Progress for When<F> {
    fn begin(&self, phase: &'static str, _total: u64, _unit: &'static str) {
        if phase == self.0 {
            self.1();
        }
    }
    fn advance(&self, _units: u64) {}
}

#[test]
fn a_texture_that_goes_while_the_job_runs_is_told() {
    let town = Town::new();
    let texture = contents(&town.path("in")).into_keys().find(|path| path.extension() == Some("jpg".as_ref())).unwrap();
    let texture = town.path("in").join(texture);
    let progress = When("textures", || fs::remove_file(&texture).unwrap());
    let error = pipeline::simplify(town.path("in/town.obj"), &town.path("out/town.obj"), &options(), &progress);
    let error = error.unwrap_err();
    assert!(error.kind() == ErrorKind::Changed && error.to_string().contains("is missing now"), "{error}");
    assert!(!town.path("out/town.obj").exists());
}

#[test]
fn an_old_result_is_not_taken_for_one_of_an_input_that_changed_when_its_state_is_damaged() {
    let town = Town::new();
    let mesh = fs::read_to_string(town.path("in/town.obj")).unwrap();
    // So many names that what is known of the input has a file of its own.
    let mut grouped = String::new();
    for (i, line) in mesh.lines().enumerate() {
        if line.starts_with("f ") && i % 20 == 0 {
            grouped += &format!("g a_group_with_a_long_name_{i}\n");
        }
        grouped += &format!("{line}\n");
    }
    fs::write(town.path("in/town.obj"), grouped).unwrap();
    let kept = || SimplifyOptions { job: JobOptions { keep_work: true, ..options().job }, ..options() };
    town.simplify("in/town.obj", "out/town.obj", kept()).unwrap();
    let mtl = fs::read_to_string(town.path("in/town.mtl")).unwrap();
    fs::write(town.path("in/town.mtl"), mtl + "Ns 77\n").unwrap();
    assert_eq!(town.simplify("in/town.obj", "out/town.obj", kept()).unwrap_err().kind(), ErrorKind::Changed);
    let state = town.path("out/town.obj.work/scan-input.state");
    let mut bytes = fs::read(&state).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&state, bytes).unwrap();
    town.simplify("in/town.obj", "out/town.obj", kept()).unwrap();
    assert!(fs::read_to_string(town.path("out/town.mtl")).unwrap().contains("Ns 77"));
}

#[test]
fn a_name_that_an_obj_cannot_refer_to_is_refused() {
    let town = Town::new();
    for name in ["a\\b.obj", " a.obj", "c:d.obj", "a\n.obj"] {
        let words = town.refusal("in/town.obj", &format!("out/{name}"), options());
        assert!(words.contains("cannot refer to"), "{words}");
    }
}

//! Work folders whose values, checksums included, were changed by an attacker: the job is resumed or restarted, or ends
//! with an error message; no number of a value leads to an index out of range.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::base::{Error, Progress, Result};
use crate::job::{Resume, StepKey, WorkFolder};
use crate::options::{JobOptions, Limits, SimplifyOptions, Target, TextureFiles};
use crate::remesh::cvd;

/// Vertices along each side of the mesh.
const SIDE: u32 = 40;
/// Maximum number of bytes of a value that are changed, one at a time.
const PLACES: usize = 20;
/// Replacements for a number of one byte: others of one byte, and the largest of two, four and eight.
const NUMBERS: [&[u8]; 7] = [
    &[0],
    &[1],
    &[2],
    &[250],
    &[251, 255, 255],
    &[252, 255, 255, 255, 255],
    &[253, 255, 255, 255, 255, 255, 255, 255, 127],
];

/// Collects messages, and stops the job after `left` reports of progress.
struct Listener {
    left: AtomicU64,
    told: Mutex<Vec<String>>,
}

impl Listener {
    fn new(reports: u64) -> Self {
        Self { left: AtomicU64::new(reports), told: Mutex::default() }
    }
}

impl Progress for Listener {
    fn begin(&self, _: &'static str, _: u64, _: &'static str) {}

    fn advance(&self, _: u64) {
        let _ = self.left.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| left.checked_sub(1));
    }

    fn tell(&self, text: &str) {
        self.told.lock().unwrap().push(text.to_owned());
    }

    fn is_stopped(&self) -> bool {
        self.left.load(Ordering::SeqCst) == 0
    }
}

/// Hills with texture coordinates, two groups and two materials.
fn hills() -> String {
    let mut text = String::new();
    for i in 0..SIDE * SIDE {
        let (x, y) = (i % SIDE, i / SIDE);
        let height = (f64::from(x) * 0.9).sin() + (f64::from(y) * 0.7).cos();
        let _ = writeln!(text, "v {x} {y} {height:.3} 0.5 0.5 {:.2}\nvt 0.{x:02} 0.{y:02}", f64::from(x) / 64.0);
    }
    for i in (0..SIDE * (SIDE - 1)).filter(|i| i % SIDE < SIDE - 1) {
        let (a, b, c, d) = (i + 1, i + 2, i + SIDE + 1, i + SIDE + 2);
        if i % (SIDE * SIDE / 4) == 0 {
            let _ = writeln!(text, "g {}\nusemtl m{}", i / 900, i / 900);
        }
        let _ = writeln!(text, "f {a}/{a} {b}/{b} {d}/{d}\nf {a}/{a} {d}/{d} {c}/{c}");
    }
    text
}

/// An unfinished job: the files of its work folder.
struct HalfDone {
    input: PathBuf,
    options: SimplifyOptions,
    files: BTreeMap<PathBuf, Vec<u8>>,
}

impl HalfDone {
    fn new(folder: &Path, options: SimplifyOptions, reports: u64) -> Self {
        let (input, work) = (folder.join("a.obj"), folder.join("half"));
        fs::write(&input, hills()).unwrap();
        let options =
            SimplifyOptions { job: JobOptions { work: Some(work.clone()), ..options.job.clone() }, ..options };
        let stopped = super::super::simplify(&input, &folder.join("b.obj"), &options, &Listener::new(reports));
        assert!(matches!(stopped, Err(Error::Stopped)), "{:?}", stopped.map(|report| report.faces.output));
        let entries = fs::read_dir(&work).unwrap().map(|entry| entry.unwrap());
        let files = entries.map(|entry| (entry.file_name().into(), fs::read(entry.path()).unwrap())).collect();
        Self { input, options, files }
    }

    fn open(&self, work: &Path) -> WorkFolder {
        fs::create_dir(work).unwrap();
        self.files.iter().for_each(|(name, content)| fs::write(work.join(name), content).unwrap());
        let manifest =
            super::super::preflight::manifest(&(&self.input).into(), std::slice::from_ref(&self.input), &self.options)
                .unwrap();
        WorkFolder::open(work, &manifest, Resume::Require).unwrap()
    }

    /// The steps that it recorded, and the bytes of their values.
    fn values(&self, work: &Path) -> Vec<(StepKey, Vec<u8>)> {
        let job = self.open(work);
        let with_value = |step: StepKey| job.value_of(&step).map(|value| (step, value));
        let values = job.latest().into_iter().filter_map(with_value).collect();
        drop(job);
        fs::remove_dir_all(work).unwrap();
        values
    }

    fn go_on(&self, work: &Path, step: &StepKey, value: Vec<u8>) -> Result<Vec<String>> {
        let job = self.open(work);
        job.forge(step, value);
        drop(job);
        let options = SimplifyOptions {
            job: JobOptions { work: Some(work.to_owned()), force: true, ..self.options.clone().job },
            ..self.options.clone()
        };
        let listener = Listener::new(u64::MAX);
        let ended = super::super::simplify(&self.input, &work.with_extension("obj"), &options, &listener);
        let _ = fs::remove_dir_all(work);
        ended.map(|_| listener.told.into_inner().unwrap())
    }
}

fn options() -> SimplifyOptions {
    SimplifyOptions {
        target: Target::ratio(0.2),
        limits: Limits { memory: Some(128 << 20), threads: Some(1) },
        cluster_faces: 1000,
        textures: TextureFiles::Reference,
        ..SimplifyOptions::default()
    }
}

/// Changes bytes of each value of a job that was stopped after `reports` reports of progress.
fn change_values(options: SimplifyOptions, reports: u64) {
    let folder = tempfile::tempdir().unwrap();
    let (work, output) = (folder.path().join("work"), folder.path().join("work.obj"));
    let job = HalfDone::new(folder.path(), options, reports);
    let values = job.values(&work);
    assert!(values.len() > 3, "{}", values.len());
    for (step, value) in values {
        let told = job.go_on(&work, &step, value.clone()).unwrap();
        assert!(
            told[0].starts_with("resumed") && !told.iter().any(|told| told.contains("damaged")),
            "{step:?}: {told:?}"
        );
        let stride = value.len().div_ceil(PLACES);
        for (i, at) in (0..value.len()).step_by(stride).enumerate() {
            let number = NUMBERS[i % NUMBERS.len()];
            let forged = [&value[..at], number, &value[at + 1..]].concat();
            match job.go_on(&work, &step, forged) {
                Ok(_) => assert!(output.exists()),
                Err(error) => {
                    let is_plain = !error.to_string().contains(char::is_control);
                    assert!(is_plain && !output.exists(), "{step:?}, byte {at} as {number:?}: {error}");
                }
            }
            let _ = fs::remove_file(&output);
        }
    }
}

#[test]
fn values_of_the_first_pass() {
    change_values(options(), 3);
}

#[test]
fn values_of_a_later_pass() {
    change_values(options(), 6);
}

#[test]
fn values_of_a_mesh_that_is_made_anew() {
    change_values(SimplifyOptions { remesh: Some(cvd::CvdSettings::default()), ..options() }, 11);
}

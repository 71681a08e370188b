//! What is fuzzed: each target takes any bytes, and panics if a promise is broken.
//!
//! The targets are shared by `fuzz_targets/*.rs`, which libFuzzer drives, and by `tests/corpora.rs`, which replays the kept
//! inputs and seeded changes of them with any compiler.

mod arrays;
mod lent;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use drystone::base::{Error, ErrorKind, Progress, Result, Silent};
use drystone::file::header::{HEADER_BYTES, seal};
use drystone::job::{self, Manifest, Recalled, Resume, Step, WorkFolder};
use drystone::options::{
    Borders, JobOptions, Limits, Normals, Pieces, Seams, SimplifyOptions, Target, TextureFiles, Weld,
};
use drystone::pipeline;
use drystone::read::{INPUT, SCAN, Scan, ScanOptions, scan};
use xxhash_rust::xxh3::{xxh3_64, xxh3_64_with_seed};

pub use self::arrays::scan_arrays;
pub use self::lent::lent;

/// A target: its name, which is that of its folder of kept inputs, and what it does.
pub type FuzzTarget = (&'static str, fn(&[u8]));

/// All targets.
pub const TARGETS: [FuzzTarget; 9] = [
    ("scan_obj", scan_obj),
    ("scan_mtl", scan_mtl),
    ("scan_ply", scan_ply),
    ("scan_arrays", scan_arrays),
    ("job_files", job_files),
    ("resume", resume),
    ("lent", lent),
    ("collapse", collapse),
    ("differential", differential),
];

/// StepNumbers as the value of a step.
#[derive(serde::Deserialize)]
struct StepNumbers(Vec<u32>);

impl Recalled for StepNumbers {
    type Context<'a> = ();

    fn is_sound(&self, (): &()) -> bool {
        true
    }
}

/// A folder in memory, where there is such a place.
fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).expect("a temporary folder")
}

fn scanned(folder: &Path) -> Result<Scan> {
    let options = ScanOptions { chunks_in_flight: 1, ..Default::default() };
    scan(&[folder.join("a.obj")], folder, &options, &Silent)
}

/// Any bytes as an OBJ: an error with words, or a mesh whose faces name what there is.
pub fn scan_obj(bytes: &[u8]) {
    let folder = folder();
    fs::write(folder.path().join("a.obj"), bytes).expect("written");
    match scanned(folder.path()) {
        Ok(scan) => assert_whole(&scan),
        Err(error) => assert_tame(&error),
    }
}

/// Any bytes as a PLY: as [`scan_obj`].
pub fn scan_ply(bytes: &[u8]) {
    let folder = folder();
    let path = folder.path().join("a.ply");
    fs::write(&path, bytes).expect("written");
    let options = ScanOptions { chunks_in_flight: 1, ..Default::default() };
    match scan(&[path], folder.path(), &options, &Silent) {
        Ok(scan) => assert_whole(&scan),
        Err(error) => assert_tame(&error),
    }
}

/// Any bytes as a material library, all of whose materials are used.
pub fn scan_mtl(bytes: &[u8]) {
    let folder = folder();
    let mut text = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n".to_vec();
    for line in bytes.split(|byte| *byte == b'\n').filter_map(|line| line.strip_prefix(b"newmtl ")).take(100) {
        let name: Vec<u8> = line.iter().copied().filter(|byte| !b"\r\0\\".contains(byte)).collect();
        text.extend([b"usemtl ", &name[..], b"\nf 1/1 2/1 3/1\n"].concat());
    }
    text.extend_from_slice(b"f 1 2 3\n");
    fs::write(folder.path().join("a.obj"), text).expect("written");
    fs::write(folder.path().join("a.mtl"), bytes).expect("written");
    fs::write(folder.path().join("secret"), "outside").expect("written");
    let output = folder.path().join("out/a.obj");
    let options = SimplifyOptions {
        target: Target::ratio(1.0),
        limits: Limits { memory: Some(128 << 20), threads: Some(1) },
        ..Default::default()
    };
    match pipeline::simplify(folder.path().join("a.obj"), &output, &options, &Silent) {
        Ok(_) => assert_readable(&output),
        Err(error) => assert_tame(&error),
    }
}

/// The meshes of a result can be read by others, unless a name that was given is no UTF-8: it is kept as it came.
///
/// NOTE: the MTL is not: its statements are those of the input, and `tobj` panics at `Kd 0`, which means a grey.
fn assert_readable(output: &Path) {
    let content = fs::read(output).expect("a result");
    let read =
        tobj::load_obj_buf(&mut &content[..], &tobj::LoadOptions::default(), |_| Ok((Vec::new(), Default::default())));
    assert!(read.is_ok() || std::str::from_utf8(&content).is_err(), "{read:?}");
}

fn assert_whole(scan: &Scan) {
    let mut faces = Vec::new();
    for piece in &scan.mesh.pieces {
        let file = piece.faces.open().expect("a file of the scan");
        for block in piece.faces.blocks() {
            piece.faces.read_block(&file, block, &mut Vec::new(), &mut faces).expect("a block of the scan");
            for face in &faces {
                assert!(face.vertices.iter().all(|v| u64::from(v.number()) < piece.positions.len()));
                assert!(face.named_texcoords().all(|t| u64::from(t.number()) < piece.texcoords.len()));
                assert!(face.part < scan.catalogue.parts.next_key());
            }
        }
    }
}

/// A message has no control characters but line feeds, and an end.
fn assert_tame(error: &Error) {
    let text = error.to_string();
    assert!(text.len() < 8000, "{} bytes of message", text.len());
    assert!(!text.chars().any(|c| c.is_control() && c != '\n'), "{text:?}");
}

fn manifest() -> Manifest {
    Manifest { program: "fuzz".into(), options: r#"{"a": 1}"#.into(), passes: 3, ..Manifest::default() }
}

/// Any bytes as one file of a work folder: it is opened or refused, and nothing outside it is touched.
pub fn job_files(bytes: &[u8]) {
    let folder = folder();
    let work = folder.path().join("work");
    fs::write(folder.path().join("outside"), "outside").expect("written");
    let job = WorkFolder::open(&work, &manifest(), Resume::Auto).expect("a new work folder");
    job.keep(Step::new(INPUT), [], &vec![1u32; 5000]).expect("kept");
    job.keep(Step::new(SCAN).from([INPUT]), [], &(1u8, String::from("two"))).expect("kept");
    drop(job);
    let Some((&which, bytes)) = bytes.split_first() else { return };
    let name = Path::new(["manifest.bin", "journal.bin", "scan-input.state", "lock"][which as usize % 4]);
    let whole = files(&work);
    let mut changed = whole.clone();
    // The higher half replaces the file, the lower one changes single bytes of it; the odd quarters make checksums fit.
    let content = changed.entry(name.into()).or_default();
    if which >= 128 {
        *content = bytes.to_vec();
    } else {
        change(content, bytes);
    }
    let is_forged = which & 64 != 0;
    if is_forged {
        forge(&whole, &mut changed);
    }
    write_files(&work, &changed);
    if let Err(error) = job::look(&work) {
        assert_tame(&error);
    }
    match WorkFolder::open(&work, &manifest(), Resume::Auto) {
        Ok(job) => {
            for key in [INPUT, SCAN] {
                if let Ok(Some(value)) = job.recall::<StepNumbers>(&key, &()) {
                    assert!(is_forged || value.0 == vec![1; 5000]);
                }
            }
        }
        Err(error) => assert_tame(&error),
    }
    assert_eq!(fs::read(folder.path().join("outside")).expect("read"), b"outside");
}

/// Changes bytes as triples say: two bytes for the place, one for what it becomes.
fn change(content: &mut [u8], triples: &[u8]) {
    for triple in triples.chunks_exact(3) {
        let at = usize::from(triple[0]) << 8 | usize::from(triple[1]);
        if let Some(byte) = content.len().checked_sub(1).and_then(|last| content.get_mut(at * (last + 1) / 65_536)) {
            *byte = triple[2];
        }
    }
}

/// Makes the checksums of changed files fit again, as somebody would who means harm: those of the header and of what
/// follows it, the journal's of other files' headers, and those of its entries, as far as its frames can be followed.
fn forge(whole: &Files, changed: &mut Files) {
    const HEADER: usize = HEADER_BYTES as usize;
    let journal = Path::new("journal.bin");
    let mut stamps = Vec::new();
    for (name, content) in changed.iter_mut() {
        let Some((header, content)) = content.split_first_chunk_mut::<HEADER>() else { continue };
        if name != journal {
            header[32..40].copy_from_slice(&xxh3_64(content).to_le_bytes());
        }
        seal(header);
        if let Some(old) = whole.get(name).and_then(|old| old.first_chunk::<HEADER>()).filter(|old| *old != header) {
            stamps.push((xxh3_64(old).to_le_bytes(), xxh3_64(header).to_le_bytes()));
        }
    }
    let Some(entries) = changed.get_mut(journal) else { return };
    let mut at = HEADER;
    while let Some((length, rest)) = entries.get_mut(at..).and_then(|rest| rest.split_first_chunk_mut::<4>()) {
        let bytes = *length;
        let length = u32::from_le_bytes(bytes) as usize;
        let Some((length_checksum, rest)) = rest.split_first_chunk_mut::<4>() else { break };
        *length_checksum = (xxh3_64_with_seed(&bytes, at as u64) as u32).to_le_bytes();
        let Some((checksum, rest)) = rest.split_first_chunk_mut::<8>() else { break };
        let Some(payload) = rest.get_mut(..length) else { break };
        for (old, new) in &stamps {
            if let Some(found) = payload.windows(8).position(|window| window == old) {
                payload[found..found + 8].copy_from_slice(new);
            }
        }
        *checksum = xxh3_64_with_seed(payload, at as u64).to_le_bytes();
        at += 16 + length;
    }
}

/// Names and contents of files.
type Files = BTreeMap<PathBuf, Vec<u8>>;

fn files(folder: &Path) -> Files {
    let entries = fs::read_dir(folder).expect("a folder").flatten();
    entries.map(|entry| (entry.file_name().into(), fs::read(entry.path()).expect("read"))).collect()
}

fn write_files(folder: &Path, files: &Files) {
    for (name, content) in files {
        fs::write(folder.join(name), content).expect("written");
    }
}

/// Changes files as groups of five bytes say: which file, what is done to it and whether checksums are made to fit
/// again, where, and with what. Returns whether they were.
fn meddle(files: &mut Files, bytes: &[u8]) -> bool {
    let whole = files.clone();
    let mut is_forged = false;
    for group in bytes.chunks_exact(5).take(20) {
        let count = files.len().max(1);
        let Some(name) = files.keys().nth(usize::from(group[0]) % count).cloned() else { break };
        let content = files.entry(name.clone()).or_default();
        is_forged |= group[1] >= 128;
        match group[1] % 128 % 5 {
            0 => change(content, &group[2..5]),
            1 => content.truncate(content.len() * usize::from(group[2]) / 256),
            2 => content.extend_from_slice(&group[2..5]),
            3 => _ = files.remove(&name),
            _ => {
                let other = files.keys().nth(usize::from(group[2]) % count).cloned().unwrap_or_default();
                let (a, b) = (files.remove(&name).unwrap_or_default(), files.remove(&other));
                files.extend(b.map(|b| (name.clone(), b)));
                files.insert(if other == name { name } else { other }, a);
            }
        }
    }
    if is_forged {
        forge(&whole, files);
    }
    is_forged
}

/// A half done job: its files, and the result of an undisturbed run.
struct HalfDone {
    work: Files,
    result: Vec<u8>,
    input: PathBuf,
    _folder: tempfile::TempDir,
}

struct StopAfter(AtomicU64);

impl Progress for StopAfter {
    fn begin(&self, _: &'static str, _: u64, _: &'static str) {}

    fn advance(&self, _: u64) {
        let _ = self.0.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| left.checked_sub(1));
    }

    fn is_stopped(&self) -> bool {
        self.0.load(Ordering::SeqCst) == 0
    }
}

/// A hilly square of this many vertices along a side, at a height.
fn hills(side: u32, height: f64) -> String {
    let mut text = String::new();
    for i in 0..side * side {
        let (x, y) = (i % side, i / side);
        let _ = writeln!(text, "v {x} {y} {:.3}", height + (f64::from(x) * 0.9).sin() + (f64::from(y) * 0.7).cos());
    }
    for i in (0..side * (side - 1)).filter(|i| i % side < side - 1) {
        let [a, b, c, d] = [i + 1, i + 2, i + side + 2, i + side + 1];
        let _ = writeln!(text, "f {a} {b} {c}\nf {a} {c} {d}");
    }
    text
}

fn half_done() -> &'static HalfDone {
    static DONE: OnceLock<HalfDone> = OnceLock::new();
    DONE.get_or_init(|| {
        let folder = folder();
        let input = folder.path().join("a.obj");
        fs::write(&input, hills(40, 0.0)).expect("written");
        let output = folder.path().join("out/a.obj");
        let options = SimplifyOptions {
            job: JobOptions { work: Some(folder.path().join("work")), ..resume_options().job },
            ..resume_options()
        };
        pipeline::simplify(&input, &output, &options, &Silent).expect("an undisturbed run");
        let result = fs::read(&output).expect("a result");
        fs::remove_file(&output).expect("removed");
        let stopped = pipeline::simplify(&input, &output, &options, &StopAfter(AtomicU64::new(4)));
        assert!(matches!(stopped, Err(Error::Stopped)));
        let work = files(&folder.path().join("work"));
        HalfDone { work, result, input, _folder: folder }
    })
}

fn resume_options() -> SimplifyOptions {
    SimplifyOptions {
        target: Target::ratio(0.2),
        limits: Limits { memory: Some(128 << 20), threads: Some(1) },
        cluster_faces: 1000,
        ..Default::default()
    }
}

/// A job whose work folder was changed in between: the bytes of an undisturbed run, or an error and no result. Where the
/// checksums are forged, too, the result may be any, and the error any that is told.
pub fn resume(bytes: &[u8]) {
    let half_done = half_done();
    let folder = folder();
    let work = folder.path().join("work");
    fs::create_dir(&work).expect("made");
    let mut files = half_done.work.clone();
    let is_forged = meddle(&mut files, bytes);
    write_files(&work, &files);
    let output = folder.path().join("out/a.obj");
    let options = SimplifyOptions { job: JobOptions { work: Some(work), ..resume_options().job }, ..resume_options() };
    match pipeline::simplify(&half_done.input, &output, &options, &Silent) {
        Ok(_) => assert!(is_forged || fs::read(&output).expect("a result") == half_done.result, "other bytes"),
        Err(error) => {
            assert_tame(&error);
            // Without a manifest or a journal that is ours the folder is taken for somebody else's.
            let is_foreign = error.kind() == ErrorKind::Usage && error.to_string().contains("is not a file of a job");
            assert!(
                is_forged || is_foreign || matches!(error.kind(), ErrorKind::Changed | ErrorKind::Damaged),
                "{error}"
            );
            assert!(!output.exists());
        }
    }
}

/// Bytes as numbers, zeros when they end.
struct Numbers<'a>(&'a [u8]);

impl Numbers<'_> {
    fn next(&mut self) -> u8 {
        let (first, rest) = self.0.split_first().unwrap_or((&0, &[]));
        self.0 = rest;
        *first
    }
}

/// A random mesh and random options through the whole program.
pub fn collapse(bytes: &[u8]) {
    let mut numbers = Numbers(bytes);
    let choice = numbers.next();
    let options = SimplifyOptions {
        target: Target::ratio((f64::from(numbers.next()) + 1.0) / 256.0),
        limits: Limits { memory: Some(128 << 20), threads: Some(1) },
        seams: Some([Seams::Stitch, Seams::Follow, Seams::Lock][usize::from(choice) % 3]),
        borders: [Borders::Simplify, Borders::Lock][usize::from(choice >> 2 & 1)],
        weld: [Weld::Exact, Weld::Off][usize::from(choice >> 3 & 1)],
        pieces: [Pieces::Keep, Pieces::Drop][usize::from(choice >> 4 & 1)],
        normals: [Normals::Auto, Normals::Drop][usize::from(choice >> 5 & 1)],
        textures: TextureFiles::Reference,
        passes: 1 + usize::from(choice >> 6),
        cluster_faces: 1000,
        ..SimplifyOptions::default()
    };
    let mut text = String::new();
    let vertices = 3 + u32::from(numbers.next()) % 60;
    for _ in 0..vertices {
        let [x, y, z] = [numbers.next(), numbers.next(), numbers.next()].map(|n| f64::from(n) / 16.0);
        let _ = writeln!(text, "v {x} {y} {z}\nvt {} {}", x / 16.0, y / 16.0);
    }
    let _ = writeln!(text, "f 1/1 2/2 3/3");
    while !numbers.0.is_empty() {
        if numbers.0[0] > 250 {
            let _ = writeln!(text, "usemtl m{}", numbers.next() % 3);
        }
        let corners = [numbers.next(), numbers.next(), numbers.next()].map(|n| u32::from(n) % vertices + 1);
        let _ = writeln!(text, "f {0}/{0} {1}/{1} {2}/{2}", corners[0], corners[1], corners[2]);
    }
    let folder = folder();
    fs::write(folder.path().join("a.obj"), text).expect("written");
    let output = folder.path().join("out/a.obj");
    match pipeline::simplify(folder.path().join("a.obj"), &output, &options, &Silent) {
        Ok(report) => {
            let (models, _) =
                tobj::load_obj(&output, &tobj::LoadOptions::default()).expect("a result that can be read");
            let faces: usize = models.iter().map(|model| model.mesh.indices.len() / 3).sum();
            assert_eq!(faces as u64, report.faces.output);
            assert!(report.faces.output <= report.faces.input);
        }
        Err(error) => assert!(error.to_string().contains("no faces"), "{error}"),
    }
}

/// A file of well-formed lines against a reader of a few lines: the same counts, or the same first line at fault.
pub fn differential(bytes: &[u8]) {
    let mut numbers = Numbers(bytes);
    let (mut text, mut line) = (String::new(), 0u64);
    let (mut vertices, mut texcoords, mut triangles, mut kept) = (0i64, 0i64, 0u64, 0u64);
    // The first line whose index can never be answered, and those that wait for vertices to come.
    let mut at_fault: Option<u64> = None;
    let mut forward: Vec<(u64, i64, i64)> = Vec::new();
    while !numbers.0.is_empty() {
        line += 1;
        match numbers.next() % 8 {
            0 | 1 => {
                vertices += 1;
                let _ = writeln!(text, "v {} {}.5 -{}e-1", numbers.next(), numbers.next(), numbers.next());
            }
            2 => {
                texcoords += 1;
                let _ = writeln!(text, "vt 0.{} {}", numbers.next(), numbers.next() % 2);
            }
            3 => _ = writeln!(text, "# f {} 0 0", numbers.next()),
            4 => _ = writeln!(text, "g part {}", numbers.next() % 4),
            _ => {
                let (corners, has_texcoords) = (3 + numbers.next() % 3, numbers.next() % 2 == 0);
                let mut ids = Vec::new();
                text.push('f');
                for _ in 0..corners {
                    let (v, t) = (i64::from(numbers.next() as i8) / 8, i64::from(numbers.next() as i8) / 8);
                    let (v, t) = (if v == 0 { 1 } else { v }, if t == 0 { 1 } else { t });
                    let _ = if has_texcoords { write!(text, " {v}/{t}") } else { write!(text, " {v}") };
                    let resolve = |index: i64, count: i64| if index > 0 { index } else { count + 1 + index };
                    ids.push((resolve(v, vertices), if has_texcoords { resolve(t, texcoords) } else { 1 }));
                }
                text.push('\n');
                if ids.iter().any(|&(v, t)| v < 1 || t < 1) {
                    at_fault = at_fault.or(Some(line));
                }
                let highest = |of: fn(&(i64, i64)) -> i64| ids.iter().map(of).max().unwrap_or(0);
                forward.push((line, highest(|c| c.0), if has_texcoords { highest(|c| c.1) } else { 0 }));
                triangles += u64::from(corners) - 2;
                let repeats = corners == 3 && (ids[0].0 == ids[1].0 || ids[1].0 == ids[2].0 || ids[2].0 == ids[0].0);
                kept += if repeats { 0 } else { u64::from(corners) - 2 };
            }
        }
    }
    let unanswered = forward.iter().find(|&&(_, v, t)| v > vertices || t > texcoords).map(|&(line, ..)| line);
    let folder = folder();
    fs::write(folder.path().join("a.obj"), &text).expect("written");
    match scanned(folder.path()) {
        Ok(scan) => {
            assert_eq!((at_fault, unanswered), (None, None), "{text}");
            assert_eq!(scan.mesh.vertex_count(), vertices as u64);
            assert_eq!(scan.mesh.texcoord_count(), texcoords as u64);
            assert_eq!((scan.triangles, scan.mesh.face_count()), (triangles, kept), "{text}");
        }
        Err(Error::Input { line: 0, message, .. }) => {
            assert!(kept == 0 && message.contains("no faces"), "{message}\n{text}")
        }
        Err(Error::Input { line, .. }) => assert_eq!(Some(line), at_fault.or(unanswered), "{text}"),
        Err(error) => panic!("{error}\n{text}"),
    }
}

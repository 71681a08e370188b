//! Tasks of a job that are done elsewhere, and whose files are changed on the way.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use drystone::base::{ErrorKind, Progress, Result, Silent};
use drystone::job::stage::{Hands, HandsEnd, Stage};
use drystone::options::{CvdSettings, JobOptions, Limits, SimplifyOptions, Target, TextureFiles, TileOptions};
use drystone::pipeline::{self, do_task};

use super::{Files, assert_tame, files, folder, hills, meddle, resume_options, write_files};

/// Files of the input, enough to be lent, and vertices along a side of each: there are enough clusters, too.
const FILES: usize = 4;
const SIDE: u32 = 36;
/// Side of the texture image in texels.
const IMAGE_SIDE: u8 = 64;

/// What is done by tasks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LentJob {
    Simplify,
    Bake,
    Tile,
    Remesh,
}

impl LentJob {
    const ALL: [Self; 4] = [Self::Simplify, Self::Bake, Self::Tile, Self::Remesh];

    /// Kind of the stages that are changed; those of files and clusters are in the first job.
    fn kinds(self) -> &'static [&'static str] {
        match self {
            Self::Simplify => &["scan", "sweep"],
            Self::Bake => &["bake"],
            Self::Tile => &["tile"],
            Self::Remesh => &["remesh"],
        }
    }

    /// How often the image is repeated along a side of a file: there are enough patches, and quick tiles.
    fn repeats(self) -> f64 {
        if self == Self::Bake { 6.0 } else { 2.0 }
    }

    /// Does it in a folder, within which the result lies in `out`.
    fn run(self, folder: &Path, hands: Option<&Arc<Meddler>>) -> Result<()> {
        let [input, work, out] = ["in", "work", "out"].map(|name| folder.join(name));
        let hands = hands.map(|hands| Arc::clone(hands).into());
        let job = JobOptions { hands, tasks: 3, work: Some(work), ..resume_options().job };
        let options = SimplifyOptions { job: job.clone(), ..resume_options() };
        let options = match self {
            Self::Simplify => options,
            Self::Bake => {
                SimplifyOptions { target: Target::ratio(0.5), textures: TextureFiles::Bake, atlas: 256, ..options }
            }
            Self::Remesh => SimplifyOptions { remesh: Some(CvdSettings::default()), ..options },
            Self::Tile => {
                let limits = options.limits;
                let options = TileOptions { tile_faces: 800, tile_side: 256, limits, job, ..TileOptions::default() };
                return pipeline::tile(input.join("0.obj"), &out, &options, &Silent).map(drop);
            }
        };
        // One file is not lent.
        let input = if self == Self::Simplify { input } else { input.join("0.obj") };
        pipeline::simplify(input, &out.join("a.obj"), &options, &Silent).map(drop)
    }

    /// The result of an undisturbed run.
    fn undisturbed(self) -> &'static Files {
        static DONE: [OnceLock<Files>; 4] = [const { OnceLock::new() }; 4];
        DONE[self as usize].get_or_init(|| {
            let folder = folder();
            write_input(&folder.path().join("in"), self.repeats());
            self.run(folder.path(), None).expect("an undisturbed run");
            tree(&folder.path().join("out"))
        })
    }
}

/// Does all tasks; changes the files of one stage, before its tasks are done or after.
#[derive(Debug)]
struct Meddler {
    /// The stages that may be changed, and which of them is: its number among those that are lent.
    kinds: &'static [&'static str],
    which: usize,
    is_before: bool,
    changes: Vec<u8>,
    lent: AtomicUsize,
    is_forged: AtomicBool,
}

impl Meddler {
    fn meddle(&self, stage: &Stage) {
        let folder = stage.path().with_file_name("");
        let mut changed = files(&folder);
        self.is_forged.fetch_or(meddle(&mut changed, &self.changes), Ordering::Relaxed);
        for name in files(&folder).keys() {
            fs::remove_file(folder.join(name)).expect("removed");
        }
        write_files(&folder, &changed);
    }
}

impl Hands for Meddler {
    fn lend(&self, stage: &Stage, _: &dyn Progress) -> Result<HandsEnd> {
        let is_chosen = self.kinds.contains(&stage.kind()) && self.lent.fetch_add(1, Ordering::Relaxed) == self.which;
        if is_chosen && self.is_before {
            self.meddle(stage);
        }
        for task in 0..stage.tasks().len() {
            let limits = Limits { memory: Some(128 << 20), threads: Some(1) };
            if let Err(error) = do_task(&stage.path(), task, limits, &Silent) {
                assert_tame(&error);
            }
        }
        if is_chosen && !self.is_before {
            self.meddle(stage);
        }
        Ok(HandsEnd::Done)
    }

    fn patience(&self) -> Duration {
        Duration::ZERO
    }
}

/// A folder of meshes, one above the other, with names of their own and of all, and a texture.
fn write_input(folder: &Path, repeats: f64) {
    fs::create_dir(folder).expect("made");
    for number in 0..FILES {
        let mut text = format!("mtllib hills.mtl\no hill{number}\ng rock\nusemtl grass\n");
        let place = |at: u32| f64::from(at) * repeats / f64::from(SIDE - 1);
        (0..SIDE * SIDE).for_each(|i| _ = writeln!(text, "vt {:.4} {:.4}", place(i % SIDE), place(i / SIDE)));
        for line in hills(SIDE, 10.0 * number as f64).lines() {
            let Some(corners) = line.strip_prefix("f ") else {
                text += &format!("{line}\n");
                continue;
            };
            text.push('f');
            corners.split(' ').for_each(|corner| _ = write!(text, " {corner}/{corner}"));
            text.push('\n');
        }
        fs::write(folder.join(format!("{number}.obj")), text).expect("written");
    }
    fs::write(folder.join("hills.mtl"), "newmtl grass\nmap_Kd grass.tga\n").expect("written");
    // Three bytes a texel, without compression.
    let mut image = vec![0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, IMAGE_SIDE, 0, IMAGE_SIDE, 0, 24, 0];
    for (y, x) in (0..IMAGE_SIDE).flat_map(|y| (0..IMAGE_SIDE).map(move |x| (y, x))) {
        image.extend([4 * x, 4 * y, (x ^ y) & 0xf0]);
    }
    fs::write(folder.join("grass.tga"), image).expect("written");
}

/// All files below a folder.
fn tree(folder: &Path) -> Files {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = PathBuf::from(entry.file_name());
        if entry.path().is_dir() {
            found.extend(tree(&entry.path()).into_iter().map(|(below, content)| (name.join(below), content)));
        } else {
            found.insert(name, fs::read(entry.path()).expect("read"));
        }
    }
    found
}

/// Files of a stage that are changed: the bytes of an undisturbed run, or an error and no result. Where the checksums are
/// forged, too, the result may be any, and the error any that is told.
pub fn lent(bytes: &[u8]) {
    let Some((&which, changes)) = bytes.split_first() else { return };
    let job = LentJob::ALL[usize::from(which >> 2) % LentJob::ALL.len()];
    let expected = job.undisturbed();
    let folder = folder();
    write_input(&folder.path().join("in"), job.repeats());
    let outside = folder.path().join("outside");
    fs::write(&outside, "outside").expect("written");
    let hands = Arc::new(Meddler {
        kinds: job.kinds(),
        which: usize::from(which % 4),
        is_before: which >= 128,
        changes: changes.to_vec(),
        lent: AtomicUsize::new(0),
        is_forged: AtomicBool::new(false),
    });
    let done = job.run(folder.path(), Some(&hands));
    let is_forged = hands.is_forged.load(Ordering::Relaxed);
    assert!(hands.lent.load(Ordering::Relaxed) > 0, "nothing was lent");
    let found = tree(&folder.path().join("out"));
    match done {
        Ok(()) => assert!(is_forged || found == *expected, "other bytes"),
        Err(error) => {
            assert_tame(&error);
            let is_told = matches!(error.kind(), ErrorKind::Changed | ErrorKind::Damaged | ErrorKind::Io);
            assert!(is_forged || is_told, "{error}");
            assert!(!["a.obj", "tileset.json"].iter().any(|name| found.contains_key(Path::new(name))));
        }
    }
    assert_eq!(fs::read(outside).expect("read"), b"outside");
}

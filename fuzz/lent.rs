//! Tasks of a job that are done elsewhere, and whose files are changed on the way.

use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use drystone::base::{ErrorKind, Progress, Result, Silent};
use drystone::job::stage::{Hands, HandsEnd, Stage};
use drystone::options::{JobOptions, Limits, SimplifyOptions};
use drystone::pipeline::{self, do_task};

use super::{assert_tame, files, folder, hills, meddle, resume_options, write_files};

/// Files of the input, enough to be lent, and vertices along a side of each: there are enough clusters, too.
const FILES: usize = 4;
const SIDE: u32 = 36;

/// Does all tasks; changes the files of one stage, before its tasks are done or after.
#[derive(Debug)]
struct Meddler {
    /// The stage that is changed: its number among all that are lent.
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
        let is_chosen = self.lent.fetch_add(1, Ordering::Relaxed) == self.which;
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

fn simplify(input: &Path, output: &Path, hands: Option<&Arc<Meddler>>) -> Result<()> {
    let hands = hands.map(|hands| Arc::clone(hands).into());
    let job = JobOptions { hands, tasks: 3, ..resume_options().job };
    pipeline::simplify(input, output, &SimplifyOptions { job, ..resume_options() }, &Silent).map(drop)
}

/// A folder of meshes, one above the other, with names of their own and of all.
fn write_input(folder: &Path) {
    fs::create_dir(folder).expect("made");
    for number in 0..FILES {
        let labels = format!("o hill{number}\ng rock\nusemtl grass\n");
        let text = labels + &hills(SIDE, 10.0 * number as f64);
        fs::write(folder.join(format!("{number}.obj")), text).expect("written");
    }
}

/// The result of an undisturbed run.
fn undisturbed() -> &'static Vec<u8> {
    static DONE: OnceLock<Vec<u8>> = OnceLock::new();
    DONE.get_or_init(|| {
        let folder = folder();
        let [input, output] = ["in", "b.obj"].map(|name| folder.path().join(name));
        write_input(&input);
        simplify(&input, &output, None).expect("an undisturbed run");
        fs::read(&output).expect("a result")
    })
}

/// Files of a stage that are changed: the bytes of an undisturbed run, or an error and no result. Where the checksums are
/// forged, too, the result may be any, and the error any that is told.
pub fn lent(bytes: &[u8]) {
    let Some((&which, changes)) = bytes.split_first() else { return };
    let expected = undisturbed();
    let folder = folder();
    let [source, output, outside] = ["in", "out/a.obj", "outside"].map(|name| folder.path().join(name));
    write_input(&source);
    fs::write(&outside, "outside").expect("written");
    let hands = Arc::new(Meddler {
        which: usize::from(which % 4),
        is_before: which >= 128,
        changes: changes.to_vec(),
        lent: AtomicUsize::new(0),
        is_forged: AtomicBool::new(false),
    });
    let done = simplify(&source, &output, Some(&hands));
    let is_forged = hands.is_forged.load(Ordering::Relaxed);
    assert!(hands.lent.load(Ordering::Relaxed) > 0, "nothing was lent");
    match done {
        Ok(()) => assert!(is_forged || fs::read(&output).expect("a result") == *expected, "other bytes"),
        Err(error) => {
            assert_tame(&error);
            let is_told = matches!(error.kind(), ErrorKind::Changed | ErrorKind::Damaged | ErrorKind::Io);
            assert!(is_forged || is_told, "{error}");
            assert!(!output.exists());
        }
    }
    assert_eq!(fs::read(outside).expect("read"), b"outside");
}

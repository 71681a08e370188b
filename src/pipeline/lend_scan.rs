//! Has the files of the input read by other processes, and reads them there.

use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use serde::Deserialize;

use crate::base::{Error, Progress, Result, WorkLimits};
use crate::job::stage::{Stage, StageTask};
use crate::job::{InputFile, Recalled, WorkFolder};
use crate::lend::{Lendable, LentItem, LentResult, LentResults, LentWork, Uncounted, details_of, encoded, lend};
use crate::model::StoredPiece;
use crate::model::id::FileId;
use crate::os::durable::new_job_number;
use crate::passes::arithmetic;
use crate::read::{ScanOptions, ScannedFile};

/// Kind of the stages whose tasks are done by [`do_task`].
pub(super) const SCAN: &str = "scan";
/// What the keys of steps begin with that record files which another process read.
const PREFIX: &str = "scan-files";

/// What a process that does tasks of a stage needs.
#[derive(Deserialize)]
struct ScanDetails {
    inputs: Vec<InputFile>,
    /// When each was changed last, in nanoseconds since 1970.
    changed: Vec<u64>,
    /// Number of the process that lends them: what was read for an earlier one is not taken, since files may have changed
    /// meanwhile, and what they name.
    #[expect(dead_code, reason = "it makes the stage another one")]
    process: u64,
}

impl Recalled for ScanDetails {
    type Context<'a> = ();

    fn locate(&mut self, _: &Path, (): &()) {}

    fn is_sound(&self, (): &()) -> bool {
        self.inputs.len() == self.changed.len()
    }
}

impl LentResult for ScannedFile {
    // A file has files of its own.
    fn add_piece(&mut self, _: StoredPiece) {}

    fn files(&self) -> Vec<PathBuf> {
        self.files()
    }
}

/// Has the files of the input read by other processes, if the job has any.
///
/// # Errors
/// Those of [`lend`].
pub(super) fn lend_files(
    inputs: &[InputFile],
    work: &WorkFolder,
    progress: &dyn Progress,
) -> Result<LentResults<FileId>> {
    let changed = inputs.iter().map(|input| changed(&input.path)).collect::<Result<Vec<u64>>>()?;
    let what = Lendable {
        kind: SCAN,
        items: items(inputs),
        prefix: PREFIX.to_owned(),
        parent: None,
        arithmetic: &|| Ok(arithmetic::of_any()),
        is_counted: true,
        is_read_whole: true,
    };
    progress.begin("scan", inputs.iter().map(|input| input.bytes).sum(), "B");
    lend(work, &what, || encoded(&(inputs, changed, new_job_number(work.path()))), progress)
}

fn items(inputs: &[InputFile]) -> Vec<LentItem<FileId>> {
    FileId::first(inputs.len()).zip(inputs).map(|(item, input)| LentItem { item, size: input.bytes }).collect()
}

fn changed(path: &Path) -> Result<u64> {
    let modified = path.metadata().and_then(|meta| meta.modified()).map_err(|e| Error::io(path, "open", e))?;
    Ok(modified.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64))
}

/// Does a task of a stage of files, one file after another.
///
/// # Errors
/// [`Error::Damaged`] if the stage holds none; those of the scan.
pub(super) fn do_task(
    stage: &Stage,
    task: &StageTask,
    options: ScanOptions,
    limits: WorkLimits,
    progress: &dyn Progress,
) -> Result<()> {
    let ScanDetails { inputs, changed: times, .. } = details_of(stage)?;
    stage.check_arithmetic(arithmetic::of_any())?;
    let paths: Vec<PathBuf> = inputs.iter().map(|input| input.path.clone()).collect();
    let folder = stage.path().with_file_name("");
    let read = |file: FileId| {
        let (path, input) = (&paths[file.index()], &inputs[file.index()]);
        // A network disk may still show an older file here; another try finds the newer one.
        if InputFile::of(path)?.bytes != input.bytes || changed(path)? != times[file.index()] {
            return Err(Error::io(path, "read", std::io::Error::other("not the file that the job was begun with")));
        }
        ScannedFile::read(&paths, file.index(), &folder, &options, &Uncounted(progress))
    };
    let work = LentWork {
        items: items(&inputs),
        has_pieces: false,
        bytes: &|_| limits.work_bytes,
        work: &|file| Ok((read(file)?, None)),
    };
    work.run(stage, task, limits, progress)
}

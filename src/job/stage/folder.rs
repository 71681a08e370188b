//! The folders of stages in a work folder.

use std::fs;
use std::path::{Path, PathBuf};

use crate::job::names::{is_phase_file, is_remains};
use crate::os::durable::sync_folder;

/// Name of the file of a stage in its folder.
pub(super) const STAGE_FILE: &str = "stage.bin";
const PREFIX: &str = "stage-";
/// Ending of the files that say that a task's results are in the work folder.
pub(super) const TAKEN: &str = "taken";
/// What the name of a file that says why a task failed begins with, and its ending; that of an empty one beside it if the
/// disk is full.
const FAILURE: &str = "task-";
pub(super) const ERROR: &str = "error";
pub(super) const FULL: &str = "full";
/// How often a folder is emptied, since a late process may write to it meanwhile.
const REMOVALS_MAX: usize = 5;

/// Name of the folder of a stage.
pub(super) fn folder_name(id: u64) -> String {
    format!("{PREFIX}{id:016x}")
}

/// Name of the file that says why a task failed.
pub(super) fn failure_name(task: usize, ending: &str) -> String {
    format!("{FAILURE}{task}.{ending}")
}

/// Whether a folder has the name of a stage's folder, and holds nothing but what processes that do tasks write.
pub(in crate::job) fn is_stage_folder(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let number = name.strip_prefix(PREFIX).unwrap_or_default();
    let is_named = number.len() == 16 && number.bytes().all(|c| matches!(c, b'0'..=b'9' | b'a'..=b'f'));
    let is_folder = fs::symlink_metadata(path).is_ok_and(|meta| meta.is_dir());
    is_named && is_folder && fs::read_dir(path).is_ok_and(|mut entries| entries.all(|entry| entry.is_ok_and(is_own)))
}

fn is_own(entry: fs::DirEntry) -> bool {
    let name = entry.file_name();
    let name = name.to_string_lossy();
    let stem = name.strip_suffix(TAKEN).and_then(|rest| rest.strip_suffix('.'));
    let is_taken = stem.is_some_and(|stem| is_phase_file(&format!("{stem}.state")));
    let failed = name.strip_prefix(FAILURE).and_then(|rest| rest.split_once('.'));
    let is_failure =
        failed.is_some_and(|(number, ending)| number.parse::<u32>().is_ok() && [ERROR, FULL].contains(&ending));
    let is_of_task = is_phase_file(&name) || is_taken || is_failure || is_remains(&name);
    let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
    is_file && (is_of_task || name == STAGE_FILE || (name.starts_with(STAGE_FILE) && name.ends_with(".tmp")))
}

/// Folders of stages in a work folder.
pub fn stages(work: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(work).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| is_stage_folder(path)).collect()
}

/// Removes the folders of all stages but one: processes that do tasks of them end.
pub(in crate::job) fn remove_stages(work: &Path, but: Option<&Path>) {
    stages(work).iter().filter(|path| Some(path.as_path()) != but).for_each(|path| remove_folder(path));
}

/// Removes the folder of a stage, the stage first: processes that do its tasks find it over. What else lies there stays,
/// and the folder with it.
pub(super) fn remove_folder(path: &Path) {
    let _ = fs::remove_file(path.join(STAGE_FILE));
    for _ in 0..REMOVALS_MAX {
        let entries = fs::read_dir(path).into_iter().flatten().flatten();
        entries.map(|entry| entry.path()).for_each(|path| drop(fs::remove_file(path)));
        if fs::remove_dir(path).is_ok() || !path.exists() {
            break;
        }
    }
    let _ = sync_folder(path);
}

/// Sizes of the files in the folders of stages, in bytes.
pub(in crate::job) fn sizes(work: &Path) -> u64 {
    let files = stages(work).into_iter().flat_map(|path| fs::read_dir(path).into_iter().flatten().flatten());
    files.filter_map(|entry| entry.metadata().ok()).map(|meta| meta.len()).sum()
}

//! Lends a stage: has its tasks done, and takes their results into the work folder.
//!
//! ```text
//! place ──▶ lend, until every task has sound results ──▶ take: rename into the work folder, record ──▶ remove
//!             ╰── up to `tries` times ──╯
//! ```

use std::path::Path;
use std::sync::Mutex;
use std::thread;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::failure::TaskFailure;
use super::folder::{TAKEN, remove_folder, remove_stages};
use super::hands::{HandsEnd, Lending};
use super::results::{RESULTS, ResultFrame, TaskContents};
use super::stage_file::{Order, Stage, StageTask};
use crate::base::lock::lock;
use crate::base::ticker::ticking;
use crate::base::{Error, Progress, Result, counted};
use crate::file::name::is_file_name;
use crate::job::WorkFolder;
use crate::job::names::is_phase_file;
use crate::job::recalled::Recalled;
use crate::job::stamp::{Condition, Stamp};
use crate::job::step::{Step, StepKey};
use crate::os::durable::{give_name, sync_folder};

/// Time between two looks at the folder of a stage.
const LOOK_INTERVAL: Duration = Duration::from_millis(200);
/// How long names may take to appear where some tasks may not be done.
const SHORT_PATIENCE: Duration = Duration::from_secs(2);

/// Results of a task, in the work folder.
#[derive(Debug, Clone)]
pub struct LentTask {
    /// The step that recorded it.
    pub key: StepKey,
    frames: Vec<ResultFrame>,
}

impl LentTask {
    /// Items that have results, in the order in which they were done.
    pub fn items(&self) -> impl Iterator<Item = u32> + '_ {
        self.frames.iter().map(|frame| frame.item)
    }

    /// Removes the file of the results; its step must not be recalled any more.
    pub fn remove(&self, work: &Path) {
        let _ = std::fs::remove_file(work.join(format!("{}.{RESULTS}", self.key.name())));
    }

    /// Reads the result of an item; `work` is the work folder.
    ///
    /// # Errors
    /// [`Error::Damaged`] if it is not sound, or there is none.
    pub fn read<T: Recalled>(&self, work: &Path, item: u32, context: &T::Context<'_>) -> Result<T> {
        let path = work.join(format!("{}.{RESULTS}", self.key.name()));
        let frame = self.frames.iter().find(|frame| frame.item == item);
        let missing = || Error::Damaged { path: path.clone(), message: format!("it has no result of item {item}") };
        frame.ok_or_else(missing)?.read(&path, work, context)
    }
}

/// What the journal records of a task.
#[derive(Serialize, Deserialize)]
struct TaskFrames(Vec<ResultFrame>);

impl Recalled for TaskFrames {
    type Context<'a> = ();

    // Each frame is compared with the length of its file before it is read.
    fn is_sound(&self, (): &()) -> bool {
        true
    }
}

impl WorkFolder {
    /// Returns the results of a task that an earlier process recorded; `None` if there are none, or not intact ones.
    ///
    /// # Errors
    /// Those of [`recall`](WorkFolder::recall).
    pub fn recall_lent(&self, key: &StepKey) -> Result<Option<LentTask>> {
        let frames = self.recall::<TaskFrames>(key, &())?;
        Ok(frames.map(|TaskFrames(frames)| LentTask { key: key.clone(), frames }))
    }

    /// Has those tasks of a stage done that are `wanted`, and takes their results; `parent` is the step that they are
    /// computed from, if there is one.
    ///
    /// # Errors
    /// [`Error::Task`] or [`Error::Elsewhere`] if a task cannot be done; [`Error::Stopped`]; on a full disk, failed reads
    /// and writes.
    pub fn lend(
        &self,
        lending: &Lending,
        order: Order,
        wanted: impl Fn(&StageTask) -> bool,
        parent: Option<&StepKey>,
        progress: &dyn Progress,
    ) -> Result<Vec<LentTask>> {
        let stage = Stage::place(self.path(), order)?;
        self.confirm()?;
        remove_stages(self.path(), stage.path().parent());
        let wanted: Vec<usize> = (0..stage.tasks().len()).filter(|&task| wanted(&stage.tasks()[task])).collect();
        // What was taken is recorded; a task that is not, as after a power cut, must be done again.
        wanted.iter().for_each(|&task| drop(std::fs::remove_file(stage.file_of(&stage.tasks()[task], TAKEN))));
        self.note_steps();
        let contents = have_done(lending, &stage, &wanted, &WhileHeld { folder: self, progress })?;
        self.confirm()?;
        let mut taken = Vec::with_capacity(wanted.len());
        for (task, contents) in wanted.into_iter().zip(contents) {
            taken.push(self.take(&stage, &stage.tasks()[task], contents, parent)?);
        }
        if let Some(folder) = stage.path().parent() {
            remove_folder(folder);
        }
        Ok(taken)
    }

    /// Moves the results of a task into the work folder, and records them.
    fn take(
        &self,
        stage: &Stage,
        task: &StageTask,
        contents: TaskContents,
        parent: Option<&StepKey>,
    ) -> Result<LentTask> {
        let folder = stage.path().with_file_name("");
        let results = format!("{}.{RESULTS}", task.key.name());
        let mut paths = Vec::new();
        for name in contents.files.iter().map(|stamp| stamp.name()).chain([results.as_str()]) {
            let path = self.path().join(name);
            give_name(&folder.join(name), &path)?;
            paths.push(path);
        }
        sync_folder(&self.path().join(&results))?;
        let step = Step::new(task.key.clone()).from(parent.cloned()).of_size(task.amount);
        self.keep(step, paths.iter().map(|path| path.as_path()), &TaskFrames(contents.frames.clone()))?;
        let taken = stage.file_of(task, TAKEN);
        std::fs::write(&taken, []).map_err(|e| Error::io(&taken, "write", e))?;
        Ok(LentTask { key: task.key.clone(), frames: contents.frames })
    }
}

impl Stage {
    /// Whether a process that is to do a task finds it done.
    pub fn is_done(&self, task: &StageTask) -> bool {
        self.file_of(task, TAKEN).exists() || self.contents(task).is_some()
    }

    /// Table of contents of a task's results, if they are whole.
    fn contents(&self, task: &StageTask) -> Option<TaskContents> {
        let contents = TaskContents::read(&self.file_of(task, RESULTS)).ok()??;
        let folder = self.path().with_file_name("");
        let is_of_task = |name: &str| is_file_name(name) && is_phase_file(name);
        let is_whole = contents.stage == self.id()
            && contents.files.iter().all(|stamp| is_of_task(stamp.name()) && stamp.is_at_head(&folder))
            && contents.frames.iter().all(|frame| task.holds(frame.item));
        is_whole.then_some(contents)
    }

    /// Whether the files of a task's results are as they were written, where that is not seen later; forgets results that
    /// are not.
    fn is_sound(&self, task: usize, contents: &TaskContents) -> bool {
        let folder = self.path().with_file_name("");
        let is_whole = |stamp: &Stamp| matches!(stamp.verify(&folder), Ok(Condition::Whole));
        let is_sound = !self.is_read_whole() || contents.files.iter().all(is_whole);
        if !is_sound {
            let _ = std::fs::remove_file(self.file_of(&self.tasks()[task], RESULTS));
        }
        is_sound
    }
}

/// Has tasks done until all of them have whole results.
fn have_done(lending: &Lending, stage: &Stage, wanted: &[usize], progress: &dyn Progress) -> Result<Vec<TaskContents>> {
    let watch = Watch { stage, left: Mutex::new(wanted.to_vec()), progress };
    let mut tried = 1;
    loop {
        wanted.iter().for_each(|&task| stage.forget_failure(task));
        let lent = if wanted.iter().all(|&task| stage.contents(&stage.tasks()[task]).is_some()) {
            Ok(HandsEnd::Done)
        } else {
            watch.during(|| lending.hands.lend(stage, progress))
        };
        if matches!(lent, Err(Error::Stopped)) {
            return Err(Error::Stopped);
        }
        let is_sure = matches!(lent, Ok(HandsEnd::Done));
        let patience = lending.hands.patience().min(if is_sure { Duration::MAX } else { SHORT_PATIENCE });
        let contents = wait_for(stage, wanted, patience, progress)?;
        let missing = Missing::among(stage, wanted, &contents);
        let Some(first) = missing.first() else {
            watch.tell_of(|_| true);
            return Ok(contents.into_iter().flatten().collect());
        };
        if let Some((task, failure)) = missing.final_failure() {
            return Err(failure.into_error(task));
        }
        let end = lent?;
        let all = counted(wanted.len() as u64, "task");
        let count = missing.tasks.len();
        let have = if count == 1 { "has" } else { "have" };
        progress.tell(&format!("{count} of {all} {have} no result after try {tried} of {}", lending.tries));
        if tried >= lending.tries {
            let tries = if tried == 1 { "1 try".to_owned() } else { format!("{tried} tries") };
            let what = format!("task {first} of {all} has no result after {tries}");
            let error = missing.first_failure().map(|(task, failure)| failure.into_error(task));
            let message = error.map_or(what.clone(), |error| format!("{what}; {error}"));
            let exit_code = match end {
                HandsEnd::Done => None,
                HandsEnd::Unsure { exit_code } => exit_code,
            };
            return Err(Error::Task { task: first, exit_code, message });
        }
        tried += 1;
    }
}

/// Tasks without results: the number of each, and how it failed.
struct Missing {
    tasks: Vec<(usize, Option<TaskFailure>)>,
}

impl Missing {
    fn among(stage: &Stage, wanted: &[usize], contents: &[Option<TaskContents>]) -> Self {
        let missing = wanted.iter().zip(contents).filter(|(_, contents)| contents.is_none());
        Self { tasks: missing.map(|(&task, _)| (task, stage.failure(task))).collect() }
    }

    fn first(&self) -> Option<usize> {
        self.tasks.first().map(|&(task, _)| task)
    }

    fn failures(&self) -> impl Iterator<Item = (usize, TaskFailure)> + '_ {
        self.tasks.iter().filter_map(|(task, failure)| Some((*task, failure.clone()?)))
    }

    fn first_failure(&self) -> Option<(usize, TaskFailure)> {
        self.failures().next()
    }

    /// A failure that another try would end with, too.
    fn final_failure(&self) -> Option<(usize, TaskFailure)> {
        self.failures().find(|(_, failure)| failure.is_final())
    }
}

/// Progress that stops what is done elsewhere for a folder that this process has lost.
struct WhileHeld<'a> {
    folder: &'a WorkFolder,
    progress: &'a dyn Progress,
}

impl Progress for WhileHeld<'_> {
    fn begin(&self, phase: &'static str, total: u64, unit: &'static str) {
        self.progress.begin(phase, total, unit);
    }

    fn begin_pass(&self, number: usize) {
        self.progress.begin_pass(number);
    }

    fn tell(&self, message: &str) {
        self.progress.tell(message);
    }

    fn is_stopped(&self) -> bool {
        self.progress.is_stopped() || self.folder.is_lost()
    }

    fn advance(&self, units: u64) {
        self.progress.advance(units);
    }
}

/// Waits until all tasks have whole results, or for some time.
fn wait_for(
    stage: &Stage,
    wanted: &[usize],
    patience: Duration,
    progress: &dyn Progress,
) -> Result<Vec<Option<TaskContents>>> {
    let began = Instant::now();
    let mut found: Vec<Option<TaskContents>> = vec![None; wanted.len()];
    loop {
        for (found, &task) in found.iter_mut().zip(wanted).filter(|(found, _)| found.is_none()) {
            *found = stage.contents(&stage.tasks()[task]).filter(|contents| stage.is_sound(task, contents));
        }
        // A process that failed says so: its results will not appear.
        let may_come =
            |(found, &task): (&Option<TaskContents>, &usize)| found.is_none() && stage.failure(task).is_none();
        if !found.iter().zip(wanted).any(may_come) || began.elapsed() >= patience {
            return Ok(found);
        }
        progress.check_stopped()?;
        thread::sleep(LOOK_INTERVAL);
    }
}

/// Tells how far the tasks are, while they are done elsewhere.
struct Watch<'a> {
    stage: &'a Stage,
    /// Tasks that were not told of.
    left: Mutex<Vec<usize>>,
    progress: &'a dyn Progress,
}

impl Watch<'_> {
    fn during<T>(&self, work: impl FnOnce() -> T) -> T {
        // Without a thread for it, the progress hears of the tasks at the end.
        ticking(LOOK_INTERVAL, || self.tell_of(|task| self.stage.file_of(task, RESULTS).exists()), work)
    }

    fn tell_of(&self, is_done: impl Fn(&StageTask) -> bool) {
        lock(&self.left).retain(|&task| {
            let task = &self.stage.tasks()[task];
            let is_done = is_done(task);
            self.progress.advance(if is_done { task.amount } else { 0 });
            !is_done
        });
    }
}

//! `drystone task`: does one task of a job that another machine coordinates.

use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use clap::Args;

use super::exit::CODES;
use super::progress::{stoppable, tell};
use super::stop::Goodbye;
use crate::base::error::escape_path;
use crate::base::{Error, Result, bytes, quantity};
use crate::options::Limits;
use crate::os::signals::StopSignal;
use crate::pipeline::{self, TaskEnd};

/// Variables in which engines number their tasks, and the number of the first task there.
const NUMBERS: [(&str, usize); 6] = [
    ("SLURM_ARRAY_TASK_ID", 0),
    ("PBS_ARRAY_INDEX", 0),
    ("LSB_JOBINDEX", 1),
    ("SGE_TASK_ID", 1),
    ("AWS_BATCH_JOB_ARRAY_INDEX", 0),
    ("JOB_COMPLETION_INDEX", 0),
];
/// How long a stage may take to appear.
const PATIENCE: Duration = Duration::from_secs(10);
/// Time between two looks for it.
const LOOK_INTERVAL: Duration = Duration::from_millis(200);
/// Exit code of a task that nobody waits for.
const OVER: u8 = CODES[9].0;

/// Arguments of `drystone task`.
#[derive(Debug, Args)]
pub struct TaskArguments {
    /// File of the stage: {stage} in the command of --task-runner
    stage: PathBuf,
    /// Number of the task, from 0 [default: the number that Slurm, PBS, LSF, SGE, AWS Batch or Kubernetes gives it]
    index: Option<usize>,
    /// Memory that the program may use, at least 128MiB [default: half of the machine's or cgroup's]
    #[arg(long, value_name = "SIZE", value_parser = bytes::parse)]
    memory: Option<u64>,
    /// Number of threads [default: one per processor]
    #[arg(long, value_name = "COUNT", value_parser = quantity::parse_whole::<usize>)]
    threads: Option<usize>,
    /// Print errors alone
    #[arg(short, long)]
    quiet: bool,
}

/// Does the task.
///
/// # Errors
/// Those of [`pipeline::do_task`].
pub fn run(arguments: &TaskArguments) -> Result<u8> {
    let stop = StopSignal::listen()?;
    let goodbye = Goodbye::of_nothing(&stop);
    let index = match arguments.index {
        Some(index) => index,
        None => index_of(|name| std::env::var(name).ok())?,
    };
    let limits = Limits { memory: arguments.memory, threads: arguments.threads };
    let progress = stoppable(arguments.quiet, stop);
    let began = Instant::now();
    let end = loop {
        match pipeline::do_task(&arguments.stage, index, limits, &*progress) {
            Err(Error::Stopped) => return Ok(goodbye.say()),
            // On a shared disk, a new file may take time to appear, or to have its size.
            Ok(TaskEnd::Over | TaskEnd::NoStage) | Err(Error::Io { .. })
                if began.elapsed() < PATIENCE && !progress.is_stopped() =>
            {
                thread::sleep(LOOK_INTERVAL);
            }
            ended => break ended?,
        }
    };
    let (code, words) = outcome(end, index, &arguments.stage);
    if !arguments.quiet {
        tell(&words);
    }
    Ok(code)
}

/// Exit code and words for how a task ended.
fn outcome(end: TaskEnd, index: usize, stage: &Path) -> (u8, String) {
    match end {
        TaskEnd::Done => (0, format!("task {index} is done")),
        TaskEnd::WasDone => (0, format!("task {index} was done before")),
        TaskEnd::Over => (OVER, format!("task {index} is not waited for any more")),
        TaskEnd::NoStage => {
            (OVER, format!("{}: no such stage; the job is over, or the path is wrong", escape_path(stage)))
        }
    }
}

/// Number of the task that an engine gave this process.
fn index_of(variable: impl Fn(&str) -> Option<String>) -> Result<usize> {
    let given = NUMBERS.iter().find_map(|(name, first)| Some((name, first, variable(name)?)));
    let missing = || Error::Usage("no task is numbered: give an INDEX, or run in an array of a scheduler".into());
    let (name, first, text) = given.ok_or_else(missing)?;
    let number = text.parse::<usize>().ok().and_then(|number| number.checked_sub(*first));
    number
        .ok_or_else(|| Error::Usage(format!("{name}: expected a number from {first}, not '{}'", text.escape_default())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_is_that_of_the_engine() {
        let of =
            |name: &'static str, text: &'static str| index_of(move |asked| (asked == name).then(|| text.to_owned()));
        assert_eq!(of("SLURM_ARRAY_TASK_ID", "7").unwrap(), 7);
        assert_eq!(of("LSB_JOBINDEX", "1").unwrap(), 0);
        assert!(
            of("SGE_TASK_ID", "undefined").is_err() && of("LSB_JOBINDEX", "0").is_err() && of("HOME", "1").is_err()
        );
    }

    #[test]
    fn a_stage_that_is_not_there_is_named() {
        let end = pipeline::do_task(Path::new("no/such"), 0, Limits::default(), &crate::base::Silent).unwrap();
        let words = "no/such: no such stage; the job is over, or the path is wrong".to_owned();
        assert_eq!(outcome(end, 0, Path::new("no/such")), (OVER, words));
    }

    #[test]
    fn its_exit_code_is_in_the_table() {
        assert_eq!(OVER, 9);
    }
}

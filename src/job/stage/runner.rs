//! A command of the user that has the tasks of a stage done, by an engine for numbered commands.

use std::ffi::{OsStr, OsString};
use std::io;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use super::hands::{Hands, HandsEnd};
use super::stage_file::Stage;
use crate::base::{Error, Progress, Result};

/// Time between two looks at the command.
const LOOK_INTERVAL: Duration = Duration::from_millis(20);
/// Time in which the command may end by itself once the job is to stop.
const GRACE: Duration = Duration::from_secs(2);
/// Exit codes of a shell that cannot run a command.
const UNKNOWN: [i32; 2] = [126, 127];

/// Runs a command of the user once for each stage.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TaskRunner {
    command: String,
}

impl TaskRunner {
    /// A command for the shell, in which `{stage}` stands for the path of the stage's file, `{count}` for the number of
    /// its tasks and `{last}` for the number of the last task.
    ///
    /// # Errors
    /// [`Error::Usage`] if it does not name the stage.
    pub fn new(command: &str) -> Result<Self> {
        if !command.contains("{stage}") {
            let words = "`task_runner`: expected a command with `{stage}`, such as `seq 0 {last} | xargs -I {} drystone task {stage} {}`";
            return Err(Error::Usage(words.into()));
        }
        Ok(Self { command: command.to_owned() })
    }

    fn start(&self, stage: &Stage) -> Result<Child> {
        let count = stage.tasks().len();
        let path = std::path::absolute(stage.path()).unwrap_or_else(|_| stage.path());
        let command = self.command.replace("{count}", &count.to_string());
        let command = command.replace("{last}", &count.saturating_sub(1).to_string());
        let mut words = OsString::new();
        for (number, part) in command.split("{stage}").enumerate() {
            if number > 0 {
                words.push(quoted(path.as_os_str()));
            }
            words.push(part);
        }
        // What the command says is not the output of the job.
        let mut shell = shell(&words);
        shell.stdin(Stdio::null()).stdout(Stdio::from(io::stderr()));
        shell.spawn().map_err(|e| Error::io(Path::new("task_runner"), "start", e))
    }
}

impl Hands for TaskRunner {
    fn lend(&self, stage: &Stage, progress: &dyn Progress) -> Result<HandsEnd> {
        let mut child = self.start(stage)?;
        let status = loop {
            if let Some(status) = child.try_wait().map_err(|e| Error::io(Path::new("task_runner"), "wait for", e))? {
                break status;
            }
            if progress.is_stopped() {
                end(&mut child);
                return Err(Error::Stopped);
            }
            thread::sleep(LOOK_INTERVAL);
        };
        match status.code() {
            Some(0) => Ok(HandsEnd::Done),
            Some(code) if UNKNOWN.contains(&code) => {
                Err(Error::Usage(format!("`task_runner`: the shell cannot run it (exit code {code})")))
            }
            exit_code => {
                progress.tell(&format!("the task runner ended with {}", ended_with(status)));
                Ok(HandsEnd::Unsure { exit_code })
            }
        }
    }
}

fn ended_with(status: ExitStatus) -> String {
    status.code().map_or_else(|| "a signal".to_owned(), |code| format!("exit code {code}"))
}

/// Asks the command and its children to end, then ends them.
fn end(child: &mut Child) {
    interrupt(child, false);
    let began = Instant::now();
    while began.elapsed() < GRACE && matches!(child.try_wait(), Ok(None)) {
        thread::sleep(LOOK_INTERVAL);
    }
    interrupt(child, true);
    let _ = child.wait();
}

#[cfg(unix)]
fn interrupt(child: &mut Child, at_once: bool) {
    use rustix::process::{Pid, Signal, kill_process_group};
    let signal = if at_once { Signal::KILL } else { Signal::INT };
    let group = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
    let _ = group.map(|group| kill_process_group(group, signal));
}

#[cfg(not(unix))]
fn interrupt(child: &mut Child, at_once: bool) {
    if at_once {
        let _ = child.kill();
    }
}

#[cfg(unix)]
fn shell(command: &OsStr) -> Command {
    use std::os::unix::process::CommandExt;
    let mut shell = Command::new("sh");
    shell.arg("-c").arg(command).process_group(0);
    shell
}

#[cfg(not(unix))]
fn shell(command: &OsStr) -> Command {
    let mut shell = Command::new("cmd");
    shell.arg("/C").arg(command);
    shell
}

/// A path as one word of the shell.
#[cfg(unix)]
fn quoted(path: &OsStr) -> OsString {
    use std::os::unix::ffi::{OsStrExt, OsStringExt};
    let mut word = vec![b'\''];
    for &byte in path.as_bytes() {
        match byte {
            b'\'' => word.extend(br"'\''"),
            byte => word.push(byte),
        }
    }
    word.push(b'\'');
    OsString::from_vec(word)
}

/// A path as one word of the shell.
#[cfg(not(unix))]
fn quoted(path: &OsStr) -> OsString {
    let mut word = OsString::from("\"");
    word.push(path);
    word.push("\"");
    word
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn any_path_is_one_word_of_the_shell() {
        use std::os::unix::ffi::OsStrExt;
        for path in [&b"/work/city"[..], b"it's", b"b\xff\xfe /$x\n`y`", b"''"] {
            let mut command = OsString::from("printf %s ");
            command.push(quoted(OsStr::from_bytes(path)));
            assert_eq!(shell(&command).output().unwrap().stdout, path);
        }
    }
}

//! Stops the program after a signal: ends the work within a few seconds and prints how to resume it.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::Builder;
use std::time::{Duration, Instant};

use super::progress::{stoppable, tell};
use crate::base::error::{escape_path, is_unseen};
use crate::base::{Error, Progress, Result};
use crate::os::signals::StopSignal;
use crate::read::InputChoice;

/// Time in which the work may end by itself; then the process exits without waiting, which is safe too.
const GRACE: Duration = Duration::from_secs(3);
/// Time to print the message then.
const WORDS_TIME: Duration = Duration::from_millis(200);
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

/// Message for the end of the process after a signal: how to resume.
#[derive(Debug, Clone)]
pub struct Goodbye {
    stop: StopSignal,
    words: Arc<Mutex<Words>>,
}

#[derive(Debug)]
enum Words {
    Job { work: PathBuf, command: String },
    Comparison { command: Option<String> },
    Nothing,
}

impl Goodbye {
    /// For a job whose steps are kept in a work folder: the same command resumes it. From now on the process ends soon
    /// after a signal, even if its work does not end by itself.
    pub fn of_job(stop: &StopSignal, work: &Path) -> Self {
        Self::new(stop, Words::Job { work: work.to_owned(), command: command_that_goes_on(std::env::args_os()) })
    }

    /// For work that keeps nothing.
    pub fn of_nothing(stop: &StopSignal) -> Self {
        Self::new(stop, Words::Nothing)
    }

    fn new(stop: &StopSignal, words: Words) -> Self {
        let goodbye = Self { stop: stop.clone(), words: Arc::new(Mutex::new(words)) };
        let late = goodbye.clone();
        // If no thread can be started, the work still ends by itself.
        let _ = Builder::new().spawn(move || {
            let mut came = None;
            loop {
                std::thread::sleep(LOOK_INTERVAL);
                if late.stop.number().is_some() && came.get_or_insert_with(Instant::now).elapsed() >= GRACE {
                    // The message may block if its reader has stopped reading.
                    let saying = late.clone();
                    let _ = Builder::new().spawn(move || saying.say());
                    std::thread::sleep(WORDS_TIME);
                    std::process::exit(i32::from(late.exit_code()));
                }
            }
        });
        goodbye
    }

    /// Records that only the comparison of a result is left.
    pub fn only_compares(&self, input: &InputChoice, output: &Path) {
        // `drystone compare` takes one whole input.
        let is_one = input.paths.len() == 1 && input.exclude.is_empty();
        let [input, output] = [input.name(), output].map(|path| quoted(path.as_os_str()));
        let words = Words::Comparison { command: is_one.then(|| format!("drystone compare {input} {output}")) };
        *self.words.lock().unwrap_or_else(PoisonError::into_inner) = words;
    }

    /// Prints the message and returns the exit code: 128 plus the number of the signal.
    pub fn say(&self) -> u8 {
        let words = match &*self.words.lock().unwrap_or_else(PoisonError::into_inner) {
            Words::Job { work, command } if work.join("journal.bin").exists() => {
                format!("what is finished is kept in {}; resume with\n  {command}", escape_path(work))
            }
            Words::Job { command, .. } => format!("nothing was finished yet; start again with\n  {command}"),
            Words::Nothing => "nothing is kept".to_owned(),
            Words::Comparison { command: Some(command) } => {
                format!("the result is written; it was not compared. Do so with\n  {command}")
            }
            Words::Comparison { command: None } => "the result is written; it was not compared".to_owned(),
        };
        tell(&format!("stopped by {}; {words}", self.stop.name()));
        self.exit_code()
    }

    fn exit_code(&self) -> u8 {
        128 + self.stop.number().unwrap_or(0)
    }
}

/// Does the work of a command that keeps nothing and shows what it found, unless a signal stops it. Returns the exit code.
///
/// # Errors
/// Those of `work` and `show`.
pub fn run_unkept<T>(
    quiet: bool,
    work: impl FnOnce(&dyn Progress) -> Result<T>,
    show: impl FnOnce(&T) -> Result<u8>,
) -> Result<u8> {
    let stop = StopSignal::listen()?;
    let goodbye = Goodbye::of_nothing(&stop);
    // The bar is gone before anything is shown.
    let outcome = work(&*stoppable(quiet, stop));
    match outcome {
        Err(Error::Stopped) => Ok(goodbye.say()),
        outcome => show(&outcome?),
    }
}

/// The command as it was typed.
pub fn command_line() -> String {
    std::env::args_os().map(|word| quoted(&word)).collect::<Vec<_>>().join(" ")
}

/// The command as it was typed, with `--resume never` replaced so that it resumes the job.
fn command_that_goes_on(words: impl Iterator<Item = OsString>) -> String {
    let mut is_resume = false;
    let words = words.map(|word| match word.to_str() {
        Some("never") if is_resume => "auto".to_owned(),
        Some("--resume=never") => "--resume=auto".to_owned(),
        _ => {
            is_resume = word == "--resume";
            quoted(&word)
        }
    });
    words.collect::<Vec<_>>().join(" ")
}

/// A word quoted for a shell; in the way of Bash if it has characters other than printable text.
fn quoted(word: &OsStr) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+=:,@%".contains(c);
    match word.to_str() {
        Some(word) if !word.is_empty() && word.chars().all(is_plain) => word.to_owned(),
        Some(word) if !word.contains(is_unseen) => format!("'{}'", word.replace('\'', "'\\''")),
        _ => {
            let byte = |&byte: &u8| match byte {
                b'\'' | b'\\' => format!("\\{}", char::from(byte)),
                b' '..=b'~' => char::from(byte).to_string(),
                _ => format!("\\x{byte:02x}"),
            };
            format!("$'{}'", word.as_encoded_bytes().iter().map(byte).collect::<String>())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_that_goes_on_does_not_begin_afresh() {
        let goes_on = |command: &str| command_that_goes_on(command.split(' ').map(OsString::from));
        assert_eq!(goes_on("drystone a.obj --resume never -o never"), "drystone a.obj --resume auto -o never");
        assert_eq!(goes_on("drystone --resume=never a.obj"), "drystone --resume=auto a.obj");
        assert_eq!(goes_on("drystone --resume require never"), "drystone --resume require never");
    }

    #[test]
    fn words_are_quoted_where_a_shell_would_part_them() {
        let quoted = |word: &str| quoted(word.as_ref());
        assert_eq!(quoted("--ratio=0.1"), "--ratio=0.1");
        assert_eq!(quoted("my city.obj"), "'my city.obj'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
        assert_eq!(quoted("a\u{202e}jbo.b"), "$'a\\xe2\\x80\\xaejbo.b'");
        assert_eq!(quoted(""), "''");
        assert_eq!(quoted("\u{1b}[31m it's"), "$'\\x1b[31m it\\'s'");
    }
}

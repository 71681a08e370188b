//! What happens when a signal asks the program to stop: the end within a few seconds, and how to go on.

use std::ffi::OsStr;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::progress::tell;
use crate::base::error::escape_path;
use crate::os::signals::StopSignal;

/// Time that the work has to come to a safe end by itself; then the process ends as it is, which is safe too.
const GRACE: Duration = Duration::from_secs(3);
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

/// What is said when a signal ends the process: how to go on.
#[derive(Debug, Clone)]
pub struct Goodbye {
    stop: StopSignal,
    words: Arc<Mutex<String>>,
}

impl Goodbye {
    /// While a job runs whose steps are kept in a work folder: the same command goes on. From now on the process ends soon
    /// after a signal, even if its work does not end by itself.
    pub fn of_job(stop: &StopSignal, work: &Path) -> Self {
        let command: Vec<String> = std::env::args_os().map(|word| quoted(&word)).collect();
        let kept = escape_path(work);
        let words = format!("what is finished is kept in {kept}; go on with\n  {}", command.join(" "));
        let goodbye = Self { stop: stop.clone(), words: Arc::new(Mutex::new(words)) };
        let late = goodbye.clone();
        std::thread::spawn(move || {
            let mut came = None;
            loop {
                std::thread::sleep(LOOK_INTERVAL);
                if late.stop.number().is_some() && came.get_or_insert_with(Instant::now).elapsed() >= GRACE {
                    std::process::exit(i32::from(late.say()));
                }
            }
        });
        goodbye
    }

    /// From now on only the comparison of a result is under way.
    pub fn only_compares(&self, input: &Path, output: &Path) {
        let [input, output] = [input, output].map(|path| quoted(path.as_os_str()));
        let words =
            format!("the result is written; it was not compared. Do so with\n  drystone compare {input} {output}");
        *self.words.lock().unwrap_or_else(PoisonError::into_inner) = words;
    }

    /// Says it and returns the exit code: 128 and the signal.
    pub fn say(&self) -> u8 {
        let words = self.words.lock().unwrap_or_else(PoisonError::into_inner);
        tell(&format!("stopped by {}; {words}", self.stop.name()));
        128 + self.stop.number().unwrap_or(0)
    }
}

/// A word as a shell takes it; in the way of Bash if it has other than plain text.
fn quoted(word: &OsStr) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+=:,@%".contains(c);
    match word.to_str() {
        Some(word) if !word.is_empty() && word.chars().all(is_plain) => word.to_owned(),
        Some(word) if !word.contains(char::is_control) => format!("'{}'", word.replace('\'', "'\\''")),
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
    fn words_are_quoted_where_a_shell_would_part_them() {
        let quoted = |word: &str| quoted(word.as_ref());
        assert_eq!(quoted("--ratio=0.1"), "--ratio=0.1");
        assert_eq!(quoted("my city.obj"), "'my city.obj'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
        assert_eq!(quoted(""), "''");
        assert_eq!(quoted("\u{1b}[31m it's"), "$'\\x1b[31m it\\'s'");
    }
}

//! What happens when a signal asks the program to stop: the end within a few seconds, and how to go on.

use std::path::Path;
use std::time::{Duration, Instant};

use super::progress::tell;
use crate::base::error::escape_path;
use crate::os::signals::StopSignal;

/// Time that the work has to come to a safe end by itself; then the process ends as it is, which is safe too.
const GRACE: Duration = Duration::from_secs(3);
const LOOK_INTERVAL: Duration = Duration::from_millis(50);

/// Ends the process when a signal came and the work does not end by itself; `work` is the work folder.
pub fn end_late(stop: &StopSignal, work: &Path) {
    let (stop, work) = (stop.clone(), work.to_owned());
    std::thread::spawn(move || {
        let mut came = None;
        loop {
            std::thread::sleep(LOOK_INTERVAL);
            if stop.number().is_some() && came.get_or_insert_with(Instant::now).elapsed() >= GRACE {
                std::process::exit(i32::from(say_goodbye(&stop, &work)));
            }
        }
    });
}

/// Says how to go on and returns the exit code: 128 and the signal.
pub fn say_goodbye(stop: &StopSignal, work: &Path) -> u8 {
    tell(&format!("stopped by {}; what is finished is kept in {}; go on with", stop.name(), escape_path(work)));
    let words: Vec<String> = std::env::args_os().map(|word| quoted(&word.to_string_lossy())).collect();
    tell(&format!("  {}", words.join(" ")));
    128 + stop.number().unwrap_or(0)
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "/._-+=:,@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_where_a_shell_would_part_them() {
        assert_eq!(quoted("--ratio=0.1"), "--ratio=0.1");
        assert_eq!(quoted("my city.obj"), "'my city.obj'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
        assert_eq!(quoted(""), "''");
    }
}

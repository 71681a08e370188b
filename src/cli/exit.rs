//! The exit codes of the program, in one table.

use std::fmt::Write as _;

use crate::base::{Error, ErrorKind};
use crate::report::{Report, Status};

/// Every exit code and what it means.
pub const CODES: [(u8, &str); 14] = [
    (0, "done"),
    (
        1,
        "failed: the system refused, a limit was exceeded, a check found a fault, or --measure found --max-error broken",
    ),
    (2, "usage: an option or the memory budget is not possible, or the output exists"),
    (3, "written, but the target was missed; the message says why"),
    (4, "bad input: the message names the file, and the line if one is at fault"),
    (5, "the input, the options or the program changed since the job began, or --resume require found no job"),
    (6, "another process works in the work folder"),
    (7, "no space left on a disk, or not enough to begin"),
    (8, "a file of the work folder is damaged"),
    (9, "the job does not wait for the task any more, or there is no such stage"),
    (101, "a fault of the program: please report it with its message"),
    (129, "stopped by SIGHUP; the same command resumes"),
    (130, "stopped by SIGINT (Ctrl-C); the same command resumes"),
    (143, "stopped by SIGTERM; the same command resumes"),
];

/// Exit code for an error.
pub fn code_of(error: &Error) -> u8 {
    match error.kind() {
        ErrorKind::Usage | ErrorKind::Budget => 2,
        ErrorKind::Input => 4,
        ErrorKind::Changed => 5,
        ErrorKind::Locked => 6,
        ErrorKind::NoSpace => 7,
        ErrorKind::Damaged => 8,
        ErrorKind::Stopped => 130,
        _ => 1,
    }
}

/// Exit code for a finished run: 1 if a measured distance exceeds `--max-error`, else 3 if the target was missed.
pub fn code_of_run(report: &Report) -> u8 {
    match report.status {
        _ if report.broken_bound().is_some() => 1,
        Status::Done => 0,
        Status::TargetMissed => 3,
    }
}

/// The table as `--help` prints it.
pub fn help() -> String {
    let mut text = "Exit codes:\n".to_owned();
    for (code, meaning) in CODES {
        let _ = writeln!(text, "{code:>5}  {meaning}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_error_has_a_code_in_the_table() {
        let path = std::path::PathBuf::new;
        let io = std::io::Error::other("");
        let errors = [
            Error::Usage(String::new()),
            Error::Input { path: path(), line: 0, message: String::new() },
            Error::Io { path: path(), action: "read", source: io },
            Error::NoSpace { path: path(), message: String::new() },
            Error::Budget { needed: None, message: String::new() },
            Error::Changed(String::new()),
            Error::Locked(path()),
            Error::Damaged { path: path(), message: String::new() },
            Error::Stopped,
            Error::Limit(String::new()),
            Error::Task { task: 0, exit_code: None, message: String::new() },
        ];
        assert!(errors.iter().all(|error| CODES.iter().any(|(code, _)| *code == code_of(error))));
        assert!(CODES.is_sorted_by_key(|(code, _)| *code));
    }
}

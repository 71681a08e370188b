//! The error type of the library.
//!
//! Messages are lower case, begin with `file:line:` if a line is known, and say what was expected, what was found and
//! what to do. Options stand in backticks, as the library names them. Text from the input is escaped.

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::bytes;

/// Why a run stopped.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The options contradict each other or are out of range.
    #[error("{0}")]
    Usage(String),
    /// The input is not a valid mesh; `line` is counted from 1, or 0 if no line is at fault.
    #[error("{}", at_line(.path, *.line, .message))]
    Input {
        /// File at fault.
        path: PathBuf,
        /// Line, counted from 1, or 0.
        line: u64,
        /// What was expected and what was found.
        message: String,
    },
    /// A file operation failed.
    #[error("{}: cannot {action}: {source}", escape_path(.path))]
    Io {
        /// File at fault.
        path: PathBuf,
        /// The operation that failed: "open", "write", …
        action: &'static str,
        /// Error of the system.
        source: io::Error,
    },
    /// A disk is full, or would be.
    #[error("{}: no space left: {message}", escape_path(.path))]
    NoSpace {
        /// File or folder at fault.
        path: PathBuf,
        /// Bytes needed and found.
        message: String,
    },
    /// The memory budget cannot hold the job.
    #[error("the memory budget is too small: {message}")]
    Budget {
        /// Budget in bytes that would suffice, if that is known.
        needed: Option<u64>,
        /// What does not fit, and what would do.
        message: String,
    },
    /// The input or the options differ from those that the work folder was created with.
    #[error("{0}")]
    Changed(String),
    /// Another process holds the lock of the work folder.
    #[error("{}: locked by another process", escape_path(.0))]
    Locked(PathBuf),
    /// The content of a file in the work folder is not what was written.
    #[error("{}: damaged: {message}", escape_path(.path))]
    Damaged {
        /// File at fault.
        path: PathBuf,
        /// What was expected and what was found.
        message: String,
    },
    /// The caller asked to stop; finished steps stay recorded.
    #[error("stopped")]
    Stopped,
    /// The mesh exceeds a limit of the program (such as 2³² - 2 vertices).
    #[error("{0}")]
    Limit(String),
    /// A task that was to be done elsewhere has no result.
    #[error("{message}")]
    Task {
        /// The number of the task in its stage.
        task: usize,
        /// Exit code of the task runner, if it ended with one.
        exit_code: Option<i32>,
        /// Task, tries and the last error.
        message: String,
    },
    /// A task that was done elsewhere failed.
    #[error("{message}")]
    Elsewhere {
        /// Kind of the error there.
        kind: ErrorKind,
        /// Task, machine and error.
        message: String,
    },
}

/// Result with the library's error.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Wraps an [`io::Error`] with the file and the operation; returns [`Error::NoSpace`] for a full disk.
    pub fn io(path: &Path, action: &'static str, source: io::Error) -> Self {
        if matches!(source.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded) {
            return Error::NoSpace { path: path.to_owned(), message: what_is_free(path, &source) };
        }
        Error::Io { path: path.to_owned(), action, source }
    }

    /// If the disk is full, adds the approximate number of bytes that were still to be written.
    pub fn lacking(self, missing: u64) -> Self {
        match self {
            Error::NoSpace { path, message } if missing > 0 => {
                let message = format!("about {} more are needed, {message}", bytes::display(missing));
                Error::NoSpace { path, message }
            }
            other => other,
        }
    }

    /// An [`Error::Input`] at a line (0: no line).
    pub fn input(path: &Path, line: u64, message: impl Into<String>) -> Self {
        Error::Input { path: path.to_owned(), line, message: message.into() }
    }

    /// The kind of the error, for a program that decides by it.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Error::Usage(_) => ErrorKind::Usage,
            Error::Input { .. } => ErrorKind::Input,
            Error::Io { .. } => ErrorKind::Io,
            Error::NoSpace { .. } => ErrorKind::NoSpace,
            Error::Budget { .. } => ErrorKind::Budget,
            Error::Changed(_) => ErrorKind::Changed,
            Error::Locked(_) => ErrorKind::Locked,
            Error::Damaged { .. } => ErrorKind::Damaged,
            Error::Stopped => ErrorKind::Stopped,
            Error::Limit(_) => ErrorKind::Limit,
            Error::Task { .. } => ErrorKind::Task,
            Error::Elsewhere { kind, .. } => *kind,
        }
    }
}

/// Kinds of [`Error`]s.
#[non_exhaustive]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum ErrorKind {
    /// The options contradict each other or are out of range.
    Usage,
    /// The input is not a valid mesh.
    Input,
    /// A file operation failed.
    Io,
    /// A disk is full, or would be.
    NoSpace,
    /// The memory budget cannot hold the job.
    Budget,
    /// The input or the options differ from those of the unfinished job.
    Changed,
    /// Another process works on the job.
    Locked,
    /// A file in the work folder is damaged.
    Damaged,
    /// The caller asked to stop.
    Stopped,
    /// The mesh exceeds a limit of the program.
    Limit,
    /// A task that was to be done elsewhere has no result.
    Task,
}

/// Describes how much space is free at `path`, and what to do.
fn what_is_free(path: &Path, source: &io::Error) -> String {
    let folder = path.ancestors().find(|folder| folder.is_dir()).unwrap_or(Path::new("."));
    let quota = if source.kind() == io::ErrorKind::QuotaExceeded { "the quota is used up; " } else { "" };
    let free =
        fs4::available_space(folder).map_or(String::new(), |free| format!("{} are free; ", bytes::display(free)));
    format!("{quota}{free}free some and run the same command again")
}

fn at_line(path: &Path, line: u64, message: &str) -> String {
    match line {
        0 => format!("{}: {message}", escape_path(path)),
        _ => format!("{}:{line}: {message}", escape_path(path)),
    }
}

/// Formats a path for a message; escapes control characters and bytes outside UTF-8.
pub fn escape_path(path: &Path) -> String {
    escape(path.as_os_str().as_encoded_bytes())
}

/// Characters of a text from the input that a message shows.
const ESCAPED_MAX: usize = 200;

/// Formats text from the input for a message: escapes control characters, invisible ones and invalid UTF-8; truncates
/// after 200 characters.
pub fn escape(text: &[u8]) -> String {
    let shown = |c: char| if is_unseen(c) { c.escape_default().to_string() } else { c.to_string() };
    let escaped = text.utf8_chunks().flat_map(|chunk| {
        let invalid = chunk.invalid().iter().map(|byte| format!("\\x{byte:02x}"));
        chunk.valid().chars().map(shown).chain(invalid)
    });
    let mut out = String::new();
    for part in escaped {
        out += &part;
        if out.chars().count() > ESCAPED_MAX {
            return out.chars().take(ESCAPED_MAX).chain(['…']).collect();
        }
    }
    out
}

/// Reports whether a character controls the terminal, changes the text direction, or is invisible.
pub fn is_unseen(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped_in_messages() {
        let error = Error::input(Path::new("a\u{1b}[31m.obj"), 7, "expected a number");
        assert_eq!(error.to_string(), "a\\u{1b}[31m.obj:7: expected a number");
        assert_eq!(escape("a\u{202e}jbo.b".as_bytes()), "a\\u{202e}jbo.b");
    }

    #[test]
    fn a_full_disk_is_told_with_what_is_missing() {
        let full = || io::Error::from(io::ErrorKind::StorageFull);
        let error = Error::io(Path::new("a.obj"), "write", full()).lacking(2 << 20);
        assert!(
            error.to_string().contains("about 2 MiB more are needed") && error.kind() == ErrorKind::NoSpace,
            "{error}"
        );
    }

    #[test]
    fn long_text_is_cut() {
        assert_eq!(escape(&[b'a'; 1000]).chars().count(), 201);
    }
}

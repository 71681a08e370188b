//! The one error type of the library, and the exit code that each kind of error has.
//!
//! Messages are lower case, begin with `file:line:` where a line is known, and name what was expected, what was
//! found and the way out. Text that comes from the input is escaped before it is quoted.

use std::io;
use std::path::{Path, PathBuf};

use super::bytes;

/// What stopped a run.
#[non_exhaustive]
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The options contradict each other or are out of range.
    #[error("{0}")]
    Usage(String),
    /// The input cannot be read as a mesh; `line` is 1-based, 0 where no line is to blame.
    #[error("{}", at_line(.path, *.line, .message))]
    Input {
        /// File at fault.
        path: PathBuf,
        /// 1-based line, or 0.
        line: u64,
        /// What was expected and what was found.
        message: String,
    },
    /// The operating system refused a file operation.
    #[error("{}: cannot {action}: {source}", escape_path(.path))]
    Io {
        /// File at fault.
        path: PathBuf,
        /// What was tried: "open", "write", …
        action: &'static str,
        /// The system's answer.
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
    #[error("the memory budget is too small: {0}")]
    Budget(String),
    /// The input or the options differ from those that the work folder was made with.
    #[error("{0}")]
    Changed(String),
    /// Another process holds the work folder.
    #[error("{}: locked by another process", escape_path(.0))]
    Locked(PathBuf),
    /// A file of the work folder does not hold what was written to it.
    #[error("{}: damaged: {message}", escape_path(.path))]
    Damaged {
        /// File at fault.
        path: PathBuf,
        /// What was expected and what was found.
        message: String,
    },
    /// The caller asked to stop; what is finished is kept.
    #[error("stopped")]
    Stopped,
    /// The mesh passes a limit of the program (such as 2³² - 2 vertices).
    #[error("{0}")]
    Limit(String),
}

/// Result with the library's error.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Wraps an [`io::Error`] with the file and what was tried; a full disk becomes [`Error::NoSpace`].
    pub fn io(path: &Path, action: &'static str, source: io::Error) -> Self {
        if matches!(source.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded) {
            return Error::NoSpace { path: path.to_owned(), message: what_is_free(path, &source) };
        }
        Error::Io { path: path.to_owned(), action, source }
    }

    /// The same, with what was still to be written there, about, if the disk is full.
    pub fn lacking(self, missing: u64) -> Self {
        match self {
            Error::NoSpace { path, message } if missing > 0 => {
                let message = format!("about {} more are needed to go on, {message}", bytes::display(missing));
                Error::NoSpace { path, message }
            }
            other => other,
        }
    }

    /// An [`Error::Input`] at a line (0: no line).
    pub fn input(path: &Path, line: u64, message: impl Into<String>) -> Self {
        Error::Input { path: path.to_owned(), line, message: message.into() }
    }

    /// The process's exit code for this error; the table stands in `docs/reference/options.md`.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Io { .. } | Error::Limit(_) => 1,
            Error::Usage(_) | Error::Budget(_) => 2,
            Error::Input { .. } => 4,
            Error::Changed(_) => 5,
            Error::Locked(_) => 6,
            Error::NoSpace { .. } => 7,
            Error::Damaged { .. } => 8,
            Error::Stopped => 130,
        }
    }
}

/// What is free where a file was to grow, and the way out.
fn what_is_free(path: &Path, source: &io::Error) -> String {
    let folder = path.ancestors().find(|folder| folder.is_dir()).unwrap_or(Path::new("."));
    let quota = if source.kind() == io::ErrorKind::QuotaExceeded { "the quota is used up; " } else { "" };
    let free =
        fs4::available_space(folder).map_or(String::new(), |free| format!("{} are free; ", bytes::display(free)));
    format!("{quota}{free}free some and give the same command again")
}

fn at_line(path: &Path, line: u64, message: &str) -> String {
    match line {
        0 => format!("{}: {message}", escape_path(path)),
        _ => format!("{}:{line}: {message}", escape_path(path)),
    }
}

/// A path for a message: control characters and bytes outside UTF-8 are escaped.
pub fn escape_path(path: &Path) -> String {
    escape(path.as_os_str().as_encoded_bytes())
}

/// Text from the input for a message: UTF-8 kept, control characters, invisible ones and other bytes escaped, at most 200 characters.
pub fn escape(text: &[u8]) -> String {
    let mut out = String::new();
    for chunk in text.utf8_chunks() {
        for c in chunk.valid().chars() {
            if is_unseen(c) {
                out.extend(c.escape_default());
            } else {
                out.push(c);
            }
        }
        for byte in chunk.invalid() {
            out.push_str(&format!("\\x{byte:02x}"));
        }
        if out.chars().count() > 200 {
            let cut: String = out.chars().take(200).collect();
            return cut + "…";
        }
    }
    out
}

/// Whether a character commands the terminal, turns the text around it, or is not seen.
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
        assert!(error.to_string().contains("about 2 MiB more are needed") && error.exit_code() == 7, "{error}");
    }

    #[test]
    fn long_text_is_cut() {
        assert_eq!(escape(&[b'a'; 1000]).chars().count(), 201);
    }
}

//! Prints results to stdout; a reader that closed the pipe (`| head`) is no error.

use std::io::{ErrorKind, Write as _};
use std::path::Path;

use serde::Serialize;

use crate::base::{Error, Result};

/// Prints text.
///
/// # Errors
/// [`Error::Io`], also for a full disk: printing is no part of a job that can be resumed.
pub fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Error::Io { path: "standard output".into(), action: "write", source: error })
        }
        _ => Ok(()),
    }
}

/// Prints a value as JSON.
///
/// # Errors
/// If a value has no form in JSON; those of [`print`].
pub fn print_json(value: &impl Serialize) -> Result<()> {
    let text =
        serde_json::to_string_pretty(value).map_err(|e| Error::io(Path::new("standard output"), "write", e.into()))?;
    print(&(text + "\n"))
}

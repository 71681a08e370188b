//! Files of a report, JSON or a page, each written whole or not at all.

use std::path::Path;

use serde::Serialize;

use crate::base::error::escape_path;
use crate::base::{Error, Result};
use crate::os::durable::{DurableFile, new_job_number};

/// Writes a value as JSON, to a file that is written whole or not at all.
///
/// # Errors
/// The file system's; [`Error::Damaged`] for a value that JSON cannot hold.
pub fn save_json(value: &impl Serialize, path: &Path) -> Result<()> {
    save_text(&json(value, path)?, path, new_job_number(path))
}

pub(super) fn json(value: &impl Serialize, path: &Path) -> Result<String> {
    let damaged = |e: serde_json::Error| Error::Damaged { path: path.to_owned(), message: e.to_string() };
    serde_json::to_string_pretty(value).map_err(damaged)
}

/// Writes a text and a line feed, to a file that is written whole or not at all.
pub(super) fn save_text(text: &str, path: &Path, job: u64) -> Result<()> {
    let mut file = DurableFile::create_outside(path, job, 64 << 10)?;
    file.write(text.as_bytes())?;
    file.write(b"\n")?;
    file.commit()?;
    Ok(())
}

/// Kinds of report files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReportKind {
    /// For scripts.
    Json,
    /// A page for people.
    Html,
}

impl ReportKind {
    /// Kind of a path, by its extension.
    ///
    /// # Errors
    /// [`Error::Usage`] for an extension other than `.json` or `.html`.
    pub fn of(path: &Path) -> Result<Self> {
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("json") => Ok(Self::Json),
            Some("html") => Ok(Self::Html),
            _ => {
                let shown = escape_path(path);
                Err(Error::Usage(format!("`report: {shown}`: expected a name that ends in .json or .html")))
            }
        }
    }
}

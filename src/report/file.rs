//! Files of a report, JSON or a page, each written whole or not at all.

use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::base::error::escape_path;
use crate::base::{Error, Result};
use crate::os::durable::{DurableFile, make_folders, new_job_number};

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

    /// Kinds of report files that are written once all is done: makes their folders.
    ///
    /// # Errors
    /// As [`of`](ReportKind::of), and for a path that is a folder; if a folder cannot be made.
    pub fn prepare(paths: &[PathBuf]) -> Result<Vec<Self>> {
        let kinds = paths.iter().map(|path| Self::of(path)).collect::<Result<Vec<_>>>()?;
        paths.iter().filter_map(|path| path.parent()).try_for_each(make_folders)?;
        match paths.iter().find(|path| path.is_dir()) {
            Some(path) => Err(Error::Usage(format!("`report: {}`: is a folder", escape_path(path)))),
            None => Ok(kinds),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_cannot_be_written_are_refused_before_the_work() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let kinds = ReportKind::prepare(&[path("new/a.json"), path("b.html")]).unwrap();
        assert_eq!(kinds, [ReportKind::Json, ReportKind::Html]);
        assert!(path("new").is_dir());
        std::fs::create_dir(path("c.json")).unwrap();
        for name in ["c.json", "d.txt", "d"] {
            assert!(matches!(ReportKind::prepare(&[path(name)]), Err(Error::Usage(_))), "{name}");
        }
    }
}

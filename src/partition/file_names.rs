//! Names of the files of a partition.

use std::path::{Path, PathBuf};

/// Names of the files of a partition.
#[derive(Debug, Clone, Copy)]
pub(super) struct FileNames<'a> {
    pub folder: &'a Path,
    /// Begins every name.
    pub prefix: &'a str,
}

impl FileNames<'_> {
    /// Path of a file, by the end of its name.
    pub fn path(self, ending: &str) -> PathBuf {
        self.folder.join(format!("{}-{ending}", self.prefix))
    }
}

//! Paths as JSON has them, which is UTF-8 and paths need not be: other bytes are replaced, for people to read.

use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};

/// Writes a path, for `serialize_with`.
///
/// # Errors
/// The serializer's.
pub fn lossy<S: Serializer>(path: &Path, serializer: S) -> Result<S::Ok, S::Error> {
    path.to_string_lossy().serialize(serializer)
}

/// Writes a path or nothing, for `serialize_with`.
///
/// # Errors
/// The serializer's.
pub fn lossy_option<S: Serializer>(path: &Option<PathBuf>, serializer: S) -> Result<S::Ok, S::Error> {
    path.as_ref().map(|path| path.to_string_lossy()).serialize(serializer)
}

/// Writes a list of paths, for `serialize_with`.
///
/// # Errors
/// The serializer's.
pub fn lossy_list<S: Serializer>(paths: &[PathBuf], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(paths.iter().map(|path| path.to_string_lossy()))
}

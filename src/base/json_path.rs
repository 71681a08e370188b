//! Serialises paths to JSON for people to read. JSON is UTF-8 and a path need not be; invalid bytes are replaced.

use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};

/// Serialises a path, for `serialize_with`.
///
/// # Errors
/// Those of the serializer.
pub fn lossy<S: Serializer>(path: &Path, serializer: S) -> Result<S::Ok, S::Error> {
    path.to_string_lossy().serialize(serializer)
}

/// Serialises an optional path, for `serialize_with`.
///
/// # Errors
/// Those of the serializer.
pub fn lossy_option<S: Serializer>(path: &Option<PathBuf>, serializer: S) -> Result<S::Ok, S::Error> {
    path.as_ref().map(|path| path.to_string_lossy()).serialize(serializer)
}

/// Serialises a list of paths, for `serialize_with`.
///
/// # Errors
/// Those of the serializer.
pub fn lossy_list<S: Serializer>(paths: &[PathBuf], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(paths.iter().map(|path| path.to_string_lossy()))
}

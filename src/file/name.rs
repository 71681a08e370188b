//! Names of files in a work folder, and how a value refers to its file.

use std::io::ErrorKind;
use std::path::Path;

/// Reports whether a name denotes a file in the folder itself: no separators, not `.` or `..`.
pub fn is_file_name(name: &str) -> bool {
    !name.is_empty() && name != "." && name != ".." && !name.contains(['/', '\\', '\0'])
}

/// Reports whether a file is large enough for disjoint extents, each given as offset and length in bytes. Checked
/// before memory is allocated for records that a journal claims to exist. True if the size of an existing file cannot
/// be determined; reading it then reports the error.
pub fn holds(path: &Path, extents: impl IntoIterator<Item = (u64, u64)>) -> bool {
    let length = match path.metadata() {
        Ok(file) => file.len(),
        Err(error) => return error.kind() != ErrorKind::NotFound,
    };
    let mut left = length;
    extents.into_iter().all(|(offset, bytes)| {
        let fits = offset.checked_add(bytes).is_some_and(|end| end <= length) && bytes <= left;
        left = left.saturating_sub(bytes);
        fits
    })
}

/// Serialises a path as its file name alone, since a work folder may be moved.
pub mod file_name {
    use std::path::{Path, PathBuf};

    use serde::de::Error as _;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::is_file_name;

    /// Writes the file name of a path.
    ///
    /// # Errors
    /// Those of the serializer.
    pub fn serialize<S: Serializer>(path: &(impl AsRef<Path> + ?Sized), serializer: S) -> Result<S::Ok, S::Error> {
        path.as_ref().file_name().unwrap_or_default().to_string_lossy().serialize(serializer)
    }

    /// Reads a file name.
    ///
    /// # Errors
    /// If the name leads to another folder, and those of the deserializer.
    pub fn deserialize<'de, D: Deserializer<'de>, P: From<PathBuf>>(deserializer: D) -> Result<P, D::Error> {
        let name = String::deserialize(deserializer)?;
        if !is_file_name(&name) {
            return Err(D::Error::custom("a file outside the work folder"));
        }
        Ok(PathBuf::from(name).into())
    }
}

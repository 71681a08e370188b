//! Paths from names in text files.

use std::path::PathBuf;

/// The path that a name in OBJ or MTL text stands for: `\` separates folders as `/` does.
pub fn path_of_name(name: &[u8]) -> PathBuf {
    path_of_bytes(&with_slashes(name))
}

/// A name with `/` in place of `\`.
pub fn with_slashes(name: &[u8]) -> Vec<u8> {
    name.iter().map(|&byte| if byte == b'\\' { b'/' } else { byte }).collect()
}

/// A path of these bytes; where paths are text, bytes that are not UTF-8 become replacement characters.
#[cfg(unix)]
pub fn path_of_bytes(bytes: &[u8]) -> PathBuf {
    use std::os::unix::ffi::OsStrExt;
    PathBuf::from(std::ffi::OsStr::from_bytes(bytes))
}

/// A path of these bytes; where paths are text, bytes that are not UTF-8 become replacement characters.
#[cfg(not(unix))]
pub fn path_of_bytes(bytes: &[u8]) -> PathBuf {
    PathBuf::from(String::from_utf8_lossy(bytes).into_owned())
}

//! The content of files that are not ours, by which a change is detected and copies are recognised.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::{Xxh3, xxh3_64};

/// Most bytes read at once.
const READ_BYTES: u64 = 256 << 10;

/// Length and hash of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
pub struct Content {
    /// Length in bytes.
    pub bytes: u64,
    /// XXH3 of all bytes.
    pub hash: u64,
}

impl Content {
    /// Content of a regular file.
    ///
    /// # Errors
    /// An I/O error; `InvalidInput` if it is not a regular file.
    pub fn of(path: &Path) -> io::Result<Self> {
        if !fs::metadata(path)?.is_file() {
            return Err(ErrorKind::InvalidInput.into());
        }
        Self::pass(File::open(path)?, |_| Ok(()))
    }

    /// Content of a text in memory.
    pub fn of_bytes(bytes: &[u8]) -> Self {
        Self { bytes: bytes.len() as u64, hash: xxh3_64(bytes) }
    }

    /// Content of an open file from where it was read to, passed on piece by piece.
    ///
    /// # Errors
    /// Those of reading, and of `take`.
    pub fn pass<E: From<io::Error>>(file: File, mut take: impl FnMut(&[u8]) -> Result<(), E>) -> Result<Self, E> {
        // Files that the system generates, like those of /proc, have no length and may have no end.
        let length = file.metadata()?.len();
        let mut file = file.take(length);
        let (mut bytes, mut hash) = (0, Xxh3::new());
        // Most textures of a survey are far smaller.
        let mut buffer = vec![0; length.clamp(1, READ_BYTES) as usize];
        loop {
            match file.read(&mut buffer) {
                Ok(0) => return Ok(Self { bytes, hash: hash.digest() }),
                Ok(count) => {
                    bytes += count as u64;
                    hash.update(&buffer[..count]);
                    take(&buffer[..count])?;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_is_that_of_the_bytes_and_only_regular_files_have_some() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let text: Vec<u8> = (0..3 * READ_BYTES).map(|i| i as u8).collect();
        fs::write(&path, &text).unwrap();
        assert_eq!(Content::of(&path).unwrap(), Content::of_bytes(&text));
        assert_eq!(Content::of(folder.path()).unwrap_err().kind(), ErrorKind::InvalidInput);
        let mut passed = Vec::new();
        let content = Content::pass(File::open(&path).unwrap(), |bytes| {
            passed.extend_from_slice(bytes);
            Ok::<(), io::Error>(())
        });
        assert_eq!((content.unwrap(), passed), (Content::of_bytes(&text), text));
    }
}

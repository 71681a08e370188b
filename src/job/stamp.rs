//! Stamps of finished files, by which they are verified before they are trusted again.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use crate::base::{Error, Result};
use crate::file::header::{HEADER_BYTES, Header};
use crate::file::name::is_file_name;
use crate::os::content::Content;
use crate::os::durable::no_links;

/// Stamp of a file in the work folder: its name, its length, and hashes of its first 64 bytes and of the rest.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    name: String,
    bytes: u64,
    /// XXH3 of the header.
    header: u64,
    /// XXH3 of what follows: the checksum in the header, or that of the content if the file has none, as an image.
    rest: u64,
}

/// State of a file compared with its stamp.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Condition {
    /// Its content is unchanged.
    Whole,
    /// It does not exist: removed when no longer needed, or by someone else.
    Gone,
    /// Its content differs, with a description.
    Damaged(String),
}

impl Stamp {
    /// Stamps a file that was just committed.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn of(path: &Path) -> Result<Self> {
        let wrap = |e| Error::io(path, "read", e);
        let mut file = File::open(path).map_err(wrap)?;
        let mut header = [0; HEADER_BYTES as usize];
        file.read_exact(&mut header).map_err(wrap)?;
        let bytes = file.metadata().map_err(wrap)?.len();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let rest = match Header::decode(&header) {
            Ok(header) => header.checksum,
            Err(_) => hash_of_rest(file).map_err(wrap)?,
        };
        Ok(Self { name, bytes, header: xxh3_64(&header), rest })
    }

    /// Compares length and header of the file with the stamp. The content is read of files without a header alone: blocks
    /// have checksums of their own.
    pub fn is_at_head(&self, folder: &Path) -> bool {
        let path = folder.join(&self.name);
        let is_file = fs::symlink_metadata(&path).is_ok_and(|meta| meta.is_file());
        is_file_name(&self.name) && is_file && Self::of(&path).is_ok_and(|found| found == *self)
    }

    /// The file's name in the work folder.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Reads the whole file and compares it with the stamp.
    ///
    /// # Errors
    /// If the file exists and cannot be read.
    pub fn verify(&self, folder: &Path) -> Result<Condition> {
        let path = folder.join(&self.name);
        let damaged = |what: &str| Ok(Condition::Damaged(what.to_owned()));
        if !is_file_name(&self.name) {
            return damaged("the journal names a file outside the work folder");
        }
        let found = match fs::symlink_metadata(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Condition::Gone),
            found => found.map_err(|e| Error::io(&path, "read", e))?,
        };
        if !found.is_file() {
            return damaged("not a regular file");
        }
        if found.len() != self.bytes {
            return Ok(Condition::Damaged(format!("{} bytes were written, it has {}", self.bytes, found.len())));
        }
        let mut options = File::options();
        let mut file = no_links(options.read(true)).open(&path).map_err(|e| Error::io(&path, "open", e))?;
        let mut header = [0; HEADER_BYTES as usize];
        file.read_exact(&mut header).map_err(|e| Error::io(&path, "read", e))?;
        if xxh3_64(&header) != self.header {
            return damaged("its header is not the one that was written");
        }
        let rest = hash_of_rest(file).map_err(|e| Error::io(&path, "read", e))?;
        if rest == self.rest { Ok(Condition::Whole) } else { damaged("its checksum does not match") }
    }
}

fn hash_of_rest(file: File) -> io::Result<u64> {
    Ok(Content::pass(file, |_| Ok::<(), io::Error>(()))?.hash)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(path: &Path, content: &[u8]) -> Stamp {
        let header = Header { kind: *b"test    ", record_bytes: 1, count: 4, checksum: xxh3_64(content) };
        fs::write(path, [&header.encode(), content].concat()).unwrap();
        Stamp::of(path).unwrap()
    }

    #[test]
    fn a_file_without_a_header_is_stamped_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let mut bytes: Vec<u8> = (0..200).collect();
        fs::write(&path, &bytes).unwrap();
        let stamp = Stamp::of(&path).unwrap();
        assert!(stamp.is_at_head(folder.path()));
        assert_eq!(stamp.verify(folder.path()).unwrap(), Condition::Whole);
        bytes[150] ^= 1;
        fs::write(&path, &bytes).unwrap();
        assert!(!stamp.is_at_head(folder.path()));
        assert!(matches!(stamp.verify(folder.path()).unwrap(), Condition::Damaged(_)));
    }

    #[test]
    fn any_change_of_a_stamped_file_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.col");
        let stamp = file(&path, b"four");
        assert_eq!(stamp.verify(folder.path()).unwrap(), Condition::Whole);
        let whole = fs::read(&path).unwrap();
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            fs::write(&path, bytes).unwrap();
            assert!(matches!(stamp.verify(folder.path()).unwrap(), Condition::Damaged(_)), "byte {at}");
        }
        for length in [0, 63, whole.len() - 1] {
            fs::write(&path, &whole[..length]).unwrap();
            assert!(matches!(stamp.verify(folder.path()).unwrap(), Condition::Damaged(_)), "{length} bytes");
        }
        file(&path, b"five");
        assert!(matches!(stamp.verify(folder.path()).unwrap(), Condition::Damaged(_)));
        fs::remove_file(&path).unwrap();
        assert_eq!(stamp.verify(folder.path()).unwrap(), Condition::Gone);
        // A folder in its place is not opened.
        fs::create_dir(&path).unwrap();
        let is_no_file = |condition| matches!(condition, Condition::Damaged(what) if what.contains("regular"));
        assert!(is_no_file(stamp.verify(folder.path()).unwrap()));
        let nowhere = stamp.verify(&path.join("a").join("b"));
        assert_eq!(nowhere.unwrap(), Condition::Gone);
    }

    #[test]
    fn a_name_is_one_of_a_file_in_a_folder() {
        assert!(["a.col", "a..b", ".a"].iter().all(|name| is_file_name(name)));
        assert!(!["", ".", "..", "a/b", "a\\b", "/", "a\0"].iter().any(|name| is_file_name(name)));
    }

    #[test]
    fn a_name_that_leaves_the_folder_is_never_opened() {
        let folder = tempfile::tempdir().unwrap();
        let outside = folder.path().join("secret");
        let stamp = Stamp { name: "../secret".into(), ..file(&outside, b"four") };
        fs::create_dir(folder.path().join("work")).unwrap();
        assert!(matches!(stamp.verify(&folder.path().join("work")).unwrap(), Condition::Damaged(_)));
    }
}

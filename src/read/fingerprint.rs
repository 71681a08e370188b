//! Fingerprints of all inputs of a result, by which a resumed job detects that one has changed.
//!
//! In: mesh files, material libraries, texture images. Out: hashes of their contents. Modification times are ignored,
//! and so are paths, except those of libraries, since texture names are relative to their folder. A mesh is hashed part
//! by part, as the scan hashes it: an OBJ by chunks, a PLY by blocks of a fixed size.
//!
//! # Memory
//! A chunk per thread, and the path of each file other than the meshes.

use std::collections::HashMap;
use std::fs;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use super::arrays::ArraySource;
use super::file::{OpenFile, chain};
use super::obj::ObjSource;
use super::source::{CHUNK_BYTES, Cutter, MeshFormat};
use crate::base::ordered::map_in_order;
use crate::base::{Error, Progress, Result, lock};
use crate::file::codec;
use crate::os::content::Content;
use crate::os::system::is_of_machine;

/// A file that the result depends on, other than the meshes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    /// Absolute path.
    #[serde(with = "codec::path")]
    pub path: PathBuf,
    /// Its content; `None` if it is not a readable regular file.
    pub content: Option<Content>,
    /// Hash of the canonical path if names in the file are relative to its folder, else 0.
    place: u64,
}

/// Cache of file contents, so that a file with several names is read once.
#[derive(Debug, Default)]
pub struct Contents(Mutex<HashMap<PathBuf, Content>>);

impl Contents {
    /// Content of a canonical path, cached.
    fn of(&self, path: PathBuf) -> std::io::Result<Content> {
        if let Some(content) = lock(&self.0).get(&path) {
            return Ok(*content);
        }
        let content = Content::of(&path)?;
        lock(&self.0).insert(path, content);
        Ok(content)
    }
}

impl Source {
    /// Fingerprints a material library.
    ///
    /// # Errors
    /// On an I/O error that leaves unknown whether the file exists.
    pub fn library(path: &Path, known: &Contents) -> Result<Self> {
        let canonical = fs::canonicalize(path);
        let place = canonical.as_ref().map_or(0, |path| xxh3_64(path.as_os_str().as_encoded_bytes()));
        let source = Self::new(path, canonical.and_then(|path| known.of(path)))?;
        Ok(Self { place: if source.content.is_some() { place } else { 0 }, ..source })
    }

    /// Fingerprints a texture image inside a folder. One that lies outside of it, even by a link, counts as missing.
    ///
    /// # Errors
    /// As [`library`](Source::library).
    pub fn inside(folder: &Path, path: &Path, known: &Contents) -> Result<Self> {
        let look = || {
            let path = fs::canonicalize(path)?;
            let is_inside = path.starts_with(fs::canonicalize(folder)?);
            if is_inside { known.of(path) } else { Err(ErrorKind::InvalidInput.into()) }
        };
        Self::new(path, look())
    }

    /// Fingerprints a texture image that may lie anywhere.
    ///
    /// # Errors
    /// As [`library`](Source::library).
    pub fn anywhere(path: &Path, known: &Contents) -> Result<Self> {
        Self::new(path, fs::canonicalize(path).and_then(|path| known.of(path)))
    }

    /// Records whether a file exists, without reading it.
    ///
    /// # Errors
    /// As [`library`](Source::library).
    pub fn presence(path: &Path) -> Result<Self> {
        let is_file = |found: fs::Metadata| {
            if found.is_file() { Ok(Content::default()) } else { Err(ErrorKind::InvalidInput.into()) }
        };
        Self::new(path, fs::metadata(path).and_then(is_file))
    }

    fn new(path: &Path, found: std::io::Result<Content>) -> Result<Self> {
        let content = match found {
            Err(error) if is_of_machine(&error) => return Err(Error::io(path, "read", error)),
            found => found.ok(),
        };
        Ok(Self { content, place: 0, path: std::path::absolute(path).unwrap_or_else(|_| path.to_owned()) })
    }

    /// Describes what has changed since, or returns `None`.
    pub fn difference(&self, now: &Self) -> Option<&'static str> {
        match (self.content, now.content) {
            (old, new) if old == new && self.place == now.place => None,
            (old, new) if old == new => Some("leads to another place"),
            (Some(_), None) => Some("is missing now"),
            (None, Some(_)) => Some("was missing and is there now"),
            _ => Some("has changed"),
        }
    }
}

/// Returns the hash of each mesh file, as in [`Scan::content_hashes`](super::Scan::content_hashes).
///
/// # Errors
/// If a file cannot be read; [`Error::Stopped`] if asked to stop.
pub fn content_hashes(inputs: &[PathBuf], threads: usize, progress: &dyn Progress) -> Result<Vec<u64>> {
    let mut hashes = vec![0; inputs.len()];
    for (format, range) in MeshFormat::runs(inputs)? {
        let (first, inputs) = (range.start, &inputs[range]);
        let parts: Box<dyn Iterator<Item = Result<FilePart>> + Send> = match format {
            MeshFormat::Obj => {
                let chunks = Cutter::<ObjSource>::new(inputs, CHUNK_BYTES);
                Box::new(chunks.map(|(file, cut)| cut.map(|cut| (file, cut.chunk.part()))))
            }
            MeshFormat::Ply => Box::new(blocks(inputs)),
            MeshFormat::Arrays => {
                let chunks = Cutter::<ArraySource>::new(inputs, CHUNK_BYTES);
                Box::new(chunks.map(|(file, cut)| cut.map(|cut| (file, cut.chunk.part()))))
            }
        };
        map_in_order(
            parts,
            threads,
            threads,
            |part| {
                progress.check_stopped()?;
                let (file, (open, range)) = part?;
                let mut text = Vec::new();
                open.read(&inputs[file], range.start, (range.end - range.start) as usize, &mut text)?;
                Ok((file, text.len() as u64, xxh3_64(&text)))
            },
            |(file, bytes, hash)| {
                chain(&mut hashes[first + file], bytes, hash);
                progress.advance(bytes);
                Ok(())
            },
        )?;
    }
    Ok(hashes)
}

/// A part of a file that is hashed on its own, after the index of the file.
type FilePart = (usize, (Arc<OpenFile>, Range<u64>));

/// Blocks of [`CHUNK_BYTES`] of some files, as a PLY is hashed.
fn blocks(inputs: &[PathBuf]) -> impl Iterator<Item = Result<FilePart>> + Send {
    let (mut file_index, mut open): (usize, Option<(Arc<OpenFile>, u64)>) = (0, None);
    std::iter::from_fn(move || {
        let path = inputs.get(file_index)?;
        let opened = match open.take() {
            Some(opened) => Ok(opened),
            None => OpenFile::open(path).map(|file| (Arc::new(file), 0)),
        };
        let own_index = file_index;
        let part = opened.map(|(file, start)| {
            let end = file.length().min(start + CHUNK_BYTES);
            open = (end < file.length()).then(|| (file.clone(), end));
            (own_index, (file, start..end))
        });
        file_index += usize::from(open.is_none());
        Some(part)
    })
}

/// Returns [`Error::Changed`] for a changed input file.
pub fn changed(path: &Path, what: &str) -> Error {
    let shown = crate::base::error::escape_path(path);
    Error::Changed(format!(
        "{shown}: {what} since the job began; start over with `resume: never`, or give another folder with `work`"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Silent;

    #[test]
    fn content_counts_and_dates_do_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mtl");
        fs::write(&path, "newmtl a\n").unwrap();
        let library = || Source::library(&path, &Contents::default()).unwrap();
        let (was, inputs) = (library(), [path.clone()]);
        let hashes = content_hashes(&inputs, 2, &Silent).unwrap();
        fs::write(&path, "newmtl a\n").unwrap();
        assert_eq!(was.difference(&library()), None);
        assert_eq!(content_hashes(&inputs, 1, &Silent).unwrap(), hashes);
        fs::write(&path, "newmtl b\n").unwrap();
        assert_eq!(was.difference(&library()), Some("has changed"));
        assert_ne!(content_hashes(&inputs, 1, &Silent).unwrap(), hashes);
        fs::remove_file(&path).unwrap();
        assert_eq!(was.difference(&library()), Some("is missing now"));
    }

    #[test]
    #[cfg(unix)]
    fn a_file_that_the_machine_fails_to_read_is_not_taken_for_a_missing_one() {
        let failed = |code| Source::new(Path::new("a.png"), Err(std::io::Error::from_raw_os_error(code)));
        for code in [libc::EIO, libc::EMFILE, libc::ENFILE, libc::EBADMSG, libc::ENOTCONN, libc::EAGAIN] {
            assert!(matches!(failed(code), Err(Error::Io { .. })), "{code}");
        }
        for code in [libc::ENOENT, libc::EACCES, libc::ENOTDIR, libc::ELOOP, libc::ENAMETOOLONG] {
            assert_eq!(failed(code).unwrap().content, None, "{code}");
        }
    }
}

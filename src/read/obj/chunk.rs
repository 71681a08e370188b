//! Cuts OBJ files into chunks of whole statements.
//!
//! In: the input files. Out: consecutive byte ranges of about the chunk size, each of which begins and ends between two
//! statements. The split points depend on the file alone: a chunk ends after the first line that reaches the chunk size
//! and is not continued.
//!
//! # Memory
//! One window of [`WINDOW_BYTES`] while a split point is searched.

use std::fs::File;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use memchr::memchr2;

use crate::base::{Error, Result};
use crate::os::system::read_exact_at;
use crate::read::file::{OpenFile, unread};
use crate::read::source::Cut;

/// Longest accepted line in bytes. No exporter writes a longer one; a damaged or foreign file may.
pub const LINE_BYTES_MAX: u64 = 16 << 20;
const WINDOW_BYTES: u64 = 16 << 10;

/// A byte range of a file that holds whole statements.
#[derive(Debug, Clone)]
pub struct ObjChunk {
    /// The open file.
    pub(super) file: Arc<OpenFile>,
    /// Offset of its first byte.
    pub start: u64,
    /// Offset of the byte after its last.
    pub end: u64,
    /// Whether no line end was found within the longest accepted line; the range then ends at the chunk size.
    pub line_is_too_long: bool,
}

impl ObjChunk {
    /// The open file, and the range of the chunk in it.
    pub(in crate::read) fn part(self) -> (Arc<OpenFile>, Range<u64>) {
        (self.file, self.start..self.end)
    }

    /// Replaces the contents of `buffer` with the bytes of the chunk.
    ///
    /// # Errors
    /// [`Error::Changed`] if the file was truncated; [`Error::Io`] if it cannot be read.
    pub fn read(&self, path: &Path, buffer: &mut Vec<u8>) -> Result<()> {
        self.file.read(path, self.start, (self.end - self.start) as usize, buffer)
    }

    /// Returns an error if the chunk is the first of a file of another format, which `text` identifies.
    ///
    /// # Errors
    /// [`Error::Input`] that names the format.
    pub(super) fn refuse_foreign(&self, path: &Path, text: &[u8]) -> Result<()> {
        match foreign_format(text).filter(|_| self.start == 0) {
            Some(format) => Err(Error::input(path, 1, format!("expected OBJ text, found {format}"))),
            None => Ok(()),
        }
    }
}

/// An OBJ file being cut.
#[derive(Debug)]
pub struct ObjSource {
    file: Arc<OpenFile>,
    chunk_bytes: u64,
    start: u64,
}

impl ObjSource {
    /// Opens a file.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub(super) fn open(path: &Path, chunk_bytes: u64) -> Result<Self> {
        Ok(Self { file: Arc::new(OpenFile::open(path)?), chunk_bytes, start: 0 })
    }

    /// Cuts off the next chunk.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(super) fn cut(&mut self, path: &Path) -> Result<Cut<ObjChunk>> {
        let (start, length) = (self.start, self.file.length());
        let cut = find_cut(self.file.file(), start, length, self.chunk_bytes).map_err(|e| unread(path, e))?;
        let end = cut.unwrap_or(length.min(start + self.chunk_bytes));
        self.start = end;
        let chunk = ObjChunk { file: self.file.clone(), start, end, line_is_too_long: cut.is_none() };
        Ok(Cut { chunk, bytes: end - start, is_last: end == length || cut.is_none() })
    }
}

/// The message about a line that is too long.
pub(super) fn too_long() -> String {
    format!("expected a line end within {} MiB; the file is damaged, or no OBJ", LINE_BYTES_MAX >> 20)
}

/// Returns the name of another file format if the first bytes identify one, else `None`.
fn foreign_format(text: &[u8]) -> Option<&'static str> {
    const FORMATS: &[(&[u8], &str)] = &[
        (b"\x1f\x8b", "gzip data; decompress it first"),
        (b"BZh", "bzip2 data; decompress it first"),
        (b"\xfd7zXZ", "xz data; decompress it first"),
        (b"\x28\xb5\x2f\xfd", "zstd data; decompress it first"),
        (b"PK\x03\x04", "a zip archive; extract it first"),
        (b"\xff\xfe", "UTF-16 text; convert it to UTF-8 first"),
        (b"\xfe\xff", "UTF-16 text; convert it to UTF-8 first"),
        (b"ply\n", "a PLY file"),
        (b"ply\r", "a PLY file"),
        (b"solid ", "an STL file"),
        (b"glTF", "a binary glTF file"),
        (b"Kaydara FBX", "an FBX file"),
        (b"OFF\n", "an OFF file"),
        (b"version https://git-lfs", "a Git LFS pointer; fetch the file itself first"),
    ];
    FORMATS.iter().find(|(magic, _)| text.starts_with(magic)).map(|(_, name)| *name)
}

/// Returns the end of the chunk that begins at `start`, or `None` if its last line is too long.
fn find_cut(file: &File, start: u64, length: u64, chunk_bytes: u64) -> std::io::Result<Option<u64>> {
    let mut window = Vec::new();
    let mut from = start + chunk_bytes.max(1) - 1;
    let limit = from.saturating_add(LINE_BYTES_MAX);
    while from < length {
        if from > limit {
            return Ok(None);
        }
        // The window includes two bytes before `from`, to see whether a line end is continued, and one byte after, for
        // CR LF.
        let window_start = from.saturating_sub(2).max(start);
        let window_end = (from + WINDOW_BYTES + 1).min(length);
        window.resize((window_end - window_start) as usize, 0);
        read_exact_at(file, &mut window, window_start)?;
        let mut at = (from - window_start) as usize;
        while let Some(distance) = memchr2(b'\n', b'\r', &window[at..]) {
            let end = at + distance;
            at = end + 1;
            let follows_cr = window[end] == b'\n' && end > 0 && window[end - 1] == b'\r';
            let text_end = end - usize::from(follows_cr);
            if text_end > 0 && window[text_end - 1] == b'\\' {
                continue;
            }
            if window[end] == b'\r' && end + 1 == window.len() && window_end < length {
                break;
            }
            let is_pair = window[end] == b'\r' && window.get(end + 1) == Some(&b'\n');
            return Ok(Some(window_start + end as u64 + 1 + u64::from(is_pair)));
        }
        from += WINDOW_BYTES;
    }
    Ok(Some(length))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use proptest::prelude::*;

    use super::*;
    use crate::read::source::Cutter;

    fn pieces(text: &str, chunk_bytes: u64) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let inputs = [folder.path().join("a.obj")];
        fs::write(&inputs[0], text).unwrap();
        let (mut out, mut buffer) = (Vec::new(), Vec::new());
        for (_, cut) in Cutter::<ObjSource>::new(&inputs, chunk_bytes) {
            cut.unwrap().chunk.read(&inputs[0], &mut buffer).unwrap();
            out.push(String::from_utf8_lossy(&buffer).into_owned());
        }
        out
    }

    #[test]
    fn chunks_end_with_a_line() {
        assert_eq!(pieces("a\nbb\nccc\n", 1), ["a\n", "bb\n", "ccc\n"]);
        assert_eq!(pieces("a\nbb\nccc", 3), ["a\nbb\n", "ccc"]);
        assert_eq!(pieces("a\rb\r\nc\n", 1), ["a\r", "b\r\n", "c\n"]);
    }

    #[test]
    fn continued_lines_stay_together() {
        assert_eq!(pieces("a\\\nb\nc\\\r\nd\\\re\nf", 1), ["a\\\nb\n", "c\\\r\nd\\\re\n", "f"]);
    }

    proptest! {
        #[test]
        fn a_chunk_ends_with_the_first_line_that_reaches_its_size(text in "[ab\\\\\r\n]{0,60}", chunk_bytes in 1u64..20) {
            let bytes = text.as_bytes();
            let ends_line = |&end: &usize| {
                let before = &bytes[..end];
                let line = before.strip_suffix(b"\r\n").or(before.strip_suffix(b"\n")).or(before.strip_suffix(b"\r"));
                let is_within_a_pair = before.ends_with(b"\r") && bytes.get(end) == Some(&b'\n');
                end == bytes.len() || !is_within_a_pair && line.is_some_and(|line| !line.ends_with(b"\\"))
            };
            let mut start = 0;
            for piece in pieces(&text, chunk_bytes) {
                let least = (start + chunk_bytes as usize).min(bytes.len());
                let end = (least..=bytes.len()).find(ends_line).unwrap_or(bytes.len());
                prop_assert_eq!(piece, &text[start..end]);
                start = end;
            }
            prop_assert_eq!(start, bytes.len());
        }
    }

    #[test]
    fn an_empty_file_is_one_empty_chunk() {
        assert_eq!(pieces("", 4), [""]);
    }

    #[test]
    fn a_pair_of_line_ends_across_windows_is_not_split() {
        for shift in 0..4 {
            let text = format!("{}\r\nb\n", "a".repeat(WINDOW_BYTES as usize - 2 + shift));
            assert_eq!(pieces(&text, 1).len(), 2, "{shift}");
            assert_eq!(pieces(&text, 1).concat(), text);
        }
    }

    #[test]
    fn a_file_that_is_written_to_meanwhile_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let inputs = [folder.path().join("a.obj")];
        fs::write(&inputs[0], "a\nb\n").unwrap();
        let whole = ObjSource::open(&inputs[0], 16).unwrap().cut(&inputs[0]).unwrap().chunk;
        whole.file.check_unchanged(&inputs[0]).unwrap();
        let file = File::options().write(true).open(&inputs[0]).unwrap();
        file.set_len(1).unwrap();
        for outcome in [whole.file.check_unchanged(&inputs[0]), whole.read(&inputs[0], &mut Vec::new())] {
            let error = outcome.unwrap_err();
            assert!(
                error.kind() == crate::base::ErrorKind::Changed && error.to_string().contains("was written to"),
                "{error}"
            );
        }
    }

    #[test]
    fn a_line_without_end_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let inputs = [folder.path().join("a.obj")];
        let file = File::create(&inputs[0]).unwrap();
        file.set_len(LINE_BYTES_MAX + (1 << 20)).unwrap();
        let cut = ObjSource::open(&inputs[0], 16).unwrap().cut(&inputs[0]).unwrap();
        assert!(cut.chunk.line_is_too_long && cut.is_last);
    }
}

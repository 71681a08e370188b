//! Splits files into chunks of whole statements.
//!
//! In: the input files. Out: consecutive byte ranges of about the chunk size, each of which begins and ends between two
//! statements. The split points depend on the file alone: a chunk ends after the first line that reaches the chunk size
//! and is not continued.
//!
//! # Memory
//! One window of [`WINDOW_BYTES`] while a split point is searched.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use memchr::memchr2;

use crate::base::error::escape_path;
use crate::base::{Error, Result};
use crate::os::system::read_exact_at;

/// Size of a chunk in bytes, before its last line is completed. Text and parsed records of a chunk fit in the cache of
/// a core.
pub const CHUNK_BYTES: u64 = 512 << 10;
/// Longest accepted line in bytes. No exporter writes a longer one; a damaged or foreign file may.
pub const LINE_BYTES_MAX: u64 = 16 << 20;
const WINDOW_BYTES: u64 = 16 << 10;

/// A byte range of a file that holds whole statements.
#[derive(Debug, Clone)]
pub struct Chunk {
    /// Index of the input file.
    pub file_index: usize,
    /// The open file.
    file: Arc<OpenFile>,
    /// Offset of its first byte.
    pub start: u64,
    /// Offset of the byte after its last.
    pub end: u64,
    /// Whether it is the last chunk of its file.
    pub is_last: bool,
    /// Whether no line end was found within the longest accepted line; the range then ends at the chunk size.
    pub line_is_too_long: bool,
}

/// An input file, with its state when it was opened.
#[derive(Debug)]
struct OpenFile {
    file: File,
    length: u64,
    modified: Option<SystemTime>,
}

impl Chunk {
    /// Checks that the file is still the one that was opened.
    ///
    /// # Errors
    /// [`Error::Changed`] if its length or modification time differs.
    pub fn check_unchanged(&self, path: &Path) -> Result<()> {
        let OpenFile { file, length, modified } = &*self.file;
        let now = file.metadata().map_err(|e| Error::io(path, "open", e))?;
        match now.len() == *length && now.modified().ok() == *modified {
            true => Ok(()),
            false => Err(written_to(path)),
        }
    }

    /// Replaces the contents of `buffer` with the bytes of the chunk.
    ///
    /// # Errors
    /// [`Error::Changed`] if the file was truncated; [`Error::Io`] if it cannot be read.
    pub fn read(&self, path: &Path, buffer: &mut Vec<u8>) -> Result<()> {
        let bytes = (self.end - self.start) as usize;
        buffer.resize(bytes, 0);
        read_exact_at(&self.file.file, buffer, self.start).map_err(|e| unread(path, e))
    }
}

/// Converts the error of a failed read.
fn unread(path: &Path, error: std::io::Error) -> Error {
    match error.kind() {
        ErrorKind::UnexpectedEof => written_to(path),
        _ => Error::io(path, "read", error),
    }
}

fn written_to(path: &Path) -> Error {
    let path = escape_path(path);
    Error::Changed(format!("{path}: was written to while it was read; run the same command again once it is complete"))
}

/// Returns the chunks of all files in order.
#[derive(Debug)]
pub struct Cutter<'a> {
    inputs: &'a [PathBuf],
    chunk_bytes: u64,
    order: u64,
    file_index: usize,
    open: Option<Arc<OpenFile>>,
    start: u64,
}

impl<'a> Cutter<'a> {
    /// Creates a cutter at the start of the first file.
    pub fn new(inputs: &'a [PathBuf], chunk_bytes: u64) -> Self {
        Self { inputs, chunk_bytes, order: 0, file_index: 0, open: None, start: 0 }
    }

    /// Returns the next chunk and its index among all chunks; `None` after the last file. An empty file has one empty
    /// chunk.
    ///
    /// # Errors
    /// If a file cannot be opened or read; the cutter then continues with the next file.
    pub fn next(&mut self) -> Option<(u64, Result<Chunk>)> {
        let path = self.inputs.get(self.file_index)?;
        let order = self.order;
        self.order += 1;
        let chunk = self.cut(path);
        if chunk.as_ref().map_or(true, |chunk| chunk.is_last) {
            self.file_index += 1;
            self.open = None;
            self.start = 0;
        }
        Some((order, chunk))
    }

    fn cut(&mut self, path: &Path) -> Result<Chunk> {
        let file = match &self.open {
            Some(file) => file.clone(),
            None => {
                let (file, length) = open_regular(path)?;
                let modified = file.metadata().and_then(|meta| meta.modified()).ok();
                let file = Arc::new(OpenFile { file, length, modified });
                self.open.insert(file).clone()
            }
        };
        let length = file.length;
        let start = self.start;
        let cut = find_cut(&file.file, start, length, self.chunk_bytes).map_err(|e| unread(path, e))?;
        let end = cut.unwrap_or(length.min(start + self.chunk_bytes));
        self.start = end;
        let is_last = end == length || cut.is_none();
        Ok(Chunk { file_index: self.file_index, file, start, end, is_last, line_is_too_long: cut.is_none() })
    }
}

/// Opens a regular file and returns it with its length in bytes.
///
/// # Errors
/// [`Error::Input`] if it is not a regular file: opening a pipe could block forever.
pub fn open_regular(path: &Path) -> Result<(File, u64)> {
    let kind = fs::metadata(path).map_err(|e| Error::io(path, "open", e))?;
    if !kind.is_file() {
        return Err(Error::input(path, 0, "expected a regular file; pipes and devices cannot be read in chunks"));
    }
    let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    let length = file.metadata().map_err(|e| Error::io(path, "open", e))?.len();
    Ok((file, length))
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
    use proptest::prelude::*;

    use super::*;

    fn pieces(text: &str, chunk_bytes: u64) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let inputs = [folder.path().join("a.obj")];
        fs::write(&inputs[0], text).unwrap();
        let mut cutter = Cutter::new(&inputs, chunk_bytes);
        let (mut out, mut buffer) = (Vec::new(), Vec::new());
        while let Some((_, chunk)) = cutter.next() {
            chunk.unwrap().read(&inputs[0], &mut buffer).unwrap();
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
        let chunk = |chunk_bytes| Cutter::new(&inputs, chunk_bytes).next().unwrap().1.unwrap();
        let whole = chunk(16);
        whole.check_unchanged(&inputs[0]).unwrap();
        let file = File::options().write(true).open(&inputs[0]).unwrap();
        file.set_len(1).unwrap();
        for outcome in [whole.check_unchanged(&inputs[0]), whole.read(&inputs[0], &mut Vec::new())] {
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
        let (_, chunk) = Cutter::new(&inputs, 16).next().unwrap();
        assert!(chunk.unwrap().line_is_too_long);
    }
}

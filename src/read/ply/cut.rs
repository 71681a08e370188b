//! Cuts a PLY into chunks of whole records of one element.
//!
//! In: a file. Out: its header's layout, then chunks of about the chunk size. The split points depend on the file
//! alone: a chunk ends with the first record that reaches the chunk size, or with its element. Records of a fixed size
//! are counted, lists are stepped over by their lengths, lines are counted by their ends.
//!
//! # Memory
//! A chunk and the block that follows it; at most [`RECORD_BYTES_MAX`] more if a record is that long.

use std::path::Path;
use std::sync::Arc;

use xxhash_rust::xxh3::xxh3_64;

use super::header::{Encoding, HEADER_BYTES_MAX, PlyHeader, Scalar};
use super::layout::{ElementLayout, FieldStep, Layout};
use crate::base::error::escape;
use crate::base::{Error, Result};
use crate::read::file::{OpenFile, chain};
use crate::read::line::{is_blank, line_end};
use crate::read::source::{CHUNK_BYTES, Cut};

/// Longest accepted record in bytes. No exporter writes a longer one; a damaged file may.
const RECORD_BYTES_MAX: u64 = 16 << 20;
/// Bytes of line ends that may follow a binary file's records.
const TRAILING_BYTES_MAX: u64 = 2;

/// Consecutive records of an element.
#[derive(Debug)]
pub struct PlyChunk {
    pub(super) file: Arc<OpenFile>,
    pub(super) layout: Arc<Layout>,
    /// Index of the element.
    pub(super) element: usize,
    /// Index of the first record in its element.
    pub(super) first: u64,
    /// Number of records.
    pub(super) count: u64,
    /// Offset of the first byte in the file.
    pub(super) offset: u64,
    /// Line of the first byte, from 1; of text alone.
    pub(super) line: u64,
    /// The records.
    pub(super) bytes: Vec<u8>,
    /// Hash of the file up to the last block that was read.
    pub(super) content_hash: u64,
}

/// A PLY being cut.
#[derive(Debug)]
pub struct PlySource {
    file: Arc<OpenFile>,
    pub(super) layout: Arc<Layout>,
    chunk_bytes: u64,
    /// Bytes that were read and not cut off yet; they end at `read_to`.
    buffer: Vec<u8>,
    read_to: u64,
    content_hash: u64,
    /// End of the last chunk that was cut off.
    cut_to: u64,
    element: usize,
    /// Records of the element that were cut off.
    done: u64,
    line: u64,
}

/// Why a record cannot be cut off.
enum Fault {
    /// The buffer ends before it does.
    Incomplete,
    /// It is faulty.
    Message(String),
}

impl PlySource {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// If the file cannot be read or the header is faulty.
    pub(super) fn open(path: &Path, chunk_bytes: u64) -> Result<Self> {
        let file = Arc::new(OpenFile::open(path)?);
        let mut text = Vec::new();
        file.read(path, 0, file.length().min(HEADER_BYTES_MAX as u64) as usize, &mut text)?;
        let header = PlyHeader::parse(path, &text)?;
        header.check_size(path, file.length())?;
        let (header_bytes, line) = (header.bytes, header.lines + 1);
        let layout = Arc::new(Layout::new(path, header)?);
        let (buffer, read_to) = (Vec::new(), 0);
        let mut source =
            Self { file, layout, chunk_bytes, buffer, read_to, content_hash: 0, cut_to: 0, element: 0, done: 0, line };
        while (source.buffer.len() as u64) < header_bytes && source.fill(path)? {}
        source.buffer.drain(..header_bytes as usize);
        Ok(source)
    }

    /// Offset of the first byte that was not cut off.
    fn offset(&self) -> u64 {
        self.read_to - self.buffer.len() as u64
    }

    /// Reads the next block; returns whether there was one.
    fn fill(&mut self, path: &Path) -> Result<bool> {
        let bytes = CHUNK_BYTES.min(self.file.length() - self.read_to) as usize;
        if bytes == 0 {
            return Ok(false);
        }
        let mut block = Vec::new();
        self.file.read(path, self.read_to, bytes, &mut block)?;
        chain(&mut self.content_hash, bytes as u64, xxh3_64(&block));
        self.read_to += bytes as u64;
        if self.buffer.is_empty() {
            self.buffer = block
        } else {
            self.buffer.extend_from_slice(&block)
        }
        Ok(true)
    }

    /// Cuts off the next chunk; the last one may be empty.
    ///
    /// # Errors
    /// [`Error::Input`] if the file ends inside a record, or goes on after the last.
    pub(super) fn cut(&mut self, path: &Path) -> Result<Cut<PlyChunk>> {
        self.next_element();
        let (element, first, line, offset) = (self.element, self.done, self.line, self.offset());
        let layout = self.layout.clone();
        let (bytes, count) = match layout.elements.get(element) {
            None => (0, 0),
            Some(own) => {
                let left = layout.header.elements[element].count - self.done;
                self.whole_records(path, own, left)?
            }
        };
        let whole = if bytes == self.buffer.len() {
            std::mem::take(&mut self.buffer)
        } else {
            let whole = self.buffer[..bytes].to_vec();
            self.buffer.drain(..bytes);
            whole
        };
        self.done += count;
        self.next_element();
        let is_last = self.element == layout.elements.len();
        if is_last {
            self.check_end(path)?;
        }
        let cut_bytes = self.offset() - self.cut_to;
        self.cut_to = self.offset();
        let (file, content_hash) = (self.file.clone(), self.content_hash);
        let chunk = PlyChunk { file, layout, element, first, count, offset, line, bytes: whole, content_hash };
        Ok(Cut { chunk, bytes: cut_bytes, is_last })
    }

    /// Goes to the next element with records that are not cut off.
    fn next_element(&mut self) {
        while let Some(element) = self.layout.header.elements.get(self.element)
            && (self.done == element.count || element.properties.is_empty())
        {
            self.element += 1;
            self.done = 0;
        }
    }

    /// Length in bytes and number of the next whole records, at least one and at most `left`.
    fn whole_records(&mut self, path: &Path, own: &ElementLayout, left: u64) -> Result<(usize, u64)> {
        if self.layout.header.encoding == Encoding::Ascii {
            return self.whole_lines(path, left);
        }
        if let Some(record) = own.record_bytes {
            let count = (self.chunk_bytes / record).clamp(1, left);
            while (self.buffer.len() as u64) < count * record {
                if !self.fill(path)? {
                    return Err(self.ended(path, self.buffer.len() as u64 / record));
                }
            }
            return Ok(((count * record) as usize, count));
        }
        let (mut end, mut count) = (0, 0);
        let encoding = self.layout.header.encoding;
        while count < left && (end as u64) < self.chunk_bytes {
            let from = self.offset() + end as u64;
            match record_end(&own.steps, encoding, &self.buffer, end, self.file.length() - self.offset()) {
                Ok(next) => (end, count) = (next, count + 1),
                Err(Fault::Message(message)) => {
                    let name = escape(&self.layout.header.elements[self.element].name);
                    let record = self.done + count;
                    return Err(Error::input(path, 0, format!("{name} {record}, at byte {from}: {message}")));
                }
                Err(Fault::Incomplete) if count > 0 && self.buffer.len() as u64 >= self.chunk_bytes => break,
                Err(Fault::Incomplete) => {
                    if !self.fill(path)? {
                        return Err(self.ended(path, count));
                    }
                }
            }
        }
        Ok((end, count))
    }

    /// The same for text; passes over blank lines.
    fn whole_lines(&mut self, path: &Path, left: u64) -> Result<(usize, u64)> {
        let (mut end, mut count) = (0, 0);
        while count < left && (end as u64) < self.chunk_bytes {
            let (text_end, next) = line_end(&self.buffer, end);
            // A line end may be the first half of a pair.
            let is_whole = next > text_end && next < self.buffer.len() || self.read_to == self.file.length();
            if !is_whole {
                if (self.buffer.len() - end) as u64 > RECORD_BYTES_MAX {
                    let message = format!("expected a line end within {} MiB", RECORD_BYTES_MAX >> 20);
                    return Err(Error::input(path, self.line, message));
                }
                if count > 0 && self.buffer.len() as u64 >= self.chunk_bytes {
                    break;
                }
                self.fill(path)?;
                continue;
            }
            if end == self.buffer.len() {
                return Err(self.ended(path, count));
            }
            count += u64::from(!self.buffer[end..text_end].iter().all(|byte| is_blank(*byte)));
            end = next;
            self.line += u64::from(next > text_end);
        }
        Ok((end, count))
    }

    /// The error about a file that ends after some more records of the current element.
    fn ended(&self, path: &Path, more: u64) -> Error {
        let element = &self.layout.header.elements[self.element];
        let (found, name) = (self.done + more, escape(&element.name));
        let line = if self.layout.header.encoding == Encoding::Ascii { self.line } else { 0 };
        let length = self.file.length();
        let message = format!(
            "expected {} records of element '{name}', the file ends after {found}, at byte {length}",
            element.count
        );
        Error::input(path, line, message)
    }

    /// Refuses bytes after the last record; blanks and line ends are no fault.
    fn check_end(&mut self, path: &Path) -> Result<()> {
        let (from, is_text) = (self.offset(), self.layout.header.encoding == Encoding::Ascii);
        loop {
            let is_nothing = |byte: &u8| matches!(byte, b'\n' | b'\r') || is_text && is_blank(*byte);
            let length = self.file.length();
            if !self.buffer.iter().all(is_nothing) || !is_text && length - from > TRAILING_BYTES_MAX {
                let line = if is_text { self.line } else { 0 };
                let message =
                    format!("expected the end of the file at byte {from}, found {} more bytes", length - from);
                return Err(Error::input(path, line, message));
            }
            self.buffer.clear();
            if !self.fill(path)? {
                return Ok(());
            }
        }
    }
}

/// Returns the end of the record that begins at `at`; `most` is the end of the file, counted like `at`.
fn record_end(
    steps: &[FieldStep],
    encoding: Encoding,
    bytes: &[u8],
    at: usize,
    most: u64,
) -> std::result::Result<usize, Fault> {
    let mut end = at;
    for step in steps {
        end += match step {
            FieldStep::Skip { bytes, .. } => *bytes,
            FieldStep::Number { scalar, .. } | FieldStep::TextureNumber(scalar) => scalar.bytes() as usize,
            FieldStep::List { length, scalar, .. } => {
                let items = list_length(*length, encoding, bytes, end)?;
                let list_bytes = items * scalar.bytes();
                let whole = (end - at) as u64 + length.bytes() + list_bytes;
                if end as u64 + length.bytes() + list_bytes > most {
                    return Err(Fault::Message(format!("a list of {items} numbers passes the end of the file")));
                }
                if whole > RECORD_BYTES_MAX {
                    let most = RECORD_BYTES_MAX >> 20;
                    return Err(Fault::Message(format!("a list of {items} numbers; a record has at most {most} MiB")));
                }
                (length.bytes() + list_bytes) as usize
            }
        };
    }
    if end <= bytes.len() { Ok(end) } else { Err(Fault::Incomplete) }
}

/// Reads the number of items of a list at an offset.
fn list_length(scalar: Scalar, encoding: Encoding, bytes: &[u8], at: usize) -> std::result::Result<u64, Fault> {
    let size = scalar.bytes() as usize;
    let Some(raw) = bytes.get(at..at + size) else { return Err(Fault::Incomplete) };
    match integer(scalar, encoding, raw) {
        length if length >= 0 => Ok(length as u64),
        length => Err(Fault::Message(format!("a list of {length} numbers"))),
    }
}

/// Returns the integer in the bytes of a scalar.
#[inline]
pub(super) fn integer(scalar: Scalar, encoding: Encoding, raw: &[u8]) -> i64 {
    let mut word = [0; 8];
    for (place, byte) in raw.iter().take(8).enumerate() {
        word[if encoding == Encoding::Big { raw.len() - 1 - place } else { place }] = *byte;
    }
    let value = i64::from_le_bytes(word);
    match scalar {
        Scalar::I8 => i64::from(value as i8),
        Scalar::I16 => i64::from(value as i16),
        Scalar::I32 => i64::from(value as i32),
        _ => value,
    }
}

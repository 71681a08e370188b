//! Cuts an array file into chunks of whole records of one array.
//!
//! In: a file. Out: its layout, then chunks of at most the chunk size, or of one record. Where they end follows from the
//! header.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use crate::base::{Error, Result};
use crate::model::array_file::{ArrayLayout, FIXED_BYTES};
use crate::read::file::OpenFile;
use crate::read::source::Cut;

/// One of the arrays of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Section {
    Vertices,
    Texcoords,
    Faces,
}

/// The arrays, in the order of the file.
const SECTIONS: [Section; 3] = [Section::Vertices, Section::Texcoords, Section::Faces];

/// Consecutive records of an array.
#[derive(Debug)]
pub struct ArrayChunk {
    pub(super) file: Arc<OpenFile>,
    pub(super) layout: Arc<ArrayLayout>,
    pub(super) section: Section,
    /// Index of the first record in its array.
    pub(super) first: u64,
    /// Bytes of the file; those of the first chunk begin with the header.
    pub(super) range: Range<u64>,
    /// Bytes of the header in it.
    pub(super) header_bytes: u64,
}

impl ArrayChunk {
    /// The part of the file that it is.
    pub(in crate::read) fn part(self) -> (Arc<OpenFile>, Range<u64>) {
        (self.file, self.range)
    }
}

/// An array file being cut.
#[derive(Debug)]
pub struct ArraySource {
    file: Arc<OpenFile>,
    pub(super) layout: Arc<ArrayLayout>,
    header_bytes: u64,
    chunk_bytes: u64,
    /// Index of the array, and its records that were cut off.
    section: usize,
    done: u64,
    /// End of the last chunk.
    offset: u64,
}

impl ArraySource {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// If the file cannot be read or the header is faulty.
    pub(super) fn open(path: &Path, chunk_bytes: u64) -> Result<Self> {
        let file = Arc::new(OpenFile::open(path)?);
        let mut header = Vec::new();
        file.read(path, 0, file.length().min(FIXED_BYTES) as usize, &mut header)?;
        let fault = |message| Error::input(path, 0, message);
        let header_bytes = ArrayLayout::header_bytes(&header, file.length()).map_err(fault)?;
        file.read(path, 0, header_bytes as usize, &mut header)?;
        let layout = Arc::new(ArrayLayout::parse(&header, file.length()).map_err(fault)?);
        Ok(Self { file, layout, header_bytes, chunk_bytes, section: 0, done: 0, offset: 0 })
    }

    /// Cuts off the next chunk; the only one of a file without records is its header.
    pub(super) fn cut(&mut self) -> Cut<ArrayChunk> {
        self.skip_finished();
        let section = SECTIONS[self.section];
        let (count, record_bytes) = self.records_of(section);
        let (first, taken) = (self.done, (self.chunk_bytes / record_bytes).max(1).min(count - self.done));
        let header_bytes = if self.offset == 0 { self.header_bytes } else { 0 };
        let range = self.offset..self.offset + header_bytes + taken * record_bytes;
        self.offset = range.end;
        self.done += taken;
        self.skip_finished();
        let (file, layout) = (self.file.clone(), self.layout.clone());
        let bytes = range.end - range.start;
        let chunk = ArrayChunk { file, layout, section, first, range, header_bytes };
        Cut { chunk, bytes, is_last: self.offset == self.file.length() }
    }

    /// Number and size of the records of an array.
    fn records_of(&self, section: Section) -> (u64, u64) {
        match section {
            Section::Vertices => (self.layout.vertices, self.layout.vertex_bytes()),
            Section::Texcoords => (self.layout.texcoords, ArrayLayout::TEXCOORD_BYTES),
            Section::Faces => (self.layout.faces, self.layout.face_bytes()),
        }
    }

    /// Goes to the next array with records that were not cut off; the last one, if there are none.
    fn skip_finished(&mut self) {
        while self.section + 1 < SECTIONS.len() && self.done == self.records_of(SECTIONS[self.section]).0 {
            (self.section, self.done) = (self.section + 1, 0);
        }
    }
}

//! Reads array files: records of a fixed size, which a header counts.
//!
//! In: array files ([`ArrayLayout`]). Out: chunks of whole records of one array. Invariant: the header's counts and the
//! length of the file agree, so that where each chunk begins and ends is known without reading it.

mod commit;
mod parse;
#[cfg(test)]
mod tests;

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use self::commit::{ArrayCommit, define_materials};
use self::parse::ArrayRecords;
use super::file::OpenFile;
use super::records::ParsedRecords;
use super::source::{Counts, Cut, KEPT_BYTES_MAX, MeshSource};
use super::texture_sample::{ChunkTexture, TextureSample};
use crate::base::{Error, Result};
use crate::file::packed::RecordBounds;
use crate::model::array_file::{ArrayLayout, FIXED_BYTES};

/// One of the arrays of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Section {
    Vertices,
    Texcoords,
    Faces,
}

/// The arrays, in the order of the file.
const SECTIONS: [Section; 3] = [Section::Vertices, Section::Texcoords, Section::Faces];

/// Consecutive records of an array.
#[derive(Debug)]
pub struct ArrayChunk {
    file: Arc<OpenFile>,
    layout: Arc<ArrayLayout>,
    section: Section,
    /// Index of the first record in its array.
    first: u64,
    /// Bytes of the file; those of the first chunk begin with the header.
    range: Range<u64>,
    /// Bytes of the header in it.
    header_bytes: u64,
}

impl ArrayChunk {
    /// The part of the file that it is.
    pub(super) fn part(self) -> (Arc<OpenFile>, Range<u64>) {
        (self.file, self.range)
    }
}

/// An array file being cut.
#[derive(Debug)]
pub struct ArraySource {
    file: Arc<OpenFile>,
    layout: Arc<ArrayLayout>,
    header_bytes: u64,
    chunk_bytes: u64,
    /// Index of the array, and its records that were cut off.
    section: usize,
    done: u64,
    /// End of the last chunk.
    offset: u64,
}

impl ArraySource {
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

impl MeshSource for ArraySource {
    type Chunk = ArrayChunk;
    type Parsed = ArrayRecords;
    type Commit<'a> = ArrayCommit<'a>;

    fn open(path: &Path, chunk_bytes: u64) -> Result<Self> {
        let file = Arc::new(OpenFile::open(path)?);
        let mut header = Vec::new();
        file.read(path, 0, file.length().min(FIXED_BYTES) as usize, &mut header)?;
        let fault = |message| Error::input(path, 0, message);
        let header_bytes = ArrayLayout::header_bytes(&header, file.length()).map_err(fault)?;
        file.read(path, 0, header_bytes as usize, &mut header)?;
        let layout = Arc::new(ArrayLayout::parse(&header, file.length()).map_err(fault)?);
        Ok(Self { file, layout, header_bytes, chunk_bytes, section: 0, done: 0, offset: 0 })
    }

    fn cut(&mut self, _: &Path) -> Result<Cut<ArrayChunk>> {
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
        Ok(Cut { chunk, bytes, is_last: self.offset == self.file.length() })
    }

    fn parse(path: &Path, chunk: &mut ArrayChunk, parsed: &mut ArrayRecords, bytes: &mut Vec<u8>) -> Result<()> {
        parse::parse(path, chunk, parsed, bytes)
    }

    fn records(parsed: &mut ArrayRecords) -> &mut ParsedRecords {
        &mut parsed.records
    }

    fn count(
        path: &Path,
        chunk: &mut ArrayChunk,
        bounds: Option<&mut RecordBounds>,
        _: Option<&mut ChunkTexture>,
        bytes: &mut Vec<u8>,
    ) -> Result<Counts> {
        let mut parsed = ArrayRecords::default();
        parse::parse(path, chunk, &mut parsed, bytes)?;
        Ok(Counts::of_records(&parsed.records, bytes.len() as u64, bounds))
    }

    fn define_counted(sample: &mut TextureSample) -> Result<()> {
        let TextureSample { path, labels, .. } = sample;
        let layout = Self::open(path, super::CHUNK_BYTES)?.layout;
        for (label, _) in &layout.images {
            labels.change(super::records::LabelKind::Material, label.to_string().as_bytes());
            labels.part()?;
        }
        define_materials(path, &layout, labels)
    }

    fn clear(parsed: &mut ArrayRecords) {
        if parsed.records.capacity_bytes() > KEPT_BYTES_MAX {
            *parsed = ArrayRecords::default();
        }
        parsed.records.clear();
    }
}

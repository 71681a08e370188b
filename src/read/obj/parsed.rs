//! Statements parsed from a chunk of OBJ text.
//!
//! ```text
//! polygon_sizes     3        4            3
//! corner_vertices   a b c    d e f g      h i j        absolute, or relative to the chunk's first vertex
//! ```
//! # Memory
//! Up to three bytes per byte of text (`v 1 2 3` takes 24 bytes, `f 1 2 3` 16), so 1.5 MiB for a chunk of 512 KiB;
//! about one byte per byte of text in the form that exporters write.

use std::ops::Range;

use crate::read::records::{ChunkCorner, ParsedRecords, cleared};

/// Kind of statement that an index counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Numbered {
    /// `v`
    Vertex,
    /// `vt`
    Texcoord,
    /// `vn`
    Normal,
}

impl Numbered {
    /// Name for messages.
    pub fn word(self) -> &'static str {
        match self {
            Numbered::Vertex => "vertex",
            Numbered::Texcoord => "texture coordinate",
            Numbered::Normal => "normal",
        }
    }
}

/// An `mtllib` statement.
#[derive(Debug, Clone)]
pub struct Library {
    /// Line in the chunk, from 1.
    pub line: u64,
    /// The text after the keyword, as a range of [`ParsedRecords::names`].
    pub name: Range<u32>,
}

/// A faulty line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineError {
    /// Line in the chunk, from 1.
    pub line: u64,
    /// What was expected and what was found.
    pub message: String,
}

/// Statements of a chunk; indices and lines are relative to its start.
#[derive(Debug, Default)]
pub struct ParsedChunk {
    /// Vertices, faces and labels; corners may be relative to the first vertex or texture coordinate of the chunk,
    /// modulo 2³².
    pub records: ParsedRecords,
    /// Physical lines of the chunk.
    pub line_count: u64,
    /// Number of `vn` statements.
    pub normal_count: u64,
    /// Corners whose vertex is relative.
    pub relative_vertices: Vec<ChunkCorner>,
    /// Corners whose texture coordinate is relative.
    pub relative_texcoords: Vec<ChunkCorner>,
    /// Highest absolute index (from 1) of v, vt and vn; 0 without any.
    pub highest: [u64; 3],
    /// Lowest relative v, vt and vn, counted from the first of the chunk; negative ones refer to earlier chunks.
    pub lowest: [i64; 3],
    /// Material libraries.
    pub libraries: Vec<Library>,
    /// XXH3 of the text.
    pub hash: u64,
    /// The first faulty line, if there is one; the rest is then incomplete.
    pub fault: Option<LineError>,
}

impl ParsedChunk {
    /// Clears the chunk but keeps the buffers of the larger columns.
    pub fn clear(&mut self) {
        let mut kept = std::mem::take(self);
        kept.records.clear();
        *self = Self {
            records: kept.records,
            relative_vertices: cleared(kept.relative_vertices),
            relative_texcoords: cleared(kept.relative_texcoords),
            ..Self::default()
        };
    }

    /// Capacity of the larger columns in bytes.
    pub fn capacity_bytes(&self) -> usize {
        self.records.capacity_bytes() + (self.relative_vertices.capacity() + self.relative_texcoords.capacity()) * 4
    }

    /// Number of v, vt and vn statements.
    pub fn counts(&self) -> [u64; 3] {
        [self.records.positions.len() as u64, self.records.texcoords.len() as u64, self.normal_count]
    }
}

//! Reads PLY files: text and both binary forms, polygons, colours, texture coordinates of vertices and of faces.
//!
//! ```text
//! header ── layout: which numbers of a record mean what
//! vertex records ──┐
//! face records   ──┼─▶ chunks of whole records of one element ──▶ parsed in parallel ──▶ appended in order
//! other records  ──┘
//! ```
//! In: PLY files. Out: chunks of whole records. Invariant: elements may come in any order, since the header tells how
//! many vertices there are.

mod commit;
mod cut;
mod fields;
mod header;
mod layout;
mod parse;
#[cfg(test)]
mod tests;

use std::path::Path;

use self::commit::{PlyCommit, define_materials};
use self::cut::PlyChunk;
use self::parse::PlyRecords;
use crate::base::Result;
use crate::file::packed::RecordBounds;
use crate::read::records::{LabelKind, ParsedRecords};
use crate::read::source::{CHUNK_BYTES, Counts, Cut, KEPT_BYTES_MAX, MeshSource};
use crate::read::texture_sample::{ChunkTexture, TextureSample};

pub(super) use self::cut::PlySource;

impl MeshSource for PlySource {
    type Chunk = PlyChunk;
    type Parsed = PlyRecords;
    type Commit<'a> = PlyCommit<'a>;

    fn open(path: &Path, chunk_bytes: u64) -> Result<Self> {
        Self::open(path, chunk_bytes)
    }

    fn cut(&mut self, path: &Path) -> Result<Cut<PlyChunk>> {
        self.cut(path)
    }

    fn work_bytes(cut: &Cut<PlyChunk>) -> u64 {
        // The chunk, the buffer that it is cut from, and its records.
        (2 + cut.chunk.layout.growth(cut.chunk.element)) * cut.bytes
    }

    fn parse(path: &Path, chunk: &mut PlyChunk, parsed: &mut PlyRecords, _: &mut Vec<u8>) -> Result<()> {
        parse::parse(path, chunk, parsed)
    }

    fn records(parsed: &mut PlyRecords) -> &mut ParsedRecords {
        &mut parsed.records
    }

    fn count(
        path: &Path,
        chunk: &mut PlyChunk,
        bounds: Option<&mut RecordBounds>,
        _: Option<&mut ChunkTexture>,
        _: &mut Vec<u8>,
    ) -> Result<Counts> {
        let (mut parsed, bytes) = (PlyRecords::default(), chunk.bytes.len() as u64);
        parse::parse(path, chunk, &mut parsed)?;
        Ok(Counts::of_records(&parsed.records, bytes, bounds))
    }

    fn define_counted(sample: &mut TextureSample) -> Result<()> {
        let TextureSample { path, labels, .. } = sample;
        let layout = Self::open(path, CHUNK_BYTES)?.layout;
        for name in &layout.materials {
            labels.change(LabelKind::Material, name);
            labels.part()?;
        }
        define_materials(&layout, labels)
    }

    fn clear(parsed: &mut PlyRecords) {
        if parsed.records.capacity_bytes() > KEPT_BYTES_MAX {
            *parsed = PlyRecords::default();
        }
        parsed.records.clear();
        parsed.largest = 0.0;
    }
}

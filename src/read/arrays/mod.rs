//! Reads array files: records of a fixed size, which a header counts.
//!
//! In: array files ([`ArrayLayout`](crate::model::array_file::ArrayLayout)). Out: chunks of whole records of one array.
//! Invariant: the header's counts and the length of the file agree, so that where each chunk begins and ends is known
//! without reading it.

mod commit;
mod cut;
mod parse;
#[cfg(test)]
mod tests;

use std::path::Path;

use self::commit::{ArrayCommit, define_materials};
use self::cut::ArrayChunk;
use self::parse::ArrayRecords;
use crate::base::Result;
use crate::file::packed::RecordBounds;
use crate::read::records::{LabelKind, ParsedRecords};
use crate::read::source::{CHUNK_BYTES, Counts, Cut, KEPT_BYTES_MAX, MeshSource};
use crate::read::texture_sample::{ChunkTexture, TextureSample};

pub(super) use self::cut::ArraySource;

impl MeshSource for ArraySource {
    type Chunk = ArrayChunk;
    type Parsed = ArrayRecords;
    type Commit<'a> = ArrayCommit<'a>;

    fn open(path: &Path, chunk_bytes: u64) -> Result<Self> {
        Self::open(path, chunk_bytes)
    }

    fn cut(&mut self, _: &Path) -> Result<Cut<ArrayChunk>> {
        Ok(self.cut())
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
        let layout = Self::open(path, CHUNK_BYTES)?.layout;
        for (label, _) in &layout.images {
            labels.change(LabelKind::Material, label.to_string().as_bytes());
            labels.part()?;
        }
        define_materials(&layout, labels)
    }

    fn clear(parsed: &mut ArrayRecords) {
        if parsed.records.capacity_bytes() > KEPT_BYTES_MAX {
            *parsed = ArrayRecords::default();
        }
        parsed.records.clear();
    }
}

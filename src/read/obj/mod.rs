//! Reads OBJ text and the MTL libraries that it names.
//!
//! In: OBJ files. Out: chunks of whole statements, parsed without knowing what precedes them, and appended in order.

mod chunk;
mod commit;
mod count;
mod fast;
mod mtl;
mod parsed;
mod statements;
#[cfg(test)]
mod tests;

use std::path::Path;

use xxhash_rust::xxh3::xxh3_64;

use self::chunk::{ObjChunk, too_long};
use self::commit::ObjCommit;
use self::mtl::define_materials;
use self::parsed::{LineError, ParsedChunk};
use self::statements::BYTE_ORDER_MARK;
use crate::base::Result;
use crate::file::packed::RecordBounds;
use crate::read::line::count_line_ends;
use crate::read::records::ParsedRecords;
use crate::read::source::{Counts, Cut, KEPT_BYTES_MAX, MeshSource};
use crate::read::texture_sample::{ChunkTexture, TextureSample};

pub(super) use self::chunk::ObjSource;

impl MeshSource for ObjSource {
    type Chunk = ObjChunk;
    type Parsed = ParsedChunk;
    type Commit<'a> = ObjCommit<'a>;

    fn open(path: &Path, chunk_bytes: u64) -> Result<Self> {
        Self::open(path, chunk_bytes)
    }

    fn cut(&mut self, path: &Path) -> Result<Cut<ObjChunk>> {
        self.cut(path)
    }

    fn parse(path: &Path, chunk: &mut ObjChunk, parsed: &mut ParsedChunk, text: &mut Vec<u8>) -> Result<()> {
        chunk.read(path, text)?;
        parsed.hash = xxh3_64(text);
        chunk.refuse_foreign(path, text)?;
        if chunk.line_is_too_long {
            parsed.fault = Some(LineError { line: count_line_ends(text) + 1, message: too_long() });
            return Ok(());
        }
        let is_marked = chunk.start == 0 && text.starts_with(BYTE_ORDER_MARK);
        let skipped = if is_marked { BYTE_ORDER_MARK.len() } else { 0 };
        parsed.fault = statements::parse(&text[skipped..], parsed).err();
        Ok(())
    }

    fn records(parsed: &mut ParsedChunk) -> &mut ParsedRecords {
        &mut parsed.records
    }

    fn count(
        path: &Path,
        chunk: &mut ObjChunk,
        bounds: Option<&mut RecordBounds>,
        texture: Option<&mut ChunkTexture>,
        text: &mut Vec<u8>,
    ) -> Result<Counts> {
        count::count_chunk(path, chunk, bounds, texture, text)
    }

    fn define_counted(sample: &mut TextureSample) -> Result<()> {
        let TextureSample { path, libraries, labels, findings, .. } = sample;
        let (catalogue, used, allowance) = labels.materials_of_file();
        define_materials(path, libraries, &mut catalogue.materials, used, allowance, findings).map(drop)
    }

    fn clear(parsed: &mut ParsedChunk) {
        if parsed.capacity_bytes() > KEPT_BYTES_MAX {
            *parsed = ParsedChunk::default();
        }
        parsed.clear();
    }
}

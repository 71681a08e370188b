//! Appends the parsed chunks of an OBJ file, in order.
//!
//! In: the chunks of one input file, in order. Out: a finished file. Invariant: only this module knows what precedes a
//! chunk, so it alone converts relative indices to ids and chunk lines to file lines; the output depends on the order of
//! chunks alone.
//!
//! # Memory
//! That of the builder, and 80 bytes per chunk with faces that refer to later vertices.

use std::path::Path;

use super::chunk::{ObjChunk, ObjSource};
use super::mtl::define_materials;
use super::parsed::{LineError, Numbered, ParsedChunk};
use super::statements::find_dangling_index;
use crate::base::error::escape_path;
use crate::base::id::{Id, TiSlice};
use crate::base::{Error, Findings, Result, counted};
use crate::read::builder::{FinishedFile, MeshBuilder};
use crate::read::file::chain;
use crate::read::parts::Labels;
use crate::read::records::ChunkCorner;
use crate::read::source::{Cut, FileCommit};

/// Bytes that an `mtllib` statement takes in addition to its text.
const LIBRARY_BYTES: u64 = 64;

/// An OBJ file whose chunks are being appended.
pub struct ObjCommit<'a> {
    path: &'a Path,
    builder: MeshBuilder<'a>,
    counts: [u64; 3],
    bytes: u64,
    content_hash: u64,
    line_count: u64,
    forward: Vec<ForwardChunk>,
    libraries: Vec<(u64, Vec<u8>)>,
    /// Whether faces refer to texture coordinates and the file has none at all.
    lacks_texcoords: bool,
    last: Option<ObjChunk>,
}

/// A chunk with an index that no statement up to its end defines.
struct ForwardChunk {
    chunk: ObjChunk,
    bases: [u64; 3],
    line_base: u64,
    highest: [u64; 3],
}

impl<'a> FileCommit<'a, ObjSource> for ObjCommit<'a> {
    fn begin(path: &'a Path, folder: &Path, index: usize) -> Result<Self> {
        Ok(Self {
            path,
            builder: MeshBuilder::create(path, folder, index)?,
            counts: [0; 3],
            bytes: 0,
            content_hash: 0,
            line_count: 0,
            forward: Vec::new(),
            libraries: Vec::new(),
            lacks_texcoords: false,
            last: None,
        })
    }

    /// Appends the next chunk.
    ///
    /// # Errors
    /// [`Error::Input`] at a faulty line or if a relative index points before the first vertex, [`Error::Limit`] if
    /// there are too many vertices, [`Error::Budget`] if names take too much memory, and those of the writers.
    fn append(&mut self, cut: &Cut<ObjChunk>, parsed: &mut ParsedChunk, labels: &mut Labels) -> Result<()> {
        if let Some(LineError { line, message }) = parsed.fault.take() {
            return Err(Error::input(self.path, self.line_count + line, message));
        }
        let (chunk, bases) = (&cut.chunk, self.counts);
        let may_lack_texcoords = self.check_backward(chunk, parsed)?;
        for (count, added) in self.counts.iter_mut().zip(parsed.counts()) {
            *count += added;
        }
        self.builder.check_counts(self.counts[0], self.counts[1])?;
        let mut highest = parsed.highest;
        if may_lack_texcoords {
            highest[Numbered::Texcoord as usize] = u64::MAX;
        }
        if highest.iter().zip(self.counts).any(|(highest, count)| *highest > count) {
            let line_base = self.line_count;
            self.forward.push(ForwardChunk { chunk: chunk.clone(), bases, line_base, highest });
        }
        self.builder.report(&parsed.records, self.line_count);
        self.note_libraries(parsed, labels)?;
        self.builder.append_vertices(&parsed.records)?;
        make_absolute(parsed, bases);
        self.builder.append_faces(&parsed.records, labels)?;
        self.line_count += parsed.line_count;
        chain(&mut self.content_hash, cut.bytes, parsed.hash);
        self.bytes += cut.bytes;
        self.last = cut.is_last.then(|| chunk.clone());
        Ok(())
    }

    /// Checks forward references, reads the material libraries and finishes the columns.
    ///
    /// # Errors
    /// [`Error::Changed`] if the file was written to meanwhile, [`Error::Input`] if an index dangles or no face is
    /// left, and those of [`define_materials`] and of the writers.
    fn finish(mut self, labels: &mut Labels, findings: &mut Findings) -> Result<FinishedFile> {
        if let Some(chunk) = &self.last {
            chunk.file.check_unchanged(self.path)?;
        }
        self.check_forward()?;
        if self.builder.has_no_faces() {
            return Err(self.no_faces());
        }
        let (catalogue, used, allowance) = labels.materials_of_file();
        self.builder.describe(catalogue);
        let (materials, found) = (&mut catalogue.materials, &mut self.builder.findings);
        let libraries = define_materials(self.path, &self.libraries, materials, used, allowance, found)?;
        let Self { bytes, content_hash, .. } = self;
        let (piece, triangles) = self.builder.finish(self.lacks_texcoords, findings)?;
        Ok(FinishedFile { piece, triangles, bytes, content_hash, libraries })
    }
}

impl ObjCommit<'_> {
    /// Refuses relative indices that point before the first vertex. Returns whether some point before the first texture
    /// coordinate of a file that has none so far; that is judged at the end of the file.
    fn check_backward(&mut self, chunk: &ObjChunk, parsed: &ParsedChunk) -> Result<bool> {
        let passes_first = |kind: Numbered| self.counts[kind as usize] as i64 + parsed.lowest[kind as usize] < 0;
        let texcoord = Numbered::Texcoord as usize;
        let has_texcoords = self.counts[texcoord] + parsed.counts()[texcoord] > 0;
        if passes_first(Numbered::Vertex) || passes_first(Numbered::Texcoord) && has_texcoords {
            let kinds = [Numbered::Vertex, Numbered::Texcoord];
            return Err(self.locate(chunk, self.counts, self.line_count, [u64::MAX; 3], &kinds)?);
        }
        if passes_first(Numbered::Normal) {
            let error = self.locate(chunk, self.counts, self.line_count, [u64::MAX; 3], &[Numbered::Normal])?;
            self.builder.findings.note("dangling_normals", || format!("{error}; normals are recomputed"));
        }
        Ok(passes_first(Numbered::Texcoord))
    }

    /// Reads a chunk again to report the first line with a dangling index.
    fn locate(
        &self,
        chunk: &ObjChunk,
        bases: [u64; 3],
        line_base: u64,
        totals: [u64; 3],
        kinds: &[Numbered],
    ) -> Result<Error> {
        let mut text = Vec::new();
        chunk.read(self.path, &mut text)?;
        Ok(match find_dangling_index(&text, bases, totals, kinds) {
            Some(LineError { line, message }) => Error::input(self.path, line_base + line, message),
            None => Error::Changed(format!("{}: changed while it was read", escape_path(self.path))),
        })
    }

    fn note_libraries(&mut self, parsed: &ParsedChunk, labels: &mut Labels) -> Result<()> {
        for library in &parsed.libraries {
            let (line, name) = (self.line_count + library.line, parsed.records.name(&library.name));
            if !name.is_empty() && self.libraries.last().is_none_or(|(_, last)| last != name) {
                labels.allow(LIBRARY_BYTES + name.len() as u64)?;
                self.libraries.push((line, name.to_vec()));
            }
        }
        Ok(())
    }

    fn check_forward(&mut self) -> Result<()> {
        let dangles =
            |forward: &&ForwardChunk, kind: Numbered| forward.highest[kind as usize] > self.counts[kind as usize];
        let has_texcoords = self.builder.texcoord_count() > 0;
        let is_error =
            |f: &&ForwardChunk| dangles(f, Numbered::Vertex) || dangles(f, Numbered::Texcoord) && has_texcoords;
        if let Some(forward) = self.forward.iter().find(is_error) {
            let kinds = [Numbered::Vertex, Numbered::Texcoord];
            return Err(self.locate(&forward.chunk, forward.bases, forward.line_base, self.counts, &kinds)?);
        }
        if let Some(forward) = self.forward.iter().find(|forward| dangles(forward, Numbered::Texcoord)) {
            let kinds = [Numbered::Texcoord];
            let error = self.locate(&forward.chunk, forward.bases, forward.line_base, self.counts, &kinds)?;
            let words = "the file has no texture coordinates, so its faces are read without them";
            self.builder.findings.note("dangling_texture_coordinates", || format!("{error}; {words}"));
            self.lacks_texcoords = true;
        }
        if let Some(forward) = self.forward.iter().find(|forward| dangles(forward, Numbered::Normal)) {
            let kinds = [Numbered::Normal];
            let error = self.locate(&forward.chunk, forward.bases, forward.line_base, self.counts, &kinds)?;
            self.builder.findings.note("dangling_normals", || format!("{error}; normals are recomputed"));
        }
        Ok(())
    }

    fn no_faces(&self) -> Error {
        let unknown =
            self.builder.findings.iter().find(|(kind, _)| *kind == "unknown_statements").map(|(_, finding)| finding);
        let found = || match unknown.and_then(|finding| Some((finding.count, finding.places.first()?))) {
            Some((1, place)) => format!("no faces; 1 line is not OBJ: {place}"),
            Some((count, place)) => format!("no faces; {count} lines are not OBJ, such as {place}"),
            None => {
                let lines = counted(self.line_count, "line");
                format!("no faces; expected OBJ text with 'f' statements, found {lines}")
            }
        };
        Error::input(self.path, 0, self.builder.all_repeat().unwrap_or_else(found))
    }
}

/// Converts relative corners of a chunk to ids of the file; `bases` are the counts of v, vt and vn before the chunk.
fn make_absolute(parsed: &mut ParsedChunk, bases: [u64; 3]) {
    shift(&mut parsed.records.corner_vertices, &parsed.relative_vertices, bases[0]);
    shift(&mut parsed.records.corner_texcoords, &parsed.relative_texcoords, bases[1]);
}

/// Adds `base` to the ids of some corners.
fn shift<I: Id>(ids: &mut TiSlice<ChunkCorner, I>, corners: &[ChunkCorner], base: u64) {
    for &corner in corners {
        ids[corner] = I::new(ids[corner].number().wrapping_add(base as u32));
    }
}

//! Appends the parsed chunks of a file to its columns, in order.
//!
//! In: the chunks of one input file, in order. Out: a [`StoredPiece`]. Invariant: only this module knows what precedes
//! a chunk, so it alone converts relative indices to ids and chunk lines to file lines; the output depends on the order
//! of chunks alone.
//!
//! # Memory
//! The buffers of the writers, [`FACE_BUFFER`] faces, and 80 bytes per chunk with faces that refer to later vertices.
//!
//! # Files
//! `scan-<index>-positions.col`, `-texcoords.col`, `-colours.col` (if a vertex has a colour) and `-faces.blk`. The last
//! is `-faces.bare.blk` if faces refer to texture coordinates and the file has none.

use std::fs;
use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};

use super::chunk::Chunk;
use super::mtl::define_materials;
use super::obj::{LineError, find_dangling_index};
use super::parsed::{Numbered, ParsedChunk};
use super::parts::Labels;
use crate::base::error::escape_path;
use crate::base::ordered::both;
use crate::base::{Error, Findings, Result};
use crate::file::{ColumnWriter, PackedWriter};
use crate::model::face::{POLYGON_CORNERS_MAX, repeats_vertex};
use crate::model::stored_mesh::ID_LIMIT;
use crate::model::{Face, FaceBlocks, FaceWriter, NO_TEXCOORD, StoredPiece};

const FACE_BUFFER: usize = 4096;
const COLOUR_BUFFER: usize = 4096;
/// Bytes that an `mtllib` statement takes in addition to its text.
const LIBRARY_BYTES: u64 = 64;

/// Writer of the columns of an input file.
pub struct FileCommit<'a> {
    path: &'a Path,
    colours_path: PathBuf,
    positions: PackedWriter<DVec3>,
    texcoords: PackedWriter<DVec2>,
    colours: Option<ColumnWriter<[f32; 3]>>,
    faces: FaceWriter,
    face_buffer: Vec<Face>,
    counts: [u64; 3],
    line_count: u64,
    triangles: u64,
    forward: Vec<ForwardChunk>,
    libraries: Vec<(u64, Vec<u8>)>,
    position_decimals: u32,
    texcoord_decimals: u32,
    uses_normals: bool,
    /// Whether faces refer to texture coordinates and the file has none at all.
    lacks_texcoords: bool,
    findings: Findings,
}

/// A chunk with an index that no statement up to its end defines.
struct ForwardChunk {
    chunk: Chunk,
    bases: [u64; 3],
    line_base: u64,
    highest: [u64; 3],
}

impl<'a> FileCommit<'a> {
    /// Creates the column files of an input in the work folder.
    ///
    /// # Errors
    /// If a file cannot be created.
    pub fn begin(path: &'a Path, folder: &Path, index: usize) -> Result<Self> {
        let file = |what: &str| folder.join(format!("scan-{index}-{what}"));
        Ok(Self {
            path,
            colours_path: file("colours.col"),
            positions: PackedWriter::create(&file("positions.col"), *b"position")?,
            texcoords: PackedWriter::create(&file("texcoords.col"), *b"texcoord")?,
            colours: None,
            faces: FaceWriter::create(&file("faces.blk"))?,
            face_buffer: Vec::with_capacity(FACE_BUFFER),
            counts: [0; 3],
            line_count: 0,
            triangles: 0,
            forward: Vec::new(),
            libraries: Vec::new(),
            position_decimals: 0,
            texcoord_decimals: 0,
            uses_normals: false,
            lacks_texcoords: false,
            findings: Findings::default(),
        })
    }

    /// Returns an error at a line of the next chunk.
    pub fn error_at(&self, error: LineError) -> Error {
        Error::input(self.path, self.line_count + error.line, error.message)
    }

    /// Appends the next chunk.
    ///
    /// # Errors
    /// [`Error::Input`] if a relative index points before the first vertex, [`Error::Limit`] if there are too many
    /// vertices, [`Error::Budget`] if names take too much memory, and those of the writers.
    pub fn append(&mut self, chunk: &Chunk, parsed: &mut ParsedChunk, labels: &mut Labels) -> Result<()> {
        let bases = self.counts;
        let may_lack_texcoords = self.check_backward(chunk, parsed)?;
        for (count, added) in self.counts.iter_mut().zip(parsed.counts()) {
            *count += added;
        }
        for (kind, count) in Numbered::ALL.into_iter().zip(self.counts) {
            if count > ID_LIMIT && kind != Numbered::Normal {
                let what = if kind == Numbered::Vertex { "vertices" } else { "texture coordinates" };
                let path = escape_path(self.path);
                return Err(Error::Limit(format!("{path}: more than {ID_LIMIT} {what}; split the file into tiles")));
            }
        }
        let mut highest = parsed.highest;
        if may_lack_texcoords {
            highest[Numbered::Texcoord as usize] = u64::MAX;
        }
        if highest.iter().zip(self.counts).any(|(highest, count)| *highest > count) {
            let line_base = self.line_count;
            self.forward.push(ForwardChunk { chunk: chunk.clone(), bases, line_base, highest });
        }
        self.report(parsed, labels)?;
        self.append_vertices(parsed, bases[0])?;
        self.append_faces(parsed, bases, labels)?;
        self.line_count += parsed.line_count;
        Ok(())
    }

    /// Refuses relative indices that point before the first vertex. Returns whether some point before the first texture
    /// coordinate of a file that has none so far; that is judged at the end of the file.
    fn check_backward(&mut self, chunk: &Chunk, parsed: &ParsedChunk) -> Result<bool> {
        let passes_first = |kind: Numbered| self.counts[kind as usize] as i64 + parsed.lowest[kind as usize] < 0;
        let texcoord = Numbered::Texcoord as usize;
        let has_texcoords = self.counts[texcoord] + parsed.counts()[texcoord] > 0;
        if passes_first(Numbered::Vertex) || passes_first(Numbered::Texcoord) && has_texcoords {
            let kinds = [Numbered::Vertex, Numbered::Texcoord];
            return Err(self.locate(chunk, self.counts, self.line_count, [u64::MAX; 3], &kinds)?);
        }
        if passes_first(Numbered::Normal) {
            let error = self.locate(chunk, self.counts, self.line_count, [u64::MAX; 3], &[Numbered::Normal])?;
            self.findings.note("dangling_normals", || format!("{error}; normals are recomputed"));
        }
        Ok(passes_first(Numbered::Texcoord))
    }

    /// Reads a chunk again to report the first line with a dangling index.
    fn locate(
        &self,
        chunk: &Chunk,
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

    fn report(&mut self, parsed: &ParsedChunk, labels: &mut Labels) -> Result<()> {
        for note in &parsed.notes {
            for (line, words) in &note.places {
                let line = self.line_count + line;
                self.findings.note(note.kind, || format!("{}:{line}: {words}", escape_path(self.path)));
            }
            self.findings.count(note.kind, note.count - note.places.len() as u64);
        }
        for library in &parsed.libraries {
            let (line, name) = (self.line_count + library.line, parsed.name(&library.name));
            if !name.is_empty() && self.libraries.last().is_none_or(|(_, last)| last != name) {
                labels.allow(LIBRARY_BYTES + name.len() as u64)?;
                self.libraries.push((line, name.to_vec()));
            }
        }
        self.position_decimals = self.position_decimals.max(parsed.position_decimals);
        self.texcoord_decimals = self.texcoord_decimals.max(parsed.texcoord_decimals);
        self.uses_normals |= parsed.uses_normals;
        Ok(())
    }

    fn append_vertices(&mut self, parsed: &ParsedChunk, vertex_base: u64) -> Result<()> {
        self.positions.append_packed(&parsed.packed_positions)?;
        self.texcoords.append_packed(&parsed.packed_texcoords)?;
        if parsed.colours.is_empty() {
            if let Some(colours) = &mut self.colours {
                append_uncoloured(colours, parsed.positions.len() as u64)?;
            }
            return Ok(());
        }
        let colours = match &mut self.colours {
            Some(colours) => colours,
            None => {
                let mut colours = ColumnWriter::create(&self.colours_path, *b"colour  ")?;
                append_uncoloured(&mut colours, vertex_base)?;
                self.colours.insert(colours)
            }
        };
        colours.append(&parsed.colours)
    }

    fn append_faces(&mut self, parsed: &mut ParsedChunk, bases: [u64; 3], labels: &mut Labels) -> Result<()> {
        for (relative, corners, base) in [
            (&parsed.relative_vertices, &mut parsed.corner_vertices, bases[0]),
            (&parsed.relative_texcoords, &mut parsed.corner_texcoords, bases[1]),
        ] {
            for corner in relative {
                let id = &mut corners[*corner as usize];
                *id = id.wrapping_add(base as u32);
            }
        }
        let mut degenerate_count = 0;
        let mut changes = parsed.changes.iter().peekable();
        let mut first = 0;
        for (polygon, size) in parsed.polygon_sizes.iter().enumerate() {
            while let Some(change) = changes.next_if(|change| change.polygon as usize == polygon) {
                labels.change(change.kind, parsed.name(&change.name));
            }
            let corners = first..first + *size as usize;
            first = corners.end;
            let vertices = &parsed.corner_vertices[corners.clone()];
            self.triangles += vertices.len() as u64 - 2;
            if matches!(*vertices, [a, b, c] if repeats_vertex([a, b, c])) {
                degenerate_count += 1;
                continue;
            }
            let part = labels.part()?;
            let texcoords = parsed.corner_texcoords.get(corners).filter(|texcoords| !texcoords.is_empty());
            let is_polygon = vertices.len() <= POLYGON_CORNERS_MAX;
            for i in 2..vertices.len() {
                let triangle = [vertices[0], vertices[i - 1], vertices[i]];
                if !is_polygon && repeats_vertex(triangle) {
                    degenerate_count += 1;
                    continue;
                }
                self.face_buffer.push(Face {
                    vertices: triangle,
                    texcoords: texcoords.map_or([NO_TEXCOORD; 3], |t| [t[0], t[i - 1], t[i]]),
                    part,
                    continues_polygon: is_polygon && i > 2,
                    deviation: 0.0,
                });
                if self.face_buffer.len() == FACE_BUFFER {
                    self.flush_faces()?;
                }
            }
        }
        for change in changes {
            labels.change(change.kind, parsed.name(&change.name));
        }
        self.findings.count("degenerate_faces", degenerate_count);
        Ok(())
    }

    fn flush_faces(&mut self) -> Result<()> {
        self.faces.append(&self.face_buffer)?;
        self.face_buffer.clear();
        Ok(())
    }

    /// Checks forward references, reads the material libraries and finishes the columns. Returns the piece and its
    /// number of triangles, including degenerate ones.
    ///
    /// # Errors
    /// [`Error::Input`] if an index dangles or no face is left, and those of [`define_materials`] and of the writers.
    pub fn finish(
        mut self,
        labels: &mut Labels,
        findings: &mut Findings,
        libraries: &mut Vec<PathBuf>,
    ) -> Result<(StoredPiece, u64)> {
        self.check_forward()?;
        self.flush_faces()?;
        if self.faces.is_empty() {
            return Err(self.no_faces());
        }
        let has_texcoords = !self.texcoords.is_empty();
        let (catalogue, used, allowance) = labels.materials_of_file();
        catalogue.has_normals |= self.uses_normals;
        catalogue.has_texcoords |= has_texcoords;
        catalogue.position_decimals = catalogue.position_decimals.max(self.position_decimals);
        catalogue.texcoord_decimals = catalogue.texcoord_decimals.max(self.texcoord_decimals);
        let materials = &mut catalogue.materials;
        let named = define_materials(self.path, &self.libraries, materials, used, allowance, &mut self.findings)?;
        libraries.extend(named);
        findings.merge(self.findings);
        let Self { positions, colours, texcoords, faces, lacks_texcoords, .. } = self;
        // Both wait for the disk; run them in parallel.
        let (faces, rest) = both(
            2,
            || faces.finish().and_then(|faces| if lacks_texcoords { without_texcoords(faces) } else { Ok(faces) }),
            || -> Result<_> {
                Ok((positions.finish()?, colours.map(ColumnWriter::finish).transpose()?, texcoords.finish()?))
            },
        );
        let (positions, colours, texcoords) = rest?;
        Ok((StoredPiece { positions, colours, texcoords, faces: faces? }, self.triangles))
    }

    fn check_forward(&mut self) -> Result<()> {
        let dangles =
            |forward: &&ForwardChunk, kind: Numbered| forward.highest[kind as usize] > self.counts[kind as usize];
        let has_texcoords = !self.texcoords.is_empty();
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
            self.findings.note("dangling_texture_coordinates", || format!("{error}; {words}"));
            self.lacks_texcoords = true;
        }
        if let Some(forward) = self.forward.iter().find(|forward| dangles(forward, Numbered::Normal)) {
            let kinds = [Numbered::Normal];
            let error = self.locate(&forward.chunk, forward.bases, forward.line_base, self.counts, &kinds)?;
            self.findings.note("dangling_normals", || format!("{error}; normals are recomputed"));
        }
        Ok(())
    }

    fn no_faces(&self) -> Error {
        let unknown = self.findings.iter().find(|(kind, _)| *kind == "unknown_statements").map(|(_, finding)| finding);
        let found = match unknown.and_then(|finding| Some((finding.count, finding.places.first()?))) {
            _ if self.triangles > 0 => format!("no faces: all {} repeat a vertex", self.triangles),
            Some((count, place)) => format!("no faces; {count} lines are not OBJ, such as {place}"),
            None => format!("no faces; expected OBJ text with 'f' statements, found {} lines", self.line_count),
        };
        Error::input(self.path, 0, found)
    }
}

/// Rewrites the faces of a file without texture coordinates.
fn without_texcoords(faces: FaceBlocks) -> Result<FaceBlocks> {
    let mut writer = FaceWriter::create(&faces.path().with_extension("bare.blk"))?;
    let (file, mut bytes, mut block_faces) = (faces.open()?, Vec::new(), Vec::new());
    for block in faces.blocks() {
        faces.read_block(&file, block, &mut bytes, &mut block_faces)?;
        for face in &mut block_faces {
            face.texcoords = [NO_TEXCOORD; 3];
        }
        writer.append(&block_faces)?;
    }
    let bare = writer.finish()?;
    fs::remove_file(faces.path()).map_err(|e| Error::io(faces.path(), "remove", e))?;
    Ok(bare)
}

fn append_uncoloured(colours: &mut ColumnWriter<[f32; 3]>, mut count: u64) -> Result<()> {
    let none = [[f32::NAN; 3]; COLOUR_BUFFER];
    while count > 0 {
        let now = count.min(COLOUR_BUFFER as u64);
        colours.append(&none[..now as usize])?;
        count -= now;
    }
    Ok(())
}

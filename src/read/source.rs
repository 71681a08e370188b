//! The formats that are read, behind one trait, and how the format of a file is recognised.
//!
//! In: a path. Out: chunks of the file in order, each of which a worker parses on its own; then its piece of the mesh.
//! Invariant: where chunks end depends on the file alone.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::builder::FinishedFile;
use super::file::open_regular;
use super::parts::Labels;
use super::records::ParsedRecords;
use super::texture_sample::{ChunkTexture, TextureSample};
use crate::base::error::escape_path;
use crate::base::{Error, Findings, Result};
use crate::file::packed::RecordBounds;

/// Size of a chunk in bytes, before its last record is completed. Text and parsed records of a chunk fit in the cache of
/// a core.
pub const CHUNK_BYTES: u64 = 512 << 10;

/// A file of a format, being cut into chunks. What is parsed is appended by a committer, which sees the chunks in order.
pub(super) trait MeshSource: Sized + Send {
    /// What a worker needs to parse a part of the file.
    type Chunk: Send;
    /// What a worker finds in a chunk; used again once it is appended.
    type Parsed: Default + Send;
    /// A file whose chunks are being appended.
    type Commit<'a>: FileCommit<'a, Self>;

    /// Opens a file; a chunk has about `chunk_bytes` bytes.
    ///
    /// # Errors
    /// If the file cannot be opened, or does not begin as files of the format do.
    fn open(path: &Path, chunk_bytes: u64) -> Result<Self>;

    /// Cuts off the next chunk. A file has at least one.
    ///
    /// # Errors
    /// If the file cannot be read, or has no end of a record where one must be.
    fn cut(&mut self, path: &Path) -> Result<Cut<Self::Chunk>>;

    /// Memory that a chunk takes while it is parsed and appended, in bytes, that of its own bytes included.
    fn work_bytes(cut: &Cut<Self::Chunk>) -> u64 {
        PARSED_GROWTH * cut.bytes
    }

    /// Parses a chunk into `parsed`, which is empty; `text` is scratch space.
    ///
    /// # Errors
    /// If the chunk cannot be read or is faulty.
    fn parse(path: &Path, chunk: &mut Self::Chunk, parsed: &mut Self::Parsed, text: &mut Vec<u8>) -> Result<()>;

    /// The records of what was parsed.
    fn records(parsed: &mut Self::Parsed) -> &mut ParsedRecords;

    /// Counts the elements of a chunk, merges the box of its vertices into `bounds` and adds to `texture`; `text` is
    /// scratch space.
    ///
    /// # Errors
    /// As [`parse`](MeshSource::parse), but some faults are not noticed.
    fn count(
        path: &Path,
        chunk: &mut Self::Chunk,
        bounds: Option<&mut RecordBounds>,
        texture: Option<&mut ChunkTexture>,
        text: &mut Vec<u8>,
    ) -> Result<Counts>;

    /// Defines the materials of a file that was counted.
    ///
    /// # Errors
    /// If a material library cannot be read, or its definitions take too much memory.
    fn define_counted(sample: &mut TextureSample) -> Result<()>;

    /// Empties what was parsed, for the next chunk.
    fn clear(parsed: &mut Self::Parsed);
}

/// The committer's side of a file.
pub(super) trait FileCommit<'a, S: MeshSource>: Sized {
    /// Creates the columns of the input number `index` in the work folder.
    ///
    /// # Errors
    /// If a file cannot be created.
    fn begin(path: &'a Path, folder: &Path, index: usize) -> Result<Self>;

    /// Appends the next chunk.
    ///
    /// # Errors
    /// Those of the writers, and the first fault of the input.
    fn append(&mut self, cut: &Cut<S::Chunk>, parsed: &mut S::Parsed, labels: &mut Labels) -> Result<()>;

    /// Finishes the file after its last chunk.
    ///
    /// # Errors
    /// Those of the writers, and faults that show at the end.
    fn finish(self, labels: &mut Labels, findings: &mut Findings) -> Result<FinishedFile>;
}

/// A part of a file that holds whole records.
#[derive(Debug)]
pub(super) struct Cut<C> {
    /// What a worker needs to parse it.
    pub(super) chunk: C,
    /// Length in bytes.
    pub(super) bytes: u64,
    /// Whether it is the last of its file.
    pub(super) is_last: bool,
}

/// A cut with the index of its input.
pub(super) type CutOfInput<S> = (usize, Result<Cut<<S as MeshSource>::Chunk>>);

/// Returns the chunks of several files of a format in order.
#[derive(Debug)]
pub(super) struct Cutter<'a, S> {
    inputs: &'a [PathBuf],
    chunk_bytes: u64,
    file_index: usize,
    open: Option<S>,
}

impl<'a, S: MeshSource> Cutter<'a, S> {
    /// Creates a cutter at the start of the first file.
    pub(super) fn new(inputs: &'a [PathBuf], chunk_bytes: u64) -> Self {
        Self { inputs, chunk_bytes, file_index: 0, open: None }
    }

    fn cut(&mut self, path: &Path) -> Result<Cut<S::Chunk>> {
        let source = match &mut self.open {
            Some(source) => source,
            None => self.open.insert(S::open(path, self.chunk_bytes)?),
        };
        source.cut(path)
    }
}

/// Returns the next chunk; `None` after the last file. An empty file has one empty chunk. After an error, which is that of
/// a file that cannot be opened or read, the next file follows.
impl<S: MeshSource> Iterator for Cutter<'_, S> {
    type Item = CutOfInput<S>;

    fn next(&mut self) -> Option<CutOfInput<S>> {
        let file_index = self.file_index;
        let cut = self.cut(self.inputs.get(file_index)?);
        if cut.as_ref().map_or(true, |cut| cut.is_last) {
            self.file_index += 1;
            self.open = None;
        }
        Some((file_index, cut))
    }
}

/// Counts of the elements of an input.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Bytes of the files.
    pub bytes: u64,
    /// Vertices.
    pub vertices: u64,
    /// Texture coordinates.
    pub texcoords: u64,
    /// Normals.
    pub normals: u64,
    /// Faces of three or more corners.
    pub polygons: u64,
    /// Triangles: n - 2 for each polygon of n corners.
    pub triangles: u64,
    /// Whether the first vertex of any chunk has a colour.
    pub has_colours: bool,
    /// Most decimals of a coordinate among the first vertices of chunks; `u32::MAX` if one has an exponent.
    pub decimals: u32,
}

impl Counts {
    /// Counts of parsed records that took `bytes`; merges the box of their vertices into `bounds`.
    pub(super) fn of_records(records: &ParsedRecords, bytes: u64, bounds: Option<&mut RecordBounds>) -> Self {
        if let Some(bounds) = bounds {
            let boxes = records.positions.iter().map(|position| position.to_array());
            boxes.for_each(|position| bounds.merge(&RecordBounds { low: position, high: position }));
        }
        let vertices = records.positions.len() as u64;
        Self {
            bytes,
            vertices,
            texcoords: records.texcoords.len() as u64,
            normals: if records.uses_normals { vertices } else { 0 },
            polygons: records.polygon_sizes.len() as u64,
            triangles: records.polygon_sizes.iter().map(|size| u64::from(*size) - 2).sum(),
            has_colours: !records.colours.is_empty(),
            decimals: records.position_decimals,
        }
    }

    /// Adds the counts of another part.
    pub(super) fn add(&mut self, other: &Counts) {
        self.bytes += other.bytes;
        self.vertices += other.vertices;
        self.texcoords += other.texcoords;
        self.normals += other.normals;
        self.polygons += other.polygons;
        self.triangles += other.triangles;
        self.has_colours |= other.has_colours;
        self.decimals = self.decimals.max(other.decimals);
    }
}

/// Memory of a chunk by its length: the text, a line joined of several, and three bytes of records for each of text.
pub(super) const PARSED_GROWTH: u64 = 5;
/// A buffer for the text of a chunk larger than this, in bytes, is freed instead of reused.
pub(super) const TEXT_BYTES_KEPT: usize = 2 * CHUNK_BYTES as usize;
/// Buffers of parsed records larger than this, in bytes, are freed instead of reused.
pub(super) const KEPT_BYTES_MAX: usize = 4 << 20;

/// A format of mesh files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshFormat {
    /// Wavefront OBJ.
    Obj,
    /// Stanford PLY.
    Ply,
    /// Arrays ([`ArrayLayout`](crate::model::array_file::ArrayLayout)).
    Arrays,
}

impl MeshFormat {
    /// All formats, with the ending of their files in lower case.
    pub const ALL: [(MeshFormat, &str); 3] =
        [(MeshFormat::Obj, "obj"), (MeshFormat::Ply, "ply"), (MeshFormat::Arrays, "drystone")];

    /// Format of the files with the ending of a path; `None` for others.
    pub fn by_ending(path: &Path) -> Option<Self> {
        let ending = path.extension()?;
        Self::ALL.iter().find(|(_, known)| ending.eq_ignore_ascii_case(known)).map(|(format, _)| *format)
    }

    /// Reports whether a file has the ending of a format that is looked for in folders.
    pub fn is_sought(path: &Path) -> bool {
        Self::by_ending(path).is_some_and(|format| format != Self::Arrays)
    }

    /// Format of a file, by its ending; with any other ending by its first bytes, an OBJ unless they are those of a PLY.
    ///
    /// # Errors
    /// [`Error::Usage`] for a GLB; if the file cannot be opened or read.
    pub fn of(path: &Path) -> Result<Self> {
        if let Some(format) = Self::by_ending(path) {
            return Ok(format);
        }
        let (file, _) = open_regular(path)?;
        let mut start = Vec::new();
        file.take(4).read_to_end(&mut start).map_err(|e| Error::io(path, "read", e))?;
        Ok(match &start[..] {
            b"ply\n" | b"ply\r" => Self::Ply,
            b"glTF" => {
                let words = format!("{}: a GLB is written, but not read; give an OBJ or a PLY", escape_path(path));
                return Err(Error::Usage(words));
            }
            _ => Self::Obj,
        })
    }

    /// Runs of consecutive files of the same format: the format, and the range of their indices.
    ///
    /// # Errors
    /// Those of [`of`](MeshFormat::of).
    pub(super) fn runs(inputs: &[PathBuf]) -> Result<Vec<(Self, std::ops::Range<usize>)>> {
        let mut runs: Vec<(Self, std::ops::Range<usize>)> = Vec::new();
        for (index, path) in inputs.iter().enumerate() {
            let format = Self::of(path)?;
            match runs.last_mut().filter(|(last, _)| *last == format) {
                Some((_, range)) => range.end = index + 1,
                None => runs.push((format, index..index + 1)),
            }
        }
        Ok(runs)
    }
}

//! How much of its images a mesh shows, estimated while its elements are counted.
//!
//! ```text
//! chunk ── vt, f, usemtl, mtllib ──▶ ChunkTexture ──▶ TextureSample ──▶ area in texture space of each part, materials
//! ```
//! In: the statements of chunks, in order. Out: [`ShownTexture`]. Invariant: exact for a file of at most
//! [`TEXCOORDS_MAX`] texture coordinates; of a larger one, only the triangles count that use the first of them. A PLY
//! counts with its images alone.
//!
//! # Memory
//! 32 MiB, and the materials.

use std::path::{Path, PathBuf};

use super::parts::Labels;
use super::records::LabelKind;
use crate::base::id::TiVec;
use crate::base::{Allowance, Findings, Result};
use crate::geometry::triangle::texture_area;
use crate::model::Catalogue;
use crate::model::id::PartId;

/// Maximum number of texture coordinates of a file that are kept.
const TEXCOORDS_MAX: usize = 4 << 20;
/// Bytes that the name of a library takes beside its text.
const LIBRARY_BYTES: u64 = 100;

/// A texture coordinate of a face, by its index from 0.
#[derive(Debug, Clone, Copy)]
pub(super) enum TexcoordIndex {
    /// In the file.
    OfFile(u64),
    /// In the chunk; one of an earlier chunk is negative.
    OfChunk(i64),
}

/// Faces of a chunk with the same material.
#[derive(Debug, Default)]
struct MaterialRun {
    /// `None` before the first `usemtl` of a chunk.
    material: Option<Vec<u8>>,
    triangles: Vec<[TexcoordIndex; 3]>,
    /// Number of triangles without texture coordinates.
    bare: u64,
}

/// What the statements of a chunk say of the texture.
#[derive(Debug, Default)]
pub(super) struct ChunkTexture {
    pub texcoords: Vec<[f32; 2]>,
    libraries: Vec<Vec<u8>>,
    runs: Vec<MaterialRun>,
}

impl ChunkTexture {
    /// A `usemtl` statement.
    pub fn use_material(&mut self, name: &[u8]) {
        self.runs.push(MaterialRun { material: Some(name.to_vec()), ..MaterialRun::default() });
    }

    /// An `mtllib` statement.
    pub fn name_library(&mut self, text: &[u8]) {
        if self.libraries.last().is_none_or(|last| last != text) {
            self.libraries.push(text.to_vec());
        }
    }

    /// A triangle, with or without texture coordinates.
    pub fn add_triangle(&mut self, texcoords: [Option<TexcoordIndex>; 3]) {
        if self.runs.is_empty() {
            self.runs.push(MaterialRun::default());
        }
        let Some(run) = self.runs.last_mut() else { return };
        match texcoords {
            [Some(a), Some(b), Some(c)] => run.triangles.push([a, b, c]),
            _ => run.bare += 1,
        }
    }
}

/// What is known of the textures of files that are being counted.
#[derive(Debug)]
pub struct TextureSample {
    pub(super) labels: Labels,
    pub(super) findings: Findings,
    areas: TiVec<PartId, f64>,
    measured: u64,
    /// Of the current file: its texture coordinates, the number of all of them so far, its libraries.
    texcoords: Vec<[f32; 2]>,
    texcoord_count: u64,
    pub(super) libraries: Vec<(u64, Vec<u8>)>,
    pub(super) path: PathBuf,
}

/// How much of its images a mesh shows.
#[derive(Debug)]
pub struct ShownTexture {
    /// Materials and parts.
    pub catalogue: Catalogue,
    /// Sum of the areas in texture space of the measured triangles of each part.
    pub areas: TiVec<PartId, f64>,
    /// Number of measured triangles.
    pub measured: u64,
    /// Libraries that are missing or damaged.
    pub findings: Findings,
}

impl TextureSample {
    /// A sample of no file, whose materials may take `catalogue_bytes`.
    pub fn new(catalogue_bytes: u64) -> Self {
        Self {
            labels: Labels::new(Allowance::new(catalogue_bytes)),
            findings: Findings::default(),
            areas: TiVec::new(),
            measured: 0,
            texcoords: Vec::new(),
            texcoord_count: 0,
            libraries: Vec::new(),
            path: PathBuf::new(),
        }
    }

    /// Begins a file.
    pub(super) fn begin_file(&mut self, path: &Path) {
        self.labels.begin_file(path);
        self.texcoords.clear();
        self.texcoord_count = 0;
        self.libraries.clear();
        self.path = path.to_owned();
    }

    /// Takes the next chunk of the current file.
    ///
    /// # Errors
    /// [`Error::Budget`](crate::base::Error::Budget) if the materials take too much memory.
    pub(super) fn take(&mut self, chunk: ChunkTexture) -> Result<()> {
        let before = self.texcoord_count;
        let room = TEXCOORDS_MAX.saturating_sub(self.texcoords.len());
        self.texcoord_count += chunk.texcoords.len() as u64;
        self.texcoords.extend(chunk.texcoords.into_iter().take(room));
        for library in chunk.libraries {
            self.labels.allow(LIBRARY_BYTES + library.len() as u64)?;
            self.libraries.push((0, library));
        }
        for run in chunk.runs {
            if let Some(name) = &run.material {
                self.labels.change(LabelKind::Material, name);
            }
            if run.triangles.is_empty() && run.bare == 0 {
                continue;
            }
            let part = self.labels.part()?;
            if self.areas.len() <= usize::from(part) {
                self.areas.resize(usize::from(part) + 1, 0.0);
            }
            self.measured += run.bare;
            for corners in run.triangles {
                let [a, b, c] = corners.map(|index| self.texcoord(index, before));
                if let Some(((a, b), c)) = a.zip(b).zip(c) {
                    self.measured += 1;
                    self.areas[part] += texture_area([a, b, c]);
                }
            }
        }
        Ok(())
    }

    /// A texture coordinate that is kept; `before` belong to earlier chunks.
    fn texcoord(&self, index: TexcoordIndex, before: u64) -> Option<[f32; 2]> {
        let index = match index {
            TexcoordIndex::OfFile(index) => index,
            TexcoordIndex::OfChunk(index) => before.checked_add_signed(index)?,
        };
        self.texcoords.get(usize::try_from(index).ok()?).copied()
    }

    /// Ends the last file.
    pub fn finish(self) -> ShownTexture {
        let (catalogue, mut areas) = (self.labels.finish(), self.areas);
        areas.resize(catalogue.parts.len(), 0.0);
        ShownTexture { catalogue, areas, measured: self.measured, findings: self.findings }
    }
}

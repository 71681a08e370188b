//! Appends the parsed chunks of a PLY, in order.
//!
//! # Memory
//! That of the builder.

use std::path::Path;
use std::sync::Arc;

use super::cut::{PlyChunk, PlySource};
use super::layout::{Layout, Texcoords};
use super::parse::PlyRecords;
use crate::base::error::escape_path;
use crate::base::{Error, Findings, Result};
use crate::model::id::PieceTexcoord;
use crate::read::builder::{FinishedFile, MeshBuilder};
use crate::read::file::OpenFile;
use crate::read::parts::Labels;
use crate::read::source::{Cut, FileCommit};

/// Decimal digits that every 32-bit float holds.
const FLOAT_DIGITS: i32 = 7;

/// A PLY whose chunks are being appended.
pub struct PlyCommit<'a> {
    path: &'a Path,
    builder: MeshBuilder<'a>,
    bytes: u64,
    vertices: u64,
    /// Largest magnitude of a coordinate.
    largest: f64,
    is_begun: bool,
    last: Option<Last>,
}

/// What the last chunk knows of the file.
struct Last {
    layout: Arc<Layout>,
    file: Arc<OpenFile>,
    content_hash: u64,
}

impl<'a> FileCommit<'a, PlySource> for PlyCommit<'a> {
    fn begin(path: &'a Path, folder: &Path, index: usize) -> Result<Self> {
        let builder = MeshBuilder::create(path, folder, index)?;
        Ok(Self { path, builder, bytes: 0, vertices: 0, largest: 0.0, is_begun: false, last: None })
    }

    fn append(&mut self, cut: &Cut<PlyChunk>, parsed: &mut PlyRecords, labels: &mut Labels) -> Result<()> {
        let layout = &cut.chunk.layout;
        if !std::mem::replace(&mut self.is_begun, true) {
            self.report_header(cut);
            self.builder.check_counts(layout.vertex_count, 0)?;
        }
        let texcoord_base = self.builder.texcoord_count();
        self.vertices += parsed.records.positions.len() as u64;
        self.largest = self.largest.max(parsed.largest);
        self.builder.check_counts(self.vertices, texcoord_base + parsed.records.texcoords.len() as u64)?;
        self.builder.report(&parsed.records, 0);
        self.builder.append_vertices(&parsed.records)?;
        if layout.texcoords == Texcoords::OfFaces {
            for id in parsed.records.corner_texcoords.iter_mut().filter(|id| **id != PieceTexcoord::NONE) {
                *id = id.plus(texcoord_base as u32);
            }
        }
        self.builder.append_faces(&parsed.records, labels)?;
        self.bytes += cut.bytes;
        if cut.is_last {
            let (file, content_hash) = (cut.chunk.file.clone(), cut.chunk.content_hash);
            self.last = Some(Last { layout: layout.clone(), file, content_hash });
        }
        Ok(())
    }

    fn finish(mut self, labels: &mut Labels, findings: &mut Findings) -> Result<FinishedFile> {
        let Some(Last { layout, file, content_hash }) = self.last.take() else {
            return Err(Error::input(self.path, 0, "no faces"));
        };
        file.check_unchanged(self.path)?;
        if self.builder.has_no_faces() {
            let none = || "no faces; expected a PLY with an element 'face' of three or more corners".to_owned();
            return Err(Error::input(self.path, 0, self.builder.all_repeat().unwrap_or_else(none)));
        }
        if layout.has_float_positions {
            // NOTE: the last digits of a float are noise, and vertices that move need no more than the others have.
            let before_point = if self.largest > 0.0 { libm::log10(self.largest).floor() as i32 + 1 } else { 0 };
            let most = (FLOAT_DIGITS - before_point).max(0) as u32;
            self.builder.position_decimals = self.builder.position_decimals.min(most);
        }
        define_materials(&layout, labels)?;
        self.builder.describe(labels.materials_of_file().0);
        let bytes = self.bytes;
        let (piece, triangles) = self.builder.finish(false, findings)?;
        Ok(FinishedFile { piece, triangles, bytes, content_hash, libraries: Vec::new() })
    }
}

impl PlyCommit<'_> {
    fn report_header(&mut self, cut: &Cut<PlyChunk>) {
        let layout = &cut.chunk.layout;
        for (kind, line, words) in &layout.notes {
            let path = escape_path(self.path);
            self.builder.findings.note(kind, || match line {
                0 => format!("{path}: {words}"),
                _ => format!("{path}:{line}: {words}"),
            });
        }
        self.builder.findings.count("ignored_alphas", layout.ignored_alphas);
    }
}

/// Gives each material that faces use its texture image.
pub(super) fn define_materials(layout: &Layout, labels: &mut Labels) -> Result<()> {
    let materials = layout.materials.iter().zip(&layout.header.textures);
    labels.define_textures(materials.map(|(name, texture)| (name.as_slice().into(), texture.as_slice())))
}

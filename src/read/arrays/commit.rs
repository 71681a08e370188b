//! Appends the parsed chunks of an array file, in order.
//!
//! # Memory
//! That of the builder.

use std::path::Path;
use std::sync::Arc;

use super::cut::{ArrayChunk, ArraySource};
use super::parse::ArrayRecords;
use crate::base::{Error, Findings, Result};
use crate::model::array_file::ArrayLayout;
use crate::read::builder::{FinishedFile, MeshBuilder};
use crate::read::file::{OpenFile, chain};
use crate::read::parts::Labels;
use crate::read::source::{Cut, FileCommit};

/// An array file whose chunks are being appended.
pub struct ArrayCommit<'a> {
    path: &'a Path,
    builder: MeshBuilder<'a>,
    bytes: u64,
    content_hash: u64,
    /// What the last chunk knows of the file.
    last: Option<(Arc<ArrayLayout>, Arc<OpenFile>)>,
}

impl<'a> FileCommit<'a, ArraySource> for ArrayCommit<'a> {
    fn begin(path: &'a Path, folder: &Path, index: usize) -> Result<Self> {
        let builder = MeshBuilder::create(path, folder, index)?;
        Ok(Self { path, builder, bytes: 0, content_hash: 0, last: None })
    }

    fn append(&mut self, cut: &Cut<ArrayChunk>, parsed: &mut ArrayRecords, labels: &mut Labels) -> Result<()> {
        let layout = &cut.chunk.layout;
        if cut.chunk.header_bytes > 0 {
            self.builder.check_counts(layout.vertices, layout.texcoords)?;
        }
        self.builder.report(&parsed.records, 0);
        self.builder.append_vertices(&parsed.records)?;
        self.builder.append_faces(&parsed.records, labels)?;
        self.bytes += cut.bytes;
        chain(&mut self.content_hash, cut.bytes, parsed.hash);
        if cut.is_last {
            self.last = Some((layout.clone(), cut.chunk.file.clone()));
        }
        Ok(())
    }

    fn finish(mut self, labels: &mut Labels, findings: &mut Findings) -> Result<FinishedFile> {
        let Some((layout, file)) = self.last.take() else {
            return Err(Error::input(self.path, 0, "no faces"));
        };
        file.check_unchanged(self.path)?;
        if self.builder.has_no_faces() {
            let none = || "no faces".to_owned();
            return Err(Error::input(self.path, 0, self.builder.all_repeat().unwrap_or_else(none)));
        }
        define_materials(&layout, labels)?;
        self.builder.describe(labels.materials_of_file().0);
        let (bytes, content_hash) = (self.bytes, self.content_hash);
        let (piece, triangles) = self.builder.finish(false, findings)?;
        Ok(FinishedFile { piece, triangles, bytes, content_hash, libraries: Vec::new() })
    }
}

/// Gives each label that faces use its texture image.
pub(super) fn define_materials(layout: &ArrayLayout, labels: &mut Labels) -> Result<()> {
    let images = layout.images.iter();
    labels.define_textures(images.map(|(label, name)| (label.to_string().into_bytes().into(), name.as_slice())))
}

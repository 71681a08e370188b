//! Writes a GLB: glTF 2.0 in one binary file, with its images.
//!
//! ```text
//! glTF, version, length     12 bytes
//! JSON                      scene, materials, where everything lies
//! BIN                       vertices, indices, images
//! ```
//! In: the faces, their materials and image files. Out: bytes in a durable file that is not committed yet. Positions are
//! floats relative to an origin, which is the translation of the node, if the mesh lies far from (0, 0, 0). Colours are
//! as they are in the images, without light, unless the result has normals.
//!
//! # Memory
//! That of [`corners`], and the memory given for two groupings.
//!
//! # Source
//! Khronos, glTF 2.0, section 4.4 (binary files).

mod corners;
mod document;
mod images;
mod layout;
mod primitives;

use std::path::Path;

use glam::DVec3;

use self::corners::{CornerSweep, GlbVertex, TakeCorners};
use self::document::GlbDocument;
pub(super) use self::images::{GlbImages, ImageLimits, find_images};
use self::layout::{ChunkLayout, PrimitiveSize, RecordForm};
use self::primitives::{PrimitiveId, Primitives};
use super::copy::{CopyError, open_regular};
use super::glb_format::{linear, padded};
use super::grouping::{Group, Grouping};
use super::result_file::{Replaced, ResultFile};
use super::sink::{MeshSink, ResultMesh};
use crate::base::error::escape_path;
use crate::base::id::TiVec;
use crate::base::{Error, Findings, Result, bytes};
use crate::model::{ColourRange, StoredMesh};
use crate::os::content::Content;

/// Bytes before a chunk, and before the first one.
const CHUNK_HEADER_BYTES: u64 = 8;
const FILE_HEADER_BYTES: u64 = 12;
/// A mesh whose farthest coordinate is farther than this many times its size has an origin of its own.
const NEAR: f64 = 2.0;

/// A GLB being written.
#[derive(Debug)]
pub(super) struct GlbSink {
    file: ResultFile,
    images: GlbImages,
    turns_z_up: bool,
    replaced: Replaced,
}

impl GlbSink {
    /// Creates a temporary file of the job that will become `target`; `turns_z_up` as in
    /// [`WriteOptions`](super::WriteOptions::turns_z_up).
    ///
    /// # Errors
    /// If the file cannot be created.
    pub(super) fn begin(target: &Path, job: u64, images: GlbImages, turns_z_up: bool) -> Result<Self> {
        Ok(Self { file: ResultFile::create(target, job)?, images, turns_z_up, replaced: Replaced::default() })
    }

    fn write_vertices(&mut self, vertices: Grouping<PrimitiveId>) -> Result<()> {
        vertices.drain(|groups| groups.iter().try_for_each(|group| self.file.write(&little_endian(group.words))))
    }

    fn write_indices(
        &mut self,
        faces: Grouping<PrimitiveId>,
        layout: &ChunkLayout,
        result: &ResultMesh<'_>,
    ) -> Result<()> {
        // Groups may come in parts; the last part is filled to whole words.
        let mut left: TiVec<PrimitiveId, u64> = layout.primitives.iter().map(|size| 3 * size.faces).collect();
        faces.drain(|groups| {
            for &Group { key, words } in groups {
                left[key] -= words.len() as u64;
                if layout.primitives[key].index_bytes() == 4 {
                    self.file.write(&little_endian(words))?;
                } else {
                    let mut short: Vec<u8> = words.iter().flat_map(|&word| (word as u16).to_le_bytes()).collect();
                    if left[key] == 0 && layout.primitives[key].faces % 2 == 1 {
                        short.extend([0; 2]);
                    }
                    self.file.write(&short)?;
                }
                result.progress.advance(words.len() as u64 / 3);
            }
            Ok(())
        })
    }

    fn write_images(&mut self) -> Result<()> {
        let Self { file, images, .. } = self;
        for image in &images.files {
            let wrap = |error| Error::io(&image.path, "read", error);
            let source = open_regular(&image.path).map_err(wrap)?;
            let content = Content::pass(source, |bytes| file.write(bytes).map_err(CopyError::Write));
            let content = content.map_err(|error| match error {
                CopyError::Read(error) => wrap(error),
                CopyError::Write(error) => error,
            })?;
            if content != image.content {
                let path = escape_path(&image.path);
                return Err(Error::Changed(format!("{path}: has changed while the result was written; try again")));
            }
            let bytes = image.content.bytes;
            file.write(&[0; 4][..(padded(bytes) - bytes) as usize])?;
        }
        Ok(())
    }
}

impl MeshSink for GlbSink {
    /// The number of vertices depends on the faces.
    fn vertices(&mut self, _: &ResultMesh<'_>) -> Result<()> {
        Ok(())
    }

    fn texcoords(&mut self, _: &ResultMesh<'_>) -> Result<()> {
        Ok(())
    }

    fn faces(&mut self, result: &mut ResultMesh<'_>) -> Result<()> {
        let result = &*result;
        let ResultMesh { mesh, catalogue, usage, ref order, form, share, work_folder, .. } = *result;
        let places = order.counts(usage).len();
        let primitives = Primitives::of(catalogue, order, places, &self.images);
        let origin = origin_of(mesh);
        let mut counter = PrimitiveCounter {
            sizes: vec![PrimitiveSize::default(); primitives.list.len()].into(),
            range: ColourRange::default(),
            uncoloured: 0,
        };
        CornerSweep::new(mesh, &primitives, origin, false)?.run(&mut counter)?;

        let colours = mesh.has_colours();
        let texcoords = primitives.list.iter().any(|primitive| primitive.image.is_some());
        let form = RecordForm { normals: form.normals, texcoords, colours };
        let layout = ChunkLayout::new(form, counter.sizes, &self.images);
        let Self { file, images, turns_z_up, .. } = self;
        let (primitives, layout) = (&primitives, &layout);
        let document = GlbDocument { catalogue, primitives, images, layout, origin, turns_z_up: *turns_z_up };
        write_document(file, &document)?;

        let counts = |of: fn(&PrimitiveSize) -> u64| layout.primitives.iter().map(of).collect();
        let file = |name: &str| work_folder.join(name);
        let mut grouper = Grouper {
            vertices: Grouping::new(
                counts(|size| size.vertices),
                form.words(),
                share / 2,
                &file("write-vertices.tmp"),
            )?,
            faces: Grouping::new(counts(|size| size.faces), 3, share / 2, &file("write-faces.tmp"))?,
            form,
            channel_scale: 1.0 / counter.range.white(),
            record: Vec::new(),
        };
        let mut sweep = CornerSweep::new(mesh, primitives, origin, form.normals)?;
        sweep.run(&mut grouper)?;
        self.replaced.non_finite = sweep.non_finite;
        self.replaced.uncoloured = if colours { counter.uncoloured } else { 0 };
        let Grouper { vertices, faces, .. } = grouper;
        self.write_vertices(vertices)?;
        self.write_indices(faces, layout, result)?;
        self.write_images()
    }

    fn finish(&mut self, findings: &mut Findings) -> Result<Content> {
        self.replaced.note(findings);
        findings.merge(std::mem::take(&mut self.images.findings));
        self.file.seal()
    }

    fn commit(self: Box<Self>) -> Result<()> {
        self.file.commit()
    }
}

fn little_endian(words: &[u32]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// Writes the headers and the JSON, filled with blanks to whole words.
fn write_document(file: &mut ResultFile, document: &GlbDocument<'_>) -> Result<()> {
    let (json, chunk) = (document.bytes()?, document.layout.bytes());
    let mut total = FILE_HEADER_BYTES + CHUNK_HEADER_BYTES + padded(json);
    if chunk > 0 {
        total += CHUNK_HEADER_BYTES + chunk;
    }
    let Ok(total) = u32::try_from(total) else {
        return Err(Error::Limit(format!(
            "the GLB would have {}, and the format ends at 4 GiB: choose fewer triangles or texels, or an OBJ",
            bytes::display(total)
        )));
    };
    file.write(b"glTF")?;
    file.write(&2u32.to_le_bytes())?;
    file.write(&total.to_le_bytes())?;
    file.write(&(padded(json) as u32).to_le_bytes())?;
    file.write(b"JSON")?;
    document.write(&mut |text| file.write(text))?;
    file.write(&b"   "[..(padded(json) - json) as usize])?;
    if chunk > 0 {
        file.write(&(chunk as u32).to_le_bytes())?;
        file.write(b"BIN\0")?;
    }
    Ok(())
}

/// The place that positions are relative to: (0, 0, 0), or a place near the middle, in few digits, if that is far away.
fn origin_of(mesh: &StoredMesh) -> DVec3 {
    let (low, high) = mesh.bounds();
    let size = (high - low).max_element();
    let farthest = low.abs().max(high.abs()).max_element();
    if !farthest.is_finite() || farthest <= NEAR * size {
        return DVec3::ZERO;
    }
    let middle = low + 0.5 * (high - low);
    let step = libm::exp2(libm::floor(libm::log2(size)));
    if step > 0.0 { (middle / step).round() * step } else { low }
}

/// Counts what primitives have.
struct PrimitiveCounter {
    sizes: TiVec<PrimitiveId, PrimitiveSize>,
    /// The range of the colours.
    range: ColourRange,
    uncoloured: u64,
}

impl TakeCorners for PrimitiveCounter {
    fn vertex(&mut self, primitive: PrimitiveId, vertex: &GlbVertex) -> Result<()> {
        let size = &mut self.sizes[primitive];
        size.vertices += 1;
        size.low = size.low.min(vertex.position);
        size.high = size.high.max(vertex.position);
        match vertex.colour {
            Some(colour) => self.range = self.range.with(&[colour]),
            None => self.uncoloured += 1,
        }
        Ok(())
    }

    fn face(&mut self, primitive: PrimitiveId, _: [u32; 3]) -> Result<()> {
        self.sizes[primitive].faces += 1;
        Ok(())
    }
}

/// Groups vertices and faces by primitive.
struct Grouper {
    vertices: Grouping<PrimitiveId>,
    faces: Grouping<PrimitiveId>,
    form: RecordForm,
    channel_scale: f32,
    record: Vec<u32>,
}

impl TakeCorners for Grouper {
    fn vertex(&mut self, primitive: PrimitiveId, vertex: &GlbVertex) -> Result<()> {
        let Self { record, form, .. } = self;
        record.clear();
        record.extend(vertex.position.to_array().map(f32::to_bits));
        if form.normals {
            record.extend(vertex.normal.to_array().map(f32::to_bits));
        }
        if form.texcoords {
            record.extend(vertex.texcoord.to_array().map(f32::to_bits));
        }
        if form.colours {
            let channel = |channel: f32| {
                let share = f64::from((channel * self.channel_scale).clamp(0.0, 1.0));
                (linear(share) * f64::from(u16::MAX)).round() as u32
            };
            let [red, green, blue] = match vertex.colour {
                Some(colour) => colour.map(channel),
                None => [u32::from(u16::MAX); 3],
            };
            record.extend([red | green << 16, blue | u32::from(u16::MAX) << 16]);
        }
        self.vertices.push(primitive, &self.record)
    }

    fn face(&mut self, primitive: PrimitiveId, vertices: [u32; 3]) -> Result<()> {
        self.faces.push(primitive, &vertices)
    }
}

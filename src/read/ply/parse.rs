//! Parses the records of a chunk.
//!
//! In: whole records of an element. Out: vertices, or faces by ids of the file; texture coordinates of corners count
//! from the first of the chunk. Invariant: a chunk is parsed without knowing what precedes it: the header tells how many
//! vertices there are, wherever they stand.

use std::path::Path;

use glam::{DVec2, DVec3};

use super::cut::PlyChunk;
use super::fields::{BinaryFields, FieldResult, Fields, TextFields};
use super::header::{Encoding, Scalar};
use super::layout::{ElementKind, ElementLayout, FieldStep, Layout, ListRole, RED, ROLES, Texcoords, U};
use crate::base::{Error, Result};
use crate::model::face::POLYGON_CORNERS_MAX;
use crate::model::id::{PieceTexcoord, PieceVertex};
use crate::read::number::COORDINATE_MAX;
use crate::read::records::{LabelKind, ParsedRecords};

/// Number of texture coordinates that are remembered, so that neighbours share them. A power of two.
const RECENT: usize = 4096;

/// Records of a chunk.
#[derive(Debug, Default)]
pub struct PlyRecords {
    /// Vertices and faces; corners count texture coordinates from the first of the chunk if they are those of faces.
    pub(super) records: ParsedRecords,
    /// Largest magnitude of a coordinate.
    pub(super) largest: f64,
}

/// Parses a chunk into `parsed`, which is empty.
///
/// # Errors
/// [`Error::Input`] at the first faulty record.
pub(super) fn parse(path: &Path, chunk: &mut PlyChunk, parsed: &mut PlyRecords) -> Result<()> {
    let bytes = std::mem::take(&mut chunk.bytes);
    match chunk.layout.header.encoding {
        Encoding::Ascii => parse_with(TextFields::new(&bytes, chunk.line), path, chunk, parsed)?,
        Encoding::Little => parse_with(BinaryFields::<false>::new(&bytes, chunk.offset), path, chunk, parsed)?,
        Encoding::Big => parse_with(BinaryFields::<true>::new(&bytes, chunk.offset), path, chunk, parsed)?,
    }
    Ok(())
}

fn parse_with<F: Fields>(mut fields: F, path: &Path, chunk: &PlyChunk, parsed: &mut PlyRecords) -> Result<()> {
    let Some(own) = chunk.layout.elements.get(chunk.element) else { return Ok(()) };
    let records = &mut parsed.records;
    let mut faces = FaceParser::new(&chunk.layout);
    let mut vertices = VertexParser { layout: &chunk.layout, largest: 0.0 };
    for record in chunk.first..chunk.first + chunk.count {
        fields.begin();
        let place = RecordPlace { record, line: fields.place().0 };
        let outcome = match own.kind {
            ElementKind::Vertex => vertices.read(&mut fields, own, &place, records),
            ElementKind::Face => faces.read(&mut fields, own, &place, records),
            ElementKind::Other => Ok(()),
        };
        let outcome = outcome.and_then(|()| if own.kind == ElementKind::Other { Ok(()) } else { fields.end() });
        if let Err(message) = outcome {
            let what = if own.kind == ElementKind::Vertex { "vertex" } else { "face" };
            let (line, offset) = fields.place();
            let message = match line {
                0 => format!("{what} {record}, at byte {offset}: {message}"),
                _ => format!("{what} {record}: {message}"),
            };
            return Err(Error::input(path, line, message));
        }
    }
    parsed.largest = vertices.largest;
    records.uses_normals = chunk.layout.has_normals;
    Ok(())
}

/// Which record is read.
struct RecordPlace {
    record: u64,
    line: u64,
}

struct VertexParser<'a> {
    layout: &'a Layout,
    largest: f64,
}

impl VertexParser<'_> {
    #[inline]
    fn read<F: Fields>(
        &mut self,
        fields: &mut F,
        own: &ElementLayout,
        place: &RecordPlace,
        records: &mut ParsedRecords,
    ) -> FieldResult<()> {
        let mut values = [0.0; ROLES];
        let mut no_decimals = 0;
        for step in &own.steps {
            match *step {
                FieldStep::Number { role, scalar } if (RED..U).contains(&role) => {
                    values[role] = match scalar {
                        Scalar::F32 | Scalar::F64 => fields.number(scalar, &mut no_decimals)?,
                        _ => fields.number(scalar, &mut no_decimals)? / scalar.whole(),
                    };
                }
                FieldStep::Number { role, scalar } if role < RED => {
                    values[role] = fields.number(scalar, &mut records.position_decimals)?;
                }
                FieldStep::Number { role, scalar } => {
                    values[role] = fields.number(scalar, &mut records.texcoord_decimals)?;
                }
                _ => pass(fields, step)?,
            }
        }
        let [x, y, z, r, g, b, u, v] = values;
        let size = x.abs().max(y.abs()).max(z.abs());
        let is_bad = |value: &f64| value.is_nan() || value.abs() > COORDINATE_MAX;
        if let Some(bad) = [x, y, z].into_iter().find(is_bad) {
            return Err(format!("expected a number between -3.4e38 and 3.4e38, found {bad}"));
        }
        self.largest = self.largest.max(size);
        let mut colour = None;
        if self.layout.has_colours {
            let rgb = [r as f32, g as f32, b as f32];
            if rgb.iter().all(|channel| channel.is_finite()) {
                colour = Some(rgb);
            } else {
                let words = || format!("vertex {}: a colour that is not finite is ignored", place.record);
                records.note("bad_colours", place.line, words);
            }
        }
        records.push_vertex(DVec3::new(x, y, z), colour);
        if self.layout.texcoords == Texcoords::OfVertices {
            let texcoord = checked([u, v], "vertex", place, records);
            records.texcoords.push(texcoord);
        }
        Ok(())
    }
}

struct FaceParser<'a> {
    layout: &'a Layout,
    corners: Vec<PieceVertex>,
    numbers: Vec<f64>,
    /// Texture coordinates of the chunk by a hash of their bits.
    recent: Vec<PieceTexcoord>,
    /// Material of the face before.
    material: Option<Option<usize>>,
}

impl<'a> FaceParser<'a> {
    fn new(layout: &'a Layout) -> Self {
        let recent = vec![PieceTexcoord::NONE; RECENT];
        Self { layout, corners: Vec::new(), numbers: Vec::new(), recent, material: None }
    }

    #[inline]
    fn read<F: Fields>(
        &mut self,
        fields: &mut F,
        own: &ElementLayout,
        place: &RecordPlace,
        records: &mut ParsedRecords,
    ) -> FieldResult<()> {
        self.corners.clear();
        self.numbers.clear();
        let mut texture = 0;
        for step in &own.steps {
            match *step {
                FieldStep::List { role: ListRole::Vertices, length, scalar } => {
                    for _ in 0..fields.integer(length)? {
                        let vertex = fields.integer(scalar)?;
                        if vertex < 0 || vertex as u64 >= self.layout.vertex_count {
                            let count = self.layout.vertex_count;
                            return Err(format!("refers to vertex {vertex}; the file has {count}, counted from 0"));
                        }
                        self.corners.push(PieceVertex::new(vertex as u32));
                    }
                }
                FieldStep::List { role: ListRole::Texcoords, length, scalar } => {
                    for _ in 0..fields.integer(length)? {
                        self.numbers.push(fields.number(scalar, &mut records.texcoord_decimals)?);
                    }
                }
                FieldStep::TextureNumber(scalar) => texture = fields.integer(scalar)?,
                _ => pass(fields, step)?,
            }
        }
        self.push(texture, place, records)
    }

    /// Appends the face whose corners and texture coordinates were read.
    #[inline]
    fn push(&mut self, texture: i64, place: &RecordPlace, records: &mut ParsedRecords) -> FieldResult<()> {
        let size = self.corners.len();
        if size < 3 {
            let words = || format!("face {}: a face with {size} corners is ignored", place.record);
            records.note("short_faces", place.line, words);
            return Ok(());
        }
        if self.numbers.len() != 2 * size && !self.numbers.is_empty() {
            let count = self.numbers.len();
            return Err(format!("{count} texture coordinates of {size} corners; expected {} or none", 2 * size));
        }
        if size > POLYGON_CORNERS_MAX {
            let words = || format!("face {}: {size} corners; read as a fan of triangles", place.record);
            records.note("fanned_polygons", place.line, words);
        }
        let is_bare = texture < 0;
        let material = usize::try_from(texture).ok().filter(|texture| *texture < self.layout.materials.len());
        if !is_bare && material.is_none() && !self.layout.materials.is_empty() {
            let words = || format!("face {}: there is no texture {texture}", place.record);
            records.note("undefined_textures", place.line, words);
        }
        if self.material.replace(material) != Some(material) && !self.layout.materials.is_empty() {
            let name = material.map_or(&[][..], |material| &self.layout.materials[material]);
            records.push_change(LabelKind::Material, name);
        }
        let start = records.corner_vertices.len();
        records.corner_vertices.raw.extend_from_slice(&self.corners);
        if !is_bare && !self.numbers.is_empty() {
            records.corner_texcoords.resize(start, PieceTexcoord::NONE);
            for corner in 0..size {
                let texcoord =
                    checked([self.numbers[2 * corner], self.numbers[2 * corner + 1]], "face", place, records);
                let id = self.texcoord_id(texcoord, records);
                records.corner_texcoords.push(id);
            }
        } else if !is_bare && self.layout.texcoords == Texcoords::OfVertices {
            records.corner_texcoords.resize(start, PieceTexcoord::NONE);
            let of_vertices = self.corners.iter().map(|vertex| PieceTexcoord::new(vertex.number()));
            records.corner_texcoords.extend(of_vertices);
        } else if !records.corner_texcoords.is_empty() {
            records.corner_texcoords.resize(start + size, PieceTexcoord::NONE);
        }
        records.polygon_sizes.push(size as u32);
        Ok(())
    }

    /// Appends a texture coordinate, unless the same one came recently; returns its place in the chunk.
    #[inline]
    fn texcoord_id(&mut self, texcoord: DVec2, records: &mut ParsedRecords) -> PieceTexcoord {
        let bits = texcoord.to_array().map(f64::to_bits);
        let mixed = (bits[0] ^ bits[1].rotate_left(29)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let known = &mut self.recent[(mixed >> 52) as usize % RECENT];
        let is_same = |other: &DVec2| other.to_array().map(f64::to_bits) == bits;
        if !records.texcoords.get(known.index()).is_some_and(is_same) {
            *known = PieceTexcoord::from(records.texcoords.len());
            records.texcoords.push(texcoord);
        }
        *known
    }
}

/// Passes over what a step reads.
#[inline]
fn pass<F: Fields>(fields: &mut F, step: &FieldStep) -> FieldResult<()> {
    match *step {
        FieldStep::Skip { words, bytes } => fields.skip(words, bytes),
        FieldStep::Number { scalar, .. } | FieldStep::TextureNumber(scalar) => fields.skip(1, scalar.bytes() as usize),
        FieldStep::List { length, scalar, .. } => {
            let count = fields.integer(length)?;
            match usize::try_from(count) {
                Ok(count) => fields.skip(count, count.saturating_mul(scalar.bytes() as usize)),
                Err(_) => Err(format!("a list of {count} numbers")),
            }
        }
    }
}

/// Returns a texture coordinate, 0 0 instead of one that is not finite.
#[inline]
fn checked([u, v]: [f64; 2], what: &str, place: &RecordPlace, records: &mut ParsedRecords) -> DVec2 {
    if u.abs() <= COORDINATE_MAX && v.abs() <= COORDINATE_MAX {
        return DVec2::new(u, v);
    }
    let words = || format!("{what} {}: a texture coordinate that is not finite is read as 0 0", place.record);
    records.note("bad_texcoords", place.line, words);
    DVec2::ZERO
}

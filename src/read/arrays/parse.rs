//! Parses the records of a chunk of an array file.

use std::path::Path;

use glam::{DVec2, DVec3};
use xxhash_rust::xxh3::xxh3_64;

use super::cut::{ArrayChunk, Section};
use crate::base::{Error, Result};
use crate::model::array_file::{ArrayLayout, NONE};
use crate::model::id::{PieceTexcoord, PieceVertex};
use crate::read::number::{COORDINATE_MAX, raise_decimals};
use crate::read::records::{LabelKind, ParsedRecords};

/// Nothing, or what is wrong with a record.
type RecordResult = std::result::Result<(), String>;

/// Records of a chunk.
#[derive(Debug, Default)]
pub struct ArrayRecords {
    pub(super) records: ParsedRecords,
    /// Hash of the bytes of the chunk.
    pub(super) hash: u64,
}

/// Parses a chunk into `parsed`, which is empty; reads it into `bytes`.
///
/// # Errors
/// [`Error::Input`] at the first faulty record; if the chunk cannot be read.
pub(super) fn parse(path: &Path, chunk: &ArrayChunk, parsed: &mut ArrayRecords, bytes: &mut Vec<u8>) -> Result<()> {
    let length = (chunk.range.end - chunk.range.start) as usize;
    chunk.file.read(path, chunk.range.start, length, bytes)?;
    parsed.hash = xxh3_64(bytes);
    let (layout, records) = (&*chunk.layout, &mut parsed.records);
    let bytes = &bytes[chunk.header_bytes as usize..];
    let outcome = match chunk.section {
        Section::Vertices => read_vertices(bytes, layout, chunk.first, records),
        Section::Texcoords => read_texcoords(bytes, chunk.first, records),
        Section::Faces => read_faces(bytes, layout, chunk.first, records),
    };
    outcome.map_err(|message| Error::input(path, 0, message))
}

fn read_vertices(bytes: &[u8], layout: &ArrayLayout, first: u64, records: &mut ParsedRecords) -> RecordResult {
    for (number, record) in (first..).zip(bytes.chunks_exact(layout.vertex_bytes() as usize)) {
        let (position, colour) = record.split_at(24);
        let position = doubles::<3>(position);
        if let Some(bad) = position.iter().find(|x| x.is_nan() || x.abs() > COORDINATE_MAX) {
            return Err(format!("vertex {number}: expected a number between -3.4e38 and 3.4e38, found {bad}"));
        }
        position.iter().for_each(|&x| raise_decimals(x, &mut records.position_decimals));
        let colour = layout.has_colours.then(|| floats::<3>(colour));
        let is_finite = |colour: &[f32; 3]| colour.iter().all(|channel| channel.is_finite());
        if colour.as_ref().is_some_and(|colour| !is_finite(colour)) {
            records.note("bad_colours", 0, || format!("vertex {number}: a colour that is not finite is ignored"));
        }
        records.push_vertex(DVec3::from_array(position), colour.filter(is_finite));
    }
    Ok(())
}

fn read_texcoords(bytes: &[u8], first: u64, records: &mut ParsedRecords) -> RecordResult {
    for (number, record) in (first..).zip(bytes.chunks_exact(ArrayLayout::TEXCOORD_BYTES as usize)) {
        let texcoord = doubles::<2>(record);
        if let Some(bad) = texcoord.iter().find(|x| x.is_nan() || x.abs() > COORDINATE_MAX) {
            return Err(format!(
                "texture coordinate {number}: expected a number between -3.4e38 and 3.4e38, found {bad}"
            ));
        }
        texcoord.iter().for_each(|&x| raise_decimals(x, &mut records.texcoord_decimals));
        records.texcoords.push(DVec2::from_array(texcoord));
    }
    Ok(())
}

fn read_faces(bytes: &[u8], layout: &ArrayLayout, first: u64, records: &mut ParsedRecords) -> RecordResult {
    let (mut current, mut words) = (None, Vec::new());
    for (number, record) in (first..).zip(bytes.chunks_exact(layout.face_bytes() as usize)) {
        words.clear();
        words.extend(record.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word)));
        let (vertices, rest) = words.split_at(layout.corners);
        let fault = |what: String| Err(format!("face {number}: {what}"));
        let count = vertices.iter().position(|vertex| *vertex == NONE).unwrap_or(layout.corners);
        if count < 3 {
            return fault(format!("expected at least 3 corners, found {count}"));
        }
        if let Some(vertex) = vertices[..count].iter().find(|vertex| u64::from(**vertex) >= layout.vertices) {
            return fault(format!("refers to vertex {vertex}; there are {}, counted from 0", layout.vertices));
        }
        records.corner_vertices.raw.extend(vertices[..count].iter().copied().map(PieceVertex::new));
        let (texcoords, label) = rest.split_at(if layout.has_texcoords { layout.corners } else { 0 });
        let texcoords = &texcoords[..count.min(texcoords.len())];
        let is_there = |texcoord: &&u32| **texcoord == NONE || u64::from(**texcoord) < layout.texcoords;
        if let Some(texcoord) = texcoords.iter().find(|texcoord| !is_there(texcoord)) {
            let there = layout.texcoords;
            return fault(format!("refers to texture coordinate {texcoord}; there are {there}, counted from 0"));
        }
        let missing = texcoords.iter().filter(|texcoord| **texcoord == NONE).count();
        if missing > 0 && missing < count {
            let words = || format!("face {number}: only some corners have texture coordinates; it is read without");
            records.note("partial_texcoords", 0, words);
        }
        let id = |texcoord: &u32| if missing > 0 { PieceTexcoord::NONE } else { PieceTexcoord::new(*texcoord) };
        records.corner_texcoords.raw.extend(texcoords.iter().map(id));
        if let Some(&label) = label.first()
            && current != Some(label)
        {
            current = Some(label);
            let name = if label == NONE { String::new() } else { label.to_string() };
            records.push_change(LabelKind::Material, name.as_bytes());
        }
        records.polygon_sizes.push(count as u32);
    }
    Ok(())
}

fn doubles<const N: usize>(bytes: &[u8]) -> [f64; N] {
    std::array::from_fn(|k| f64::from_le_bytes(bytes.as_chunks::<8>().0[k]))
}

fn floats<const N: usize>(bytes: &[u8]) -> [f32; N] {
    std::array::from_fn(|k| f32::from_le_bytes(bytes.as_chunks::<4>().0[k]))
}

//! Writes the lines of the OBJ.
//!
//! ```text
//! # drystone 0.1.0          header
//! mtllib city.mtl
//! v 452123.25 5411820.5 31  vertices that faces use: shared ones, then piece by piece
//! vt 0.25 0.5               texture coordinates that faces use, piece by piece
//! vn 0.0000 0.0000 1.0000   normals, of shared vertices first
//! o house                   parts; only statements that differ from the previous part
//! usemtl brick
//! f 1/1/1 2/2/1 3/3/1
//! ```
//! In: the used ids, the normals of each piece and the grouped faces. Out: bytes in a durable file that is not
//! committed yet. Blocks of lines are formatted independently and written in order.
//!
//! # Memory
//! The blocks in flight: [`LINES_BYTES`] each, within the memory given.

use std::ops::Range;
use std::path::Path;

use super::number::{put_f32, put_f64, put_four_decimals, put_u32};
use crate::base::Result;
use crate::base::ordered::map_within;
use crate::file::packed::BLOCK_RECORDS;
use crate::file::{PackedColumn, Segment};
use crate::model::Catalogue;
use crate::model::id::{MeshVertex, NameId, PartId, Texcoord};
use crate::write::grouping::{Group, Grouping};
use crate::write::normals::RoundedNormal;
use crate::write::numbering::IdSet;
use crate::write::order::PartPlace;
use crate::write::result_file::ResultFile;
use crate::write::signature::{put_statement, signature};
use crate::write::sink::{CornerForm, ResultMesh};
use glam::{DVec2, DVec3};

/// Number of lines formatted at once.
const BLOCK_LINES: u64 = 4 << 10;
/// Largest size of a block of lines in bytes: six numbers of 25 characters, and the records. A column is read by whole
/// blocks.
const LINES_BYTES: u64 = (BLOCK_LINES + BLOCK_RECORDS as u64) * (6 * 25 + 36);

/// The text of an OBJ being written.
#[derive(Debug)]
pub(super) struct ObjText {
    file: ResultFile,
    /// Count of numbers that were NaN or infinite and are written as 0.
    pub(super) non_finite: u64,
}

/// Positions and colours of a range of vertices.
struct VertexRun<'a> {
    positions: &'a PackedColumn<DVec3>,
    colours: Option<&'a Segment<[f32; 3]>>,
    /// The vertex of the first position of the column.
    first: MeshVertex,
    range: Range<u64>,
}

/// A range of texture coordinates.
struct TexcoordRun<'a> {
    column: &'a PackedColumn<DVec2>,
    /// The first texture coordinate of the column.
    first: Texcoord,
    range: Range<u64>,
}

impl ObjText {
    /// Creates a temporary file of the job that will become `target`; `library` is the name of the MTL, if there is
    /// one.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub(super) fn create(target: &Path, job: u64, library: Option<&[u8]>) -> Result<Self> {
        let mut obj = Self { file: ResultFile::create(target, job)?, non_finite: 0 };
        let mut text = signature();
        if let Some(name) = library {
            put_statement(&mut text, b"mtllib", name);
        }
        obj.file.write(&text)?;
        Ok(obj)
    }

    /// The file.
    pub(super) fn file(&mut self) -> &mut ResultFile {
        &mut self.file
    }

    /// Renames the file to its final name.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub(super) fn commit(self) -> Result<()> {
        self.file.commit()
    }

    /// Writes the used vertices.
    ///
    /// # Errors
    /// If a column cannot be read or the file cannot be written.
    pub(super) fn vertices(&mut self, result: &ResultMesh<'_>) -> Result<()> {
        let ResultMesh { mesh, numbering, usage, share, .. } = *result;
        let begin = MeshVertex::new(0);
        let shared = mesh.shared_positions.iter().map(|positions| (positions, mesh.shared_colours.as_ref(), begin));
        let own = mesh.pieces.iter().zip(numbering);
        let own = own.map(|(piece, ids)| (&piece.positions, piece.colours.as_ref(), ids.vertex_base));
        let runs = shared.chain(own).flat_map(|(positions, colours, first)| {
            positions.ranges(BLOCK_LINES).map(move |range| VertexRun { positions, colours, first, range })
        });
        self.blocks(runs, share, |run| vertex_lines(&run, &usage.vertices))
    }

    /// Writes the used texture coordinates.
    ///
    /// # Errors
    /// As [`vertices`](ObjText::vertices).
    pub(super) fn texcoords(&mut self, result: &ResultMesh<'_>) -> Result<()> {
        let ResultMesh { mesh, numbering, usage, share, .. } = *result;
        let runs = mesh.pieces.iter().zip(numbering).flat_map(|(piece, ids)| {
            let (column, first) = (&piece.texcoords, ids.texcoord_base);
            column.ranges(BLOCK_LINES).map(move |range| TexcoordRun { column, first, range })
        });
        self.blocks(runs, share, |run| texcoord_lines(&run, &usage.texcoords))
    }

    fn blocks<I: Send>(
        &mut self,
        runs: impl Iterator<Item = I> + Send,
        memory_bytes: u64,
        format: impl Fn(I) -> Result<(Vec<u8>, u64)> + Sync,
    ) -> Result<()> {
        map_within(
            memory_bytes,
            |_| LINES_BYTES,
            runs,
            format,
            |(text, non_finite)| {
                self.non_finite += non_finite;
                self.file.write(&text)
            },
        )
    }

    /// Writes normals.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(super) fn normals(&mut self, normals: &[RoundedNormal]) -> Result<()> {
        let mut text = Vec::new();
        for block in normals.chunks(BLOCK_LINES as usize) {
            text.clear();
            for normal in block {
                text.extend_from_slice(b"vn");
                for &coordinate in normal {
                    text.push(b' ');
                    put_four_decimals(&mut text, coordinate);
                }
                text.push(b'\n');
            }
            self.file.write(&text)?;
        }
        Ok(())
    }

    /// Writes the faces, part by part.
    ///
    /// # Errors
    /// If the faces cannot be read back or the file cannot be written.
    pub(super) fn faces(&mut self, grouped: Grouping<PartPlace>, result: &ResultMesh<'_>) -> Result<()> {
        let ResultMesh { catalogue, ref order, form, share: memory_bytes, progress, .. } = *result;
        let mut labels = CurrentLabels { catalogue, part: None, object: None, group: None, material: None };
        let words = form.words();
        grouped.drain(|groups| {
            let blocks = groups.iter().flat_map(|group| group.chunks(words * BLOCK_LINES as usize));
            let cost = |block: &Group<'_, _>| (block.words.len() * 11 + block.words.len() / words * 8) as u64;
            let format = |Group { key, words: block }: Group<'_, PartPlace>| {
                Ok((key, block.len() / words, face_lines(block, form)))
            };
            map_within(memory_bytes, cost, blocks, format, |(place, face_count, text)| {
                let heading = labels.turn_to(order.part(place));
                self.file.write(&heading)?;
                self.file.write(&text)?;
                progress.advance(face_count as u64);
                Ok(())
            })
        })
    }
}

fn vertex_lines(run: &VertexRun<'_>, used: &IdSet<MeshVertex>) -> Result<(Vec<u8>, u64)> {
    let positions = run.positions.window(run.range.clone())?;
    let colours = run.colours.map(|column| column.window(run.range.clone())).transpose()?;
    let mut text = Vec::with_capacity(positions.len() * 40);
    let mut non_finite = 0;
    let first = run.first.plus(run.range.start as u32);
    for (i, position) in positions.iter().enumerate().filter(|&(i, _)| used.contains(first.plus(i as u32))) {
        text.push(b'v');
        for coordinate in position.to_array() {
            non_finite += u64::from(!coordinate.is_finite());
            text.push(b' ');
            put_f64(&mut text, coordinate);
        }
        let colour = colours.as_ref().map(|colours| colours[i]);
        for channel in colour.filter(|colour| !colour.iter().any(|c| c.is_nan())).into_iter().flatten() {
            text.push(b' ');
            put_f32(&mut text, channel);
        }
        text.push(b'\n');
    }
    Ok((text, non_finite))
}

fn texcoord_lines(run: &TexcoordRun<'_>, used: &IdSet<Texcoord>) -> Result<(Vec<u8>, u64)> {
    let first = run.first.plus(run.range.start as u32);
    let texcoords = run.column.window(run.range.clone())?;
    let mut text = Vec::with_capacity(texcoords.len() * 24);
    let mut non_finite = 0;
    for (_, texcoord) in (0..).zip(&*texcoords).filter(|&(i, _)| used.contains(first.plus(i))) {
        text.extend_from_slice(b"vt");
        for coordinate in texcoord.to_array() {
            non_finite += u64::from(!coordinate.is_finite());
            text.push(b' ');
            put_f64(&mut text, coordinate);
        }
        text.push(b'\n');
    }
    Ok((text, non_finite))
}

fn face_lines(faces: &[u32], form: CornerForm) -> Vec<u8> {
    let words = form.words();
    let mut text = Vec::with_capacity(faces.len() * 8);
    for face in faces.chunks_exact(words) {
        text.push(b'f');
        for k in 0..3 {
            text.push(b' ');
            put_u32(&mut text, face[k]);
            let texcoord = if form.texcoords { face[3 + k] } else { 0 };
            if texcoord != 0 {
                text.push(b'/');
                put_u32(&mut text, texcoord);
            }
            if form.normals {
                text.extend_from_slice(if texcoord != 0 { b"/" } else { b"//" });
                put_u32(&mut text, face[words - 3 + k]);
            }
        }
        text.push(b'\n');
    }
    text
}

/// The object, group and material that are current for a reader of the file.
struct CurrentLabels<'a> {
    catalogue: &'a Catalogue,
    part: Option<PartId>,
    object: Option<&'a [u8]>,
    group: Option<&'a [u8]>,
    material: Option<&'a [u8]>,
}

impl CurrentLabels<'_> {
    /// Returns the statements that change the current part to `part`.
    fn turn_to(&mut self, part: PartId) -> Vec<u8> {
        let mut text = Vec::new();
        if self.part.replace(part) == Some(part) {
            return text;
        }
        let part = &self.catalogue.parts[part];
        let name = |name: NameId| self.catalogue.names[name].as_slice();
        turn(&mut text, b"o", &mut self.object, part.object.map(name));
        turn(&mut text, b"g", &mut self.group, part.group.map(name));
        let material = part.material.map(|material| self.catalogue.materials[material].output_name.as_slice());
        if material.is_some() {
            turn(&mut text, b"usemtl", &mut self.material, material);
        }
        text
    }
}

fn turn<'a>(text: &mut Vec<u8>, key: &[u8], current: &mut Option<&'a [u8]>, wanted: Option<&'a [u8]>) {
    if *current != wanted {
        *current = wanted;
        put_statement(text, key, wanted.unwrap_or(b"default"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::id::TiVec;
    use crate::model::id::{FileId, MaterialId};
    use crate::model::{Material, Part};
    use crate::write::numbering::Usage;
    use crate::write::order::PartOrder;

    #[test]
    fn corners_are_written_in_four_forms() {
        let line = |texcoords, normals, face: &[u32]| {
            String::from_utf8(face_lines(face, CornerForm { texcoords, normals })).unwrap()
        };
        assert_eq!(line(false, false, &[1, 2, 3]), "f 1 2 3\n");
        assert_eq!(line(true, false, &[1, 2, 3, 4, 0, 6]), "f 1/4 2 3/6\n");
        assert_eq!(line(false, true, &[1, 2, 3, 7, 8, 9]), "f 1//7 2//8 3//9\n");
        assert_eq!(line(true, true, &[1, 2, 3, 4, 0, 6, 7, 8, 9]), "f 1/4/7 2//8 3/6/9\n");
    }

    #[test]
    fn a_part_inherits_nothing_from_the_part_before() {
        let material = |name: &[u8]| Material { name: name.into(), output_name: name.into(), definition: None };
        let part = |object: Option<u32>, group: Option<u32>, material: Option<u32>| Part {
            file: FileId::new(0),
            object: object.map(NameId::new),
            group: group.map(NameId::new),
            material: material.map(MaterialId::new),
        };
        let catalogue = Catalogue {
            names: vec![b"house".into(), b"roof".into()].into(),
            materials: vec![material(b"brick"), material(b"tile")].into(),
            parts: vec![
                part(Some(0), Some(1), Some(0)),
                part(Some(0), None, Some(1)),
                part(Some(0), None, None),
                part(None, None, Some(0)),
                part(None, None, None),
            ]
            .into(),
            ..Catalogue::default()
        };
        let usage = Usage {
            vertices: IdSet::new(0),
            texcoords: IdSet::new(0),
            faces_per_part: vec![1; 5].into(),
            corners_per_shared: TiVec::new(),
        };
        let order = PartOrder::new(&catalogue, &usage);
        let places = || PartPlace::first(5);
        assert!(places().map(|place| order.part(place).number()).eq([4, 2, 3, 1, 0]));
        assert!(PartId::first(5).map(|part| order.place(part).number()).eq([4, 3, 1, 2, 0]));
        let mut labels = CurrentLabels { catalogue: &catalogue, part: None, object: None, group: None, material: None };
        let text: Vec<String> =
            places().map(|place| String::from_utf8(labels.turn_to(order.part(place))).unwrap()).collect();
        assert_eq!(
            text,
            ["", "o house\n", "o default\nusemtl brick\n", "o house\nusemtl tile\n", "g roof\nusemtl brick\n"]
        );
    }
}

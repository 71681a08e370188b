//! Writes a PLY: binary, little-endian.
//!
//! ```text
//! ply … end_header                      text
//! x y z [nx ny nz] [red green blue]     a record per vertex that faces use: shared ones, then piece by piece
//! 3 a b c [6 u v u v u v n]             a record per face, part by part; n is the texture image, -1 for none
//! ```
//! In: the used ids and the faces. Out: bytes in a durable file that is not committed yet. Positions are floats if all
//! of them come back as they are ([`fits_float`]), else doubles.
//!
//! # Memory
//! The blocks in flight, within the memory given; with normals, the pieces in flight and 24 bytes per shared vertex.

mod images;

use std::ops::Range;
use std::path::Path;

use glam::{DVec2, DVec3};

pub(super) use self::images::{PlyImages, stage_images, stage_whole_images};
use super::grouping::{Group, Grouping};
use super::numbering::IdSet;
use super::order::PartPlace;
use super::result_file::{Replaced, ResultFile};
use super::sink::{MeshSink, ResultMesh};
use super::vertex_normals::{own_normals, own_normals_bytes, shared_normals};
use crate::base::id::TiVec;
use crate::base::ordered::map_within;
use crate::base::{Findings, Result};
use crate::file::float::fits_float;
use crate::file::{PackedColumn, Segment};
use crate::model::corners::FaceReader;
use crate::model::id::{MeshVertex, PieceTexcoord};
use crate::model::stored_mesh::PieceNumbering;
use crate::model::{ColourRange, StoredPiece};
use crate::os::content::Content;

/// Number of records formatted at once.
const BLOCK_RECORDS: u64 = 16 << 10;
/// Largest size of a block of vertices in bytes: the record, and what it is made from.
const BLOCK_BYTES: u64 = BLOCK_RECORDS * (24 + 12 + 3 + 36);
/// Words of a corner without texture coordinate.
const NO_UV: u32 = f32::NAN.to_bits();

/// A PLY being written.
#[derive(Debug)]
pub(super) struct PlySink {
    file: ResultFile,
    images: PlyImages,
    form: VertexForm,
    replaced: Replaced,
}

/// What the record of a vertex has.
#[derive(Debug, Clone, Copy, Default)]
struct VertexForm {
    /// Whether positions are doubles.
    is_double: bool,
    has_normals: bool,
    /// The range of the colours, if there are any.
    colours: Option<ColourRange>,
}

/// Positions, colours and normals of a range of vertices.
struct VertexRange<'a> {
    positions: &'a PackedColumn<DVec3>,
    colours: Option<&'a Segment<[f32; 3]>>,
    /// The vertex of the first position of the column.
    first: MeshVertex,
    range: Range<u64>,
    normals: VertexNormals<'a>,
}

/// Where the normals of a run come from.
#[derive(Clone, Copy)]
enum VertexNormals<'a> {
    None,
    /// Of all shared vertices.
    Known(&'a [DVec3]),
    /// Of the own vertices of a piece, which is one run.
    Of(&'a StoredPiece),
}

/// Records of a run, and how many numbers and colours were replaced in them.
type Formatted = (Vec<u8>, u64, u64);

impl PlySink {
    /// Creates a temporary file of the job that will become `target`.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub(super) fn begin(target: &Path, job: u64, images: PlyImages) -> Result<Self> {
        let file = ResultFile::create(target, job)?;
        Ok(Self { file, images, form: VertexForm::default(), replaced: Replaced::default() })
    }

    /// Finds out what the records need.
    fn choose_form(&self, result: &ResultMesh<'_>) -> Result<VertexForm> {
        let (mut is_double, mut colours): (bool, Option<ColourRange>) = (false, None);
        let used = &result.usage.vertices;
        map_within(
            result.share,
            |_| BLOCK_BYTES,
            runs(result, false, &[]),
            |run| {
                let positions = run.positions.window(run.range.clone())?;
                let first = run.first.plus(run.range.start as u32);
                let of_used = (0..).zip(&positions).filter(|&(i, _)| used.contains(first.plus(i)));
                let is_double = of_used.flat_map(|(_, p)| p.to_array()).any(|x| x.is_finite() && !fits_float(x));
                let colours = run.colours.map(|column| column.window(run.range)).transpose()?;
                Ok((is_double, colours.map(|colours| ColourRange::default().with(&colours))))
            },
            |(is_double_here, colours_here): (bool, Option<ColourRange>)| {
                is_double |= is_double_here;
                if let Some(here) = colours_here {
                    colours = Some(here.joined(colours.unwrap_or_default()));
                }
                Ok(())
            },
        )?;
        Ok(VertexForm { is_double, has_normals: result.form.normals, colours })
    }

    fn header(&self, result: &ResultMesh<'_>) -> Vec<u8> {
        let VertexForm { is_double, has_normals, colours } = self.form;
        let mut lines = vec!["ply".to_owned(), "format binary_little_endian 1.0".to_owned()];
        lines.push(format!("comment drystone {}", env!("CARGO_PKG_VERSION")));
        let mut text = (lines.join("\n") + "\n").into_bytes();
        for name in &self.images.names {
            text.extend_from_slice(b"comment TextureFile ");
            text.extend_from_slice(name);
            text.push(b'\n');
        }
        let mut lines = vec![format!("element vertex {}", result.usage.vertices.len())];
        let number = if is_double { "double" } else { "float" };
        lines.extend(["x", "y", "z"].map(|name| format!("property {number} {name}")));
        if has_normals {
            lines.extend(["nx", "ny", "nz"].map(|name| format!("property float {name}")));
        }
        if colours.is_some() {
            lines.extend(["red", "green", "blue"].map(|name| format!("property uchar {name}")));
        }
        lines.push(format!("element face {}", result.mesh.face_count()));
        let index = if result.usage.vertices.len() > i32::MAX as u64 { "uint" } else { "int" };
        lines.push(format!("property list uchar {index} vertex_indices"));
        if result.form.texcoords {
            lines.push("property list uchar float texcoord".to_owned());
            lines.push("property int texnumber".to_owned());
        }
        lines.push("end_header\n".to_owned());
        text.extend_from_slice(lines.join("\n").as_bytes());
        text
    }

    /// Groups the faces by part: three vertices counted from 0, and the bits of three texture coordinates.
    fn group_faces(&self, result: &ResultMesh<'_>) -> Result<Grouping<PartPlace>> {
        let ResultMesh { mesh, numbering, usage, ref order, form, share, work_folder, .. } = *result;
        let words = if form.texcoords { 9 } else { 3 };
        let mut faces = Grouping::new(order.counts(usage), words, share, &work_folder.join("write-faces.tmp"))?;
        let mut reader = FaceReader::default();
        let texcoords = |piece: &StoredPiece| -> Result<TiVec<PieceTexcoord, DVec2>> {
            let count = if form.texcoords { piece.texcoords.len() } else { 0 };
            piece.texcoords.window(0..count).map(TiVec::from)
        };
        map_within(
            share,
            |(piece, _)| 16 * piece.texcoords.len(),
            mesh.pieces.iter().zip(numbering),
            |(piece, ids)| Ok((piece, ids, texcoords(piece)?)),
            |(piece, ids, texcoords)| {
                let mut record = Vec::with_capacity(words);
                reader.each_block(piece, |block| {
                    for face in block {
                        record.clear();
                        record.extend(ids.globalise(face).vertices.map(|v| usage.vertices.rank(v)));
                        for texcoord in face.texcoords.into_iter().filter(|_| form.texcoords) {
                            match texcoords.get(texcoord) {
                                Some(uv) => record.extend(uv.to_array().map(|x| (x as f32).to_bits())),
                                None => record.extend([NO_UV; 2]),
                            }
                        }
                        faces.push(order.place(face.part), &record)?;
                    }
                    Ok(())
                })
            },
        )?;
        Ok(faces)
    }
}

impl MeshSink for PlySink {
    fn vertices(&mut self, result: &ResultMesh<'_>) -> Result<()> {
        self.form = self.choose_form(result)?;
        let header = self.header(result);
        self.file.write(&header)?;
        let shared = if self.form.has_normals { shared_normals(result.mesh)? } else { Vec::new() };
        let (form, used) = (self.form, &result.usage.vertices);
        map_within(
            result.share,
            |run| match run.normals {
                VertexNormals::Of(piece) => own_normals_bytes(piece) + 75 * piece.positions.len(),
                _ => BLOCK_BYTES,
            },
            runs(result, form.has_normals, &shared),
            |run| vertex_records(&run, result, form, used),
            |(records, non_finite, uncoloured)| {
                self.replaced.non_finite += non_finite;
                self.replaced.uncoloured += uncoloured;
                self.file.write(&records)
            },
        )
    }

    /// Corners have their texture coordinates themselves.
    fn texcoords(&mut self, _: &ResultMesh<'_>) -> Result<()> {
        Ok(())
    }

    fn faces(&mut self, result: &mut ResultMesh<'_>) -> Result<()> {
        let result = &*result;
        let grouped = self.group_faces(result)?;
        let (order, words) = (&result.order, if result.form.texcoords { 9 } else { 3 });
        let Self { file, images, .. } = self;
        let image_of = |place: PartPlace| match result.catalogue.parts[order.part(place)].material {
            _ if images.names.is_empty() => Some(0),
            Some(material) => images.of_material[material].map(|image| image as i32),
            None => None,
        };
        grouped.drain(|groups| {
            let blocks = groups.iter().flat_map(|group| group.chunks(words * BLOCK_RECORDS as usize));
            let cost = |block: &Group<'_, _>| (block.words.len() / words * 42) as u64;
            let format = |Group { key, words: block }: Group<'_, PartPlace>| {
                Ok((block.len() / words, face_records(block, words, image_of(key))))
            };
            map_within(result.share, cost, blocks, format, |(face_count, records)| {
                file.write(&records)?;
                result.progress.advance(face_count as u64);
                Ok(())
            })
        })
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

/// Runs of all vertices: blocks, or with normals the shared vertices in blocks and then whole pieces.
fn runs<'a>(
    result: &ResultMesh<'a>,
    has_normals: bool,
    shared_normals: &'a [DVec3],
) -> impl Iterator<Item = VertexRange<'a>> {
    let mesh = result.mesh;
    let of_shared = if has_normals { VertexNormals::Known(shared_normals) } else { VertexNormals::None };
    let shared = mesh
        .shared_positions
        .iter()
        .map(move |positions| (positions, mesh.shared_colours.as_ref(), MeshVertex::new(0), of_shared, BLOCK_RECORDS));
    let own = mesh.pieces.iter().zip(result.numbering).map(move |(piece, ids): (&StoredPiece, &PieceNumbering)| {
        let (normals, block) =
            if has_normals { (VertexNormals::Of(piece), u64::MAX) } else { (VertexNormals::None, BLOCK_RECORDS) };
        (&piece.positions, piece.colours.as_ref(), ids.vertex_base, normals, block)
    });
    shared.chain(own).flat_map(|(positions, colours, first, normals, block)| {
        let whole = (block == u64::MAX).then(|| 0..positions.len());
        let blocks = (block != u64::MAX).then(|| positions.ranges(block)).into_iter().flatten();
        whole.into_iter().chain(blocks).map(move |range| VertexRange { positions, colours, first, range, normals })
    })
}

fn vertex_records(
    run: &VertexRange<'_>,
    result: &ResultMesh<'_>,
    form: VertexForm,
    used: &IdSet<MeshVertex>,
) -> Result<Formatted> {
    let positions = run.positions.window(run.range.clone())?;
    let colours = run.colours.map(|column| column.window(run.range.clone())).transpose()?;
    let own;
    let normals = match run.normals {
        VertexNormals::None => &[][..],
        VertexNormals::Known(normals) => &normals[run.range.start as usize..run.range.end as usize],
        VertexNormals::Of(piece) => {
            own = own_normals(result.mesh, piece)?;
            &own[..]
        }
    };
    let mut out = Vec::with_capacity(positions.len() * if form.is_double { 24 } else { 12 });
    let (mut non_finite, mut uncoloured) = (0, 0);
    let first = run.first.plus(run.range.start as u32);
    for (i, position) in positions.iter().enumerate().filter(|&(i, _)| used.contains(first.plus(i as u32))) {
        for coordinate in position.to_array() {
            non_finite += u64::from(!coordinate.is_finite());
            let coordinate = if coordinate.is_finite() { coordinate } else { 0.0 };
            if form.is_double {
                out.extend_from_slice(&coordinate.to_le_bytes())
            } else {
                out.extend_from_slice(&(coordinate as f32).to_le_bytes())
            }
        }
        if let Some(normal) = normals.get(i) {
            normal.to_array().iter().for_each(|&x| out.extend_from_slice(&(x as f32).to_le_bytes()));
        }
        if let Some(range) = form.colours {
            let colour = colours.as_ref().map(|colours| colours[i]).filter(|colour| !colour.iter().any(|c| c.is_nan()));
            uncoloured += u64::from(colour.is_none());
            out.extend(colour.map_or([255; 3], |colour| range.bytes(colour)));
        }
    }
    Ok((out, non_finite, uncoloured))
}

/// Formats faces of `words` words; those without texture coordinates or image have the number -1.
fn face_records(faces: &[u32], words: usize, image: Option<i32>) -> Vec<u8> {
    let mut out = Vec::with_capacity(faces.len() / words * if words == 9 { 42 } else { 13 });
    for face in faces.chunks_exact(words) {
        let (vertices, texcoords) = face.split_at(3);
        out.push(3);
        vertices.iter().for_each(|vertex| out.extend_from_slice(&vertex.to_le_bytes()));
        if texcoords.is_empty() {
            continue;
        }
        let is_bare = image.is_none() || texcoords.iter().any(|&bits| f32::from_bits(bits).is_nan());
        out.push(6);
        texcoords.iter().for_each(|&bits| out.extend_from_slice(&if is_bare { 0 } else { bits }.to_le_bytes()));
        out.extend_from_slice(&if is_bare { -1 } else { image.unwrap_or(-1) }.to_le_bytes());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_face_without_texture_coordinates_has_no_image() {
        let uv = [0.25f32, 0.5, 1.0, 0.0, 0.75, 1.0].map(f32::to_bits);
        let whole: Vec<u32> = [&[0, 1, 2][..], &uv[..]].concat();
        let record = |face: &[u32], image| face_records(face, 9, image)[38..].to_vec();
        assert_eq!(record(&whole, Some(3)), 3i32.to_le_bytes());
        assert_eq!(record(&whole, None), (-1i32).to_le_bytes());
        let mut bare = whole;
        bare[5..7].fill(NO_UV);
        assert_eq!(record(&bare, Some(3)), (-1i32).to_le_bytes());
        assert_eq!(face_records(&[7, 8, 9], 3, Some(0)).len(), 13);
    }
}

//! Writes an array file: the records of [`ArrayLayout`].
//!
//! In: the used ids and the faces. Out: bytes in a durable file that is not committed yet. The label of a face is the
//! name of its material if that is a number, else the number of the material, or a free one; normals are not written.
//!
//! # Memory
//! The blocks in flight, within the memory given.

use std::collections::HashSet;
use std::path::Path;

use glam::DVec3;

use super::grouping::{Group, Grouping};
use super::numbered::group_faces;
use super::order::PartPlace;
use super::ply::PlyImages;
use super::result_file::{Replaced, ResultFile};
use super::sink::{MeshSink, ResultMesh};
use crate::base::id::TiVec;
use crate::base::ordered::map_within;
use crate::base::{Findings, Result};
use crate::file::{PackedColumn, Segment};
use crate::model::array_file::{ArrayLayout, NONE};
use crate::model::id::{MaterialId, MeshVertex};
use crate::os::content::Content;

/// Number of records formatted at once.
const BLOCK_RECORDS: u64 = 16 << 10;
/// Largest size of a block of vertices, or of texture coordinates, in bytes: the record, and what it is made from.
const BLOCK_BYTES: u64 = BLOCK_RECORDS * 2 * 36;

/// An array file being written.
#[derive(Debug)]
pub(super) struct ArraySink {
    file: ResultFile,
    images: PlyImages,
    /// Label of the faces of each material.
    labels: TiVec<MaterialId, u32>,
    /// What the file holds, once it has begun.
    layout: Option<ArrayLayout>,
    replaced: Replaced,
}

/// Records of a block, and how many of them had a number or a colour replaced.
struct FormattedBlock {
    records: Vec<u8>,
    non_finite: u64,
    uncoloured: u64,
}

impl ArraySink {
    /// Creates a temporary file of the job that will become `target`.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub(super) fn begin(target: &Path, job: u64, images: PlyImages) -> Result<Self> {
        let file = ResultFile::create(target, job)?;
        Ok(Self { file, images, labels: TiVec::new(), layout: None, replaced: Replaced::default() })
    }

    fn describe(&self, result: &ResultMesh<'_>) -> ArrayLayout {
        let catalogue = result.catalogue;
        let image_of = |(material, image): (MaterialId, &Option<usize>)| {
            image.map(|image| (self.labels[material], self.images.names[image].clone()))
        };
        ArrayLayout {
            vertices: result.usage.vertices.len(),
            texcoords: result.usage.texcoords.len(),
            faces: result.mesh.face_count(),
            corners: 3,
            has_colours: result.mesh.has_colours(),
            has_texcoords: result.form.texcoords,
            has_labels: !catalogue.materials.is_empty(),
            images: self.images.of_material.iter_enumerated().filter_map(image_of).collect(),
        }
    }

    /// Groups the faces by part: three vertices, and three texture coordinates if any face has some.
    fn group_faces(&self, result: &ResultMesh<'_>) -> Result<Grouping<PartPlace>> {
        let ResultMesh { usage, form, .. } = *result;
        group_faces(result, if form.texcoords { 6 } else { 3 }, |face, words| {
            words.extend(face.vertices.map(|vertex| usage.vertices.rank(vertex)));
            if form.texcoords {
                let rank = |texcoord| usage.texcoords.rank(texcoord);
                words.extend(face.texcoords.map(|texcoord| texcoord.some().map_or(NONE, rank)));
            }
        })
    }
}

impl MeshSink for ArraySink {
    fn vertices(&mut self, result: &ResultMesh<'_>) -> Result<()> {
        self.labels = labels_of(result.catalogue.materials.iter().map(|material| &material.name));
        let layout = self.describe(result);
        self.file.write(&layout.encode())?;
        let (used, has_colours) = (&result.usage.vertices, layout.has_colours);
        self.layout = Some(layout);
        let shared = result.mesh.shared_positions.iter();
        let shared = shared.map(|positions| (positions, result.mesh.shared_colours.as_ref(), MeshVertex::new(0)));
        let own = result.mesh.pieces.iter().zip(result.numbering);
        let own = own.map(|(piece, ids)| (&piece.positions, piece.colours.as_ref(), ids.vertex_base));
        let blocks = shared.chain(own).flat_map(|(positions, colours, first)| {
            positions.ranges(BLOCK_RECORDS).map(move |range| (positions, colours, first, range))
        });
        map_within(
            result.share,
            |_| BLOCK_BYTES,
            blocks,
            |(positions, colours, first, range)| {
                let first = first.plus(range.start as u32);
                let is_used = |i: usize| used.contains(first.plus(i as u32));
                vertex_records(positions, colours, range, has_colours, is_used)
            },
            |block| {
                self.replaced.non_finite += block.non_finite;
                self.replaced.uncoloured += block.uncoloured;
                self.file.write(&block.records)
            },
        )
    }

    fn texcoords(&mut self, result: &ResultMesh<'_>) -> Result<()> {
        let used = &result.usage.texcoords;
        let pieces = result.mesh.pieces.iter().zip(result.numbering);
        let blocks = pieces.flat_map(|(piece, ids)| {
            piece.texcoords.ranges(BLOCK_RECORDS).map(move |range| (&piece.texcoords, ids.texcoord_base, range))
        });
        map_within(
            result.share,
            |_| BLOCK_BYTES,
            blocks,
            |(texcoords, first, range)| {
                let first = first.plus(range.start as u32);
                let mut records = Vec::new();
                for (_, uv) in (0..).zip(texcoords.window(range)?).filter(|&(i, _)| used.contains(first.plus(i))) {
                    uv.to_array().iter().for_each(|x| records.extend_from_slice(&x.to_le_bytes()));
                }
                Ok(records)
            },
            |records: Vec<u8>| self.file.write(&records),
        )
    }

    fn faces(&mut self, result: &mut ResultMesh<'_>) -> Result<()> {
        let result = &*result;
        let grouped = self.group_faces(result)?;
        let words = if result.form.texcoords { 6 } else { 3 };
        let Self { file, labels, layout, .. } = self;
        let has_labels = layout.as_ref().is_some_and(|layout| layout.has_labels);
        grouped.drain(|groups| {
            let blocks = groups.iter().flat_map(|group| group.chunks(words * BLOCK_RECORDS as usize));
            for Group { key, words: block } in blocks {
                let material = result.catalogue.parts[result.order.part(key)].material;
                let label = material.map_or(NONE, |material| labels[material]);
                let mut records = Vec::with_capacity(4 * (block.len() + block.len() / words));
                for face in block.chunks_exact(words) {
                    face.iter().for_each(|word| records.extend_from_slice(&word.to_le_bytes()));
                    if has_labels {
                        records.extend_from_slice(&label.to_le_bytes());
                    }
                }
                file.write(&records)?;
                result.progress.advance((block.len() / words) as u64);
            }
            Ok(())
        })
    }

    fn finish(&mut self, findings: &mut Findings) -> Result<Content> {
        self.replaced.note(findings);
        self.file.seal()
    }

    fn commit(self: Box<Self>) -> Result<()> {
        self.file.commit()
    }
}

/// Label of the faces of each material: its name if that is a number, else its own number; if that is taken, the lowest
/// free one.
fn labels_of(names: impl Iterator<Item = impl AsRef<[u8]>>) -> TiVec<MaterialId, u32> {
    let mut taken: HashSet<u32> = HashSet::from([NONE]);
    let number = |name: &[u8]| std::str::from_utf8(name).ok()?.parse().ok();
    let by_name: TiVec<MaterialId, Option<u32>> =
        names.map(|name| number(name.as_ref()).filter(|label| taken.insert(*label))).collect();
    let mut lowest = 0;
    let mut label = |(material, by_name): (MaterialId, &Option<u32>)| {
        by_name.or_else(|| taken.insert(material.number()).then_some(material.number())).unwrap_or_else(|| {
            while !taken.insert(lowest) {
                lowest += 1;
            }
            lowest
        })
    };
    by_name.iter_enumerated().map(&mut label).collect()
}

fn vertex_records(
    positions: &PackedColumn<DVec3>,
    colours: Option<&Segment<[f32; 3]>>,
    range: std::ops::Range<u64>,
    has_colours: bool,
    is_used: impl Fn(usize) -> bool,
) -> Result<FormattedBlock> {
    let colours = colours.map(|column| column.window(range.clone())).transpose()?;
    let positions = positions.window(range)?;
    let mut block = FormattedBlock { records: Vec::new(), non_finite: 0, uncoloured: 0 };
    for (i, position) in positions.iter().enumerate().filter(|&(i, _)| is_used(i)) {
        for x in position.to_array() {
            block.non_finite += u64::from(!x.is_finite());
            block.records.extend_from_slice(&if x.is_finite() { x } else { 0.0 }.to_le_bytes());
        }
        if has_colours {
            let colour = colours.as_ref().map_or([f32::NAN; 3], |colours| colours[i]);
            block.uncoloured += u64::from(colour.iter().any(|channel| channel.is_nan()));
            colour.iter().for_each(|channel| block.records.extend_from_slice(&channel.to_le_bytes()));
        }
    }
    Ok(block)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_materials_share_a_label() {
        let labels = |names: &[&str]| labels_of(names.iter()).raw;
        assert_eq!(labels(&["7", "wall", "3"]), [7, 1, 3]);
        assert_eq!(labels(&["wall", "0", "door", "00", "4294967295"]), [1, 0, 2, 3, 4]);
        assert_eq!(labels(&[]), [] as [u32; 0]);
    }
}

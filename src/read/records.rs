//! Records of a chunk: the vertices, faces and labels that a worker has parsed, whatever the format.
//!
//! ```text
//! polygon_sizes     3        4            3
//! corner_vertices   a b c    d e f g      h i j        vertices of the file
//! corner_texcoords  A B C    - - - -      D E F        empty if no face of the chunk has any
//! changes           ^ material wall       ^ group roof before a polygon, in order
//! ```

use std::ops::Range;

use glam::{DVec2, DVec3};

use crate::base::findings::PLACES_PER_KIND;
use crate::base::id::{TiVec, ids};
use crate::file::PackedBlocks;
use crate::model::id::{PieceTexcoord, PieceVertex};

ids! {
    /// A corner of the polygons of a chunk, polygon by polygon.
    ChunkCorner;
}

/// Label of the following faces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LabelKind {
    /// Object: `o` of an OBJ.
    Object,
    /// Group: `g` of an OBJ.
    Group,
    /// Material: `usemtl` of an OBJ, a texture image of a PLY.
    Material,
}

/// A change of object, group or material.
#[derive(Debug, Clone)]
pub struct LabelChange {
    /// Number of polygons of the chunk before the change.
    pub polygon: u32,
    /// Label that changes.
    pub kind: LabelKind,
    /// Name as a range of [`ParsedRecords::names`].
    pub name: Range<u32>,
}

/// Number of findings of a kind in a chunk, and the first few of them.
#[derive(Debug)]
pub struct Note {
    /// Kind of finding.
    pub kind: &'static str,
    /// Number of findings.
    pub count: u64,
    /// Line, counted as by the reader of the format, and description.
    pub places: Vec<(u64, String)>,
}

/// Largest number of places kept per kind: the limit of a whole file, so that chunk borders do not change the report.
const PLACES_MAX: usize = PLACES_PER_KIND;

/// Vertices, faces and labels of a chunk.
#[derive(Debug, Default)]
pub struct ParsedRecords {
    /// Positions.
    pub positions: Vec<DVec3>,
    /// Colour of each vertex, NaN for vertices without; empty if no vertex of the chunk has one.
    pub colours: Vec<[f32; 3]>,
    /// Texture coordinates.
    pub texcoords: Vec<DVec2>,
    /// Positions as stored; filled by [`pack`](ParsedRecords::pack).
    pub packed_positions: PackedBlocks,
    /// Texture coordinates as stored; filled by [`pack`](ParsedRecords::pack).
    pub packed_texcoords: PackedBlocks,
    /// Number of corners of each polygon.
    pub polygon_sizes: Vec<u32>,
    /// Vertex of each corner.
    pub corner_vertices: TiVec<ChunkCorner, PieceVertex>,
    /// Texture coordinate of each corner, or none; may be shorter than the corners, or empty.
    pub corner_texcoords: TiVec<ChunkCorner, PieceTexcoord>,
    /// Changes of object, group and material.
    pub changes: Vec<LabelChange>,
    /// Text of the changes.
    pub names: Vec<u8>,
    /// Largest number of decimals of a position.
    pub position_decimals: u32,
    /// Largest number of decimals of a texture coordinate.
    pub texcoord_decimals: u32,
    /// Whether the chunk shows that the mesh has normals.
    pub uses_normals: bool,
    /// Findings.
    pub notes: Vec<Note>,
}

impl ParsedRecords {
    /// Clears the records but keeps the buffers of the larger columns.
    pub fn clear(&mut self) {
        let kept = std::mem::take(self);
        *self = Self {
            positions: cleared(kept.positions),
            colours: cleared(kept.colours),
            texcoords: cleared(kept.texcoords),
            polygon_sizes: cleared(kept.polygon_sizes),
            corner_vertices: cleared(kept.corner_vertices.raw).into(),
            corner_texcoords: cleared(kept.corner_texcoords.raw).into(),
            changes: cleared(kept.changes),
            names: cleared(kept.names),
            ..Self::default()
        };
    }

    /// Encodes positions and texture coordinates for their files. Negative zero becomes zero: programs print small
    /// negative numbers as -0.000000, which no count of decimals stands for, and which would lie at a seam beside 0.
    pub fn pack(&mut self) {
        self.positions.iter_mut().for_each(|position| *position += 0.0);
        self.texcoords.iter_mut().for_each(|texcoord| *texcoord += 0.0);
        self.packed_positions = PackedBlocks::new(&self.positions);
        self.packed_texcoords = PackedBlocks::new(&self.texcoords);
    }

    /// Capacity of the larger columns in bytes.
    pub fn capacity_bytes(&self) -> usize {
        self.positions.capacity() * size_of::<DVec3>()
            + self.colours.capacity() * size_of::<[f32; 3]>()
            + self.texcoords.capacity() * size_of::<DVec2>()
            + self.polygon_sizes.capacity() * 4
            + self.corner_vertices.capacity() * 4
            + self.corner_texcoords.capacity() * 4
            + self.changes.capacity() * size_of::<LabelChange>()
            + self.names.capacity()
    }

    /// Appends a vertex.
    #[inline]
    pub fn push_vertex(&mut self, position: DVec3, colour: Option<[f32; 3]>) {
        if let Some(colour) = colour {
            self.colours.resize(self.positions.len(), [f32::NAN; 3]);
            self.colours.push(colour);
        } else if !self.colours.is_empty() {
            self.colours.push([f32::NAN; 3]);
        }
        self.positions.push(position);
    }

    /// Records a change. Replaces one that no face has used yet, so that changes without faces take no memory.
    pub fn push_change(&mut self, kind: LabelKind, name: &[u8]) {
        let polygon = self.polygon_sizes.len() as u32;
        let name = self.push_name(name);
        let unused = self.changes.iter_mut().rev().take_while(|change| change.polygon == polygon);
        match unused.into_iter().find(|change| change.kind == kind) {
            Some(change) => change.name = name,
            None => self.changes.push(LabelChange { polygon, kind, name }),
        }
    }

    /// Appends a name to `names` and returns its range.
    pub fn push_name(&mut self, name: &[u8]) -> Range<u32> {
        let start = self.names.len() as u32;
        self.names.extend_from_slice(name);
        start..self.names.len() as u32
    }

    /// Returns a name by its range.
    pub fn name(&self, range: &Range<u32>) -> &[u8] {
        &self.names[range.start as usize..range.end as usize]
    }

    /// Counts a finding, and keeps its description if it is among the first of its kind.
    pub fn note(&mut self, kind: &'static str, line: u64, words: impl FnOnce() -> String) {
        let note = self.note_of(kind);
        note.count += 1;
        if note.places.len() < PLACES_MAX {
            note.places.push((line, words()));
        }
    }

    /// Counts a finding without description.
    pub fn count(&mut self, kind: &'static str) {
        self.note_of(kind).count += 1;
    }

    fn note_of(&mut self, kind: &'static str) -> &mut Note {
        let place = self.notes.iter().position(|note| note.kind == kind).unwrap_or_else(|| {
            self.notes.push(Note { kind, count: 0, places: Vec::new() });
            self.notes.len() - 1
        });
        &mut self.notes[place]
    }
}

/// Empties a buffer, which keeps its memory.
pub fn cleared<T>(mut records: Vec<T>) -> Vec<T> {
    records.clear();
    records
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thousand_changes_without_faces_are_one() {
        let mut chunk = ParsedRecords::default();
        for i in 0..1000 {
            chunk.push_change(LabelKind::Material, format!("m{i}").as_bytes());
            chunk.push_change(LabelKind::Group, b"g");
        }
        assert_eq!(chunk.changes.len(), 2);
        assert_eq!(chunk.name(&chunk.changes[0].name), b"m999");
    }

    #[test]
    fn vertices_before_the_first_colour_have_none() {
        let mut chunk = ParsedRecords::default();
        chunk.push_vertex(DVec3::ZERO, None);
        chunk.push_vertex(DVec3::ZERO, Some([1.0; 3]));
        chunk.push_vertex(DVec3::ZERO, None);
        assert!(chunk.colours[0][0].is_nan() && chunk.colours[2][0].is_nan());
        assert_eq!(chunk.colours[1], [1.0; 3]);
    }
}

//! A mesh stored in files: the output of the scan and of every pass. [`id`](super::id) tells how it is numbered.

use std::ops::Range;
use std::path::Path;

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::face::Face;
use super::face_blocks::FaceBlocks;
use super::id::{MeshVertex, PieceTexcoord, PieceVertex, Texcoord};
use crate::base::{Error, Result};
use crate::file::column::Segment;
use crate::file::packed::{PackedColumn, RecordBounds};
use crate::job::Recalled;

/// Largest number of vertices or texture coordinates: ids are 32 bits, and the last one means "none".
pub const ID_LIMIT: u64 = u32::MAX as u64 - 1;
/// Rounding noise in units in the last place of the largest coordinate.
const NOISE_UNITS: f64 = 8.0;

/// A piece of a stored mesh: its own vertices, texture coordinates and faces.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StoredPiece {
    /// Positions of its own vertices, in units of length of the mesh.
    pub positions: PackedColumn<DVec3>,
    /// Colours of its own vertices as the input has them, NaN for vertices without; `None` if the mesh has none.
    pub colours: Option<Segment<[f32; 3]>>,
    /// Texture coordinates.
    pub texcoords: PackedColumn<DVec2>,
    /// Faces by ids of this piece.
    pub faces: FaceBlocks,
}

impl Recalled for StoredMesh {
    type Context<'a> = ();

    fn locate(&mut self, folder: &Path, (): &()) {
        self.shared_positions.iter_mut().for_each(|segment| segment.locate(folder));
        self.shared_colours.iter_mut().for_each(|segment| segment.locate(folder));
        self.pieces.iter_mut().for_each(|piece| piece.locate(folder));
    }

    fn is_sound(&self, (): &()) -> bool {
        self.shared_positions.iter().all(|positions| positions.is_sound() && positions.len() <= ID_LIMIT)
            && self.shared_colours.iter().all(|colours| colours.is_sound() && colours.len() == self.shared_count())
            && self.pieces.iter().all(StoredPiece::is_sound)
    }
}

impl StoredPiece {
    /// Sets the folder of the files of a recalled value.
    pub fn locate(&mut self, folder: &Path) {
        self.positions.locate(folder);
        self.colours.iter_mut().for_each(|segment| segment.locate(folder));
        self.texcoords.locate(folder);
        self.faces.locate(folder);
    }

    /// Reports whether a recalled and located value is consistent with its files.
    pub fn is_sound(&self) -> bool {
        self.positions.len() <= ID_LIMIT
            && self.positions.is_sound()
            && self.has_sound_texcoords()
            && self.faces.is_sound()
            && self.colours.iter().all(|colours| colours.is_sound() && colours.len() == self.positions.len())
    }

    /// Reports the same for its texture coordinates alone.
    fn has_sound_texcoords(&self) -> bool {
        self.texcoords.len() <= ID_LIMIT && self.texcoords.is_sound()
    }

    /// Paths of its files; some occur more than once.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let colours = self.colours.iter().map(Segment::path);
        [self.positions.path(), self.texcoords.path(), self.faces.path()].into_iter().chain(colours)
    }
}

/// A mesh in files.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct StoredMesh {
    /// Positions of the vertices used by several pieces; they have the first ids.
    pub shared_positions: Option<PackedColumn<DVec3>>,
    /// Colours of the shared vertices.
    pub shared_colours: Option<Segment<[f32; 3]>>,
    /// The pieces, in order.
    pub pieces: Vec<StoredPiece>,
}

impl StoredMesh {
    /// Number of shared vertices.
    pub fn shared_count(&self) -> u64 {
        self.shared_positions.as_ref().map_or(0, PackedColumn::len)
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> u64 {
        self.shared_count() + self.pieces.iter().map(|piece| piece.positions.len()).sum::<u64>()
    }

    /// Number of texture coordinates.
    pub fn texcoord_count(&self) -> u64 {
        self.pieces.iter().map(|piece| piece.texcoords.len()).sum()
    }

    /// Number of triangles.
    pub fn face_count(&self) -> u64 {
        self.pieces.iter().map(|piece| piece.faces.len()).sum()
    }

    /// Whether vertices have colours.
    pub fn has_colours(&self) -> bool {
        self.shared_colours.is_some() || self.pieces.iter().any(|piece| piece.colours.is_some())
    }

    /// Forgets the colours of the vertices.
    pub fn drop_colours(&mut self) {
        self.shared_colours = None;
        self.pieces.iter_mut().for_each(|piece| piece.colours = None);
    }

    /// Reports the same for its texture coordinates alone.
    pub fn has_sound_texcoords(&self) -> bool {
        self.pieces.iter().all(StoredPiece::has_sound_texcoords)
    }

    /// Paths of all files; some occur more than once.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        let shared = self.shared_positions.iter().map(PackedColumn::path);
        let shared = shared.chain(self.shared_colours.iter().map(Segment::path));
        shared.chain(self.pieces.iter().flat_map(StoredPiece::files))
    }

    /// Paths of the files with texture coordinates; some occur more than once.
    pub fn texcoord_files(&self) -> impl Iterator<Item = &Path> {
        self.pieces.iter().map(|piece| piece.texcoords.path())
    }

    /// Bounding box of all positions, including vertices without faces; low exceeds high if there are none.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let mut bounds = RecordBounds::default();
        self.position_columns().for_each(|column| bounds.merge(&column.bounds()));
        (bounds.low.into(), bounds.high.into())
    }

    /// Distance that rounding of coordinates alone may cause, in units of length of the mesh.
    pub fn rounding_noise(&self) -> f64 {
        let (low, high) = self.bounds();
        let largest = low.abs().max(high.abs()).max_element();
        if largest.is_finite() { NOISE_UNITS * f64::EPSILON * largest } else { 0.0 }
    }

    /// Columns of positions in the order of vertex ids.
    pub fn position_columns(&self) -> impl Iterator<Item = &PackedColumn<DVec3>> {
        self.shared_positions.iter().chain(self.pieces.iter().map(|piece| &piece.positions))
    }

    /// Returns how to convert the ids of each piece to ids of the mesh.
    ///
    /// # Errors
    /// [`Error::Limit`] if there are more than 2³² - 2 vertices or texture coordinates.
    pub fn numbering(&self) -> Result<Vec<PieceNumbering>> {
        for (count, what) in [(self.vertex_count(), "vertices"), (self.texcoord_count(), "texture coordinates")] {
            if count > ID_LIMIT {
                return Err(Error::Limit(format!("the mesh has {count} {what}; at most {ID_LIMIT} are supported")));
            }
        }
        let mut vertex_base = MeshVertex::new(self.shared_count() as u32);
        let mut texcoord_base = Texcoord::new(0);
        let number = |piece: &StoredPiece| {
            let numbering = PieceNumbering { own: piece.positions.len() as u32, vertex_base, texcoord_base };
            vertex_base = vertex_base.plus(numbering.own);
            texcoord_base = texcoord_base.plus(piece.texcoords.len() as u32);
            numbering
        };
        Ok(self.pieces.iter().map(number).collect())
    }
}

/// Converts ids of a piece to ids of its mesh.
#[derive(Debug, Clone, Copy)]
pub struct PieceNumbering {
    /// Number of own vertices of the piece.
    pub own: u32,
    /// Its first own vertex.
    pub vertex_base: MeshVertex,
    /// Its first texture coordinate.
    pub texcoord_base: Texcoord,
}

impl PieceNumbering {
    /// A vertex of the piece as one of the mesh.
    #[inline]
    pub fn vertex(&self, vertex: PieceVertex) -> MeshVertex {
        match vertex.shared(self.own) {
            None => self.vertex_base.plus(vertex.number()),
            Some(shared) => shared.into(),
        }
    }

    /// The ranges of vertices of the mesh that a range of the piece stands for: of own ones and of shared ones.
    pub fn vertices(&self, range: &Range<PieceVertex>) -> impl Iterator<Item = Range<MeshVertex>> + use<> {
        let [start, end] = [range.start, range.end].map(PieceVertex::number);
        let own = self.vertex_base.plus(start.min(self.own))..self.vertex_base.plus(end.min(self.own));
        let shared = [start, end].map(|number| MeshVertex::new(number.saturating_sub(self.own)));
        [own, shared[0]..shared[1]].into_iter().filter(|range| !range.is_empty())
    }

    /// A texture coordinate of the piece as one of the mesh.
    #[inline]
    pub fn texcoord(&self, texcoord: PieceTexcoord) -> Texcoord {
        self.texcoord_base.plus(texcoord.number())
    }

    /// A face of the piece as one of the mesh.
    pub fn globalise(&self, face: &Face<PieceVertex>) -> Face<MeshVertex> {
        face.translated(|vertex| self.vertex(vertex), |texcoord| self.texcoord(texcoord))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::codec;
    use crate::file::{ColumnWriter, PackedWriter};
    use crate::model::FaceWriter;

    /// A mesh in a folder: three shared vertices, and a piece with one face and one own vertex.
    fn mesh(folder: &Path) -> StoredMesh {
        let positions = |name: &str, count: usize| {
            let mut writer = PackedWriter::create(&folder.join(name), *b"position").unwrap();
            writer.append(&vec![DVec3::ONE; count]).unwrap();
            writer.finish().unwrap()
        };
        let colours = |name: &str, count: usize| {
            let mut writer = ColumnWriter::create(&folder.join(name), *b"colour  ").unwrap();
            writer.append(&vec![[0.5f32; 3]; count]).unwrap();
            writer.finish().unwrap()
        };
        let mut texcoords = PackedWriter::create(&folder.join("texcoords"), *b"texcoord").unwrap();
        texcoords.append(&[DVec2::ZERO; 3]).unwrap();
        let mut faces = FaceWriter::create(&folder.join("faces")).unwrap();
        let vertices = [0, 1, 2].map(PieceVertex::new);
        let face = Face { vertices, texcoords: [0, 1, 2].map(PieceTexcoord::new), ..Face::default() };
        faces.append(&[face]).unwrap();
        let piece = StoredPiece {
            positions: positions("positions", 1),
            colours: Some(colours("colours", 1)),
            texcoords: texcoords.finish().unwrap(),
            faces: faces.finish().unwrap(),
        };
        StoredMesh {
            shared_positions: Some(positions("shared", 3)),
            shared_colours: Some(colours("shared-colours", 3)),
            pieces: vec![piece],
        }
    }

    /// The value as recalled from a journal in another folder.
    fn moved(mesh: &StoredMesh, folder: &Path) -> StoredMesh {
        let mut mesh: StoredMesh = codec::decode(&codec::encode(mesh).unwrap()).unwrap();
        mesh.locate(folder, &());
        mesh
    }

    #[test]
    fn a_mesh_that_was_read_back_is_found_in_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = mesh(folder.path());
        let found = moved(&mesh, folder.path());
        assert!(found.is_sound(&()) && found.has_sound_texcoords());
        assert_eq!((found.vertex_count(), found.texcoord_count(), found.face_count()), (4, 3, 1));
        assert!(mesh.files().count() == 6 && found.files().eq(mesh.files()));
        let elsewhere = moved(&mesh, &folder.path().join("elsewhere"));
        assert!(!elsewhere.is_sound(&()));
        assert!(elsewhere.files().all(|file| file.parent() == Some(&folder.path().join("elsewhere"))));
    }

    #[test]
    fn a_mesh_without_one_of_its_files_is_not_sound() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = mesh(folder.path());
        for file in mesh.files() {
            let bytes = std::fs::read(file).unwrap();
            std::fs::write(file, &bytes[..bytes.len() - 1]).unwrap();
            assert!(!mesh.is_sound(&()), "{file:?}");
            assert_eq!(mesh.has_sound_texcoords(), !file.ends_with("texcoords"));
            std::fs::write(file, bytes).unwrap();
        }
        assert!(mesh.is_sound(&()));
    }

    #[test]
    fn colours_that_not_each_vertex_has_are_not_sound() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = mesh(folder.path());
        let changes: [fn(&mut StoredMesh); 3] = [
            |mesh| std::mem::swap(&mut mesh.shared_colours, &mut mesh.pieces[0].colours),
            |mesh| mesh.shared_positions = None,
            |mesh| mesh.pieces[0].colours.clone_from(&mesh.shared_colours),
        ];
        for (i, change) in changes.into_iter().enumerate() {
            let mut changed = mesh.clone();
            change(&mut changed);
            assert!(!changed.is_sound(&()), "change {i}");
        }
    }
}

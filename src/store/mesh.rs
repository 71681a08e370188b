//! A mesh stored in files: the output of the scan and of every pass.
//!
//! ```text
//! vertex ids   0 .. shared        vertices used by several pieces
//!              shared ..          own vertices of the pieces, piece by piece
//! texcoord ids 0 ..               texture coordinates of the pieces, piece by piece
//! ```
//! Within a piece, ids 0 .. own are its own vertices, and own .. own + shared are the shared ones.

use std::path::{Path, PathBuf};

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

use super::column::Segment;
use super::face::{Face, NO_TEXCOORD};
use super::face_blocks::FaceBlocks;
use super::packed::{Bounds, PackedColumn};
use crate::base::{Error, Result};
use crate::job::codec;

/// Largest number of vertices or texture coordinates: ids are 32 bits, and the last one means "none".
pub const ID_LIMIT: u64 = u32::MAX as u64 - 1;
/// Bytes of a part or material, in addition to its name.
const LABEL_BYTES: u64 = 256;
/// Bytes of a material statement in addition to its text; and of a texture statement, including bookkeeping of its
/// file.
const STATEMENT_BYTES: u64 = 40;
const TEXTURE_BYTES: u64 = 980;

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

    /// Sets the folder of the files of a recalled value.
    pub fn locate(&mut self, folder: &Path) {
        self.shared_positions.iter_mut().for_each(|segment| segment.locate(folder));
        self.shared_colours.iter_mut().for_each(|segment| segment.locate(folder));
        self.pieces.iter_mut().for_each(|piece| piece.locate(folder));
    }

    /// Reports whether a recalled and located value is consistent with its files.
    pub fn is_sound(&self) -> bool {
        self.shared_positions.iter().all(|positions| positions.is_sound() && positions.len() <= ID_LIMIT)
            && self.shared_colours.iter().all(|colours| colours.is_sound() && colours.len() == self.shared_count())
            && self.pieces.iter().all(StoredPiece::is_sound)
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
        let mut bounds = Bounds::default();
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
        let (mut vertex_base, mut texcoord_base) = (self.shared_count() as u32, 0);
        Ok(self
            .pieces
            .iter()
            .map(|piece| {
                let numbering = PieceNumbering { own: piece.positions.len() as u32, vertex_base, texcoord_base };
                vertex_base += numbering.own;
                texcoord_base += piece.texcoords.len() as u32;
                numbering
            })
            .collect())
    }
}

/// Converts ids of a piece to ids of its mesh.
#[derive(Debug, Clone, Copy)]
pub struct PieceNumbering {
    /// Number of own vertices of the piece.
    pub own: u32,
    /// Mesh id of its first own vertex.
    pub vertex_base: u32,
    /// Mesh id of its first texture coordinate.
    pub texcoord_base: u32,
}

impl PieceNumbering {
    /// Returns the face with ids of the mesh.
    pub fn globalise(&self, face: &Face) -> Face {
        let vertex = |v: u32| if v < self.own { self.vertex_base + v } else { v - self.own };
        let texcoord = |t: u32| if t == NO_TEXCOORD { t } else { self.texcoord_base + t };
        Face { vertices: face.vertices.map(vertex), texcoords: face.texcoords.map(texcoord), ..*face }
    }
}

/// A material that faces refer to.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Material {
    /// Name in the input (`usemtl`), as bytes; need not be UTF-8.
    pub name: Vec<u8>,
    /// Name in the output: that of the input, with a suffix if two inputs use it for different materials.
    pub output_name: Vec<u8>,
    /// The statements after `newmtl`; `None` if no MTL file defines the material.
    pub definition: Option<MaterialDefinition>,
}

impl Material {
    /// Memory in bytes without the definition, including bookkeeping.
    pub fn bytes(&self) -> u64 {
        LABEL_BYTES + (self.name.len() + self.output_name.len()) as u64
    }
}

/// Statements of a material in an MTL file.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct MaterialDefinition {
    /// Folder of the MTL file; texture names are relative to it.
    #[serde(with = "codec::path")]
    pub folder: PathBuf,
    /// Statements that name no texture, as written.
    pub statements: Vec<Vec<u8>>,
    /// Statements that name a texture.
    pub textures: Vec<TextureStatement>,
}

impl MaterialDefinition {
    /// Memory in bytes, including bookkeeping of its files.
    pub fn bytes(&self) -> u64 {
        let plain = self.statements.iter().map(|text| statement_bytes(text));
        let textures = self.textures.iter().map(TextureStatement::bytes);
        plain.chain(textures).sum()
    }
}

/// Memory of a statement that names no texture, in bytes.
pub fn statement_bytes(statement: &[u8]) -> u64 {
    STATEMENT_BYTES + statement.len() as u64
}

/// A statement such as `map_Kd -s 1 1 1 wall.png`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TextureStatement {
    /// Key and options as written: `map_Kd -s 1 1 1`.
    pub key_and_options: Vec<u8>,
    /// File name as written, options removed: `wall.png`.
    pub name: Vec<u8>,
}

impl TextureStatement {
    /// Memory in bytes.
    pub fn own_bytes(&self) -> u64 {
        (self.key_and_options.len() + self.name.len()) as u64 + 3 * STATEMENT_BYTES
    }

    /// Memory in bytes, including bookkeeping of its file.
    pub fn bytes(&self) -> u64 {
        self.own_bytes() + 2 * self.name.len() as u64 + TEXTURE_BYTES
    }
}

/// Label of faces: a combination of input file, object, group and material.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Part {
    /// Index of the input file.
    pub file: u32,
    /// Index of the object's name in [`Catalogue::names`]; `None` without an `o` statement.
    pub object: Option<u32>,
    /// Index of the group names (the text after `g`) in [`Catalogue::names`]; `None` without a `g` statement.
    pub group: Option<u32>,
    /// Index of the material; `None` without a `usemtl` statement.
    pub material: Option<u32>,
}

impl Part {
    /// Memory in bytes, including bookkeeping.
    pub const BYTES: u64 = LABEL_BYTES;
}

/// Everything in the input that is not geometry.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Catalogue {
    /// Input files, in order. Not stored with the job, which may be resumed with other paths to them.
    #[serde(skip)]
    pub files: Vec<PathBuf>,
    /// Folders that the user named.
    #[serde(skip)]
    pub folders: Vec<PathBuf>,
    /// Object and group names, as bytes.
    pub names: Vec<Vec<u8>>,
    /// Materials in order of first use.
    pub materials: Vec<Material>,
    /// Parts in order of first use; faces refer to them by index.
    pub parts: Vec<Part>,
    /// Whether the input had vertex normals.
    pub has_normals: bool,
    /// Whether the input had texture coordinates.
    pub has_texcoords: bool,
    /// Largest number of decimals of a position in the input.
    pub position_decimals: u32,
    /// Largest number of decimals of a texture coordinate in the input.
    pub texcoord_decimals: u32,
}

impl Catalogue {
    /// Index of a part's material; that after the last for a part without one.
    pub fn material_index(&self, part: u32) -> usize {
        let material = self.parts.get(part as usize).and_then(|part| part.material);
        material.map_or(self.materials.len(), |material| material as usize)
    }
    /// Memory in bytes, including bookkeeping.
    pub fn bytes(&self) -> u64 {
        let names = self.names.iter().map(|name| name.len() as u64);
        let materials = self.materials.iter().map(Material::bytes);
        let definitions = self.materials.iter().filter_map(|material| Some(material.definition.as_ref()?.bytes()));
        self.parts.len() as u64 * Part::BYTES + names.chain(materials).chain(definitions).sum::<u64>()
    }

    /// Reports whether the parts of a recalled value refer to existing entries.
    pub fn is_sound(&self) -> bool {
        let names = |index: Option<u32>, count: usize| index.is_none_or(|index| (index as usize) < count);
        self.parts.iter().all(|part| {
            (part.file as usize) < self.files.len()
                && names(part.object, self.names.len())
                && names(part.group, self.names.len())
                && names(part.material, self.materials.len())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{ColumnWriter, FaceWriter, PackedWriter};

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
        faces.append(&[Face { vertices: [0, 1, 2], texcoords: [0, 1, 2], ..Face::default() }]).unwrap();
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
        mesh.locate(folder);
        mesh
    }

    #[test]
    fn a_mesh_that_was_read_back_is_found_in_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = mesh(folder.path());
        let found = moved(&mesh, folder.path());
        assert!(found.is_sound() && found.has_sound_texcoords());
        assert_eq!((found.vertex_count(), found.texcoord_count(), found.face_count()), (4, 3, 1));
        assert!(mesh.files().count() == 6 && found.files().eq(mesh.files()));
        let elsewhere = moved(&mesh, &folder.path().join("elsewhere"));
        assert!(!elsewhere.is_sound());
        assert!(elsewhere.files().all(|file| file.parent() == Some(&folder.path().join("elsewhere"))));
    }

    #[test]
    fn a_mesh_without_one_of_its_files_is_not_sound() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = mesh(folder.path());
        for file in mesh.files() {
            let bytes = std::fs::read(file).unwrap();
            std::fs::write(file, &bytes[..bytes.len() - 1]).unwrap();
            assert!(!mesh.is_sound(), "{file:?}");
            assert_eq!(mesh.has_sound_texcoords(), !file.ends_with("texcoords"));
            std::fs::write(file, bytes).unwrap();
        }
        assert!(mesh.is_sound());
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
            assert!(!changed.is_sound(), "change {i}");
        }
    }

    #[test]
    fn parts_that_name_what_is_not_there_are_not_sound() {
        let part = Part { file: 0, object: Some(0), group: Some(1), material: None };
        let names = vec!["a".into(), "b".into()];
        let whole = Catalogue { parts: vec![part], files: vec!["a.obj".into()], names, ..Catalogue::default() };
        assert!(whole.is_sound());
        let parts = [
            Part { file: 1, ..part },
            Part { object: Some(2), ..part },
            Part { group: Some(2), ..part },
            Part { material: Some(0), ..part },
        ];
        for other in parts {
            assert!(!Catalogue { parts: vec![part, other], ..whole.clone() }.is_sound(), "{other:?}");
        }
    }
}

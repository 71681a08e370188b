//! What the faces of a mesh refer to by number: parts, their names and materials.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::id::{FileId, MaterialId, NameId, PartId};
use crate::base::id::TiVec;
use crate::file::codec;

/// Bytes of a part or material, in addition to its name.
const LABEL_BYTES: u64 = 256;
/// Bytes of a material statement in addition to its text; and of a texture statement, including bookkeeping of its
/// file.
const STATEMENT_BYTES: u64 = 40;
const TEXTURE_BYTES: u64 = 980;

/// A material that faces refer to.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
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
    /// The input file.
    pub file: FileId,
    /// The object's name; `None` without an `o` statement.
    pub object: Option<NameId>,
    /// The group names (the text after `g`); `None` without a `g` statement.
    pub group: Option<NameId>,
    /// The material; `None` without a `usemtl` statement.
    pub material: Option<MaterialId>,
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
    pub files: TiVec<FileId, PathBuf>,
    /// Folders that the user named.
    #[serde(skip)]
    pub folders: Vec<PathBuf>,
    /// Object and group names, as bytes.
    pub names: TiVec<NameId, Vec<u8>>,
    /// Materials in order of first use.
    pub materials: TiVec<MaterialId, Material>,
    /// Parts in order of first use.
    pub parts: TiVec<PartId, Part>,
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
    /// Material of a part; that after the last for a part without one.
    pub fn material_of(&self, part: PartId) -> MaterialId {
        self.parts.get(part).and_then(|part| part.material).unwrap_or(self.materials.next_key())
    }

    /// A value per material, all the same, and one for none.
    pub fn per_material<T: Clone>(&self, value: T) -> TiVec<MaterialId, T> {
        vec![value; self.materials.len() + 1].into()
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
        let has_name = |name: NameId| name < self.names.next_key();
        let has_material = |material: MaterialId| material < self.materials.next_key();
        self.parts.iter().all(|part| {
            part.file < self.files.next_key()
                && part.object.is_none_or(has_name)
                && part.group.is_none_or(has_name)
                && part.material.is_none_or(has_material)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_that_name_what_is_not_there_are_not_sound() {
        let name = |number| Some(NameId::new(number));
        let part = Part { file: FileId::new(0), object: name(0), group: name(1), material: None };
        let (files, names) = (vec!["a.obj".into()].into(), vec!["a".into(), "b".into()].into());
        let whole = Catalogue { parts: vec![part].into(), files, names, ..Catalogue::default() };
        assert!(whole.is_sound());
        let parts = [
            Part { file: FileId::new(1), ..part },
            Part { object: name(2), ..part },
            Part { group: name(2), ..part },
            Part { material: Some(MaterialId::new(0)), ..part },
        ];
        for other in parts {
            assert!(!Catalogue { parts: vec![part, other].into(), ..whole.clone() }.is_sound(), "{other:?}");
        }
    }
}

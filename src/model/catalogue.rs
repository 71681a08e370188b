//! What the faces of a mesh refer to by number: parts, their names and materials.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

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

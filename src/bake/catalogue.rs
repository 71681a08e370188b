//! The parts and materials that the passes see, and those of a result with new textures.

use std::path::Path;

use super::patch::BakedImage;
use crate::base::id::TiVec;
use crate::image::textures::TextureImages;
use crate::model::Catalogue;
use crate::model::catalogue::{Material, MaterialDefinition, Part, TextureStatement};
use crate::model::id::{FileId, ImageId, MaterialId, PartId};

/// The catalogue that the passes see: materials with an image are one.
pub fn geometry_catalogue(catalogue: &Catalogue, images: &TextureImages) -> Catalogue {
    let mut plain = catalogue.clone();
    for (part, &image) in plain.parts.iter_mut().zip(&images.of_part) {
        if image != ImageId::NONE {
            part.material = None;
        }
    }
    plain.has_texcoords = false;
    plain
}

/// A catalogue with a part and a material for each image.
pub(super) fn image_catalogue(input: &Catalogue, images: &[BakedImage], folder: &Path) -> Catalogue {
    let material_of = |image: &BakedImage| {
        let name = image.path.file_name().map(|name| name.as_encoded_bytes().to_vec()).unwrap_or_default();
        let stem = image.path.file_stem().map(|stem| stem.as_encoded_bytes().to_vec()).unwrap_or_default();
        let map = TextureStatement { key_and_options: b"map_Kd".to_vec(), name };
        let statements = vec![b"Ka 1 1 1".to_vec(), b"Kd 1 1 1".to_vec(), b"Ks 0 0 0".to_vec(), b"illum 1".to_vec()];
        let definition = MaterialDefinition { folder: folder.to_owned(), statements, textures: vec![map] };
        Material { name: stem.clone(), output_name: stem, definition: Some(definition) }
    };
    let part =
        |material: MaterialId| Part { file: FileId::new(0), object: None, group: None, material: Some(material) };
    let materials: TiVec<MaterialId, Material> = images.iter().map(material_of).collect();
    let parts: TiVec<PartId, Part> = materials.keys().map(part).collect();
    Catalogue {
        files: input.files.clone(),
        folders: vec![folder.to_owned()],
        materials,
        parts,
        has_normals: input.has_normals,
        has_texcoords: true,
        position_decimals: input.position_decimals,
        texcoord_decimals: input.texcoord_decimals.max(6),
        ..Catalogue::default()
    }
}

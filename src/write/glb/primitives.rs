//! Primitives of a GLB: faces with the same material, with or without its image.

use std::collections::HashMap;

use super::images::GlbImages;
use crate::base::id::{TiVec, ids};
use crate::model::Catalogue;
use crate::model::diffuse::{ImagePlacement, diffuse_image};
use crate::model::id::{MaterialId, PartId};
use crate::write::order::{PartOrder, PartPlace};

ids! {
    /// A primitive of the file.
    PrimitiveId;
}

/// What the faces of a primitive have in common.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Primitive {
    pub material: Option<MaterialId>,
    /// Index of its image, for which every corner has a texture coordinate.
    pub image: Option<usize>,
    /// Where the image lies.
    pub placement: Option<ImagePlacement>,
}

/// The primitives of a result, in the order of its parts.
#[derive(Debug, Default)]
pub(super) struct Primitives {
    pub list: TiVec<PrimitiveId, Primitive>,
    /// Of each part, that without image and that with it.
    of_part: TiVec<PartId, [PrimitiveId; 2]>,
}

impl Primitives {
    /// The primitives of parts with faces.
    pub fn of(catalogue: &Catalogue, order: &PartOrder, places: usize, images: &GlbImages) -> Self {
        let mut primitives =
            Self { of_part: vec![[PrimitiveId::NONE; 2]; catalogue.parts.len()].into(), ..Self::default() };
        let mut known: HashMap<Option<MaterialId>, [PrimitiveId; 2]> = HashMap::new();
        for part in (0..places).map(|place| order.part(PartPlace::from(place))) {
            let material = catalogue.parts[part].material;
            let ids = *known.entry(material).or_insert_with(|| {
                let bare = primitives.list.push_and_get_key(Primitive { material, image: None, placement: None });
                let Some(image) = material.and_then(|material| images.of_material[material]) else { return [bare; 2] };
                let definition = material.and_then(|material| catalogue.materials[material].definition.as_ref());
                let placement = definition.and_then(diffuse_image).and_then(ImagePlacement::of);
                [bare, primitives.list.push_and_get_key(Primitive { material, image: Some(image), placement })]
            });
            primitives.of_part[part] = ids;
        }
        primitives
    }

    /// The primitive of a face.
    #[inline]
    pub fn find(&self, part: PartId, has_texcoords: bool) -> PrimitiveId {
        self.of_part[part][usize::from(has_texcoords)]
    }
}

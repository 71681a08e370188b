//! The order in which the faces of a result are written: part by part.

use super::numbering::Usage;
use crate::base::id::{TiVec, ids};
use crate::model::Catalogue;
use crate::model::id::PartId;

ids! {
    /// Place of a part in the order in which parts are written.
    PartPlace;
}

/// The order in which parts are written.
#[derive(Debug)]
pub(super) struct PartOrder {
    /// Parts with faces, in order.
    parts: TiVec<PartPlace, PartId>,
    /// Place of each part with faces.
    places: TiVec<PartId, PartPlace>,
}

impl PartOrder {
    /// Parts in the order of the catalogue: first those without material, among them those without object, then without
    /// group.
    ///
    /// NOTE: a statement holds until the next of its kind, and none ends a material. Objects and groups are ended by
    /// the name `default`, which an OBJ has if a part without one follows a part with one.
    pub(super) fn new(catalogue: &Catalogue, usage: &Usage) -> Self {
        let has_faces = |part: &PartId| usage.faces_per_part[*part] > 0;
        let mut parts: TiVec<PartPlace, PartId> = catalogue.parts.keys().filter(has_faces).collect();
        parts.sort_by_key(|&id| {
            let part = &catalogue.parts[id];
            (part.material.is_some(), part.object.is_some(), part.group.is_some())
        });
        let mut places: TiVec<PartId, PartPlace> = vec![PartPlace::default(); catalogue.parts.len()].into();
        for (place, &part) in parts.iter_enumerated() {
            places[part] = place;
        }
        Self { parts, places }
    }

    /// The part at a place.
    pub(super) fn part(&self, place: PartPlace) -> PartId {
        self.parts[place]
    }

    /// Place of a part.
    pub(super) fn place(&self, part: PartId) -> PartPlace {
        self.places[part]
    }

    /// Number of faces at each place.
    pub(super) fn counts(&self, usage: &Usage) -> TiVec<PartPlace, u64> {
        self.parts.iter().map(|&part| usage.faces_per_part[part]).collect()
    }
}

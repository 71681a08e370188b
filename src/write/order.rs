//! The order in which the faces of a result are written: part by part.

use super::numbering::Usage;
use crate::model::Catalogue;

/// The order in which parts are written.
#[derive(Debug)]
pub(super) struct PartOrder {
    /// Parts with faces, in order.
    parts: Vec<u32>,
    /// Position of each part in that order.
    places: Vec<u32>,
}

impl PartOrder {
    /// Parts in the order of the catalogue: first those without material, among them those without object, then without
    /// group.
    ///
    /// NOTE: a statement holds until the next of its kind, and none ends a material. Objects and groups are ended by
    /// the name `default`, which an OBJ has if a part without one follows a part with one.
    pub(super) fn new(catalogue: &Catalogue, usage: &Usage) -> Self {
        let mut parts: Vec<u32> = (0u32..).take(catalogue.parts.len()).collect();
        parts.retain(|&part| usage.faces_per_part[part as usize] > 0);
        parts.sort_by_key(|&index| {
            let part = &catalogue.parts[index as usize];
            (part.material.is_some(), part.object.is_some(), part.group.is_some())
        });
        let mut places = vec![0; catalogue.parts.len()];
        for (place, &part) in (0u32..).zip(&parts) {
            places[part as usize] = place;
        }
        Self { parts, places }
    }

    /// The part at a position.
    pub(super) fn part(&self, place: u32) -> u32 {
        self.parts[place as usize]
    }

    /// Position of a part.
    pub(super) fn place(&self, part: u32) -> u32 {
        self.places[part as usize]
    }

    /// Number of faces at each position.
    pub(super) fn counts(&self, usage: &Usage) -> Vec<u64> {
        self.parts.iter().map(|&part| usage.faces_per_part[part as usize]).collect()
    }
}

//! A part that covers much of the surface keeps at least one face, and with it its material.
//!
//! Costs measure planes and texture, so where charts of several materials meet, one of them may shrink to nothing at
//! little cost. The area of a part is compared with the mean area of a face, so the rule relaxes as faces get fewer.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use crate::geometry::triangle::area;
use crate::mesh::{ClusterMesh, FaceId};
use crate::model::id::PartId;

/// A part keeps a face if it covers at least this many mean face areas.
const MEAN_FACES: f64 = 2.0;

/// Up to this many faces of a large part, faces are counted with each collapse.
const FEW_FACES: u32 = 8;
/// The same if fewer than this share of all faces may vanish before a large part has so few: counting all takes long.
const SPARE_MIN: f64 = 1.0 / 8.0;

/// Faces and area of each part, in meshes of several parts.
#[derive(Debug, Default)]
pub struct LastFaces {
    parts: HashMap<PartId, Holding, FixedState>,
    /// Area of the mesh at the first count, in units of length².
    area: f64,
    /// A number of faces that may vanish before any large part has as few as [`FEW_FACES`]. While there are some, `parts`
    /// does not follow collapses.
    spare: u32,
}

#[derive(Debug, Default)]
struct Holding {
    faces: u32,
    /// Area at the first count, in units of length².
    area: f64,
}

impl LastFaces {
    /// Counts the faces of each part in a mesh without dead faces. The first call also measures areas, which collapses
    /// hardly change.
    pub fn count(&mut self, mesh: &ClusterMesh) {
        if self.area == 0.0 && mesh.parts.raw.windows(2).any(|pair| pair[0] != pair[1]) {
            let mut faces = mesh.face_ids();
            for parts in mesh.parts.raw.chunk_by(|a, b| a == b) {
                let holding = self.parts.entry(parts[0]).or_default();
                for face in faces.by_ref().take(parts.len()) {
                    let area = area(mesh.triangle(face));
                    holding.area += area;
                    self.area += area;
                }
            }
        }
        if !self.parts.is_empty() {
            self.recount(mesh);
        }
    }

    /// Counts the living faces of each part.
    fn recount(&mut self, mesh: &ClusterMesh) {
        self.parts.values_mut().for_each(|holding| holding.faces = 0);
        let mut first = FaceId::new(0);
        for parts in mesh.parts.raw.chunk_by(|a, b| a == b) {
            let next = first.plus(parts.len() as u32);
            let living = FaceId::within(&(first..next)).filter(|&face| !mesh.is_dead(face)).count();
            self.parts.entry(parts[0]).or_default().faces += living as u32;
            first = next;
        }
        let large = self.parts.values().filter(|holding| self.is_large(mesh, holding));
        let fewest = large.map(|holding| holding.faces).min().unwrap_or(u32::MAX);
        let spare = fewest.saturating_sub(FEW_FACES);
        self.spare = if f64::from(spare) < SPARE_MIN * mesh.face_count as f64 { 0 } else { spare };
    }

    fn is_large(&self, mesh: &ClusterMesh, holding: &Holding) -> bool {
        holding.area * mesh.face_count as f64 >= MEAN_FACES * self.area
    }

    /// Whether a large part would have no face left if the `dying` faces vanished; each must occur once.
    pub fn are_last(&self, mesh: &ClusterMesh, dying: &[FaceId]) -> bool {
        // No further part becomes large, since faces get fewer.
        if self.parts.is_empty() || (self.spare > 0 && dying.len() <= FEW_FACES as usize) {
            return false;
        }
        let part_of = |face: FaceId| mesh.parts[face];
        dying.iter().any(|&face| {
            let of_part = dying.iter().filter(|&&other| part_of(other) == part_of(face)).count();
            let holding = self.parts.get(&part_of(face));
            holding.is_some_and(|holding| holding.faces as usize <= of_part && self.is_large(mesh, holding))
        })
    }

    /// Subtracts faces that have vanished.
    pub fn remove(&mut self, mesh: &ClusterMesh, died: &[FaceId]) {
        if self.parts.is_empty() {
            return;
        }
        if self.spare > 0 {
            self.spare = self.spare.saturating_sub(died.len() as u32);
            if self.spare == 0 {
                self.recount(mesh);
            }
            return;
        }
        for &face in died {
            if let Some(holding) = self.parts.get_mut(&mesh.parts[face]) {
                holding.faces -= 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use proptest::prelude::*;

    use super::{LastFaces, MEAN_FACES};
    use crate::cost::{SurfaceCost, Weights};
    use crate::mesh::FaceId;
    use crate::mesh::cluster::{ClusterMesh, samples};
    use crate::model::id::PartId;
    use crate::simplify::{Engine, Stop};

    /// What [`LastFaces::are_last`] says, by a plain count of all faces. The faces of the grid are equally large.
    fn are_last_by_count(mesh: &ClusterMesh, dying: &[FaceId], all: &HashMap<PartId, usize>) -> bool {
        dying.iter().map(|&face| mesh.parts[face]).any(|part| {
            let share = all[&part] as f64 / mesh.parts.len() as f64;
            let is_large = share * mesh.face_count as f64 >= MEAN_FACES;
            is_large && mesh.living_faces().all(|face| mesh.parts[face] != part || dying.contains(&face))
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn it_knows_the_last_faces_whatever_order_they_die_in(
            parts in prop::collection::vec(0..6_u32, 128),
            by_patches in any::<bool>(),
            order in Just((0..128_u32).collect::<Vec<_>>()).prop_shuffle(),
            stage in 20..100_usize,
        ) {
            let mut mesh = samples::grid(8, 0.0);
            prop_assert_eq!(mesh.parts.len(), 128);
            for face in 0..128 {
                // Patches of unequal size, or parts mixed face by face.
                mesh.parts.raw[face] = PartId::new(if by_patches { parts[face / 23] } else { parts[face].min(1) });
            }
            let mut all: HashMap<PartId, usize> = HashMap::new();
            mesh.parts.iter().for_each(|&part| *all.entry(part).or_default() += 1);
            prop_assume!(all.len() > 1);
            let mut last = LastFaces::default();
            last.count(&mesh);
            let mut refused = 0;
            for (i, pair) in order.chunks(2).enumerate() {
                let dying: Vec<_> = pair.iter().map(|&face| FaceId::new(face)).collect();
                let is_last = last.are_last(&mesh, &dying);
                prop_assert_eq!(is_last, are_last_by_count(&mesh, &dying, &all));
                if is_last {
                    refused += 1;
                } else {
                    dying.iter().for_each(|&face| mesh.kill(face));
                    last.remove(&mesh, &dying);
                }
                if i == stage {
                    last.count(&mesh);
                }
            }
            prop_assert!(refused > 0 || mesh.face_count < 10);
        }
    }

    #[test]
    fn a_part_keeps_a_face_while_it_covers_what_two_faces_do() {
        let (size, side) = (24, 3);
        let is_in_part = |i: u32| (9..9 + side).contains(&(i / 2 % size)) && (9..9 + side).contains(&(i / 2 / size));
        for faces in [100, 140, 200, 400] {
            let mut mesh = samples::grid(size, 0.0);
            (0..).zip(&mut mesh.parts).for_each(|(i, part)| *part = PartId::new(is_in_part(i).into()));
            let mut engine = Engine::<SurfaceCost>::new(mesh, &Weights::default());
            assert!(engine.run(Stop::Faces(faces)).reached);
            let left = engine.finish();
            let has_part = left.parts.contains(&PartId::new(1));
            let is_large = side * side * left.face_count as u32 >= 2 * size * size;
            assert!(has_part || !is_large, "{faces}");
        }
    }
}

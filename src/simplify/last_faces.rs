//! A part that covers much of the surface keeps a face, and its material with it.
//!
//! Costs know planes and pictures, and where charts of several materials meet, one of them may shrink to nothing for
//! little. What a part covers is compared with what faces cover on average, so the rule gives way as faces get fewer.

use super::witness::area_of;
use crate::mesh::ClusterMesh;

/// A part keeps a face if it covers at least what so many average faces do.
const MEAN_FACES: f64 = 2.0;

/// The faces that each part has, in meshes of several parts.
#[derive(Debug, Default)]
pub struct LastFaces {
    /// In order.
    parts: Vec<u32>,
    /// Of each part.
    holdings: Vec<Holding>,
    /// Area of the mesh, in units of length².
    area: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Holding {
    faces: u32,
    /// Area when the count began, in units of length².
    area: f64,
}

impl LastFaces {
    /// Counts the faces of a mesh that has no dead ones.
    pub fn count(&mut self, mesh: &ClusterMesh) {
        self.parts.clear();
        self.parts.extend(&mesh.parts);
        self.parts.dedup();
        self.parts.sort_unstable();
        self.parts.dedup();
        self.holdings.clear();
        self.area = 0.0;
        if self.parts.len() < 2 {
            self.parts.clear();
            return;
        }
        self.holdings.resize(self.parts.len(), Holding::default());
        for face in 0..mesh.corners.len() as u32 {
            let area = area_of(mesh.triangle(face));
            self.area += area;
            if let Some(holding) = self.holding(mesh, face) {
                holding.faces += 1;
                holding.area += area;
            }
        }
    }

    /// Whether a large part would have no face if these vanished, each of which is named once.
    pub fn are_last(&mut self, mesh: &ClusterMesh, dying: &[u32]) -> bool {
        let (area, part_of) = (self.area, |face: u32| mesh.parts[face as usize]);
        dying.iter().any(|&face| {
            let of_part = dying.iter().filter(|&&other| part_of(other) == part_of(face)).count();
            self.holding(mesh, face).is_some_and(|holding| {
                holding.faces as usize <= of_part && holding.area * mesh.face_count as f64 >= MEAN_FACES * area
            })
        })
    }

    /// Takes note of faces that have vanished.
    pub fn remove(&mut self, mesh: &ClusterMesh, died: &[u32]) {
        for &face in died {
            if let Some(holding) = self.holding(mesh, face) {
                holding.faces -= 1;
            }
        }
    }

    fn holding(&mut self, mesh: &ClusterMesh, face: u32) -> Option<&mut Holding> {
        let at = self.parts.binary_search(&mesh.parts[face as usize]).ok()?;
        Some(&mut self.holdings[at])
    }
}

#[cfg(test)]
mod tests {
    use crate::cost::{SurfaceCost, Weights};
    use crate::mesh::cluster::samples;
    use crate::simplify::{Engine, Stop};

    #[test]
    fn a_part_keeps_a_face_while_it_covers_what_two_faces_do() {
        let (size, side) = (24, 3);
        let is_in_part = |i: u32| (9..9 + side).contains(&(i / 2 % size)) && (9..9 + side).contains(&(i / 2 / size));
        for faces in [100, 140, 200, 400] {
            let mut mesh = samples::grid(size, 0.0);
            (0..).zip(&mut mesh.parts).for_each(|(i, part)| *part = u32::from(is_in_part(i)));
            let mut engine = Engine::<SurfaceCost>::new(mesh, &Weights::default());
            assert!(engine.run(Stop::Faces(faces)).reached);
            let left = engine.finish();
            let has_part = left.parts.contains(&1);
            let is_large = side * side * left.face_count as u32 >= 2 * size * size;
            assert!(has_part || !is_large, "{faces}");
        }
    }
}

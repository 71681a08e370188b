//! Measures the seams of a cluster on a sample of one edge in eight.

use super::ranks::SortedIds;
use super::reading::ClusterFaces;
use crate::base::id::TiVec;
use crate::mesh::id::LocalVertex;
use crate::mesh::seam_density::SeamTally;
use crate::model::Catalogue;
use crate::model::id::{MaterialId, Texcoord};

/// One in this many edges is sampled.
const EDGE_STEP: u32 = 8;

/// An edge of a face: its ends, the smaller vertex first, and the texcoords and material of the face there.
#[derive(Clone, Copy)]
struct SeamSide {
    ends: [LocalVertex; 2],
    texcoords: [Texcoord; 2],
    material: MaterialId,
}

/// Sorts edges of a mesh of `vertex_count` vertices by their ends: at first by the smaller vertex, which needs no
/// comparisons.
fn sorted(sides: &[SeamSide], vertex_count: usize) -> Vec<SeamSide> {
    let mut places: TiVec<LocalVertex, u32> = vec![0; vertex_count + 1].into();
    sides.iter().for_each(|side| places[side.ends[0].plus(1)] += 1);
    for vertex in 1..places.len() {
        places.raw[vertex] += places.raw[vertex - 1];
    }
    let mut sorted = sides.to_vec();
    for side in sides {
        let place = &mut places[side.ends[0]];
        sorted[*place as usize] = *side;
        *place += 1;
    }
    for around in sorted.chunk_by_mut(|one, other| one.ends[0] == other.ends[0]) {
        around.sort_unstable_by_key(|side| side.ends[1]);
    }
    sorted
}

/// Reports whether the edges whose smaller vertex is this one are sampled.
fn is_drawn(vertex: LocalVertex) -> bool {
    vertex.number().wrapping_mul(0x9e37_79b1) < u32::MAX / EDGE_STEP
}

impl ClusterFaces {
    /// Measures the faces, and estimates the length of the seams between them from one edge in eight, sampled by a hash
    /// of a vertex. An edge is a seam if its faces differ in material, or in a texture coordinate at one of its ends.
    pub fn tally_seams(&self, catalogue: &Catalogue) -> SeamTally {
        let mut tally = SeamTally { faces: self.faces.len() as u64, ..SeamTally::default() };
        let mut sides: Vec<SeamSide> = Vec::with_capacity(self.faces.len() / 2);
        for face in &self.faces {
            let [a, b, c] = self.triangle_of(face);
            tally.area += 0.5 * (b - a).cross(c - a).length();
            for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                let (i, j) = if face.vertices[i] < face.vertices[j] { (i, j) } else { (j, i) };
                if is_drawn(face.vertices[i]) {
                    let material = catalogue.material_of(face.part);
                    let (ends, texcoords) = ([i, j].map(|k| face.vertices[k]), [i, j].map(|k| face.texcoords[k]));
                    sides.push(SeamSide { ends, texcoords, material });
                }
            }
        }
        let ranks = SortedIds::new(&self.texcoord_ids);
        let uv_of = |id: Texcoord| id.some().map(|id| self.texcoords[ranks.of(id)].to_array().map(f64::to_bits));
        for edge in sorted(&sides, self.positions.len()).chunk_by(|one, other| one.ends == other.ends) {
            let first = edge[0];
            let differs = |side: &SeamSide| {
                side.material != first.material
                    || (side.texcoords != first.texcoords && side.texcoords.map(uv_of) != first.texcoords.map(uv_of))
            };
            if edge.iter().any(differs) {
                let [a, b] = first.ends.map(|v| self.positions[v]);
                tally.seams += f64::from(EDGE_STEP) * a.distance(b);
            }
        }
        tally
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, DVec3};

    use super::*;
    use crate::model::id::{FileId, PartId};
    use crate::model::{Face, Part};
    use crate::partition::id::PartitionVertex;

    /// A strip of two columns of squares, `length` long. In the right column u is larger by `step` and has its own ids.
    fn strip(length: u32, step: f64) -> ClusterFaces {
        let at = |x: u32, y: u32| DVec3::new(f64::from(x), f64::from(y), 0.0);
        let (mut positions, mut texcoords, mut faces) = (TiVec::new(), TiVec::new(), TiVec::new());
        for y in 0..=length {
            positions.extend((0..3).map(|x| at(x, y)));
            texcoords.extend([0, 1, 1, 2].map(|x| DVec2::new(f64::from(x), f64::from(y))));
            texcoords.iter_mut().rev().take(2).for_each(|uv| uv.x += step);
        }
        for (y, x) in (0..length).flat_map(|y| [(y, 0), (y, 1)]) {
            let ends =
                [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[dx, dy]| [3 * (y + dy) + x + dx, 4 * (y + dy) + 2 * x + dx]);
            faces.extend([[0, 1, 2], [0, 2, 3]].map(|corners| {
                let vertices = corners.map(|corner: usize| LocalVertex::new(ends[corner][0]));
                let texcoords = corners.map(|corner: usize| Texcoord::new(ends[corner][1]));
                Face { vertices, texcoords, part: PartId::new(0), continues_polygon: false, deviation: 0.0 }
            }));
        }
        let vertex_ids = PartitionVertex::first(positions.len()).collect();
        let texcoord_ids = Texcoord::first(texcoords.len()).collect();
        ClusterFaces { faces, positions, degenerate: 0, doubles: 0, vertex_ids, texcoord_ids, texcoords }
    }

    #[test]
    fn seams_are_measured_and_rims_are_not() {
        let part = Part { file: FileId::new(0), object: None, group: None, material: None };
        let catalogue = Catalogue { parts: vec![part].into(), ..Catalogue::default() };
        let tally = strip(10_000, 5.0).tally_seams(&catalogue);
        assert_eq!((tally.faces, tally.area), (40_000, 20_000.0));
        assert!((tally.seams / 10_000.0 - 1.0).abs() < 0.1, "{}", tally.seams);
        // Equal texture coordinates under two ids.
        assert_eq!(strip(10_000, 0.0).tally_seams(&catalogue).seams, 0.0);
    }
}

//! A mesh held in memory for measuring.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::edges::repeats_vertex;
use crate::base::id::TiSlice;
use crate::base::pool::in_parallel;
use crate::base::{Error, Result};
use crate::file::PackedColumn;
use crate::file::packed::Coordinates;
use crate::geometry::position_key;
use crate::model::{Catalogue, Mesh, StoredMesh};
use crate::partition::reading::triangulate_polygons;

/// Marks a corner without texture coordinate.
pub const NO_TEXCOORD: u32 = Mesh::NO_TEXCOORD;
/// Marks a face without material.
pub const NO_MATERIAL: u32 = u32::MAX;
/// Records read at once.
const WINDOW_RECORDS: u64 = 1 << 20;

/// A mesh held in memory for measuring.
///
/// The three face vectors are of one length; ids are indices of `positions` and `texcoords`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Surface {
    /// Position of each vertex, in the mesh's unit of length.
    pub positions: Vec<DVec3>,
    /// Texture coordinates.
    pub texcoords: Vec<DVec2>,
    /// Vertices of each face, counter-clockwise.
    pub faces: Vec<[u32; 3]>,
    /// Texture coordinate of each corner, or [`NO_TEXCOORD`].
    pub face_texcoords: Vec<[u32; 3]>,
    /// Material of each face, or [`NO_MATERIAL`].
    pub face_materials: Vec<u32>,
}

impl Surface {
    /// Reads all pieces of a stored mesh; polygons are triangulated as they are for simplification.
    ///
    /// # Errors
    /// [`Error::Damaged`] if a face refers to a vertex, a texture coordinate or a part that does not exist,
    /// [`Error::Limit`] if there are too many faces for memory, else [`Error::Io`].
    pub fn load(mesh: &StoredMesh, catalogue: &Catalogue) -> Result<Self> {
        let face_count = mesh.face_count();
        let face_limit = u64::from(u32::MAX / 3);
        if face_count >= face_limit {
            return Err(Error::Limit(format!("{face_count} faces cannot be measured in memory, at most {face_limit}")));
        }
        let mut surface = Self::default();
        for segment in mesh.position_columns() {
            append_column(segment, &mut surface.positions)?;
        }
        for piece in &mesh.pieces {
            append_column(&piece.texcoords, &mut surface.texcoords)?;
        }
        surface.faces.reserve_exact(face_count as usize);
        surface.face_texcoords.reserve_exact(face_count as usize);
        surface.face_materials.reserve_exact(face_count as usize);
        let (mut bytes, mut block_faces) = (Vec::new(), Vec::new());
        for (piece, numbering) in mesh.pieces.iter().zip(mesh.numbering()?) {
            let file = piece.faces.open()?;
            let damaged = |message| Error::Damaged { path: piece.faces.path().to_owned(), message };
            let vertex_limit = u64::from(numbering.own) + mesh.shared_count();
            for block in piece.faces.blocks() {
                piece.faces.read_block(&file, block, &mut bytes, &mut block_faces)?;
                for face in &block_faces {
                    let missing = |&v: &u32| u64::from(v) >= vertex_limit;
                    if let Some(v) = face.vertices.map(|v| v.number()).into_iter().find(missing) {
                        return Err(damaged(format!("a face names vertex {v}, there are {vertex_limit}")));
                    }
                    let missing = |&t: &u32| u64::from(t) >= piece.texcoords.len();
                    if let Some(t) = face.named_texcoords().map(|t| t.number()).find(missing) {
                        let count = piece.texcoords.len();
                        return Err(damaged(format!("a face names texture coordinate {t}, there are {count}")));
                    }
                    if face.part.index() >= catalogue.parts.len() {
                        let (part, count) = (face.part.number(), catalogue.parts.len());
                        return Err(damaged(format!("a face names part {part}, there are {count}")));
                    }
                }
                let mut faces = block_faces.iter().map(|face| numbering.globalise(face)).collect();
                triangulate_polygons(&mut faces, TiSlice::from_ref(&surface.positions));
                for face in &faces {
                    surface.faces.push(face.vertices.map(|v| v.number()));
                    surface.face_texcoords.push(face.texcoords.map(|t| t.number()));
                    let material = catalogue.parts[face.part].material;
                    surface.face_materials.push(material.map_or(NO_MATERIAL, |material| material.number()));
                }
            }
        }
        Ok(surface)
    }

    /// The surface after welding vertices at bit-identical positions (-0 is 0); faces that then repeat a vertex are
    /// dropped. Vertices keep the order of their first occurrence.
    pub fn welded(&self) -> Self {
        let (positions, new_ids) = weld_positions(&self.positions);
        let mut welded = Self { positions, texcoords: self.texcoords.clone(), ..Self::default() };
        welded.faces.reserve_exact(self.faces.len());
        welded.face_texcoords.reserve_exact(self.faces.len());
        welded.face_materials.reserve_exact(self.faces.len());
        for (face, vertices) in self.faces.iter().enumerate() {
            let vertices = vertices.map(|v| new_ids[v as usize]);
            if !repeats_vertex(vertices) {
                welded.faces.push(vertices);
                welded.face_texcoords.push(self.face_texcoords[face]);
                welded.face_materials.push(self.face_materials[face]);
            }
        }
        welded
    }

    /// Position of a vertex by its id.
    pub fn position(&self, vertex: u32) -> DVec3 {
        self.positions[vertex as usize]
    }
}

fn append_column<T: Coordinates>(column: &PackedColumn<T>, out: &mut Vec<T>) -> Result<()> {
    out.reserve_exact(column.len() as usize);
    for range in column.ranges(WINDOW_RECORDS) {
        out.extend_from_slice(&column.window(range)?);
    }
    Ok(())
}

/// Distinct positions, and the new id of each old vertex.
fn weld_positions(positions: &[DVec3]) -> (Vec<DVec3>, Vec<u32>) {
    let mut keys: Vec<([u64; 3], u32)> = positions.iter().zip(0u32..).map(|(&p, id)| (position_key(p), id)).collect();
    in_parallel(|| keys.par_sort_unstable());
    let mut firsts = vec![0u32; positions.len()];
    for group in keys.chunk_by(|a, b| a.0 == b.0) {
        for &(_, id) in group {
            firsts[id as usize] = group[0].1;
        }
    }
    drop(keys);
    let mut kept = Vec::with_capacity(positions.len());
    for vertex in 0..positions.len() {
        let first = firsts[vertex] as usize;
        if first == vertex {
            firsts[vertex] = kept.len() as u32;
            kept.push(positions[vertex]);
        } else {
            firsts[vertex] = firsts[first];
        }
    }
    (kept, firsts)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::file::PackedWriter;
    use crate::model::id::{FileId, MaterialId, PartId, PieceTexcoord, PieceVertex};
    use crate::model::{Face, FaceWriter, Part, StoredPiece};

    /// A surface without texture and materials.
    pub fn bare(positions: &[[f64; 3]], faces: &[[u32; 3]]) -> Surface {
        Surface {
            positions: positions.iter().map(|&p| p.into()).collect(),
            texcoords: Vec::new(),
            faces: faces.to_vec(),
            face_texcoords: vec![[NO_TEXCOORD; 3]; faces.len()],
            face_materials: vec![NO_MATERIAL; faces.len()],
        }
    }

    #[test]
    fn vertices_at_one_position_become_the_first_of_them() {
        // 1 and 2 lie on 0: the first face keeps three vertices, the second one loses its area
        let surface = bare(
            &[[0.0, 0.0, 0.0], [-0.0, 0.0, 0.0], [0.0, -0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            &[[2, 3, 4], [0, 1, 3]],
        );
        let welded = surface.welded();
        assert_eq!(welded.positions.len(), 3);
        assert_eq!(welded.faces, [[0, 1, 2]]);
        assert_eq!(welded.face_materials.len(), 1);
    }

    fn store(folder: &std::path::Path, part: u32) -> StoredMesh {
        let positions = |name: &str, positions: &[DVec3]| {
            let mut writer = PackedWriter::create(&folder.join(name), *b"position").unwrap();
            writer.append(positions).unwrap();
            writer.finish().unwrap()
        };
        let shared = positions("shared", &[DVec3::X, DVec3::Y]);
        let pieces = ["a", "b"].map(|name| {
            let mut texcoords = PackedWriter::create(&folder.join(format!("{name}.uv")), *b"texcoord").unwrap();
            texcoords.append(&[DVec2::X, DVec2::Y]).unwrap();
            let mut faces = FaceWriter::create(&folder.join(format!("{name}.faces"))).unwrap();
            let of_face = [0, 1, NO_TEXCOORD].map(PieceTexcoord::new);
            let (vertices, part) = ([0, 1, 2].map(PieceVertex::new), PartId::new(part));
            faces.append(&[Face { vertices, texcoords: of_face, part, ..Face::default() }]).unwrap();
            StoredPiece {
                positions: positions(name, &[DVec3::Z]),
                colours: None,
                texcoords: texcoords.finish().unwrap(),
                faces: faces.finish().unwrap(),
            }
        });
        StoredMesh { shared_positions: Some(shared), shared_colours: None, pieces: pieces.into() }
    }

    #[test]
    fn pieces_of_a_stored_mesh_share_vertices() {
        let folder = tempfile::tempdir().unwrap();
        let part = Part { file: FileId::new(0), object: None, group: None, material: Some(MaterialId::new(4)) };
        let catalogue = Catalogue { parts: vec![part].into(), ..Catalogue::default() };
        let surface = Surface::load(&store(folder.path(), 0), &catalogue).unwrap();
        assert_eq!(surface.positions, [DVec3::X, DVec3::Y, DVec3::Z, DVec3::Z]);
        assert_eq!(surface.faces, [[2, 0, 1], [3, 0, 1]]);
        assert_eq!(surface.face_texcoords, [[0, 1, NO_TEXCOORD], [2, 3, NO_TEXCOORD]]);
        assert_eq!(surface.face_materials, [4, 4]);
    }

    #[test]
    fn a_face_of_a_part_that_does_not_exist_is_damage() {
        let folder = tempfile::tempdir().unwrap();
        let error = Surface::load(&store(folder.path(), 1), &Catalogue::default()).unwrap_err();
        assert!(error.to_string().ends_with("a face names part 1, there are 0"), "{error}");
    }
}

//! A mesh held in memory for measuring.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::base::id::{TiSlice, TiVec};
use crate::base::pool::{blocks_until_stopped, check_stopped, in_parallel};
use crate::base::{Error, Result};
use crate::file::PackedColumn;
use crate::file::packed::Coordinates;
use crate::geometry::position_key;
use crate::mesh::id::FaceId;
use crate::model::face::repeats_vertex;
use crate::model::id::{MaterialId, MeshVertex, Texcoord};
use crate::model::{Catalogue, Mesh, StoredMesh};
use crate::partition::reading::triangulate_polygons;
use crate::topology::cell::{Countable, shown_key};

/// Records read at once.
const WINDOW_RECORDS: u64 = 1 << 20;

/// A mesh held in memory for measuring.
///
/// The three face vectors are of one length.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Surface {
    /// Position of each vertex, in the mesh's unit of length.
    pub positions: TiVec<MeshVertex, DVec3>,
    /// Texture coordinates.
    pub texcoords: TiVec<Texcoord, DVec2>,
    /// Vertices of each face, counter-clockwise.
    pub faces: TiVec<FaceId, [MeshVertex; 3]>,
    /// Texture coordinate of each corner, or none.
    pub face_texcoords: TiVec<FaceId, [Texcoord; 3]>,
    /// Material of each face, or none.
    pub face_materials: TiVec<FaceId, MaterialId>,
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
            append_column(segment, &mut surface.positions.raw)?;
        }
        for piece in &mesh.pieces {
            append_column(&piece.texcoords, &mut surface.texcoords.raw)?;
        }
        surface.faces.raw.reserve_exact(face_count as usize);
        surface.face_texcoords.raw.reserve_exact(face_count as usize);
        surface.face_materials.raw.reserve_exact(face_count as usize);
        let (mut bytes, mut block_faces) = (Vec::new(), Vec::new());
        for (piece, numbering) in mesh.pieces.iter().zip(mesh.numbering()?) {
            let file = piece.faces.open()?;
            let damaged = |message| Error::Damaged { path: piece.faces.path().to_owned(), message };
            let vertex_limit = u64::from(numbering.own) + mesh.shared_count();
            for block in piece.faces.blocks() {
                check_stopped()?;
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
                triangulate_polygons(&mut faces, &surface.positions);
                for face in &faces {
                    surface.faces.push(face.vertices);
                    surface.face_texcoords.push(face.texcoords);
                    surface.face_materials.push(catalogue.parts[face.part].material.unwrap_or(MaterialId::NONE));
                }
            }
        }
        Ok(surface)
    }

    /// The surface after welding vertices at bit-identical positions (-0 is 0); faces that then repeat a vertex are
    /// dropped. Vertices keep the order of their first occurrence.
    ///
    /// # Errors
    /// [`Error::Stopped`].
    pub fn welded(&self) -> Result<Self> {
        let (positions, new_ids) = weld_positions(&self.positions)?;
        let mut welded = Self { positions, texcoords: self.texcoords.clone(), ..Self::default() };
        welded.faces.raw.reserve_exact(self.faces.len());
        welded.face_texcoords.raw.reserve_exact(self.faces.len());
        welded.face_materials.raw.reserve_exact(self.faces.len());
        for block in blocks_until_stopped(self.faces.len()) {
            for face in block?.map(FaceId::from) {
                let vertices = self.faces[face].map(|v| new_ids[v]);
                if !repeats_vertex(vertices) {
                    welded.faces.push(vertices);
                    welded.face_texcoords.push(self.face_texcoords[face]);
                    welded.face_materials.push(self.face_materials[face]);
                }
            }
        }
        Ok(welded)
    }
}

impl From<&Mesh> for Surface {
    fn from(mesh: &Mesh) -> Self {
        let faces = mesh.faces.len();
        let mut surface = Self {
            positions: mesh.positions.iter().copied().map(DVec3::from_array).collect(),
            texcoords: mesh.texcoords.iter().copied().map(DVec2::from_array).collect(),
            faces: mesh.faces.iter().map(|face| face.map(MeshVertex::new)).collect(),
            face_texcoords: mesh.face_texcoords.iter().map(|face| face.map(Texcoord::new)).collect(),
            face_materials: mesh.face_labels.iter().copied().map(MaterialId::new).collect(),
        };
        surface.face_texcoords.resize(faces, [Texcoord::NONE; 3]);
        surface.face_materials.resize(faces, MaterialId::NONE);
        surface
    }
}

impl Countable for Surface {
    type Vertex = MeshVertex;

    fn positions(&self) -> &TiSlice<MeshVertex, DVec3> {
        &self.positions
    }

    fn faces(&self) -> &TiSlice<FaceId, [MeshVertex; 3]> {
        &self.faces
    }

    fn texcoords(&self, face: FaceId) -> [DVec2; 3] {
        self.face_texcoords[face].map(|texcoord| texcoord.some().map_or(DVec2::NAN, |known| self.texcoords[known]))
    }

    fn shown(&self, face: FaceId, corner: usize) -> u64 {
        shown_key(self.texcoords(face)[corner], self.face_materials[face])
    }

    fn is_shared(&self, _: MeshVertex) -> bool {
        false
    }
}

fn append_column<T: Coordinates>(column: &PackedColumn<T>, out: &mut Vec<T>) -> Result<()> {
    out.reserve_exact(column.len() as usize);
    for range in column.ranges(WINDOW_RECORDS) {
        check_stopped()?;
        out.extend_from_slice(&column.window(range)?);
    }
    Ok(())
}

/// Distinct positions, and the new id of each old vertex.
fn weld_positions(
    positions: &TiSlice<MeshVertex, DVec3>,
) -> Result<(TiVec<MeshVertex, DVec3>, TiVec<MeshVertex, MeshVertex>)> {
    let mut keys: Vec<([u64; 3], MeshVertex)> = Vec::with_capacity(positions.len());
    for block in blocks_until_stopped(positions.len()) {
        keys.extend(block?.map(MeshVertex::from).map(|id| (position_key(positions[id]), id)));
    }
    check_stopped()?;
    in_parallel(|| keys.par_sort_unstable());
    let mut firsts = TiVec::from(vec![MeshVertex::default(); positions.len()]);
    let mut first = keys.first().copied().unwrap_or_default();
    for block in blocks_until_stopped(keys.len()) {
        for &(key, id) in &keys[block?] {
            if key != first.0 {
                first = (key, id);
            }
            firsts[id] = first.1;
        }
    }
    drop(keys);
    let mut kept = TiVec::from(Vec::with_capacity(positions.len()));
    for block in blocks_until_stopped(positions.len()) {
        for vertex in block?.map(MeshVertex::from) {
            let first = firsts[vertex];
            firsts[vertex] = if first == vertex { kept.push_and_get_key(positions[vertex]) } else { firsts[first] };
        }
    }
    Ok((kept, firsts))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::file::PackedWriter;
    use crate::model::id::{FileId, PartId, PieceTexcoord, PieceVertex};
    use crate::model::{Face, FaceWriter, Part, StoredPiece};

    /// A surface without texture and materials.
    pub fn bare(positions: &[[f64; 3]], faces: &[[u32; 3]]) -> Surface {
        Surface::from(&Mesh { positions: positions.to_vec(), faces: faces.to_vec(), ..Mesh::default() })
    }

    #[test]
    fn vertices_at_one_position_become_the_first_of_them() {
        // 1 and 2 lie on 0: the first face keeps three vertices, the second one loses its area
        let surface = bare(
            &[[0.0, 0.0, 0.0], [-0.0, 0.0, 0.0], [0.0, -0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            &[[2, 3, 4], [0, 1, 3]],
        );
        let welded = surface.welded().unwrap();
        assert_eq!(welded.positions.len(), 3);
        assert_eq!(welded.faces.raw, [[0, 1, 2].map(MeshVertex::new)]);
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
            let of_face = [PieceTexcoord::new(0), PieceTexcoord::new(1), PieceTexcoord::NONE];
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
        assert_eq!(surface.positions.raw, [DVec3::X, DVec3::Y, DVec3::Z, DVec3::Z]);
        assert_eq!(surface.faces.raw, [[2, 0, 1], [3, 0, 1]].map(|face| face.map(MeshVertex::new)));
        let none = Texcoord::NONE.number();
        assert_eq!(surface.face_texcoords.raw, [[0, 1, none], [2, 3, none]].map(|face| face.map(Texcoord::new)));
        assert_eq!(surface.face_materials.raw, [MaterialId::new(4); 2]);
    }

    #[test]
    fn a_face_of_a_part_that_does_not_exist_is_damage() {
        let folder = tempfile::tempdir().unwrap();
        let error = Surface::load(&store(folder.path(), 1), &Catalogue::default()).unwrap_err();
        assert!(error.to_string().ends_with("a face names part 1, there are 0"), "{error}");
    }
}

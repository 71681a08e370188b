//! Writes an OBJ: its text, with the normals of corners, and its MTL.

mod lines;
pub(super) mod mtl;
mod number;

use std::path::Path;

use self::lines::ObjText;
use super::grouping::Grouping;
use super::normals::{SharedNormals, piece_bytes, piece_normals};
use super::numbered::group_faces;
use super::order::PartPlace;
use super::sink::{MeshSink, ResultMesh};
use crate::base::ordered::map_within;
use crate::base::{Error, Findings, Result};
use crate::model::corners::FaceReader;
use crate::model::id::MeshVertex;
use crate::model::stored_mesh::PieceNumbering;
use crate::model::{Face, StoredPiece};
use crate::os::content::Content;

/// An OBJ being written.
#[derive(Debug)]
pub(super) struct ObjSink {
    text: ObjText,
}

impl ObjSink {
    /// Creates a temporary file of the job that will become `target`; `library` is the name of the MTL, if there is
    /// one.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub(super) fn begin(target: &Path, job: u64, library: Option<&[u8]>) -> Result<Self> {
        Ok(Self { text: ObjText::create(target, job, library)? })
    }
}

impl MeshSink for ObjSink {
    fn vertices(&mut self, result: &ResultMesh<'_>) -> Result<()> {
        self.text.vertices(result)
    }

    fn texcoords(&mut self, result: &ResultMesh<'_>) -> Result<()> {
        self.text.texcoords(result)
    }

    fn faces(&mut self, result: &mut ResultMesh<'_>) -> Result<()> {
        let corners = std::mem::take(&mut result.corners_per_shared);
        let result = &*result;
        let ResultMesh { mesh, usage, ref order, form, share, work_folder, .. } = *result;
        let obj = &mut self.text;
        let shared = SharedNormals::gather(mesh, corners, share, work_folder, |normals| obj.normals(normals))?;
        let faces = if form.normals {
            let faces = Grouping::new(order.counts(usage), form.words(), share, &work_folder.join("write-faces.tmp"))?;
            Numberer { result, shared: &shared }.number_faces(faces, obj)?
        } else {
            group_faces(result, form.words(), |face, words| put_numbers(result, face, words))?
        };
        obj.faces(faces, result)
    }

    fn finish(&mut self, findings: &mut Findings) -> Result<Content> {
        findings.count("non_finite_numbers", self.text.non_finite);
        self.text.file().seal()
    }

    fn commit(self: Box<Self>) -> Result<()> {
        self.text.commit()
    }
}

/// Appends the numbers of the vertices of a face, counted from 1, and of its texture coordinates, 0 for none.
fn put_numbers(result: &ResultMesh<'_>, face: &Face<MeshVertex>, words: &mut Vec<u32>) {
    let ResultMesh { usage, form, .. } = *result;
    words.extend(face.vertices.map(|vertex| usage.vertices.rank(vertex) + 1));
    if form.texcoords {
        let number = |texcoord| usage.texcoords.rank(texcoord) + 1;
        words.extend(face.texcoords.map(|texcoord| texcoord.some().map_or(0, number)));
    }
}

/// Converts faces with normals of their corners to the numbering of the result.
struct Numberer<'a> {
    result: &'a ResultMesh<'a>,
    shared: &'a SharedNormals,
}

impl Numberer<'_> {
    /// Adds every face to `faces`, and writes the normals at the pieces' own vertices to the OBJ.
    fn number_faces(&self, mut faces: Grouping<PartPlace>, obj: &mut ObjText) -> Result<Grouping<PartPlace>> {
        let ResultMesh { mesh, numbering, share: memory_bytes, .. } = *self.result;
        let mut reader = FaceReader::default();
        let mut normal_count = u64::from(self.shared.count);
        map_within(
            memory_bytes,
            |(piece, _)| piece_bytes(piece),
            mesh.pieces.iter().zip(numbering),
            |(piece, ids)| Ok((piece, ids, piece_normals(mesh, piece, self.shared)?)),
            |(piece, ids, normals)| {
                obj.normals(&normals.unique)?;
                let first_normal = normal_count;
                normal_count += normals.unique.len() as u64;
                if normal_count >= u64::from(u32::MAX) {
                    return Err(Error::Limit("the result has more than 2³² normals; leave the normals out".into()));
                }
                self.number_piece(piece, ids, &normals.corners.raw, first_normal as u32, &mut reader, &mut faces)
            },
        )?;
        Ok(faces)
    }

    fn number_piece(
        &self,
        piece: &StoredPiece,
        ids: &PieceNumbering,
        corner_normals: &[u32],
        first_normal: u32,
        reader: &mut FaceReader,
        faces: &mut Grouping<PartPlace>,
    ) -> Result<()> {
        let own_base = first_normal - self.shared.count;
        let number = |&n: &u32| if n < self.shared.count { n + 1 } else { n + own_base + 1 };
        let mut corner_normals = corner_normals.chunks_exact(3);
        let mut numbered = Vec::with_capacity(9);
        reader.each_block(piece, |block| {
            for face in block {
                numbered.clear();
                put_numbers(self.result, &ids.globalise(face), &mut numbered);
                numbered.extend(corner_normals.next().into_iter().flatten().map(number));
                faces.push(self.result.order.place(face.part), &numbered)?;
            }
            Ok(())
        })
    }
}

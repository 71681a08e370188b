//! The formats that are written, behind one trait.

use std::path::Path;

use super::numbering::Usage;
use super::order::PartOrder;
use crate::base::id::TiVec;
use crate::base::{Findings, Progress, Result};
use crate::model::id::SharedVertex;
use crate::model::stored_mesh::PieceNumbering;
use crate::model::{Catalogue, StoredMesh};
use crate::os::content::Content;

/// A mesh file being written, under a temporary name until it is committed. The steps come in this order, once each.
pub(super) trait MeshSink: std::fmt::Debug + Send {
    /// Writes the vertices that faces use, in the order of their ids.
    ///
    /// # Errors
    /// If a column cannot be read or the file cannot be written.
    fn vertices(&mut self, result: &ResultMesh<'_>) -> Result<()>;

    /// Writes the texture coordinates that faces use.
    ///
    /// # Errors
    /// As [`vertices`](MeshSink::vertices).
    fn texcoords(&mut self, result: &ResultMesh<'_>) -> Result<()>;

    /// Writes the faces, part by part, and their normals if the format has some of corners.
    ///
    /// # Errors
    /// As [`vertices`](MeshSink::vertices).
    fn faces(&mut self, result: &mut ResultMesh<'_>) -> Result<()>;

    /// Syncs the file under its temporary name, and adds what could not be written as it was to `findings`. Returns
    /// length in bytes and XXH3.
    ///
    /// # Errors
    /// Those of the file system.
    fn finish(&mut self, findings: &mut Findings) -> Result<Content>;

    /// Renames the file to its final name.
    ///
    /// # Errors
    /// Those of the file system.
    fn commit(self: Box<Self>) -> Result<()>;
}

/// A mesh to be written, and what was found out about it.
pub(super) struct ResultMesh<'a> {
    /// The mesh.
    pub(super) mesh: &'a StoredMesh,
    /// Its labels and materials.
    pub(super) catalogue: &'a Catalogue,
    /// How ids of pieces become ids of the mesh.
    pub(super) numbering: &'a [PieceNumbering],
    /// What faces use.
    pub(super) usage: &'a Usage,
    /// Number of corners at each shared vertex, if they have normals; taken by the sink that needs it.
    pub(super) corners_per_shared: TiVec<SharedVertex, u64>,
    /// The order of the faces.
    pub(super) order: PartOrder,
    /// What a corner has.
    pub(super) form: CornerForm,
    /// Memory for the grouping, and as much for work in flight, in bytes.
    pub(super) share: u64,
    /// Folder of temporary files.
    pub(super) work_folder: &'a Path,
    /// Receives the lines that were written.
    pub(super) progress: &'a dyn Progress,
}

/// Indices of a corner in addition to the vertex.
#[derive(Debug, Clone, Copy)]
pub(super) struct CornerForm {
    /// Whether some corner has a texture coordinate.
    pub(super) texcoords: bool,
    /// Whether every corner has a normal.
    pub(super) normals: bool,
}

impl CornerForm {
    /// Words per face of an OBJ: for each corner vertex, texture coordinate (0 for none) and normal, counted from 1.
    pub(super) fn words(self) -> usize {
        3 * (1 + usize::from(self.texcoords) + usize::from(self.normals))
    }
}

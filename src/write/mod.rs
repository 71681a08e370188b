//! Writes a stored mesh as one OBJ with its MTL and textures.
//!
//! In: a [`StoredMesh`] and the [`Catalogue`] of its parts. Out: the files of the result, which get their final names
//! only once all of them are complete: textures, then the MTL, then the OBJ. Invariant: the bytes depend on the mesh,
//! the catalogue and the options, not on the memory or the number of threads. Vertices and texture coordinates keep the
//! stored order; unused ones are left out. The faces of a part are consecutive, in the stored order.
//!
//! ```text
//!  faces ──► usage ──► numbers of vertices and texcoords ──┐
//!                                                          ▼
//!  columns ──► v, vt lines      pieces ──► vn lines, numbered faces ──► grouped by part ──► f lines
//!  catalogue ──► textures, MTL
//! ```
//!
//! # Memory
//! 3/16 byte per vertex and texture coordinate, 12 bytes per shared vertex (only with normals), and the rest of
//! [`WriteOptions::work_bytes`]: half for the grouping, half for work in flight. A piece whose normals need more than
//! that half (64 bytes per face) is processed alone.
//!
//! # Files
//! `write-faces.tmp`, `write-stars.tmp`, `write-normals.col` in the work folder, removed before [`write()`] returns.

mod batches;
mod companion;
mod copy;
mod grouping;
mod mtl;
mod normals;
mod number;
mod numbering;
mod obj;
mod options;
mod paths;
mod signature;
mod targets;
#[cfg(test)]
mod tests;
mod textures;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use self::batches::in_order;
pub use self::companion::{Companion, CopiedTexture};
use self::copy::{Look, look};
use self::grouping::Grouping;
pub use self::mtl::texture_count;
use self::normals::{PieceNormals, SharedNormals, piece_bytes, piece_normals};
use self::numbering::Usage;
use self::obj::{CornerForm, ObjFile, PartOrder};
pub use self::options::{Textures, WriteOptions};
pub use self::paths::{NamedTexture, is_texture_there, named_textures};
use self::targets::Targets;
pub use self::targets::{Sources, textures_folder, why_unnameable};
use self::textures::TextureStage;
use crate::base::bytes::MIB;
use crate::base::error::escape_path;
use crate::base::{Error, Findings, Progress, Result};
use crate::job::Recalled;
use crate::model::corners::FaceReader;
use crate::model::stored_mesh::PieceNumbering;
use crate::model::{Catalogue, NO_TEXCOORD, StoredMesh, StoredPiece};
use crate::os::durable::{DurableFile, folder_of, lock_while_open, remove_waiting};

/// Smallest memory in bytes for the grouping, and for work in flight.
const SHARE_BYTES_MIN: u64 = 4 * MIB;
/// Largest memory in bytes for each of them; more would make memory grow with the result and save little time.
pub const SHARE_BYTES_MAX: u64 = 8 * MIB;

/// The result as written.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Written {
    /// Number of `v` lines.
    pub vertices: u64,
    /// Number of `vt` lines.
    pub texcoords: u64,
    /// Number of `f` lines.
    pub faces: u64,
    /// Length of the OBJ in bytes.
    pub bytes: u64,
    /// XXH3 of the OBJ.
    pub hash: u64,
    /// The MTL and the textures.
    pub companions: Vec<Companion>,
    /// Textures that were missing (`missing_texture`) or left in place (`refused_texture`), and numbers replaced by 0
    /// (`non_finite_numbers`).
    pub findings: Findings,
}

impl Recalled for Written {
    type Context<'a> = ();

    fn is_sound(&self, (): &()) -> bool {
        self.findings.are_plain()
    }
}

/// A complete result under temporary names.
#[derive(Debug)]
pub struct Staged {
    written: Written,
    textures: TextureStage,
    /// With the state of the file that it replaces.
    mtl: Option<(DurableFile, Look)>,
    obj: ObjFile,
    targets: Targets,
    force: bool,
    may_replace_obj: bool,
}

impl Staged {
    /// Describes the result to be committed.
    pub fn written(&self) -> &Written {
        &self.written
    }

    /// Textures that were copied for it.
    pub fn copied_textures(&self) -> &[CopiedTexture] {
        &self.textures.copied
    }

    /// Textures that do not exist or may not be copied, by the paths that the materials give.
    pub fn left_out_textures(&self) -> &BTreeSet<PathBuf> {
        &self.textures.left_out
    }

    /// Renames the files to their final names: textures, then the MTL, then the OBJ.
    ///
    /// # Errors
    /// [`Error::NoSpace`] and [`Error::Io`] from the file system; [`Error::Usage`] and [`Error::Changed`] if another
    /// process has written there meanwhile; [`Error::Stopped`] if asked to stop.
    pub fn commit(self, progress: &dyn Progress) -> Result<Written> {
        // Commits are serialised where the system locks folders; otherwise the files of two jobs would mix.
        let mut is_told = false;
        let _locked = lock_while_open(&self.targets.folder, || {
            if !std::mem::replace(&mut is_told, true) {
                progress.tell(&format!("{}: locked by another process; waiting", escape_path(&self.targets.folder)));
            }
            progress.check_stopped()
        })?;
        let appeared = |path: &Path| {
            let shown = escape_path(path);
            Err(Error::Usage(format!("{shown}: was written by another process meanwhile; `force` replaces it")))
        };
        if !self.may_replace_obj && self.targets.obj.symlink_metadata().is_ok() {
            return appeared(&self.targets.obj);
        }
        if !self.force {
            let mtl = self.mtl.as_ref().map(|(_, looked)| (self.targets.mtl.as_path(), looked));
            if let Some((path, _)) = self.textures.replaced().chain(mtl).find(|(path, looked)| look(path) != **looked) {
                return appeared(path);
            }
        }
        self.textures.commit()?;
        self.mtl.map(|(mtl, _)| mtl.commit()).transpose()?;
        self.obj.commit()?;
        Ok(self.written)
    }
}

/// Writes the mesh to `output` (an OBJ), with its MTL and its textures beside it.
///
/// # Errors
/// Those of [`stage`] and of [`Staged::commit`].
pub fn write(
    mesh: &StoredMesh,
    catalogue: &Catalogue,
    output: &Path,
    work_folder: &Path,
    options: &WriteOptions,
    progress: &dyn Progress,
) -> Result<Written> {
    stage(mesh, catalogue, output, work_folder, options, progress)?.commit(progress)
}

/// Refuses an output whose OBJ, MTL or textures would replace files that they must not, before any work is done.
/// Accepts a part of the same MTL and the same textures, which an interrupted process may have left. If `was_writing`,
/// checks the OBJ and the files of the input alone.
///
/// # Errors
/// [`Error::Usage`] that names the file in the way.
pub fn check_output(output: &Path, catalogue: &Catalogue, options: &WriteOptions, was_writing: bool) -> Result<()> {
    let targets = Targets::choose(output, &options.sources, options.may_replace_obj())?;
    // NOTE: a texture that is no longer used may have left its name to another one.
    if was_writing {
        return Ok(());
    }
    if look(&targets.mtl).is_none() && look(&targets.textures()).is_none() {
        return Ok(());
    }
    let mut textures = TextureStage::rehearsal(options, &targets, catalogue);
    let library = mtl::whole_library(catalogue, &mut textures)?;
    if let Some(whole) = library {
        targets.check_mtl(&whole, options.force)?;
    }
    textures.check_targets(&[&targets.obj, &targets.mtl])
}

/// Removes temporary files that an interrupted process of the job left beside an output.
pub fn remove_waiting_of(output: &Path, job: u64) {
    remove_waiting(folder_of(output), job);
    let textures = textures_folder(output);
    if remove_waiting(&textures, job) {
        let _ = std::fs::remove_dir(textures);
    }
}

/// Writes the mesh beside `output` (an OBJ) under temporary names, with its MTL and its textures.
///
/// # Errors
/// [`Error::Usage`] if the output exists and `force` is not set, or if it is a file of the input; [`Error::NoSpace`]
/// and [`Error::Io`] from the file system; [`Error::Damaged`] if the files of the mesh are inconsistent. An existing
/// result is then unchanged, and no file of the new one is left.
pub fn stage(
    mesh: &StoredMesh,
    catalogue: &Catalogue,
    output: &Path,
    work_folder: &Path,
    options: &WriteOptions,
    progress: &dyn Progress,
) -> Result<Staged> {
    progress.begin("collect", 0, "");
    let targets = Targets::choose(output, &options.sources, options.may_replace_obj())?;
    remove_waiting_of(&targets.obj, options.job);
    let numbering = mesh.numbering()?;
    let mut usage = Usage::sweep(mesh, &numbering, catalogue.parts.len(), options.normals)?;
    let share = (options.work_bytes.saturating_sub(usage.memory_bytes()) / 2).clamp(SHARE_BYTES_MIN, SHARE_BYTES_MAX);

    if options.textures == Textures::Copy && catalogue.has_texcoords {
        progress.begin("textures", 0, "");
    }
    let mut textures = TextureStage::new(options, &targets, catalogue);
    let library = mtl::library(catalogue, &usage, &mut textures)?;
    textures.check_targets(&[&targets.obj, &targets.mtl])?;
    let mut companions = std::mem::take(&mut textures.companions);
    let mut mtl = None;
    if let Some(text) = library {
        mtl = Some(targets.begin_mtl(&text, options.force, options.job)?);
        companions.push(Companion { path: targets.mtl.clone(), content: Some((text.len() as u64, xxh3_64(&text))) });
    }

    let mut obj = ObjFile::create(&targets.obj, options.job, mtl.is_some().then(|| targets.library_name()))?;
    let lines = [usage.vertices.len(), usage.texcoords.len(), mesh.face_count()];
    progress.begin("write", lines.iter().sum(), "lines");
    obj.vertices(mesh, &numbering, &usage.vertices, share)?;
    progress.advance(lines[0]);
    obj.texcoords(mesh, &numbering, &usage.texcoords, share)?;
    progress.advance(lines[1]);

    let form = CornerForm { texcoords: usage.has_texcoords(), normals: options.normals };
    let order = PartOrder::new(catalogue, &usage);
    let corners = std::mem::take(&mut usage.corners_per_shared);
    let shared = SharedNormals::gather(mesh, corners, share, work_folder, |normals| obj.normals(normals))?;
    let faces = Grouping::new(order.counts(&usage), form.words(), share, &work_folder.join("write-faces.tmp"))?;
    let faces = Numberer { mesh, numbering: &numbering, usage: &usage, order: &order, form, shared: &shared }
        .number_faces(faces, share, &mut obj)?;
    obj.faces(faces, form, &order, catalogue, share, progress)?;

    let mut findings = Findings::default();
    findings.count("non_finite_numbers", obj.non_finite);
    findings.merge(std::mem::take(&mut textures.findings));
    let (bytes, hash) = obj.content();
    let written = Written {
        vertices: usage.vertices.len(),
        texcoords: usage.texcoords.len(),
        faces: mesh.face_count(),
        bytes,
        hash,
        companions,
        findings,
    };
    // Anything that can still fail must fail before the first file gets its final name.
    obj.seal()?;
    let (force, may_replace_obj) = (options.force, options.may_replace_obj());
    Ok(Staged { written, textures, mtl, obj, targets, force, may_replace_obj })
}

/// Converts the faces to the numbering of the result.
struct Numberer<'a> {
    mesh: &'a StoredMesh,
    numbering: &'a [PieceNumbering],
    usage: &'a Usage,
    order: &'a PartOrder,
    form: CornerForm,
    shared: &'a SharedNormals,
}

impl Numberer<'_> {
    /// Adds every face to `faces`, and writes the normals at the pieces' own vertices to the OBJ.
    fn number_faces(&self, mut faces: Grouping, memory_bytes: u64, obj: &mut ObjFile) -> Result<Grouping> {
        let mut reader = FaceReader::default();
        let mut normal_count = u64::from(self.shared.count);
        in_order(
            self.mesh.pieces.iter().zip(self.numbering),
            memory_bytes,
            |(piece, _)| if self.form.normals { piece_bytes(piece) } else { 0 },
            |(piece, ids)| match self.form.normals {
                true => Ok((piece, ids, piece_normals(self.mesh, piece, self.shared)?)),
                false => Ok((piece, ids, PieceNormals::default())),
            },
            |(piece, ids, normals)| {
                obj.normals(&normals.unique)?;
                let first_normal = normal_count;
                normal_count += normals.unique.len() as u64;
                if normal_count >= u64::from(u32::MAX) {
                    return Err(Error::Limit("the result has more than 2³² normals; leave the normals out".into()));
                }
                self.number_piece(piece, ids, &normals.corners, first_normal as u32, &mut reader, &mut faces)
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
        faces: &mut Grouping,
    ) -> Result<()> {
        let mut corner_normals = corner_normals.chunks_exact(3);
        let mut numbered = Vec::with_capacity(9);
        reader.each_block(piece, |block| {
            for face in block {
                let face = ids.globalise(face);
                numbered.clear();
                numbered.extend(face.vertices.map(|v| self.usage.vertices.rank(v) + 1));
                if self.form.texcoords {
                    let number = |t| if t == NO_TEXCOORD { 0 } else { self.usage.texcoords.rank(t) + 1 };
                    numbered.extend(face.texcoords.map(number));
                }
                if let Some(normals) = corner_normals.next() {
                    let own_base = first_normal - self.shared.count;
                    let number = |&n: &u32| if n < self.shared.count { n + 1 } else { n + own_base + 1 };
                    numbered.extend(normals.iter().map(number));
                }
                faces.push(self.order.place(face.part), &numbered)?;
            }
            Ok(())
        })
    }
}

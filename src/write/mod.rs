//! A stored mesh becomes one OBJ with its MTL and textures.
//!
//! In: a [`StoredMesh`] and the [`Catalogue`] of its parts. Out: the files of the result, under their names only once
//! all of them are whole: textures, then the MTL, then the OBJ. Invariant: the bytes depend on the mesh, the catalogue
//! and the options, not on the memory or the number of threads; vertices and texture coordinates keep the stored
//! order, those that no face uses are left out; each part's faces stand together in the stored order.
//!
//! ```text
//!  faces ──► usage ──► numbers of vertices and texcoords ──┐
//!                                                          ▼
//!  columns ──► v, vt lines      pieces ──► vn lines, numbered faces ──► grouped by part ──► f lines
//!  catalogue ──► textures, MTL
//! ```
//!
//! # Memory
//! 3/16 byte for each vertex and texture coordinate, 12 bytes for each shared vertex (only with normals), and
//! [`WriteOptions::work_bytes`] less these: half for the grouping, half for what is in flight. A piece whose normals
//! need more (64 bytes a face) than that half runs alone.
//!
//! # Files
//! `write-faces.tmp`, `write-stars.tmp`, `write-normals.col` in the work folder, removed before [`write()`] returns.

mod batches;
mod grouping;
mod mtl;
mod normals;
mod number;
mod numbering;
mod obj;
#[cfg(test)]
mod tests;
mod textures;

use std::fs;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use self::batches::in_order;
use self::grouping::Grouping;
use self::normals::{PieceNormals, SharedNormals, piece_bytes, piece_normals};
use self::numbering::{FaceReader, Usage};
use self::obj::{CornerForm, ObjFile, PartOrder};
use self::textures::TextureStage;
pub use self::textures::{is_texture_there, texture_paths};
use crate::base::bytes::MIB;
use crate::base::error::escape_path;
use crate::base::{Error, Findings, Progress, Result};
use crate::os::durable::DurableFile;
use crate::store::mesh::PieceNumbering;
use crate::store::{Catalogue, NO_TEXCOORD, StoredMesh, StoredPiece};

/// Memory that the grouping and what is in flight get at least, each.
const SHARE_BYTES_MIN: u64 = 4 * MIB;
/// The same, at most: more would make memory grow with the result and save little.
pub const SHARE_BYTES_MAX: u64 = 8 * MIB;

/// What becomes of the images that materials refer to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Textures {
    /// Copied into `<stem>_textures/` beside the output.
    #[default]
    Copy,
    /// Linked there: a symbolic link, else a hard link, else a copy.
    Link,
    /// Left where they are; the MTL names the path to them from the output's folder.
    Reference,
}

/// How the result is written.
#[derive(Debug, Clone)]
pub struct WriteOptions {
    /// What becomes of the textures.
    pub textures: Textures,
    /// Whether vertex normals are computed and written.
    pub normals: bool,
    /// Whether an older result may be replaced.
    pub force: bool,
    /// Memory that the phase may use, in bytes; below 32 MiB it uses somewhat more.
    pub work_bytes: u64,
}

/// What was written.
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
    /// Textures that were missing (`missing_texture`) or not taken along (`refused_texture`), and numbers that had to
    /// be replaced by 0 (`non_finite_numbers`).
    pub findings: Findings,
}

/// A result that is whole, and under temporary names still.
#[derive(Debug)]
pub struct Staged {
    written: Written,
    textures: TextureStage,
    mtl: Option<DurableFile>,
    obj: ObjFile,
}

impl Staged {
    /// What will have been written.
    pub fn written(&self) -> &Written {
        &self.written
    }

    /// Gives the files their names: textures, then the MTL, then the OBJ.
    ///
    /// # Errors
    /// [`Error::NoSpace`] and [`Error::Io`] from the file system.
    pub fn commit(self) -> Result<Written> {
        self.textures.commit()?;
        self.mtl.map(DurableFile::commit).transpose()?;
        self.obj.commit()?;
        Ok(self.written)
    }
}

/// Writes the mesh to `output` (an OBJ), its MTL and its textures beside it.
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
    stage(mesh, catalogue, output, work_folder, options, progress)?.commit()
}

/// Writes the mesh beside `output` (an OBJ), under temporary names, with its MTL and its textures.
///
/// # Errors
/// [`Error::Usage`] if the output exists and `force` is not set, or if it is a file of the input; [`Error::NoSpace`]
/// and [`Error::Io`] from the file system; [`Error::Damaged`] if the mesh's files do not hold what they should. An
/// older result is still whole then, and nothing of the new one is left.
pub fn stage(
    mesh: &StoredMesh,
    catalogue: &Catalogue,
    output: &Path,
    work_folder: &Path,
    options: &WriteOptions,
    progress: &dyn Progress,
) -> Result<Staged> {
    progress.begin("write", mesh.face_count(), "faces");
    let targets = Targets::choose(output, catalogue, options.force)?;
    let numbering = mesh.numbering()?;
    let mut usage = Usage::sweep(mesh, &numbering, catalogue.parts.len(), options.normals)?;
    let share = (options.work_bytes.saturating_sub(usage.memory_bytes()) / 2).clamp(SHARE_BYTES_MIN, SHARE_BYTES_MAX);

    let mut textures = TextureStage::new(options.textures, options.force, &targets.folder, &targets.stem);
    let library = mtl::library(catalogue, &usage, &mut textures)?;
    textures.check_targets(&[&targets.obj, &targets.mtl])?;
    let mtl = library.map(|text| targets.begin_mtl(&text, options.force)).transpose()?;

    let mut obj = ObjFile::create(&targets.obj, mtl.is_some().then(|| targets.library_name()))?;
    obj.vertices(mesh, &numbering, &usage.vertices, share)?;
    obj.texcoords(mesh, &numbering, &usage.texcoords, share)?;

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
        findings,
    };
    Ok(Staged { written, textures, mtl, obj })
}

/// The comment that the OBJ and the MTL begin with.
fn signature() -> Vec<u8> {
    format!("# drystone {}\n", env!("CARGO_PKG_VERSION")).into_bytes()
}

/// Where the result goes; paths in a canonical folder.
struct Targets {
    folder: PathBuf,
    stem: std::ffi::OsString,
    obj: PathBuf,
    mtl: PathBuf,
}

impl Targets {
    /// Makes the folder and checks that nothing of value is in the way.
    fn choose(output: &Path, catalogue: &Catalogue, force: bool) -> Result<Self> {
        let refuse = |why: &str| Err(Error::Usage(format!("{}: {why}", escape_path(output))));
        let (Some(name), Some(stem)) = (output.file_name(), output.file_stem()) else {
            return refuse("the output must be a file name");
        };
        if name.as_encoded_bytes().iter().any(u8::is_ascii_control) {
            return refuse("the output's name has control characters, which an OBJ cannot refer to");
        }
        let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::create_dir_all(folder).map_err(|e| Error::io(folder, "create", e))?;
        let folder = fs::canonicalize(folder).map_err(|e| Error::io(folder, "open", e))?;
        let mut mtl_name = stem.to_owned();
        mtl_name.push(".mtl");
        let targets = Self { obj: folder.join(name), mtl: folder.join(mtl_name), stem: stem.to_owned(), folder };
        if targets.obj == targets.mtl {
            return refuse("the output is the OBJ; its MTL takes this name");
        }
        if targets.obj.is_dir() {
            return refuse("is a folder; the output must be a file name");
        }
        let inputs: Vec<PathBuf> = catalogue.files.iter().filter_map(|file| fs::canonicalize(file).ok()).collect();
        for target in [&targets.obj, &targets.mtl] {
            let mut temporary = target.clone().into_os_string();
            temporary.push(".tmp");
            let temporary = PathBuf::from(temporary);
            let ends_at = fs::canonicalize(target).ok();
            if inputs.iter().any(|input| input == target || *input == temporary || Some(input) == ends_at.as_ref()) {
                return refuse("an input file would be replaced; choose another output");
            }
        }
        if !force && targets.obj.symlink_metadata().is_ok() {
            return refuse("exists; --force replaces it");
        }
        Ok(targets)
    }

    /// The MTL's name as the OBJ writes it.
    fn library_name(&self) -> &[u8] {
        self.mtl.file_name().unwrap_or_default().as_encoded_bytes()
    }

    /// Writes the MTL under its temporary name.
    fn begin_mtl(&self, text: &[u8], force: bool) -> Result<DurableFile> {
        // NOTE: the very same MTL may be there already, left by a run that was killed before its OBJ got its name.
        let present = self.mtl.symlink_metadata().is_ok();
        let same = || {
            fs::metadata(&self.mtl).is_ok_and(|found| found.len() == text.len() as u64)
                && fs::read(&self.mtl).is_ok_and(|found| found == text)
        };
        if present && !force && !same() {
            return Err(Error::Usage(format!("{}: exists; --force replaces it", escape_path(&self.mtl))));
        }
        let mut file = DurableFile::create(&self.mtl, 64 << 10)?;
        file.write(text)?;
        Ok(file)
    }
}

/// Gives faces the numbers of the result.
struct Numberer<'a> {
    mesh: &'a StoredMesh,
    numbering: &'a [PieceNumbering],
    usage: &'a Usage,
    order: &'a PartOrder,
    form: CornerForm,
    shared: &'a SharedNormals,
}

impl Numberer<'_> {
    /// Adds every face to `faces`, and the normals of the pieces' own vertices to the OBJ.
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

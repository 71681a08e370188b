//! Writes a stored mesh as one OBJ with its MTL and textures, as one PLY with its textures, or as one GLB.
//!
//! In: a [`StoredMesh`] and the [`Catalogue`] of its parts. Out: the files of the result, which get their final names
//! only once all of them are complete: textures, then the MTL, then the mesh. The ending of the output chooses the
//! format, a `MeshSink`. Invariant: the bytes depend on the mesh,
//! the catalogue and the options, not on the memory or the number of threads. Vertices and texture coordinates keep the
//! stored order; unused ones are left out. The faces of a part are consecutive, in the stored order.
//!
//! ```text
//!  faces ──► usage ──► numbers of vertices and texcoords ──┐
//!                                                          ▼
//!  columns ──► vertices, texcoords      pieces ──► normals, numbered faces ──► grouped by part ──► faces
//!  catalogue ──► textures, MTL
//! ```
//!
//! # Memory
//! 3/16 byte per vertex and texture coordinate, 12 bytes per shared vertex (only with normals), and the rest of
//! [`WriteOptions::work_bytes`]: half for the grouping, half for work in flight. A piece whose normals need more than
//! that half (64 bytes per face) is processed alone.
//!
//! # Files
//! In the work folder, `write-faces.tmp`, `write-stars.tmp`, `write-vertices.tmp` and `write-normals.col`, removed before
//! [`write()`] returns; `write-image-<number>.png`, an image that a GLB cannot hold as it is.

mod arrays;
mod companion;
mod copy;
mod face_sweep;
mod format;
mod glb;
pub mod glb_format;
mod grouping;
mod losses;
mod normals;
mod numbered;
mod numbering;
mod obj;
mod options;
mod order;
mod paths;
mod ply;
mod result_file;
mod signature;
mod sink;
mod targets;
#[cfg(test)]
mod tests;
mod textures;
mod vertex_normals;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use self::arrays::ArraySink;
pub use self::companion::{Companion, CopiedTexture};
use self::copy::{Look, look};
pub use self::format::ResultFormat;
use self::glb::GlbSink;
use self::losses::note_losses;
pub use self::losses::texture_count;
use self::numbering::Usage;
use self::obj::{ObjSink, mtl};
pub use self::options::{Textures, WriteOptions};
use self::order::PartOrder;
pub use self::paths::{NamedTexture, named_textures};
use self::ply::PlySink;
use self::sink::{CornerForm, MeshSink, ResultMesh};
use self::targets::Targets;
pub use self::targets::{Sources, textures_folder, why_unnameable};
use self::textures::TextureStage;
use crate::base::bytes::MIB;
use crate::base::error::escape_path;
use crate::base::pool;
use crate::base::{Error, Findings, Progress, Result};
use crate::job::{Recalled, StepKey};
use crate::model::{Catalogue, StoredMesh};
use crate::os::content::Content;
use crate::os::durable::{DurableFile, folder_of, lock_while_open, remove_waiting};
use serde::{Deserialize, Serialize};

/// Step that records the path of the output, where temporary files may lie.
pub const OUTPUT: StepKey = StepKey::fixed("write-output");
/// Step that records the published result.
pub const RESULT: StepKey = StepKey::fixed("write-result");

/// Smallest memory in bytes for the grouping, and for work in flight.
const SHARE_BYTES_MIN: u64 = 4 * MIB;
/// Memory in bytes for each of them that more would save no time with, on few threads.
const SHARE_BYTES: u64 = 8 * MIB;
/// The same for each thread: a block of faces or lines, and one that waits.
const THREAD_SHARE_BYTES: u64 = 3 * MIB;

/// Largest memory in bytes for the grouping, and for work in flight; more would make memory grow with the result and save
/// no time.
pub fn share_bytes_max(threads: usize) -> u64 {
    SHARE_BYTES.max(threads as u64 * THREAD_SHARE_BYTES)
}

/// The result as written.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Written {
    /// Number of vertices.
    pub vertices: u64,
    /// Number of texture coordinates that are used.
    pub texcoords: u64,
    /// Number of faces.
    pub faces: u64,
    /// Content of the mesh file.
    pub content: Content,
    /// The MTL and the textures.
    pub companions: Vec<Companion>,
    /// Textures that were missing (`missing_texture`) or left in place (`refused_texture`), numbers replaced by 0
    /// (`non_finite_numbers`), and what the format cannot hold.
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
    sink: Box<dyn MeshSink>,
    targets: Targets,
    force: bool,
    may_replace_mesh: bool,
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

    /// Renames the files to their final names: textures, then the MTL, then the mesh.
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
        if !self.may_replace_mesh && self.targets.mesh.symlink_metadata().is_ok() {
            return appeared(&self.targets.mesh);
        }
        if !self.force {
            let mtl = self.targets.mtl.as_deref().zip(self.mtl.as_ref().map(|(_, looked)| looked));
            if let Some((path, _)) = self.textures.replaced().chain(mtl).find(|(path, looked)| look(path) != **looked) {
                return appeared(path);
            }
        }
        self.textures.commit()?;
        self.mtl.map(|(mtl, _)| mtl.commit()).transpose()?;
        self.sink.commit()?;
        Ok(self.written)
    }
}

/// Writes the mesh to `output` (an OBJ, a PLY or a GLB), with its MTL and its textures beside it.
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

/// Refuses an output whose mesh, MTL or textures would replace files that they must not, before any work is done.
/// Accepts a part of the same MTL and the same textures, which an interrupted process may have left. If `was_writing`,
/// checks the mesh and the files of the input alone.
///
/// # Errors
/// [`Error::Usage`] that names the file in the way.
pub fn check_output(output: &Path, catalogue: &Catalogue, options: &WriteOptions, was_writing: bool) -> Result<()> {
    let targets = Targets::choose(output, &options.sources, options.may_replace_mesh())?;
    // NOTE: a texture that is no longer used may have left its name to another one.
    if was_writing {
        return Ok(());
    }
    if !targets.format.has_companions()
        || targets.mtl.as_deref().is_none_or(|mtl| look(mtl).is_none()) && look(&targets.textures()).is_none()
    {
        return Ok(());
    }
    let mut textures = TextureStage::rehearsal(options, &targets, catalogue);
    match &targets.mtl {
        Some(mtl) => {
            if let Some(whole) = mtl::whole_library(catalogue, &mut textures)? {
                targets.check_mtl(mtl, &whole, options.force)?;
            }
        }
        None => _ = ply::stage_whole_images(catalogue, &mut textures)?,
    }
    textures.check_targets(&targets.files())
}

/// Refuses an output with new textures that would replace files, before any work is done: an MTL, or a folder of
/// textures. If `was_writing`, checks the mesh and the files of the input alone.
///
/// # Errors
/// [`Error::Usage`] that names the file in the way.
pub fn check_baked_output(output: &Path, options: &WriteOptions, was_writing: bool) -> Result<()> {
    let targets = Targets::choose(output, &options.sources, options.may_replace_mesh())?;
    if was_writing || options.may_replace_mesh() || !targets.format.has_companions() {
        return Ok(());
    }
    let textures = targets.textures();
    let is_filled = textures.read_dir().is_ok_and(|mut entries| entries.next().is_some());
    let mtl = targets.mtl.as_deref().filter(|mtl| look(mtl).is_some());
    match mtl.or(Some(&*textures).filter(|_| is_filled)) {
        Some(path) => Err(Error::Usage(format!("{}: already there; `force` replaces it", escape_path(path)))),
        None => Ok(()),
    }
}

/// Removes temporary files that an interrupted process of the job left beside an output.
pub fn remove_waiting_of(output: &Path, job: u64) {
    remove_waiting(folder_of(output), job);
    let textures = textures_folder(output);
    if remove_waiting(&textures, job) {
        let _ = std::fs::remove_dir(textures);
    }
}

/// Writes the mesh beside `output` (an OBJ, a PLY or a GLB) under temporary names, with its MTL and its textures.
///
/// # Errors
/// [`Error::Usage`] if the output exists and `force` is not set, or if it is a file of the input; [`Error::NoSpace`]
/// and [`Error::Io`] from the file system; [`Error::Damaged`] if the files of the mesh are inconsistent;
/// [`Error::Stopped`]. An existing result is then unchanged, and no file of the new one is left.
pub fn stage(
    mesh: &StoredMesh,
    catalogue: &Catalogue,
    output: &Path,
    work_folder: &Path,
    options: &WriteOptions,
    progress: &dyn Progress,
) -> Result<Staged> {
    progress.begin("collect", 0, "");
    let targets = Targets::choose(output, &options.sources, options.may_replace_mesh())?;
    remove_waiting_of(&targets.mesh, options.job);
    let numbering = mesh.numbering()?;
    let counts_corners = options.normals && targets.mtl.is_some();
    let usage = Usage::none(mesh, catalogue.parts.len(), counts_corners);
    let share = options.work_bytes.saturating_sub(usage.memory_bytes()) / 2;
    let share = share.clamp(SHARE_BYTES_MIN, share_bytes_max(pool::thread_count()));
    let mut usage = usage.sweep(mesh, &numbering, share)?;
    if options.textures == Textures::Copy && catalogue.has_texcoords {
        progress.begin("textures", 0, "");
    }
    let mut textures = TextureStage::new(options, &targets, catalogue);
    note_losses(catalogue, &usage, &mut textures.findings);
    let Begun { mut sink, mtl, companions } = begin(&targets, catalogue, &usage, &mut textures, options, work_folder)?;

    let lines = [usage.vertices.len(), usage.texcoords.len(), mesh.face_count()];
    progress.begin("write", lines.iter().sum(), "lines");
    let form = CornerForm { texcoords: usage.has_texcoords(), normals: options.normals };
    let order = PartOrder::new(catalogue, &usage);
    let corners_per_shared = std::mem::take(&mut usage.corners_per_shared);
    let (numbering, usage) = (&numbering[..], &usage);
    let mut result =
        ResultMesh { mesh, catalogue, numbering, usage, corners_per_shared, order, form, share, work_folder, progress };
    sink.vertices(&result)?;
    progress.advance(lines[0]);
    sink.texcoords(&result)?;
    progress.advance(lines[1]);
    sink.faces(&mut result)?;

    let mut findings = Findings::default();
    // Anything that can still fail must fail before the first file gets its final name.
    let content = sink.finish(&mut findings)?;
    findings.merge(std::mem::take(&mut textures.findings));
    let [vertices, texcoords, faces] = lines;
    let written = Written { vertices, texcoords, faces, content, companions, findings };
    let (force, may_replace_mesh) = (options.force, options.may_replace_mesh());
    Ok(Staged { written, textures, mtl, sink, targets, force, may_replace_mesh })
}

/// A result that has begun: its mesh file, and the files beside it.
struct Begun {
    sink: Box<dyn MeshSink>,
    mtl: Option<(DurableFile, Look)>,
    companions: Vec<Companion>,
}

/// Stages the textures and what names them, and creates the mesh file.
fn begin(
    targets: &Targets,
    catalogue: &Catalogue,
    usage: &Usage,
    textures: &mut TextureStage,
    options: &WriteOptions,
    work_folder: &Path,
) -> Result<Begun> {
    if targets.format == ResultFormat::Glb {
        // The result is measured at the same time.
        let work_bytes = options.work_bytes.saturating_sub(usage.memory_bytes()) / 2;
        let limits = glb::ImageLimits { work_folder, work_bytes };
        let images = glb::find_images(catalogue, usage, textures, &limits)?;
        let sink = Box::new(GlbSink::begin(&targets.mesh, options.job, images, options.turns_z_up)?);
        return Ok(Begun { sink, mtl: None, companions: Vec::new() });
    }
    let Some(path) = &targets.mtl else {
        let images = ply::stage_images(catalogue, usage, textures)?;
        textures.check_targets(&targets.files())?;
        let sink: Box<dyn MeshSink> = match targets.format {
            ResultFormat::Arrays => Box::new(ArraySink::begin(&targets.mesh, options.job, images)?),
            _ => Box::new(PlySink::begin(&targets.mesh, options.job, images)?),
        };
        return Ok(Begun { sink, mtl: None, companions: std::mem::take(&mut textures.companions) });
    };
    let library = mtl::library(catalogue, usage, textures)?;
    textures.check_targets(&targets.files())?;
    let mut companions = std::mem::take(&mut textures.companions);
    let mut mtl = None;
    if let Some(text) = library {
        mtl = Some(targets.begin_mtl(path, &text, options.force, options.job)?);
        companions.push(Companion { path: path.clone(), content: Some(Content::of_bytes(&text)) });
    }
    let sink = Box::new(ObjSink::begin(&targets.mesh, options.job, mtl.is_some().then(|| targets.library_name()))?);
    Ok(Begun { sink, mtl, companions })
}

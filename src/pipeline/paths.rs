//! Refuses outputs that cannot be written, or that conflict with the input or the work folder.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use crate::base::error::escape_path;
use crate::base::{Error, Result};
use crate::options::TextureFiles;
use crate::os::durable::{DurableFile, folder_of, make_folders};
use crate::read::InputChoice;
use crate::write::{ResultFormat, Sources, textures_folder, why_unnameable};

/// Longest name of a file in bytes, and the ending of the longest name that is made of the output's name.
const NAME_BYTES_MAX: usize = 255;
const LONGEST_ENDING: &str = ".work-measure";

/// What a job writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum OutputKind {
    /// A mesh file, with textures beside it.
    File(TextureFiles),
    /// A folder of tiles.
    Folder,
}

/// Refuses, before anything is read or written, an output that cannot be one, or is one of the inputs, and paths that
/// conflict with each other.
pub(super) fn refuse(
    choice: &InputChoice,
    inputs: &[PathBuf],
    output: &Path,
    work: &Path,
    kind: OutputKind,
) -> Result<()> {
    let Some(name) = output.file_name() else {
        return Err(refused(output, "the output must have a name, such as out/city.obj"));
    };
    if name.len() + LONGEST_ENDING.len() > NAME_BYTES_MAX {
        return Err(refused(output, "the output's name is too long"));
    }
    match kind {
        OutputKind::File(textures) => refuse_file(output, name, textures)?,
        OutputKind::Folder if output.metadata().is_ok_and(|there| !there.is_dir()) => {
            return Err(refused(output, "the output is a folder for tiles, and there is a file"));
        }
        OutputKind::Folder => {}
    }
    let there = resolved(output);
    if let Some(folder) = choice.folders().find(|folder| there.starts_with(resolved(folder))) {
        let words = format!("lies below the input, {}; choose a name outside of it", escape_path(folder));
        return Err(refused(output, &words));
    }
    if Sources::new(inputs.iter().map(PathBuf::as_path)).are_at(output) {
        return Err(refused(output, "the output is the input; choose another name"));
    }
    if kind == OutputKind::Folder && inputs.iter().any(|input| resolved(input).starts_with(&there)) {
        return Err(refused(output, "holds the input; choose another folder"));
    }
    let work_folder = resolved(work);
    if there.starts_with(&work_folder)
        || work_folder.starts_with(textures_folder(&there))
        || work_folder.starts_with(&there)
    {
        let words =
            "the output, or its folder of textures, and the work folder lie in each other; choose another `work`";
        return Err(refused(work, words));
    }
    if inputs.iter().any(|input| resolved(input).starts_with(&work_folder)) {
        return Err(refused(work, "the input lies in the work folder; choose another `work`"));
    }
    Ok(())
}

pub(super) fn refused(path: &Path, words: &str) -> Error {
    Error::Usage(format!("{}: {words}", escape_path(path)))
}

/// Refuses a mesh file that cannot be one.
fn refuse_file(output: &Path, name: &OsStr, textures: TextureFiles) -> Result<()> {
    if output.is_dir() {
        return Err(refused(output, "the output must be a file, such as out/city.obj"));
    }
    let Some(format) = ResultFormat::by_ending(output) else {
        let words = "the output is an OBJ, a PLY or a GLB file: its name must end in .obj, .ply or .glb";
        return Err(refused(output, words));
    };
    if format == ResultFormat::Glb && matches!(textures, TextureFiles::Link | TextureFiles::Reference) {
        return Err(refused(output, "a GLB holds its images: `textures` is copy or bake"));
    }
    if let Some(why) = why_unnameable(name) {
        return Err(refused(output, why));
    }
    // A device or a pipe would be replaced by a file.
    if output.metadata().is_ok_and(|there| !there.is_file()) {
        return Err(refused(output, "is there already, and no regular file"));
    }
    Ok(())
}

/// Checks, before the work is done, that the output can be written, and refuses to replace an existing one.
pub(super) fn prepare(output: &Path, job: u64, may_exist: bool) -> Result<()> {
    make_folders(folder_of(output))?;
    DurableFile::create_outside(output, job, 0).map(drop)?;
    refuse_existing(output, may_exist)
}

/// Refuses to replace an existing mesh file.
pub(super) fn refuse_existing(output: &Path, may_exist: bool) -> Result<()> {
    if !may_exist && output.symlink_metadata().is_ok() {
        return Err(Error::Usage(format!("{}: exists already; `force` replaces it", escape_path(output))));
    }
    Ok(())
}

/// A path with links resolved, as far as it exists.
pub(super) fn resolved(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let there = absolute.ancestors().find_map(|above| Some((above.canonicalize().ok()?, above)));
    match there {
        Some((canonical, above)) => absolute.strip_prefix(above).map_or(canonical.clone(), |rest| canonical.join(rest)),
        None => absolute,
    }
}

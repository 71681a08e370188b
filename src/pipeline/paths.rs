//! Refuses outputs that cannot be written, or that conflict with the input or the work folder.

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

/// Refuses, before anything is read or written, an output that is no OBJ, PLY or GLB, or one of the inputs, and paths that
/// conflict with each other.
pub(super) fn refuse(
    choice: &InputChoice,
    inputs: &[PathBuf],
    output: &Path,
    work: &Path,
    textures: TextureFiles,
) -> Result<()> {
    let shown = escape_path(output);
    let refused = |words: &str| Err(Error::Usage(format!("{shown}: {words}")));
    let (Some(name), false) = (output.file_name(), output.is_dir()) else {
        return refused("the output must be a file, such as out/city.obj");
    };
    if ResultFormat::by_ending(output).is_none() {
        return refused("the output is an OBJ, a PLY or a GLB file: its name must end in .obj, .ply or .glb");
    }
    let leaves_images = matches!(textures, TextureFiles::Link | TextureFiles::Reference);
    if leaves_images && ResultFormat::by_ending(output) == Some(ResultFormat::Glb) {
        return refused("a GLB holds its images: `textures` is copy or bake");
    }
    if let Some(why) = why_unnameable(name) {
        return refused(why);
    }
    if name.len() + LONGEST_ENDING.len() > NAME_BYTES_MAX {
        return refused("the output's name is too long");
    }
    // A device or a pipe would be replaced by a file.
    if output.metadata().is_ok_and(|there| !there.is_file()) {
        return refused("is there already, and no regular file");
    }
    let there = resolved(output);
    if let Some(folder) = choice.folders().find(|folder| there.starts_with(resolved(folder))) {
        return refused(&format!("lies below the input, {}; choose a name outside of it", escape_path(folder)));
    }
    if Sources::new(inputs.iter().map(PathBuf::as_path)).are_at(output) {
        return refused("the output is the input; choose another name");
    }
    let work_folder = resolved(work);
    let shown = escape_path(work);
    if there.starts_with(&work_folder) || work_folder.starts_with(textures_folder(&there)) {
        return Err(Error::Usage(format!(
            "{shown}: the output, or its folder of textures, and the work folder lie in each other; choose another `work`"
        )));
    }
    if inputs.iter().any(|input| resolved(input).starts_with(&work_folder)) {
        return Err(Error::Usage(format!("{shown}: the input lies in the work folder; choose another `work`")));
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

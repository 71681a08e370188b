//! Checks the output file before the work is done: refuses one that cannot be written, and recognises an earlier
//! result.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::base::error::escape_path;
use crate::base::{Error, Result};
use crate::file::codec;
use crate::job::{Step, WorkFolder};
use crate::os::durable::{DurableFile, folder_of, make_folders};
use crate::read::{InputChoice, MeshFormat, fingerprint};
use crate::write::{Companion, Sources, Written, remove_waiting_of, textures_folder, why_unnameable};

/// Longest name of a file in bytes, and the ending of the longest name that is made of the output's name.
const NAME_BYTES_MAX: usize = 255;
const LONGEST_ENDING: &str = ".work-measure";

/// Result of a process that ended while its files were being renamed to their final names.
pub(super) enum Earlier {
    /// No result, or it is no longer there.
    Nothing,
    /// The mesh is there; its MTL or some textures are missing.
    Obj,
    /// All files are there.
    Whole(Written),
}

/// Looks for the result of an earlier process.
pub(super) fn earlier(job: &WorkFolder, output: &Path) -> Result<Earlier> {
    let is_sound = |written: &mut Written| written.findings.are_plain();
    let Some(written) = job.recall_if(Step::Written, is_sound)? else { return Ok(Earlier::Nothing) };
    let there = resolved(output);
    // The folder of textures may be a link.
    let folders = [folder_of(&there).to_owned(), resolved(&textures_folder(&there))];
    let is_beside = written.companions.iter().all(|c| folders.iter().any(|folder| c.path.starts_with(folder)));
    if !is_beside || !fingerprint::content(output).is_ok_and(|content| content == (written.bytes, written.hash)) {
        return Ok(Earlier::Nothing);
    }
    if !written.companions.iter().all(Companion::is_there) {
        return Ok(Earlier::Obj);
    }
    // The same files were there before; copies of them waited for their final names when the process ended.
    remove_waiting_of(output, job.number());
    Ok(Earlier::Whole(written))
}

/// Refuses, before anything is read or written, an output that is no OBJ or PLY or one of the inputs, and paths that conflict
/// with each other.
pub(super) fn refuse(choice: &InputChoice, inputs: &[PathBuf], output: &Path, work: &Path) -> Result<()> {
    let shown = escape_path(output);
    let refused = |words: &str| Err(Error::Usage(format!("{shown}: {words}")));
    let (Some(name), false) = (output.file_name(), output.is_dir()) else {
        return refused("the output must be a file, such as out/city.obj");
    };
    if MeshFormat::by_ending(output).is_none() {
        return refused("the output is an OBJ or a PLY file: its name must end in .obj or .ply");
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
            "{shown}: the output, or its folder of textures, and the work folder lie in each other; choose another --work"
        )));
    }
    if inputs.iter().any(|input| resolved(input).starts_with(&work_folder)) {
        return Err(Error::Usage(format!("{shown}: the input lies in the work folder; choose another --work")));
    }
    Ok(())
}

/// Whether an earlier process of the job had begun to write the result there. If it wrote elsewhere, removes the files
/// that wait for their final names.
///
/// # Errors
/// Those of [`WorkFolder::recall`].
pub(super) fn was_writing(job: &WorkFolder, output: &Path) -> Result<bool> {
    let there = OutputPlace { obj: resolved(output) };
    let Some(earlier) = job.recall::<OutputPlace>(Step::Output)? else { return Ok(false) };
    if earlier != there {
        remove_waiting_of(&earlier.obj, job.number());
    }
    Ok(earlier == there)
}

/// Records where the files of the result will wait for their final names.
///
/// # Errors
/// Those of [`WorkFolder::keep`].
pub(super) fn remember(job: &WorkFolder, output: &Path) -> Result<()> {
    job.keep(Step::Output, 0, [], &OutputPlace { obj: resolved(output) })
}

/// Path of the output.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
struct OutputPlace {
    #[serde(with = "codec::path")]
    obj: PathBuf,
}

/// Checks, before the work is done, that the output can be written, and refuses to replace an existing one.
pub(super) fn check(output: &Path, job: u64, may_exist: bool) -> Result<()> {
    make_folders(folder_of(output))?;
    DurableFile::create_outside(output, job, 0).map(drop)?;
    refuse_existing(output, may_exist)
}

/// Refuses to replace an existing mesh.
pub(super) fn refuse_existing(output: &Path, may_exist: bool) -> Result<()> {
    if !may_exist && output.symlink_metadata().is_ok() {
        return Err(Error::Usage(format!("{}: exists already; --force replaces it", escape_path(output))));
    }
    Ok(())
}

/// A path with links resolved, as far as it exists.
fn resolved(path: &Path) -> PathBuf {
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let there = absolute.ancestors().find_map(|above| Some((above.canonicalize().ok()?, above)));
    match there {
        Some((canonical, above)) => absolute.strip_prefix(above).map_or(canonical.clone(), |rest| canonical.join(rest)),
        None => absolute,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Silent;
    use crate::options::SimplifyOptions;

    const SPHERE: &str = "fixtures/miniatures/closed_sphere.obj";

    fn refusal(input: &Path, output: &Path) -> String {
        let options = SimplifyOptions { ratio: Some(0.5), force: true, ..SimplifyOptions::default() };
        let error = crate::pipeline::simplify(input, output, &options, &Silent).unwrap_err();
        assert_eq!(error.exit_code(), 2, "{error}");
        error.to_string()
    }

    #[test]
    fn an_output_that_is_named_like_another_format_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.stl", "a", ".obj", ".ply", "a.obj.gz"] {
            let words = refusal(Path::new(SPHERE), &folder.path().join(name));
            assert!(words.contains("must end in .obj or .ply"), "{words}");
        }
        assert_eq!(folder.path().read_dir().unwrap().count(), 0);
    }

    /// Records the phases that began.
    #[derive(Default)]
    struct Phases(std::sync::Mutex<Vec<&'static str>>);

    impl crate::base::Progress for Phases {
        fn begin(&self, phase: &'static str, _total: u64, _unit: &'static str) {
            self.0.lock().unwrap().push(phase);
        }
        fn advance(&self, _units: u64) {}
    }

    #[test]
    fn an_mtl_or_a_texture_of_others_is_refused_before_the_passes() {
        let input = Path::new("fixtures/town/town.obj");
        for other in ["a.mtl", "a_textures/roof.jpg"] {
            let folder = tempfile::tempdir().unwrap();
            let output = folder.path().join("a.obj");
            std::fs::create_dir(folder.path().join("a_textures")).unwrap();
            std::fs::write(folder.path().join(other), "mine").unwrap();
            let run =
                |options: &SimplifyOptions, phases: &Phases| crate::pipeline::simplify(input, &output, options, phases);
            let (phases, options) = (Phases::default(), SimplifyOptions { ratio: Some(0.5), ..Default::default() });
            let error = run(&options, &phases).unwrap_err();
            assert!(error.exit_code() == 2 && error.to_string().contains(other), "{error}");
            assert_eq!(*phases.0.lock().unwrap(), ["scan"]);
            assert_eq!(std::fs::read(folder.path().join(other)).unwrap(), b"mine");
            run(&SimplifyOptions { force: true, ..options.clone() }, &phases).unwrap();
            // Files that a stopped process left do not get in the way.
            std::fs::remove_file(&output).unwrap();
            run(&options, &phases).unwrap();
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("a.obj");
        std::os::unix::fs::symlink("/dev/null", &output).unwrap();
        let words = refusal(Path::new(SPHERE), &output);
        assert!(words.contains("no regular file"), "{words}");
        assert!(output.is_symlink());
    }

    #[test]
    fn what_waits_where_an_earlier_process_was_to_write_goes() {
        use crate::job::Resume;
        use crate::os::durable::waiting_place;
        for resume in [Resume::Auto, Resume::Never] {
            let folder = tempfile::tempdir().unwrap();
            let path = |name: &str| folder.path().join(name);
            let manifest = crate::pipeline::manifest(&"".into(), &[], &SimplifyOptions::default()).unwrap();
            let open = |resume| WorkFolder::open(&path("work"), &manifest, resume).unwrap();
            let job = open(Resume::Auto);
            std::fs::create_dir_all(path("a/city_textures")).unwrap();
            remember(&job, &path("a/city.obj")).unwrap();
            for name in ["a/city.obj", "a/city_textures/wall.png"] {
                std::fs::write(waiting_place(&path(name), job.number()), "").unwrap();
            }
            let of_other = waiting_place(&path("a/city.obj"), job.number() + 1);
            std::fs::write(&of_other, "").unwrap();
            drop(job);
            let job = open(resume);
            was_writing(&job, &path("a/../a/city.obj")).unwrap();
            assert!(path("a/city_textures").exists());
            was_writing(&job, &path("b/city.obj")).unwrap();
            let left: Vec<_> = path("a").read_dir().unwrap().map(|entry| entry.unwrap().path()).collect();
            assert_eq!(left, [of_other]);
        }
    }

    #[test]
    fn an_earlier_result_below_the_input_folder_is_not_taken_for_input() {
        let folder = tempfile::tempdir().unwrap();
        let output: PathBuf = folder.path().join("out/a.obj");
        std::fs::create_dir(folder.path().join("out")).unwrap();
        std::fs::copy(SPHERE, &output).unwrap();
        let words = refusal(folder.path(), &output);
        assert!(words.contains("lies below the input"), "{words}");
    }
}

//! What an earlier process left where the result goes.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::paths::{prepare, resolved};
use super::preflight::Preflight;
use crate::base::Result;
use crate::file::codec;
use crate::job::{Recalled, Step, WorkFolder};
use crate::os::content::Content;
use crate::os::durable::folder_of;
use crate::write::{Companion, OUTPUT, RESULT, Written, remove_waiting_of, textures_folder};

/// Result of a process that ended while its files were being renamed to their final names.
pub(super) enum Earlier {
    /// No result, or it is no longer there.
    Nothing,
    /// The mesh is there; its MTL or some textures are missing.
    Obj,
    /// All files are there.
    Whole(Written),
}

/// What an earlier process left where the result goes.
pub(super) struct EarlierOutput {
    /// Its result.
    pub found: Earlier,
    /// Whether it had begun to write there.
    pub was_writing: bool,
}

impl EarlierOutput {
    /// Looks for the output of an earlier process of the job. Refuses to replace a result of another job.
    ///
    /// # Errors
    /// [`Error::Usage`] if the output exists; those of the work folder and of the file system.
    pub fn look(job: &Preflight<'_>, work: &WorkFolder) -> Result<Self> {
        let there = Self { found: earlier(work, job.output)?, was_writing: was_writing(work, job.output)? };
        prepare(job.output, work.number(), job.options.job.force || there.is_own())?;
        Ok(there)
    }

    /// Whether the job itself wrote the mesh file.
    pub fn is_own(&self) -> bool {
        !matches!(self.found, Earlier::Nothing)
    }
}

/// Looks for the result of an earlier process.
fn earlier(job: &WorkFolder, output: &Path) -> Result<Earlier> {
    let Some(written) = job.recall::<Written>(&RESULT, &())? else { return Ok(Earlier::Nothing) };
    let there = resolved(output);
    // The folder of textures may be a link.
    let folders = [folder_of(&there).to_owned(), resolved(&textures_folder(&there))];
    let is_beside = written.companions.iter().all(|c| folders.iter().any(|folder| c.path.starts_with(folder)));
    if !is_beside || !Content::of(output).is_ok_and(|content| content == written.content) {
        return Ok(Earlier::Nothing);
    }
    if !written.companions.iter().all(Companion::is_there) {
        return Ok(Earlier::Obj);
    }
    // The same files were there before; copies of them waited for their final names when the process ended.
    remove_waiting_of(output, job.number());
    Ok(Earlier::Whole(written))
}

/// Whether an earlier process of the job had begun to write the result there. If it wrote elsewhere, removes the files
/// that wait for their final names.
///
/// # Errors
/// Those of [`WorkFolder::recall`].
pub(super) fn was_writing(job: &WorkFolder, output: &Path) -> Result<bool> {
    let there = OutputPlace { obj: resolved(output) };
    let Some(earlier) = job.recall::<OutputPlace>(&OUTPUT, &())? else { return Ok(false) };
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
    job.keep(Step::new(OUTPUT).that_outlasts(), [], &OutputPlace { obj: resolved(output) })
}

/// Path of the output.
#[derive(Debug, PartialEq, Eq, Serialize, Deserialize)]
struct OutputPlace {
    #[serde(with = "codec::path")]
    obj: PathBuf,
}

impl Recalled for OutputPlace {
    type Context<'a> = ();

    /// It is only compared.
    fn is_sound(&self, (): &()) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ErrorKind;
    use crate::base::Silent;
    use crate::options::{JobOptions, SimplifyOptions, Target};

    const SPHERE: &str = "fixtures/miniatures/closed_sphere.obj";

    fn refusal(input: &Path, output: &Path) -> String {
        let options = SimplifyOptions {
            target: Target::ratio(0.5),
            job: JobOptions { force: true, ..JobOptions::default() },
            ..SimplifyOptions::default()
        };
        let error = crate::pipeline::simplify(input, output, &options, &Silent).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Usage, "{error}");
        error.to_string()
    }

    #[test]
    fn an_output_that_is_named_like_another_format_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.stl", "a", ".obj", ".ply", "a.obj.gz"] {
            let words = refusal(Path::new(SPHERE), &folder.path().join(name));
            assert!(words.contains("must end in .obj, .ply or .glb"), "{words}");
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
            let (phases, options) =
                (Phases::default(), SimplifyOptions { target: Target::ratio(0.5), ..Default::default() });
            let error = run(&options, &phases).unwrap_err();
            assert!(error.kind() == ErrorKind::Usage && error.to_string().contains(other), "{error}");
            assert_eq!(*phases.0.lock().unwrap(), ["scan"]);
            assert_eq!(std::fs::read(folder.path().join(other)).unwrap(), b"mine");
            run(
                &SimplifyOptions { job: JobOptions { force: true, ..options.clone().job }, ..options.clone() },
                &phases,
            )
            .unwrap();
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
            let manifest = crate::pipeline::preflight::manifest(&"".into(), &[], &SimplifyOptions::default()).unwrap();
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

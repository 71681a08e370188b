//! The file that is to be written, before the work is done: one that cannot be is refused, one that is there already is known.

use std::path::Path;

use super::input::Reading;
use crate::base::error::escape_path;
use crate::base::{Error, Result};
use crate::job::{Step, WorkFolder};
use crate::os::durable::DurableFile;
use crate::scan::fingerprint;
use crate::write::Written;

/// What a process that was ended after its result had its name had written, if it is there still.
pub(super) fn finished(job: &WorkFolder, output: &Path) -> Result<Option<Written>> {
    let Some(written) = job.recall::<Written>(Step::Written)? else { return Ok(None) };
    let content = fingerprint::content(output).ok();
    Ok((content == Some((written.bytes, written.hash))).then_some(written))
}

/// Refuses, before anything is read, an output that is no OBJ, exists or is one of the inputs.
pub(super) fn refuse(reading: &Reading<'_>, output: &Path, may_exist: bool) -> Result<()> {
    let shown = escape_path(output);
    let refused = |words: &str| Err(Error::Usage(format!("{shown}: {words}")));
    if output.file_name().is_none() || output.is_dir() {
        return refused("the output must be a file, such as out/city.obj");
    }
    if !output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("obj")) {
        return refused("the output is an OBJ file: its name must end in .obj");
    }
    // A device or a pipe would be replaced by a file.
    if output.metadata().is_ok_and(|there| !there.is_file()) {
        return refused("is there already, and no regular file");
    }
    try_output(output)?;
    let Ok(there) = output.canonicalize() else { return Ok(()) };
    if reading.inputs.iter().any(|input| input.canonicalize().is_ok_and(|input| input == there)) {
        return match reading.path.is_dir() {
            true => {
                refused(&format!("lies below the input, {}; choose a name outside of it", escape_path(reading.path)))
            }
            false => refused("the output is the input; choose another name"),
        };
    }
    if !may_exist {
        return refused("exists already; --force replaces it");
    }
    Ok(())
}

/// Finds out, before the work is done, whether the output can be written.
fn try_output(output: &Path) -> Result<()> {
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "create", e))?;
    DurableFile::create(output, 0).map(drop)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

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
        for name in ["a.ply", "a", ".obj", "a.obj.gz"] {
            let words = refusal(Path::new(SPHERE), &folder.path().join(name));
            assert!(words.contains("must end in .obj"), "{words}");
        }
        assert_eq!(folder.path().read_dir().unwrap().count(), 0);
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
    fn an_earlier_result_below_the_input_folder_is_not_taken_for_input() {
        let folder = tempfile::tempdir().unwrap();
        let output: PathBuf = folder.path().join("out/a.obj");
        std::fs::create_dir(folder.path().join("out")).unwrap();
        std::fs::copy(SPHERE, &output).unwrap();
        let words = refusal(folder.path(), &output);
        assert!(words.contains("lies below the input"), "{words}");
    }
}

//! `drystone simplify`: one OBJ, or many, becomes one with fewer triangles.

use std::path::{Path, PathBuf};

use clap::Args;

use super::compare::{SamplingArguments, compare_meshes};
use super::progress::{stoppable, tell};
use super::stop::Goodbye;
use crate::base::error::escape_path;
use crate::base::{Error, Result};
use crate::options::{Drawing, SimplifyOptions};
use crate::os::durable::make_folders;
use crate::os::signals::StopSignal;
use crate::pipeline;
use crate::report;
use crate::report::gallery::Relief;

/// Arguments of `drystone simplify`.
#[derive(Debug, Args)]
pub struct SimplifyArguments {
    /// OBJ file, or a folder: every OBJ in it and below it becomes one mesh
    input: PathBuf,
    /// OBJ file to write; its MTL and textures go beside it
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    options: SimplifyOptions,
    /// Write a report: .json for scripts, .html for people; may be repeated
    #[arg(long, value_name = "FILE")]
    report: Vec<PathBuf>,
    /// Compare the result with the input, as `drystone compare` does, and put the numbers into the reports
    #[arg(long)]
    measure: bool,
    #[command(flatten)]
    sampling: SamplingArguments,
    /// Say nothing but errors
    #[arg(short, long)]
    quiet: bool,
}

/// Simplifies, compares if asked to, prints the closing words and returns the exit code.
///
/// # Errors
/// Those of [`pipeline::simplify`] and of the reports.
pub fn run(arguments: &SimplifyArguments) -> Result<u8> {
    let SimplifyArguments { input, output, options, report: reports, measure, sampling, quiet } = arguments;
    sampling.check()?;
    reports.iter().try_for_each(|path| report::Kind::of(path).map(|_| ()))?;
    let folders = reports.iter().filter_map(|path| path.parent());
    folders.into_iter().try_for_each(make_folders)?;
    if let Some(path) = reports.iter().find(|path| path.is_dir()) {
        return Err(Error::Usage(format!("--report {}: is a folder", escape_path(path))));
    }
    let pictures = reports.iter().any(|path| report::Kind::of(path).is_ok_and(|kind| kind == report::Kind::Html));
    let drawing = match (pictures, measure) {
        (false, _) => Drawing::Nothing,
        (true, false) => Drawing::Pictures,
        (true, true) => Drawing::PicturesAndErrors,
    };
    let options = SimplifyOptions { drawing, ..options.clone() };
    let stop = StopSignal::listen()?;
    let work = pipeline::work_folder(output, &options);
    let goodbye = Goodbye::of_job(&stop, &work);
    let told = stoppable(*quiet, stop.clone());
    let mut number = 0;
    // With the job not yet done: where a report cannot be written, the same command goes on.
    let outcome = pipeline::simplify_and(input, output, &options, &*told, |result, job| {
        number = job;
        reports.iter().try_for_each(|path| result.save(path, job))
    });
    let mut result = match outcome {
        Err(Error::Stopped) => return Ok(goodbye.say()),
        outcome => outcome?,
    };
    goodbye.only_compares(input, output);
    let compared = measure.then(|| {
        let work = work_beside(&work);
        let meshes = [input.as_path(), output.as_path()];
        match &mut result.shots {
            Some([_, after]) => {
                compare_meshes(meshes, *sampling, options.memory, options.threads, Relief::BYTES, work, after, &*told)
            }
            None => compare_meshes(meshes, *sampling, options.memory, options.threads, 0, work, &mut (), &*told),
        }
    });
    drop(told);
    // The result is there even if it could not be compared.
    let failure = match compared.transpose() {
        Ok(comparison) => {
            result.comparison = comparison;
            None
        }
        Err(error) => Some(error),
    };
    if *measure {
        reports.iter().try_for_each(|path| result.save(path, number))?;
    }
    if !quiet || result.exit_code() != 0 {
        tell(result.summary().trim_end());
    }
    match failure {
        Some(Error::Stopped) => Ok(goodbye.say()),
        Some(error) => Err(error),
        None => Ok(result.exit_code()),
    }
}

/// The folder for a comparison, apart from that of the run.
fn work_beside(work: &Path) -> PathBuf {
    let mut name = work.file_name().unwrap_or_default().to_owned();
    name.push("-measure");
    work.with_file_name(name)
}

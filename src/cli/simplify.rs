//! `drystone simplify`: one OBJ, or many, becomes one with fewer triangles.

use std::path::PathBuf;

use clap::Args;

use super::progress::told;
use crate::base::{Error, Result};
use crate::options::SimplifyOptions;
use crate::pipeline;
use crate::report;

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
    /// Say nothing but errors
    #[arg(short, long)]
    quiet: bool,
}

/// Simplifies, prints the closing words and returns the exit code.
///
/// # Errors
/// Those of [`pipeline::simplify`] and of the reports.
pub fn run(arguments: &SimplifyArguments) -> Result<u8> {
    let SimplifyArguments { input, output, options, report: reports, quiet } = arguments;
    reports.iter().try_for_each(|path| report::Kind::of(path).map(|_| ()))?;
    let folders = reports.iter().filter_map(|path| path.parent());
    for folder in folders.filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "create", e))?;
    }
    let told = told(*quiet);
    let result = pipeline::simplify(input, output, options, &*told)?;
    drop(told);
    reports.iter().try_for_each(|path| result.save(path))?;
    if !quiet || result.exit_code() != 0 {
        eprint!("{}", result.summary());
    }
    Ok(result.exit_code())
}

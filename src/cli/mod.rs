//! The command line: arguments in, exit code out.

mod check;
mod progress;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::base::{Error, Progress, Result};
use crate::options::SimplifyOptions;
use crate::{pipeline, report};

/// Simplifies textured triangle meshes larger than memory.
#[derive(Debug, Parser)]
#[command(name = "drystone", version, about, after_help = EXIT_CODES)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXIT_CODES: &str = "Exit codes: 0 done, 1 failed, 2 usage, 3 written but the target was missed, 4 bad input, \
                          5 input or options changed, 6 locked, 7 no space, 8 damaged job folder";

#[derive(Debug, Subcommand)]
enum Command {
    /// Simplify an OBJ, or every OBJ below a folder, into one OBJ
    Simplify {
        /// OBJ file, or a folder
        input: PathBuf,
        /// OBJ file to write
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        #[command(flatten)]
        options: Box<SimplifyOptions>,
        /// Write a report; .json; may be repeated
        #[arg(long, value_name = "FILE")]
        report: Vec<PathBuf>,
        /// Say nothing but errors
        #[arg(short, long)]
        quiet: bool,
    },
    /// Count cracks, topology faults and folded texture; exit code 1 if any is new
    Check {
        /// OBJ file
        mesh: PathBuf,
        /// OBJ file that the mesh was made from
        #[arg(long, value_name = "FILE")]
        against: Option<PathBuf>,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
}

/// Runs the program.
pub fn run() -> ExitCode {
    match Cli::parse().command.run() {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}

impl Command {
    fn run(self) -> Result<u8> {
        match self {
            Command::Simplify { input, output, options, report, quiet } => {
                simplify(&input, &output, &options, &report, quiet)
            }
            Command::Check { mesh, against, json } => check::run(&mesh, against.as_deref(), json),
        }
    }
}

fn simplify(
    input: &std::path::Path,
    output: &std::path::Path,
    options: &SimplifyOptions,
    reports: &[PathBuf],
    quiet: bool,
) -> Result<u8> {
    reports.iter().try_for_each(|path| report::check_path(path))?;
    if let Some(missing) =
        reports.iter().filter_map(|path| path.parent()).find(|p| !p.as_os_str().is_empty() && !p.is_dir())
    {
        std::fs::create_dir_all(missing).map_err(|e| Error::io(missing, "create", e))?;
    }
    let told: Box<dyn Progress> = if quiet { Box::new(crate::base::Silent) } else { Box::new(progress::Told::new()) };
    let result = pipeline::simplify(input, output, options, &*told)?;
    drop(told);
    reports.iter().try_for_each(|path| result.save(path))?;
    if !quiet || result.exit_code() != 0 {
        eprint!("{}", result.summary());
    }
    Ok(result.exit_code())
}

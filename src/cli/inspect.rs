//! `drystone inspect`: counts and faults of a mesh.

use std::path::PathBuf;

use clap::Args;

use super::answer::CommandAnswer;
use super::input::InputArguments;
use super::print::{print, print_json};
use super::stop::run_unkept;
use crate::base::{Progress, Result, bytes};
use crate::inspect::{self, InspectOptions, Inspection};

/// Arguments of `drystone inspect`.
#[derive(Debug, Args)]
pub struct InspectArguments {
    #[command(flatten)]
    input: InputArguments,
    /// Memory that the program may use, at least 128MiB [default: half of the machine's or cgroup's]
    #[arg(long, value_name = "SIZE", value_parser = bytes::parse)]
    memory: Option<u64>,
    /// Number of threads; the results do not depend on it [default: one per processor]
    #[arg(long, value_name = "COUNT")]
    threads: Option<usize>,
    /// Folder for intermediate files, removed at the end [default: in the system's temporary folder]
    #[arg(long, value_name = "DIR")]
    work: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Print the counts and errors only
    #[arg(short, long)]
    quiet: bool,
}

/// Prints the counts and faults of the input.
///
/// # Errors
/// Those of [`inspect::inspect`].
pub fn run(arguments: &InspectArguments) -> Result<u8> {
    let show = |inspection: &Inspection| {
        if arguments.json {
            print_json(inspection)?
        } else {
            print(&inspection.table())?
        }
        Ok(0)
    };
    run_unkept(arguments.quiet, |progress| inspect(arguments, progress), show)
}

/// Inspects for a program that calls the command.
///
/// # Errors
/// Those of [`inspect::inspect`].
pub fn answer(arguments: &InspectArguments, progress: &dyn Progress) -> Result<CommandAnswer> {
    CommandAnswer::new(0, &inspect(arguments, progress)?)
}

fn inspect(arguments: &InspectArguments, progress: &dyn Progress) -> Result<Inspection> {
    let InspectArguments { input, memory, threads, work, .. } = arguments;
    let options = InspectOptions { memory: *memory, threads: *threads, work: work.clone() };
    inspect::inspect(input.choice(), &options, progress)
}

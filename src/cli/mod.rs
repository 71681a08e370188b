//! The command line: arguments in, exit code out. Each command has a file of its own.

mod check;
mod compare;
mod exit;
mod inspect;
mod markdown;
mod plan;
mod print;
mod progress;
mod simplify;
mod status;
mod stop;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::base::Result;

pub use self::markdown::options_markdown;

/// Simplifies textured triangle meshes larger than memory.
#[derive(Debug, Parser)]
#[command(name = "drystone", version, about, after_help = exit::help())]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Simplify an OBJ, or every OBJ below a folder, into one OBJ
    Simplify(Box<simplify::SimplifyArguments>),
    /// Tell what a run will take: clusters, memory, scratch space, time; one streaming look, writes nothing
    Plan(Box<plan::PlanArguments>),
    /// Tell what an OBJ holds: counts, bounds, materials, seams, borders, faults; within a memory budget
    Inspect(inspect::InspectArguments),
    /// Count cracks, topology faults and folded texture; exit code 1 if any is new. Holds the mesh in memory
    Check(check::CheckArguments),
    /// Measure what a simplification did: distances, colours, topology, shapes; within a memory budget
    Compare(compare::CompareArguments),
    /// Tell what is done and what is left of the job in a work folder; it may be running
    Status(status::StatusArguments),
    /// Print docs/options.md
    #[command(hide = true)]
    OptionsMarkdown,
}

/// Runs the program.
pub fn run() -> ExitCode {
    match Cli::parse().command.run() {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            progress::tell(&format!("error: {error}"));
            ExitCode::from(error.exit_code())
        }
    }
}

impl Command {
    fn run(&self) -> Result<u8> {
        match self {
            Command::Simplify(arguments) => simplify::run(arguments),
            Command::Plan(arguments) => plan::run(arguments),
            Command::Inspect(arguments) => inspect::run(arguments),
            Command::Check(arguments) => check::run(arguments),
            Command::Compare(arguments) => compare::run(arguments),
            Command::Status(arguments) => status::run(arguments),
            Command::OptionsMarkdown => {
                print::print(&options_markdown())?;
                Ok(0)
            }
        }
    }
}

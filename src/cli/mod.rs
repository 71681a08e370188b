//! The command line: arguments in, exit code out. Each command has a file of its own.

mod check;
mod compare;
mod exit;
mod flags;
mod input;
mod inspect;
mod manual;
mod markdown;
mod plan;
mod print;
mod progress;
mod serve;
mod share;
mod simplify;
mod status;
mod stop;
mod tile;
mod version;
mod words;

use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};

use crate::base::Result;

pub use self::markdown::options_markdown;

/// Simplifies textured triangle meshes larger than memory.
#[derive(Debug, Parser)]
#[command(name = "drystone", about, after_help = exit::help())]
#[command(version = version::SHORT, long_version = version::LONG, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Simplify an OBJ or a PLY, or all in and below a folder, into one OBJ, PLY or GLB
    #[command(after_help = simplify::MORE, after_long_help = simplify::EXAMPLES)]
    Simplify(Box<simplify::SimplifyArguments>),
    /// Make a pyramid of tiles that a browser streams: 3D Tiles, from one or many meshes
    Tile(Box<tile::TileArguments>),
    /// Predict what a run takes: clusters, memory, scratch space, time. Reads the input once and writes nothing
    Plan(Box<plan::PlanArguments>),
    /// Print what a mesh holds: counts, bounds, materials, seams, boundaries, faults. Works within a memory budget
    Inspect(inspect::InspectArguments),
    /// Count cracks, topology faults and folded texture; exit code 1 if any is new. Holds the mesh in memory
    Check(check::CheckArguments),
    /// Measure what a simplification changed: distances, colours, topology, shapes. Works within a memory budget
    Compare(compare::CompareArguments),
    /// Show a folder of tiles in a browser on this machine
    Serve(serve::ServeArguments),
    /// Print what a job has done and what is left, also while it runs
    Status(status::StatusArguments),
    /// Print the completion script of a shell
    Completions(manual::CompletionsArguments),
    /// Write the manual pages to a folder
    Man(manual::ManArguments),
    /// Print docs/reference/options.md
    #[command(hide = true)]
    OptionsMarkdown,
}

/// Runs the program.
pub fn run() -> ExitCode {
    match Cli::parse().command.run() {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            progress::tell(&words::with_flags(&format!("error: {error}")));
            ExitCode::from(exit::code_of(&error))
        }
    }
}

impl Command {
    fn run(&self) -> Result<u8> {
        match self {
            Command::Simplify(arguments) => simplify::run(arguments),
            Command::Tile(arguments) => tile::run(arguments),
            Command::Plan(arguments) => plan::run(arguments),
            Command::Inspect(arguments) => inspect::run(arguments),
            Command::Check(arguments) => check::run(arguments),
            Command::Compare(arguments) => compare::run(arguments),
            Command::Serve(arguments) => serve::run(arguments),
            Command::Status(arguments) => status::run(arguments),
            Command::Completions(arguments) => manual::print_completions(arguments, Cli::command()),
            Command::Man(arguments) => manual::write_pages(arguments, Cli::command()),
            Command::OptionsMarkdown => {
                print::print(&options_markdown())?;
                Ok(0)
            }
        }
    }
}

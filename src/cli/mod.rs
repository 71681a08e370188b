//! The command line: arguments in, exit code out. Each command has a file of its own.

mod answer;
mod check;
mod compare;
mod exit;
mod flags;
mod idle;
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
mod task;
mod tile;
mod version;
mod words;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{ArgMatches, CommandFactory, FromArgMatches, Parser, Subcommand};

use crate::base::{Error, Progress, Result};
use crate::job::stage::SharedHands;

pub use self::answer::CommandAnswer;
pub use self::exit::code_of;
pub use self::markdown::options_markdown;
pub use self::version::LONG as LONG_VERSION;

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
    /// Count cracks, topology faults and folded texture; exit code 1 if there is a fault, with --against a new one. Holds the
    /// mesh in memory
    Check(check::CheckArguments),
    /// Measure what a simplification changed: distances, colours, topology, shapes. Works within a memory budget
    Compare(compare::CompareArguments),
    /// Show a folder of tiles in a browser on this machine
    Serve(serve::ServeArguments),
    /// Print what a job has done and what is left, also while it runs
    Status(status::StatusArguments),
    /// Do a task of a job that runs on several machines: docs/guide/machines.md
    Task(task::TaskArguments),
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
    ExitCode::from(run_with(std::env::args_os()))
}

/// Runs the program with arguments, of which the first is its name; returns the exit code.
pub fn run_with(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let (command, matches) = match parse(arguments) {
        Ok(parsed) => parsed,
        Err(error) => {
            // Help goes to stdout; a reader that closed it is no error.
            let _ = error.print();
            return u8::try_from(error.exit_code()).unwrap_or(2);
        }
    };
    command.run(idle::refuse(&matches, false)).unwrap_or_else(|error| {
        progress::tell(&words::with_flags(&format!("error: {error}")));
        code_of(&error)
    })
}

/// The command of arguments, and what was given of its options.
fn parse(arguments: impl IntoIterator<Item = OsString>) -> std::result::Result<(Command, ArgMatches), clap::Error> {
    let matches = Cli::command().try_get_matches_from(arguments)?;
    let cli = Cli::from_arg_matches(&matches).map_err(|error| error.format(&mut Cli::command()))?;
    Ok((cli.command, matches))
}

/// Runs a command for a program that calls it: the command's name and its arguments, such as `inspect city.obj`.
/// Prints nothing, and leaves signals alone; `progress` can stop it. `hands` have tasks of a job done, if there are any.
///
/// # Errors
/// [`Error::Usage`] for arguments that the command line refuses, and those of the command.
pub fn call(
    arguments: impl IntoIterator<Item = OsString>,
    hands: Option<SharedHands>,
    progress: &dyn Progress,
) -> Result<CommandAnswer> {
    let name = OsString::from("drystone");
    let (command, matches) = parse(std::iter::once(name).chain(arguments)).map_err(|error| usage(&error))?;
    idle::refuse(&matches, hands.is_some())?;
    match &command {
        Command::Simplify(arguments) => simplify::answer(arguments, hands, progress),
        Command::Tile(arguments) => tile::answer(arguments, hands, progress),
        Command::Plan(arguments) => plan::answer(arguments, progress),
        Command::Inspect(arguments) => inspect::answer(arguments, progress),
        Command::Check(arguments) => check::answer(arguments, progress),
        Command::Compare(arguments) => compare::answer(arguments, progress),
        Command::Status(arguments) => status::answer(arguments),
        _ => Err(Error::Usage("this command prints its result".into())),
    }
}

/// The message of an error of the arguments, without the hints for people at a terminal.
fn usage(error: &clap::Error) -> Error {
    let text = error.to_string();
    let message = text.split("\n\n").next().unwrap_or_default();
    Error::Usage(message.strip_prefix("error: ").unwrap_or(message).to_owned())
}

impl Command {
    /// Runs the command, if its options are `usable` together.
    fn run(&self, usable: Result<()>) -> Result<u8> {
        if let Command::Simplify(arguments) = self {
            // It prints an object for that error, too.
            return simplify::run(arguments, usable);
        }
        usable?;
        match self {
            Command::Simplify(arguments) => simplify::run(arguments, Ok(())),
            Command::Tile(arguments) => tile::run(arguments),
            Command::Plan(arguments) => plan::run(arguments),
            Command::Inspect(arguments) => inspect::run(arguments),
            Command::Check(arguments) => check::run(arguments),
            Command::Compare(arguments) => compare::run(arguments),
            Command::Serve(arguments) => serve::run(arguments),
            Command::Status(arguments) => status::run(arguments),
            Command::Task(arguments) => task::run(arguments),
            Command::Completions(arguments) => manual::print_completions(arguments, Cli::command()),
            Command::Man(arguments) => manual::write_pages(arguments, Cli::command()),
            Command::OptionsMarkdown => {
                print::print(&options_markdown())?;
                Ok(0)
            }
        }
    }
}

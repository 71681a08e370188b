//! `drystone plan`: prediction for a run.

use clap::Args;

use super::flags::SimplifyFlags;
use super::input::InputArguments;
use super::print::{print, print_json};
use super::progress::{tell, told};
use crate::base::Result;
use crate::plan;
use crate::report;

/// Arguments of `drystone plan`.
#[derive(Debug, Args)]
pub struct PlanArguments {
    #[command(flatten)]
    flags: SimplifyFlags,
    #[command(flatten)]
    input: InputArguments,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Print the plan and errors only
    #[arg(short, long)]
    quiet: bool,
}

/// Prints the plan.
///
/// # Errors
/// Those of [`plan::plan`], and [`Error::NoSpace`](crate::base::Error::NoSpace) after the plan if the disk is too
/// small.
pub fn run(arguments: &PlanArguments) -> Result<u8> {
    let told = told(arguments.quiet);
    let plan = plan::plan(arguments.input.choice(), &arguments.flags.options(), &*told)?;
    drop(told);
    if !arguments.quiet {
        report::warning_lines(&plan.warnings, "--json lists them").iter().for_each(|line| tell(line));
    }
    if arguments.json {
        print_json(&plan)?
    } else {
        print(&plan.table())?
    }
    plan.refuse_small_disk()?;
    Ok(0)
}

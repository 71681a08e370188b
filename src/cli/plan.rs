//! `drystone plan`: what a run will take.

use std::path::PathBuf;

use clap::Args;

use super::print::{print, print_json};
use super::progress::told;
use crate::base::Result;
use crate::options::SimplifyOptions;
use crate::plan;

/// Arguments of `drystone plan`.
#[derive(Debug, Args)]
pub struct PlanArguments {
    /// OBJ file, or a folder: every OBJ in and below it joins one mesh
    input: PathBuf,
    #[command(flatten)]
    options: SimplifyOptions,
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
/// Those of [`plan::plan`], and [`Error::NoSpace`](crate::base::Error::NoSpace) after the plan if the disk is too small.
pub fn run(arguments: &PlanArguments) -> Result<u8> {
    let told = told(arguments.quiet);
    let plan = plan::plan(&arguments.input, &arguments.options, &*told)?;
    drop(told);
    match arguments.json {
        true => print_json(&plan)?,
        false => print(&plan.table())?,
    }
    plan.refuse_small_disk()?;
    Ok(0)
}

//! `drystone inspect`: what an OBJ holds.

use std::path::PathBuf;

use clap::Args;

use super::print::{print, print_json};
use super::progress::told;
use crate::base::{Result, bytes};
use crate::inspect::{self, InspectOptions};

/// Arguments of `drystone inspect`.
#[derive(Debug, Args)]
pub struct InspectArguments {
    /// OBJ file, or a folder: every OBJ in it and below it is one mesh
    input: PathBuf,
    /// Memory that the program may use, at least 128MiB [default: half of the machine's or cgroup's]
    #[arg(long, value_name = "SIZE", value_parser = bytes::parse)]
    memory: Option<u64>,
    /// Threads; the counts do not depend on them [default: one for each processor]
    #[arg(long, value_name = "COUNT")]
    threads: Option<usize>,
    /// Folder for intermediate files, removed at the end [default: in the system's temporary folder]
    #[arg(long, value_name = "DIR")]
    work: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Say nothing but the counts and errors
    #[arg(short, long)]
    quiet: bool,
}

/// Prints what the input holds.
///
/// # Errors
/// Those of [`inspect::inspect`].
pub fn run(arguments: &InspectArguments) -> Result<u8> {
    let InspectArguments { input, memory, threads, work, json, quiet } = arguments;
    let options = InspectOptions { memory: *memory, threads: *threads, work: work.clone() };
    let told = told(*quiet);
    let inspection = inspect::inspect(input, &options, &*told)?;
    drop(told);
    match json {
        true => print_json(&inspection)?,
        false => print(&inspection.table()),
    }
    Ok(0)
}

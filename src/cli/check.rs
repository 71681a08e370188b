//! `drystone check`: counts of one mesh, and what is new against another.

use std::path::{Path, PathBuf};

use clap::Args;

use crate::base::{Error, Result, Silent};
use crate::measure::{Check, Regression, Surface, compare_checks, weld_and_check};
use crate::scan::{ScanOptions, find_inputs, scan};

/// Arguments of `drystone check`.
#[derive(Debug, Args)]
pub struct CheckArguments {
    /// OBJ file
    mesh: PathBuf,
    /// OBJ file that the mesh was made from
    #[arg(long, value_name = "FILE")]
    against: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Prints the counts; returns exit code 1 if anything is new.
///
/// # Errors
/// If a mesh cannot be read.
pub fn run(arguments: &CheckArguments) -> Result<u8> {
    let after = counts(&arguments.mesh)?;
    let before = arguments.against.as_deref().map(counts).transpose()?;
    let news = before.as_ref().map_or_else(Vec::new, |before| compare_checks(before, &after));
    if arguments.json {
        print_json(&after, before.as_ref(), &news);
    } else {
        print_table(&after, before.as_ref());
        for regression in &news {
            println!("new: {regression}");
        }
    }
    let faults = after.degenerate_faces
        + after.duplicate_faces
        + after.non_manifold_edges
        + after.t_junctions
        + after.atlas.folded_uv;
    let is_bad = if before.is_some() { !news.is_empty() } else { faults > 0 };
    Ok(u8::from(is_bad))
}

fn counts(path: &Path) -> Result<Check> {
    let folder = std::env::temp_dir().join(format!("drystone-check-{}", std::process::id()));
    std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, "create", e))?;
    let outcome = find_inputs(path)
        .and_then(|inputs| scan(&inputs, &folder, &ScanOptions { threads: 2, chunks_in_flight: 4 }, &Silent))
        .and_then(|scan| Surface::load(&scan.mesh, &scan.catalogue))
        .map(|surface| weld_and_check(&surface));
    let _ = std::fs::remove_dir_all(&folder);
    outcome
}

fn fields(check: &Check) -> serde_json::Map<String, serde_json::Value> {
    match serde_json::to_value(check) {
        Ok(serde_json::Value::Object(map)) => map,
        _ => serde_json::Map::new(),
    }
}

fn print_table(after: &Check, before: Option<&Check>) {
    let before = before.map(fields);
    for (name, value) in fields(after) {
        let old = before.as_ref().and_then(|before| before.get(&name)).map(|old| format!("   (before: {old})"));
        println!("{:28} {value}{}", name.replace('_', " "), old.unwrap_or_default());
    }
}

fn print_json(after: &Check, before: Option<&Check>, news: &[Regression]) {
    let news: Vec<String> = news.iter().map(|regression| regression.to_string()).collect();
    let value = serde_json::json!({ "after": fields(after), "before": before.map(fields), "new": news });
    println!("{value:#}");
}

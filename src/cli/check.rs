//! `drystone check`: counts of one mesh, and its faults that another mesh does not have.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::print::{print, print_json};
use super::progress::stoppable;
use super::stop::Goodbye;
use crate::base::pool::Pool;
use crate::base::{Error, Progress, Result, WorkLimits};
use crate::image::textures::TextureImages;
use crate::measure::{Check, Regression, Surface, compare_checks, compare_topology, weld_and_check};
use crate::os::durable::temporary_folder;
use crate::os::signals::StopSignal;
use crate::plan::memory;
use crate::read::{Scan, ScanOptions, find_inputs, scan};
use crate::surface::cells::{SurfaceCells, SurfacePlace};
use crate::tile::{TilesetCheck, TilesetInput, check_tileset, check_tileset_against};

/// Threads that read and measure.
const THREADS: usize = 2;

/// Arguments of `drystone check`.
#[derive(Debug, Args)]
pub struct CheckArguments {
    /// OBJ or PLY file, or a folder of tiles
    mesh: PathBuf,
    /// OBJ or PLY file that the mesh was made from; only faults that it does not have count then
    ///
    /// For tiles: their input, a file or a folder. No tile may lie farther from it than its geometric error says
    #[arg(long, value_name = "FILE")]
    against: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Prints the counts; returns exit code 1 if there are new faults.
///
/// # Errors
/// If a mesh cannot be read.
pub fn run(arguments: &CheckArguments) -> Result<u8> {
    let stop = StopSignal::listen()?;
    let goodbye = Goodbye::of_nothing(&stop);
    let told = stoppable(true, stop);
    if arguments.mesh.is_dir() {
        return check_tiles(arguments, &goodbye, &*told);
    }
    let counted = counts(&arguments.mesh, &*told)
        .and_then(|after| Ok((after, arguments.against.as_deref().map(|mesh| counts(mesh, &*told)).transpose()?)));
    let (after, before) = match counted {
        Err(Error::Stopped) => return Ok(goodbye.say()),
        counted => counted?,
    };
    drop(told);
    let news = before.as_ref().map_or_else(Vec::new, |before| compare_checks(before, &after));
    if arguments.json {
        let news: Vec<String> = news.iter().map(|regression| regression.to_string()).collect();
        print_json(&json!({ "after": fields(&after), "before": before.as_ref().map(fields), "new": news }))?;
    } else {
        print(&table(&after, before.as_ref(), &news))?;
    }
    let faults = after.degenerate_faces
        + after.duplicate_faces
        + after.non_manifold_edges
        + after.t_junctions
        + after.uv.folded_uv;
    let is_bad = if before.is_some() { !news.is_empty() } else { faults > 0 };
    Ok(u8::from(is_bad))
}

/// Checks a folder of tiles; returns exit code 1 if there are faults.
fn check_tiles(arguments: &CheckArguments, goodbye: &Goodbye, progress: &dyn Progress) -> Result<u8> {
    let checked = match &arguments.against {
        None => check_tileset(&arguments.mesh, progress),
        Some(input) => check_tiles_against(&arguments.mesh, input, progress),
    };
    let check = match checked {
        Err(Error::Stopped) => return Ok(goodbye.say()),
        outcome => outcome?,
    };
    if arguments.json {
        print_json(&check)?;
    } else {
        print(&check.table())?;
    }
    Ok(u8::from(check.fault_count > 0))
}

fn check_tiles_against(tiles: &Path, input: &Path, progress: &dyn Progress) -> Result<TilesetCheck> {
    with_scan(input, progress, |scan, folder| {
        let limits = WorkLimits { threads: THREADS, work_bytes: memory::budget_of(None)?.for_work() };
        let place = SurfacePlace { folder, name: "input", limits, progress };
        let none = TextureImages::none(&scan.catalogue);
        let surface = SurfaceCells::make(&scan.mesh, &scan.catalogue, &none, &place)?;
        check_tileset_against(tiles, &TilesetInput { surface: &surface, folder, limits }, progress)
    })
}

fn counts(path: &Path, progress: &dyn Progress) -> Result<Check> {
    let surface = with_scan(path, progress, |scan, _| Surface::load(&scan.mesh, &scan.catalogue))?;
    progress.check_stopped()?;
    Ok(weld_and_check(&surface))
}

/// Reads a mesh into a temporary folder, which is removed after `then` is done with it.
fn with_scan<T>(path: &Path, progress: &dyn Progress, then: impl FnOnce(Scan, &Path) -> Result<T>) -> Result<T> {
    let _threads = Pool::new(0)?.enter();
    let inputs = find_inputs(&path.into())?;
    let folder = temporary_folder("check");
    std::fs::create_dir(&folder).map_err(|e| Error::io(&folder, "create", e))?;
    let options = ScanOptions { threads: THREADS, chunks_in_flight: 2 * THREADS, ..Default::default() };
    let done = scan(&inputs, &folder, &options, progress).and_then(|scan| {
        progress.check_stopped()?;
        then(scan, &folder)
    });
    let _ = std::fs::remove_dir_all(&folder);
    done
}

fn fields(check: &Check) -> serde_json::Map<String, serde_json::Value> {
    match serde_json::to_value(check) {
        Ok(serde_json::Value::Object(map)) => map,
        _ => serde_json::Map::new(),
    }
}

/// The name of a count, as `inspect` and `compare` write it.
fn words(name: &str) -> String {
    match name {
        "euler" => "Euler characteristic".to_owned(),
        "t_junctions" => "T-junctions".to_owned(),
        "folded_uv" => "folded texture triangles".to_owned(),
        _ => name.replace('_', " ").replace("non manifold", "non-manifold").replace("zero area", "zero-area"),
    }
}

/// The counts as a table for people, with a verdict if there is a mesh to compare with.
fn table(after: &Check, before: Option<&Check>, news: &[Regression]) -> String {
    let mut text = String::new();
    let old = before.map(fields);
    for (name, value) in fields(after) {
        let old = old.as_ref().and_then(|old| old.get(&name)).map(|old| format!("   (before: {old})"));
        let _ = writeln!(text, "{:28} {value}{}", words(&name), old.unwrap_or_default());
    }
    for regression in news {
        let _ = writeln!(text, "new: {regression}");
    }
    for change in before.map_or_else(Vec::new, |before| compare_topology(before, after)) {
        let _ = writeln!(text, "changed: {change}");
    }
    if before.is_some() && news.is_empty() {
        text.push_str("no fault is new\n");
    }
    text
}

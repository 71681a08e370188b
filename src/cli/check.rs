//! `drystone check`: counts of one mesh, and its faults that another mesh does not have.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::answer::CommandAnswer;
use super::print::{print, print_json};
use super::stop::run_unkept;
use crate::base::pool::{Durability, Pool};
use crate::base::{Error, Progress, Result, WorkLimits};
use crate::image::textures::TextureImages;
use crate::measure::{Check, Regression, Surface, compare_checks, compare_topology, weld_and_check};
use crate::os::durable::temporary_folder;
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
    /// File or folder that the mesh or the tiles were made from; only faults that it does not have count then
    ///
    /// Without it, degenerate and duplicate faces, non-manifold edges, T-junctions and folded texture triangles count.
    /// With it, zero-area faces, folded edges, inconsistent edges and open borders count, too
    ///
    /// For tiles: 99 % of each lie no farther from the input than its geometric error divided by the error factor, and
    /// 99 % of the input no farther from each level
    #[arg(long, value_name = "PATH")]
    against: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// Prints the counts; returns exit code 1 if there are faults, or with a mesh to compare with, new ones.
///
/// # Errors
/// If a mesh cannot be read.
pub fn run(arguments: &CheckArguments) -> Result<u8> {
    let show = |checked: &Checked| {
        if arguments.json {
            print_json(&checked.json())?
        } else {
            print(&checked.table())?
        }
        Ok(u8::from(checked.is_bad()))
    };
    run_unkept(true, |progress| check(arguments, progress), show)
}

/// Checks for a program that calls the command.
///
/// # Errors
/// Those of [`run`].
pub fn answer(arguments: &CheckArguments, progress: &dyn Progress) -> Result<CommandAnswer> {
    let checked = check(arguments, progress)?;
    CommandAnswer::new(u8::from(checked.is_bad()), &checked.json())
}

/// What was checked, and what was found.
enum Checked {
    Mesh { after: Box<Check>, before: Option<Box<Check>>, news: Vec<Regression> },
    Tiles(TilesetCheck),
}

impl Checked {
    /// Reports whether there are faults; with a mesh to compare with, new ones.
    fn is_bad(&self) -> bool {
        match self {
            Self::Mesh { before: Some(_), news, .. } => !news.is_empty(),
            Self::Mesh { after, .. } => !after.faults().is_empty(),
            Self::Tiles(check) => check.fault_count > 0,
        }
    }

    fn json(&self) -> serde_json::Value {
        match self {
            Self::Mesh { after, before, news } => {
                let news: Vec<String> = news.iter().map(ToString::to_string).collect();
                json!({ "after": fields(after), "before": before.as_deref().map(fields), "new": news })
            }
            Self::Tiles(check) => json!(check),
        }
    }

    fn table(&self) -> String {
        match self {
            Self::Mesh { after, before, news } => table(after, before.as_deref(), news),
            Self::Tiles(check) => check.table(),
        }
    }
}

fn check(arguments: &CheckArguments, progress: &dyn Progress) -> Result<Checked> {
    Pool::with(0, Durability::None)?.run(progress, || check_in_pool(arguments, progress))
}

fn check_in_pool(arguments: &CheckArguments, progress: &dyn Progress) -> Result<Checked> {
    let CheckArguments { mesh, against, .. } = arguments;
    if mesh.is_dir() {
        let tiles = match against {
            None => check_tileset(mesh, progress),
            Some(input) => check_tiles_against(mesh, input, progress),
        };
        return tiles.map(Checked::Tiles);
    }
    let after = Box::new(counts(mesh, progress)?);
    let before = against.as_deref().map(|mesh| counts(mesh, progress).map(Box::new)).transpose()?;
    let news = before.as_ref().map_or_else(Vec::new, |before| compare_checks(before, &after));
    Ok(Checked::Mesh { after, before, news })
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
    let (surface, dropped) = with_scan(path, progress, |scan, _| {
        Ok((Surface::load(&scan.mesh, &scan.catalogue)?, scan.findings.get("degenerate_faces")))
    })?;
    let found = weld_and_check(&surface)?;
    Ok(Check { degenerate_faces: found.degenerate_faces + dropped, ..found })
}

/// Reads a mesh into a temporary folder, which is removed after `then` is done with it.
fn with_scan<T>(path: &Path, progress: &dyn Progress, then: impl FnOnce(Scan, &Path) -> Result<T>) -> Result<T> {
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

/// The counts as a table for people, and a verdict.
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
    match before {
        Some(_) if news.is_empty() => text.push_str("no fault is new\n"),
        Some(_) => {}
        None => text.push_str(&verdict(after)),
    }
    text
}

/// `faults: 2 duplicate faces, 1 non-manifold edge`.
fn verdict(check: &Check) -> String {
    let faults = check.faults();
    if faults.is_empty() {
        return "no fault\n".to_owned();
    }
    let words = |&(name, count): &(&str, u64)| format!("{count} {name}{}", if count == 1 { "" } else { "s" });
    format!("faults: {}\n", faults.iter().map(words).collect::<Vec<_>>().join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_line_names_the_faults_that_the_exit_code_tells_of() {
        let last = |after: Check| {
            let checked = Checked::Mesh { after: Box::new(after), before: None, news: Vec::new() };
            (checked.is_bad(), checked.table().lines().last().unwrap().to_owned())
        };
        assert_eq!(last(Check { zero_area_faces: 3, ..Check::default() }), (false, "no fault".to_owned()));
        let doubled = Check { duplicate_faces: 800, non_manifold_edges: 1160, t_junctions: 1, ..Check::default() };
        let words = "faults: 800 duplicate faces, 1160 non-manifold edges, 1 T-junction".to_owned();
        assert_eq!(last(doubled), (true, words));
    }
}

//! Checks a folder of tiles: the rules of 3D Tiles for what is written here, and what is promised of borders and errors.
//!
//! ```text
//! tileset.json ── tiles ── boxes, errors, names ──╮
//!                   │                             ├──▶ faults
//!                   ╰── GLBs ── box, borders, ────╯
//!                               accessors, image
//! ```
//! # Memory
//! A tile at a time, with its image; 60 bytes for each edge along the borders, 100 for each tile without texture; with
//! an input, that of [`errors`].
//!
//! # Source
//! Open Geospatial Consortium, 3D Tiles 1.1 (22-025r4), sections 7 and 8.

mod borders;
mod content;
mod errors;
mod level;
mod reader;
mod texture;
mod transform;

use std::collections::{BTreeMap, HashSet};
use std::path::{Component, Path, PathBuf};

use glam::DVec3;
use serde::Serialize;
use serde_json::Value;

use self::content::{ReadTile, read_glb};
pub use self::errors::TilesetInput;
use self::errors::{ErrorScale, LevelErrors, TileErrors};
use self::level::FoundLevel;
pub use self::level::LevelCheck;
use self::reader::{TileFault, number};
use self::transform::transform_fault;
use super::tileset::{ERROR_FACTOR, TILESET};
use crate::base::error::{escape, escape_path};
use crate::base::{Error, Findings, Progress, Result, grouped};
use crate::geometry::boxtree::Bounds;
use crate::os::system::is_file;

/// Largest size of a file that is read, in bytes.
const FILE_BYTES_MAX: u64 = 1 << 28;
/// Tiles below each other, and tilesets inside each other, at most.
const DEPTH_MAX: usize = 200;
/// Characters of a fault that are shown: some are those of a file.
const WORDS_MAX: usize = 400;
/// A box may be exceeded by this share of its size, for rounding.
const ROUNDING: f64 = 1e-9;

/// What was found in a folder of tiles.
#[derive(Debug, Default, Serialize)]
pub struct TilesetCheck {
    /// Tiles, with or without content.
    pub tiles: u64,
    /// Files with content.
    pub contents: u64,
    /// Bytes of all files.
    pub bytes: u64,
    /// The levels, the finest first: tiles with the same lattice.
    pub levels: Vec<LevelCheck>,
    /// Tiles whose distances from the input were measured, in tilesets that are checked against one.
    pub measured: u64,
    /// Geometric error by the distance from the input, as the tileset says; `None` if it does not.
    pub error_factor: Option<f64>,
    /// Number of faults.
    pub fault_count: u64,
    /// The first faults of each kind.
    pub faults: Vec<String>,
}

/// Checks the tileset in a folder.
///
/// # Errors
/// [`Error::Usage`] if there is none; [`Error::Io`] if a file cannot be read; if the check was stopped.
pub fn check_tileset(folder: &Path, progress: &dyn Progress) -> Result<TilesetCheck> {
    Checking::new(folder, None, progress).run()
}

/// Checks the tileset in a folder, and that no tile lies farther from the input than its geometric error says.
///
/// # Errors
/// Those of [`check_tileset`]; [`Error::Usage`] if the tileset does not say where it lies in the coordinates of the
/// input.
pub fn check_tileset_against(folder: &Path, input: &TilesetInput<'_>, progress: &dyn Progress) -> Result<TilesetCheck> {
    Checking::new(folder, Some(input), progress).run()
}

struct Checking<'a> {
    folder: &'a Path,
    input: Option<&'a TilesetInput<'a>>,
    /// The tiles that are measured; `None` without an input.
    errors: Option<TileErrors<'a>>,
    progress: &'a dyn Progress,
    found: TilesetCheck,
    /// By the bits of the step, which is positive.
    levels: BTreeMap<u64, FoundLevel>,
    /// Files of the tilesets that were read.
    tilesets: HashSet<PathBuf>,
    faults: Findings,
}

/// What a tile has of the one above it.
#[derive(Clone, Copy)]
struct Above {
    bounds: Option<Bounds>,
    error: f64,
    depth: usize,
    /// Step of the lattice of the next tile above with triangles; infinite if there is none.
    step: f64,
}

impl<'a> Checking<'a> {
    fn new(folder: &'a Path, input: Option<&'a TilesetInput<'a>>, progress: &'a dyn Progress) -> Self {
        Self {
            folder,
            input,
            errors: None,
            progress,
            found: TilesetCheck::default(),
            levels: BTreeMap::new(),
            tilesets: HashSet::new(),
            faults: Findings::default(),
        }
    }

    fn run(mut self) -> Result<TilesetCheck> {
        let path = self.folder.join(TILESET);
        if !is_file(&path).unwrap_or(false) {
            let shown = escape_path(self.folder);
            let words = format!("{shown}: holds no {TILESET}; one that is being written has it at the end");
            return Err(Error::Usage(words));
        }
        self.tileset(&path, Above { bounds: None, error: f64::INFINITY, depth: 0, step: f64::INFINITY })?;
        self.finish()
    }

    fn fault(&mut self, kind: &'static str, path: &Path, words: &str) {
        let shown: String = words.chars().take(WORDS_MAX).collect();
        self.faults.note(kind, || format!("{}: {}", escape_path(path), escape(shown.as_bytes())));
    }

    /// Reads a file; `None`, with a fault, if it is too large.
    fn read(&mut self, path: &Path) -> Result<Option<Vec<u8>>> {
        let wrap = |error| Error::io(path, "read", error);
        let bytes = path.metadata().map_err(wrap)?.len();
        if bytes > FILE_BYTES_MAX {
            self.fault("file", path, "it is too large");
            return Ok(None);
        }
        self.found.bytes += bytes;
        std::fs::read(path).map(Some).map_err(wrap)
    }

    fn tileset(&mut self, path: &Path, above: Above) -> Result<()> {
        // Tilesets that name each other twice would otherwise take exponential time.
        if !self.tilesets.insert(path.to_owned()) {
            self.fault("tileset", path, "several tiles name it");
            return Ok(());
        }
        let Some(bytes) = self.read(path)? else { return Ok(()) };
        let document: Value = match serde_json::from_slice(&bytes) {
            Ok(document) => document,
            Err(error) => {
                self.fault("tileset", path, &error.to_string());
                return Ok(());
            }
        };
        if above.depth == 0 {
            self.found.error_factor = number(&document["asset"]["extras"][ERROR_FACTOR]).filter(|&at| at > 0.0);
        }
        if let Some(input) = self.input.filter(|_| above.depth == 0) {
            let scale = ErrorScale::of(&document).ok_or_else(|| {
                let shown = escape_path(path);
                Error::Usage(format!("{shown}: does not say where its tiles lie in the coordinates of the input"))
            })?;
            self.errors = Some(TileErrors::new(input, scale));
        }
        if document["root"]["refine"].is_null() {
            self.fault("refine", path, "the root has none");
        }
        if document["asset"]["version"].as_str() != Some("1.1") {
            self.fault("tileset", path, "asset.version: expected 1.1");
        }
        let error = number(&document["geometricError"]).filter(|error| (0.0..=above.error).contains(error));
        if error.is_none() {
            self.fault("geometric error", path, "the tileset has none, or a larger one than the tile that names it");
        }
        self.tile(path, &document["root"], Above { error: error.unwrap_or(above.error), ..above })
    }

    fn tile(&mut self, path: &Path, tile: &Value, above: Above) -> Result<()> {
        self.progress.check_stopped()?;
        if above.depth > DEPTH_MAX {
            self.fault("tileset", path, "tiles lie too deep in each other");
            return Ok(());
        }
        self.found.tiles += 1;
        let bounds = box_of(&tile["boundingVolume"]["box"]);
        match (bounds, above.bounds) {
            (None, _) => self.fault("bounding volume", path, "expected a box of 12 numbers along the axes"),
            (Some(own), Some(around)) if !holds(around, own) => {
                self.fault("bounding volume", path, "the box of a tile does not hold that of its child");
            }
            _ => {}
        }
        let error = number(&tile["geometricError"]).filter(|error| (0.0..=above.error).contains(error));
        if error.is_none() {
            self.fault("geometric error", path, "a tile has none, or a larger one than its parent");
        }
        if !tile["refine"].is_null() && tile["refine"] != "REPLACE" {
            self.fault("refine", path, "expected REPLACE");
        }
        if let Some(words) = transform_fault(&tile["transform"], above.depth) {
            self.fault("transform", path, words);
        }
        if error == Some(0.0) && tile["content"].is_null() && !tile["children"].is_null() {
            self.fault(
                "geometric error",
                path,
                "a tile without content has none, so no viewer looks at those below it",
            );
        }
        let mut below = Above { bounds, error: error.unwrap_or(above.error), depth: above.depth + 1, ..above };
        if !tile["content"].is_null() {
            below.step = self.content(path, &tile["content"], below)?.unwrap_or(above.step);
        }
        match &tile["children"] {
            Value::Null => {}
            Value::Array(children) if !children.is_empty() => {
                children.iter().try_for_each(|child| self.tile(path, child, below))?;
            }
            _ => self.fault("tileset", path, "children: expected a list of tiles"),
        }
        Ok(())
    }

    /// Checks the content of a tile; returns the step of its lattice if that is triangles.
    fn content(&mut self, tileset: &Path, content: &Value, tile: Above) -> Result<Option<f64>> {
        let Some(path) = content["uri"].as_str().and_then(|uri| inside(self.folder, tileset, uri)) else {
            self.fault("content", tileset, "expected the name of a file in the folder");
            return Ok(None);
        };
        if !is_file(&path).unwrap_or(false) {
            self.fault("content", &path, "there is no such file");
            return Ok(None);
        }
        if path.extension().is_some_and(|ending| ending == "json") {
            return self.tileset(&path, tile).map(|()| None);
        }
        let Some(bytes) = self.read(&path)? else { return Ok(None) };
        self.found.contents += 1;
        match read_glb(&bytes) {
            Err(words) => {
                self.fault("content", &path, &words);
                Ok(None)
            }
            Ok(read) => {
                self.add(&path, &read, tile)?;
                Ok(Some(read.step))
            }
        }
    }

    /// Adds a tile that was read.
    fn add(&mut self, path: &Path, read: &ReadTile, tile: Above) -> Result<()> {
        for TileFault { kind, words } in &read.faults {
            self.fault(kind, path, words);
        }
        let position = |place: &[i64; 3]| DVec3::from(place.map(|at| at as f64)) * read.step;
        let own = Bounds::around(read.places.iter().map(position));
        if tile.bounds.is_some_and(|around| !holds(around, own)) {
            self.fault("bounding volume", path, "the box of the tile does not hold it");
        }
        let level = self.levels.entry(read.step.to_bits()).or_insert_with(|| FoundLevel::new(read.step));
        level.add(path, read, tile.error);
        if let Some(errors) = &mut self.errors {
            errors.add(path, read, tile.error, tile.step)?;
            self.found.measured += 1;
        }
        Ok(())
    }

    fn finish(mut self) -> Result<TilesetCheck> {
        let measured = self.errors.take().map(|errors| errors.measure(self.progress)).transpose()?;
        for LevelErrors { beyond, input_beyond } in measured.into_iter().flat_map(BTreeMap::into_values) {
            for (path, share) in beyond {
                let words = format!("{:.1} % of it lies farther from the input than its error says", 100.0 * share);
                self.fault("geometric error", &path, &words);
            }
            if let Some(share) = input_beyond {
                let words =
                    format!("{:.1} % of the input lies farther from a level than its errors say", 100.0 * share);
                self.fault("geometric error", self.folder, &words);
            }
        }
        for level in std::mem::take(&mut self.levels).into_values() {
            for path in level.without_texture() {
                self.fault("texture", path, "it has none, as others of its level have");
            }
            for (kind, words) in level.faults(self.found.error_factor) {
                self.fault(kind, self.folder, &words);
            }
            self.found.levels.push(level.into_check());
        }
        let fault_count = self.faults.iter().map(|(_, finding)| finding.count).sum();
        Ok(TilesetCheck { fault_count, faults: self.faults.warnings(), ..self.found })
    }
}

/// A box along the axes.
fn box_of(value: &Value) -> Option<Bounds> {
    let numbers: Vec<f64> = value.as_array()?.iter().map(number).collect::<Option<_>>()?;
    let &[x, y, z, a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c] = &numbers[..] else { return None };
    let (middle, half) = (DVec3::new(x, y, z), DVec3::new(a, b, c));
    (half.min_element() >= 0.0).then(|| Bounds { low: middle - half, high: middle + half })
}

fn holds(around: Bounds, inner: Bounds) -> bool {
    let play = ROUNDING * around.diagonal();
    (inner.low - around.low).min_element() >= -play && (around.high - inner.high).min_element() >= -play
}

/// The file of a name in a tileset, if it lies in the folder.
fn inside(folder: &Path, tileset: &Path, uri: &str) -> Option<PathBuf> {
    let is_plain = |part: Component<'_>| matches!(part, Component::Normal(_));
    let path = Path::new(uri);
    let beside = tileset.parent().unwrap_or(folder);
    (!uri.contains([':', '\\', '?', '#', '%']) && path.components().all(is_plain)).then(|| beside.join(path))
}

impl TilesetCheck {
    /// The levels as a table, and the faults.
    pub fn table(&self) -> String {
        use std::fmt::Write as _;
        let mut text =
            String::from("level     step   tiles   triangles   most   border edges   unequal   longest skirt\n");
        for (number, level) in self.levels.iter().enumerate().rev() {
            let _ = writeln!(
                text,
                "{number:5} {:8.4} {:>7} {:>11} {:>6} {:>14} {:>9} {:15.4}",
                level.step,
                grouped(level.tiles),
                grouped(level.triangles),
                grouped(level.triangles_max),
                grouped(level.border_edges),
                grouped(level.unequal_edges),
                level.longest_skirt,
            );
        }
        let _ = writeln!(text, "tiles: {}", self.tiles);
        let _ = writeln!(text, "bytes with {TILESET}: {}", self.bytes);
        let duplicates: u64 = self.levels.iter().map(|level| level.duplicate_triangles).sum();
        if duplicates > 0 {
            let _ = writeln!(text, "duplicate triangles: {}", grouped(duplicates));
        }
        if self.measured > 0 {
            let factor = self.error_factor.unwrap_or_default();
            let _ = writeln!(text, "tiles measured against the input: {}, error factor {factor}", self.measured);
        }
        self.faults.iter().for_each(|fault| _ = writeln!(text, "{fault}"));
        let _ = writeln!(text, "faults: {}", self.fault_count);
        text
    }
}

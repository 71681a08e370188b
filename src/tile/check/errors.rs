//! Checks geometric errors: how far the tiles are from the input, both ways.
//!
//! ```text
//! triangles of a tile, without its skirt ── a cell ──▶ points ── distances to the input ── no farther than its error ÷ factor?
//! cells of all tiles of a level ── a surface ◀── distances ── points of the input
//! ```
//! A tile's error holds for 99 % of its surface, so some points may lie farther: as many as chance allows.
//!
//! # Memory
//! 440 bytes for each triangle of a tile, and that of the searches.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde_json::Value;

use super::content::{ReadTile, number};
use crate::base::{Progress, Result, WorkLimits};
use crate::measure::compare::SurfacePair;
use crate::model::id::ImageId;
use crate::surface::cell::{Cell, CellDraft, CellFace, CellWriter};
use crate::surface::cells::SurfaceCells;
use crate::tile::deviation::SHARE;
use crate::tile::tileset::{ERROR_FACTOR, SCENE_ORIGIN};

/// Points by area of a tile, and of the input for each level.
const POINTS_OF_TILE: u64 = 2000;
const POINTS_OF_LEVEL: u64 = 100_000;
/// Share of a surface that may lie farther than its error says.
const BEYOND: f64 = 1.0 - SHARE;
/// Standard deviations by which the share of points may exceed that, by chance.
const DEVIATIONS: f64 = 5.0;

/// The input of a tileset, and what measuring the distances from it may take.
pub struct TilesetInput<'a> {
    /// Its surface.
    pub surface: &'a SurfaceCells,
    /// Folder for the surfaces of the levels.
    pub folder: &'a Path,
    /// Memory and threads.
    pub limits: WorkLimits,
}

/// What a tileset says of its errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorScale {
    /// Geometric error by the distance from the input.
    factor: f64,
    /// Origin of the tiles in the coordinates of the input.
    origin: DVec3,
}

impl ErrorScale {
    /// Reads it of a tileset; `None` if that does not say.
    pub fn of(document: &Value) -> Option<Self> {
        let extras = &document["asset"]["extras"];
        let factor = number(&extras[ERROR_FACTOR]).filter(|factor| factor.is_normal() && *factor > 0.0)?;
        let [x, y, z] = [0, 1, 2].map(|axis| number(&extras[SCENE_ORIGIN][axis]));
        Some(Self { factor, origin: DVec3::new(x?, y?, z?) })
    }
}

/// A tile of which the distances are measured.
struct MeasuredTile {
    path: PathBuf,
    /// No farther from the input, by its error.
    limit: f64,
}

/// The tiles of a level.
struct MeasuredLevel {
    writer: CellWriter,
    tiles: Vec<MeasuredTile>,
}

/// Tiles under way, by level.
pub struct TileErrors<'a> {
    input: &'a TilesetInput<'a>,
    scale: ErrorScale,
    /// By the bits of the lattice's step.
    levels: BTreeMap<u64, MeasuredLevel>,
}

/// What was measured of a level.
#[derive(Debug, Default)]
pub struct LevelErrors {
    /// Tiles with more points beyond their error than chance allows, each with their share.
    pub beyond: Vec<(PathBuf, f64)>,
    /// Share of the input's points beyond the largest error of a tile, if it is more than chance allows.
    pub input_beyond: Option<f64>,
}

impl<'a> TileErrors<'a> {
    /// Measures tiles against an input.
    pub fn new(input: &'a TilesetInput<'a>, scale: ErrorScale) -> Self {
        Self { input, scale, levels: BTreeMap::new() }
    }

    /// Takes a tile with its geometric error.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn add(&mut self, path: &Path, tile: &ReadTile, error: f64) -> Result<()> {
        let Self { input, scale, levels } = self;
        let step = tile.step.to_bits();
        let level = match levels.entry(step) {
            std::collections::btree_map::Entry::Occupied(level) => level.into_mut(),
            std::collections::btree_map::Entry::Vacant(new) => {
                let writer = CellWriter::create(&input.folder.join(format!("level-{step:x}.cells")), DVec3::ZERO)?;
                new.insert(MeasuredLevel { writer, tiles: Vec::new() })
            }
        };
        let positions = tile.places.iter().map(|place| DVec3::from(place.map(|at| at as f64)) * tile.step).collect();
        let surface = &tile.triangles[..tile.triangles.len() - tile.skirt_triangles];
        let face = |&vertices: &[u32; 3]| CellFace { vertices, image: ImageId::NONE, texcoords: [[0.0; 2]; 3] };
        let faces: Vec<CellFace> = surface.iter().map(face).collect();
        if !faces.is_empty() {
            level.writer.append(CellDraft::new(scale.origin, positions, &faces, Vec::new()))?;
            // Places of the lattice are rounded.
            level.tiles.push(MeasuredTile { path: path.to_owned(), limit: error / scale.factor + tile.step });
        }
        Ok(())
    }

    /// Measures all levels.
    ///
    /// # Errors
    /// If the check was stopped; on a full disk, failed reads and writes.
    pub fn measure(self, progress: &dyn Progress) -> Result<BTreeMap<u64, LevelErrors>> {
        let Self { input, levels, .. } = self;
        let mut found = BTreeMap::new();
        for (step, MeasuredLevel { writer, tiles }) in levels {
            let (cells, _) = writer.finish()?;
            found.insert(step, measure_level(input, cells, &tiles, progress)?);
        }
        Ok(found)
    }
}

fn measure_level(
    input: &TilesetInput<'_>,
    cells: Vec<Cell>,
    tiles: &[MeasuredTile],
    progress: &dyn Progress,
) -> Result<LevelErrors> {
    let share = |from: &SurfaceCells, to: &SurfaceCells, points: u64, limit: f64| {
        let (mut beyond, mut count) = (0_u64, 0_u64);
        SurfacePair { from, to }.each_distance(points, input.limits, progress, |_, distance| {
            count += 1;
            beyond += u64::from(distance > limit);
        })?;
        let count = count.max(1) as f64;
        let chance = DEVIATIONS * (BEYOND * SHARE / count).sqrt();
        let share = beyond as f64 / count;
        Result::Ok((share > BEYOND + chance).then_some(share))
    };
    let mut errors = LevelErrors::default();
    for (cell, tile) in cells.iter().zip(tiles) {
        progress.check_stopped()?;
        let own = SurfaceCells::from(vec![cell.clone()]);
        if let Some(share) = share(&own, input.surface, POINTS_OF_TILE, tile.limit)? {
            errors.beyond.push((tile.path.clone(), share));
        }
    }
    let largest = tiles.iter().map(|tile| tile.limit).fold(0.0, f64::max);
    errors.input_beyond = share(input.surface, &SurfaceCells::from(cells), POINTS_OF_LEVEL, largest)?;
    Ok(errors)
}

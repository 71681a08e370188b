//! Checks geometric errors: how far the tiles are from the input, both ways.
//!
//! ```text
//! triangles of a tile, without its skirt ── a cell ──▶ points ── distances to the input ── no farther than its error ÷ factor?
//! cells of all tiles of a level ── a surface ◀── distances ── points of the input
//! ```
//! A tile's error holds for 99 % of its surface, so some points may lie farther: as many as chance allows. Where a level
//! has lost all triangles of a tile, finer tiles stand in, as in a viewer:
//!
//! ```text
//! level 3   [       tile        ]        level 3's surface: its tile
//! level 2   [  tile  ]  (lost)           level 2's surface: its tile, and the tile of level 1 that stands in
//! level 1   [  tile  ] [  tile  ]
//! ```
//!
//! # Memory
//! 440 bytes for each triangle of a tile, and that of the searches.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde_json::Value;

use super::content::ReadTile;
use super::reader::number;
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
/// Steps of the lattice by which a place may be off: one where a cut meets an edge is rounded twice, by up to half the
/// diagonal of a step each.
const ROUNDING_STEPS: f64 = 2.0;
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
    /// Step of the lattice of the next tile above; infinite if there is none. It stands in for the levels between.
    step_above: f64,
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

    /// Takes a tile with its geometric error, and the step of the lattice of the next tile above, infinite if there is
    /// none.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn add(&mut self, path: &Path, tile: &ReadTile, error: f64, step_above: f64) -> Result<()> {
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
        let face = |&vertices: &[u32; 3]| CellFace { vertices, image: ImageId::NONE, texcoords: [[0.0; 2]; 3] };
        let faces: Vec<CellFace> = tile.surface().iter().map(face).collect();
        if !faces.is_empty() {
            level.writer.append(CellDraft::new(scale.origin, positions, &faces, Vec::new()))?;
            let limit = error / scale.factor + ROUNDING_STEPS * tile.step;
            level.tiles.push(MeasuredTile { path: path.to_owned(), limit, step_above });
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
        // Finer tiles that may stand in for one of the next level: steps ascend, as their bits do.
        let mut finer: Vec<(Cell, MeasuredTile)> = Vec::new();
        for (step, MeasuredLevel { writer, tiles }) in levels {
            finer.retain(|(_, tile)| tile.step_above > f64::from_bits(step));
            let own: Vec<(Cell, MeasuredTile)> = writer.finish()?.0.into_iter().zip(tiles).collect();
            found.insert(step, measure_level(input, &own, &finer, progress)?);
            finer.extend(own);
        }
        Ok(found)
    }
}

fn measure_level(
    input: &TilesetInput<'_>,
    own: &[(Cell, MeasuredTile)],
    finer: &[(Cell, MeasuredTile)],
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
    for (cell, tile) in own {
        progress.check_stopped()?;
        let surface = SurfaceCells::from(vec![cell.clone()]);
        if let Some(share) = share(&surface, input.surface, POINTS_OF_TILE, tile.limit)? {
            errors.beyond.push((tile.path.clone(), share));
        }
    }
    let shown = || own.iter().chain(finer);
    let largest = shown().map(|(_, tile)| tile.limit).fold(0.0, f64::max);
    let surface = SurfaceCells::from(shown().map(|(cell, _)| cell.clone()).collect::<Vec<Cell>>());
    errors.input_beyond = share(input.surface, &surface, POINTS_OF_LEVEL, largest)?;
    Ok(errors)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::Silent;

    const STEP: f64 = 1.0 / 64.0;

    /// A square of 64 steps whose corner lies at some steps from the origin, with places `every` steps apart.
    fn square(corner: [i64; 3], every: i64) -> ReadTile {
        let places = [[0, 0], [64, 0], [64, 64], [0, 64]];
        let place = |[x, y]: [i64; 2]| [corner[0] + x, corner[1] + y, corner[2]].map(|at| at / every);
        ReadTile {
            step: STEP * every as f64,
            places: places.map(place).to_vec(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..ReadTile::default()
        }
    }

    fn surface(folder: &Path, squares: &[ReadTile]) -> SurfaceCells {
        let mut writer = CellWriter::create(&folder.join("input.cells"), DVec3::ZERO).unwrap();
        for square in squares {
            let positions = square.places.iter().map(|place| DVec3::from(place.map(|at| at as f64)) * square.step);
            let face = |&vertices: &[u32; 3]| CellFace { vertices, image: ImageId::NONE, texcoords: [[0.0; 2]; 3] };
            let faces: Vec<CellFace> = square.triangles.iter().map(face).collect();
            writer.append(CellDraft::new(DVec3::ZERO, positions.collect(), &faces, Vec::new())).unwrap();
        }
        writer.finish().unwrap().0.into()
    }

    /// What is found of tiles, each with the step of the next tile above, against squares; a tile has no error but its
    /// step.
    fn found(input: &[ReadTile], tiles: &[(ReadTile, f64)]) -> Vec<LevelErrors> {
        let folder = tempfile::tempdir().unwrap();
        let surface = surface(folder.path(), input);
        let limits = WorkLimits { threads: 1, work_bytes: 1 << 20 };
        let input = TilesetInput { surface: &surface, folder: folder.path(), limits };
        let mut errors = TileErrors::new(&input, ErrorScale { factor: 1.0, origin: DVec3::ZERO });
        for (tile, step_above) in tiles {
            errors.add(Path::new("tile.glb"), tile, 0.0, *step_above).unwrap();
        }
        errors.measure(&Silent).unwrap().into_values().collect()
    }

    #[test]
    fn finer_tiles_stand_in_for_one_that_is_lost_and_for_no_other() {
        let input = [square([0, 0, 0], 1), square([640, 0, 0], 1)];
        let tiles = |step_above: f64| {
            let (kept, fine) = (square([0, 0, 0], 2), square([0, 0, 0], 1));
            [(kept, f64::INFINITY), (fine, 2.0 * STEP), (square([640, 0, 0], 1), step_above)]
        };
        let lost = found(&input, &tiles(f64::INFINITY));
        assert!(lost.len() == 2 && lost.iter().all(|level| level.input_beyond.is_none()), "{lost:?}");
        // Here a tile of level 1 should be there.
        let gone = found(&input, &tiles(2.0 * STEP));
        assert!(gone[0].input_beyond.is_none() && gone[1].input_beyond.is_some_and(|share| share > 0.4), "{gone:?}");
    }

    #[test]
    fn a_place_may_be_off_by_two_roundings_and_no_more() {
        let input = [square([0, 0, 0], 1)];
        for (off, is_fault) in [(0, false), (1, false), (2, false), (3, true)] {
            let level = &found(&input, &[(square([0, 0, off], 1), f64::INFINITY)])[0];
            assert_eq!((level.beyond.len() == 1, level.input_beyond.is_some()), (is_fault, is_fault), "{off} steps");
        }
    }
}

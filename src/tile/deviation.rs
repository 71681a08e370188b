//! How far each tile of a level lies from the input.
//!
//! In: the surface of the level, that of the input, and the tiles. Out: of each tile the distance within which 99 % of it
//! lies from the input, and 99 % of the input in its node from the level, whichever is larger.
//!
//! # Memory
//! 4 bytes for each point, 8 while they grow: 64 MiB at up to 160,000 tiles, then 400 bytes a tile.

use glam::DVec3;

use super::node_counts::LevelTiles;
use super::scene::TileScene;
use super::tree::{ROOT, TileNode, TileTree};
use crate::base::{Progress, Result, WorkLimits};
use crate::measure::compare::SurfacePair;
use crate::surface::cells::SurfaceCells;

/// Points by area for each tile, on each surface; and if some tile may lie farther than a texel, where its distance
/// counts: with these it is known within one per cent, about.
const SAMPLES_OF_TILE: u64 = 4000;
const SAMPLES_OF_FAR_TILE: u64 = 20_000;
/// At most this number of the latter in all, as each takes 4 bytes of memory, but never fewer a tile than at first.
const SAMPLES_MAX: u64 = 2_000_000;
/// At most this number in all at first, which is less a tile from 4,195 tiles on, but never fewer a tile than the least.
/// The number must not depend on the memory budget, as the errors do on it.
const FIRST_SAMPLES_MAX: u64 = 1 << 24;
const SAMPLES_OF_TILE_MIN: u64 = 100;
/// Share of a texel from which a tile may lie farther, by the fewer points.
const FAR: f64 = 0.9;
/// Share of a surface that the distance holds for.
pub const SHARE: f64 = 0.99;

/// Tiles of a level, by place.
#[derive(Clone, Copy)]
pub struct TilePlan<'a> {
    /// The tree.
    pub tree: &'a TileTree,
    /// The tiles of the level.
    pub tiles: &'a LevelTiles,
    /// Where they lie.
    pub scene: &'a TileScene,
}

impl TilePlan<'_> {
    /// Index of the tile that contains a position in the coordinates of the input; `None` if it has no triangles.
    fn tile_at(&self, position: DVec3) -> Option<usize> {
        let position = position - self.scene.origin;
        let mut node = ROOT;
        while !self.tiles.is_tile[node] {
            let TileNode::Split { axis, plane, below } = self.tree.nodes[node] else { return None };
            node = below.plus(u32::from(position[usize::from(axis)] >= plane));
        }
        self.tiles.tiles.binary_search(&node).ok()
    }

    /// The deviation of each tile, in the mesh's unit of length; less than `texel` is known less well.
    ///
    /// # Errors
    /// If the job was stopped, and on failed reads.
    pub fn deviations(
        &self,
        surfaces: [&SurfaceCells; 2],
        texel: f64,
        limits: WorkLimits,
        progress: &dyn Progress,
    ) -> Result<Vec<f64>> {
        let first = first_samples(self.tiles.tiles.len());
        let deviations = self.measured(surfaces, first, limits, progress)?;
        if deviations.iter().all(|&deviation| deviation < FAR * texel) {
            return Ok(deviations);
        }
        let more = (SAMPLES_MAX / deviations.len().max(1) as u64).min(SAMPLES_OF_FAR_TILE);
        // The same points have the same distances.
        if more > first { self.measured(surfaces, more, limits, progress) } else { Ok(deviations) }
    }

    fn measured(
        &self,
        [level, input]: [&SurfaceCells; 2],
        samples: u64,
        limits: WorkLimits,
        progress: &dyn Progress,
    ) -> Result<Vec<f64>> {
        let count = self.tiles.tiles.len();
        let mut deviations = vec![0.0f64; count];
        for pair in [SurfacePair { from: level, to: input }, SurfacePair { from: input, to: level }] {
            let mut distances: Vec<Vec<f32>> = vec![Vec::new(); count];
            pair.each_distance(samples * count as u64, limits, progress, |position, distance| {
                if let Some(tile) = self.tile_at(position) {
                    distances[tile].push(distance as f32);
                }
            })?;
            for (deviation, mut own) in deviations.iter_mut().zip(distances) {
                *deviation = deviation.max(quantile(&mut own));
            }
        }
        Ok(deviations)
    }
}

/// Points by area for each of `tiles` tiles, on each surface, at first.
fn first_samples(tiles: usize) -> u64 {
    (FIRST_SAMPLES_MAX / tiles.max(1) as u64).clamp(SAMPLES_OF_TILE_MIN, SAMPLES_OF_TILE)
}

/// The distance that [`SHARE`] of some distances do not exceed; 0 if there are none.
fn quantile(distances: &mut [f32]) -> f64 {
    let Some(last) = distances.len().checked_sub(1) else { return 0.0 };
    let rank = ((SHARE * distances.len() as f64).ceil() as usize).saturating_sub(1).min(last);
    let (_, value, _) = distances.select_nth_unstable_by(rank, f32::total_cmp);
    f64::from(*value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_hundred_distances_one_is_larger() {
        let mut distances: Vec<f32> = (1..=100).rev().map(|distance| distance as f32).collect();
        assert_eq!(quantile(&mut distances), 99.0);
        assert_eq!((quantile(&mut [3.0]), quantile(&mut [])), (3.0, 0.0));
    }

    #[test]
    fn points_of_very_many_tiles_stay_few() {
        for tiles in [1, 10, 1000, 4194] {
            assert_eq!(first_samples(tiles), SAMPLES_OF_TILE);
        }
        for tiles in [4195, 100_000, 160_000] {
            let own = first_samples(tiles);
            assert!(own >= SAMPLES_OF_TILE_MIN && own * tiles as u64 <= FIRST_SAMPLES_MAX, "{tiles}: {own}");
        }
        assert_eq!(first_samples(10_000_000), SAMPLES_OF_TILE_MIN);
    }
}

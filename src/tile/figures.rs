//! What was written of each tile, and of each level.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::chain::PassMesh;
use super::colours::ColourError;
use super::tree::TileId;
use crate::geometry::boxtree::Bounds;
use crate::job::Recalled;
use crate::os::content::Content;

/// What was written of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TileRecord {
    /// Its node.
    pub node: TileId,
    /// The smallest box around it, relative to the origin of the scene.
    pub bounds: Bounds,
    /// Triangles, those of the skirt included.
    pub faces: u64,
    /// Texels of its image.
    pub texels: u64,
    /// Texels that charts cover.
    pub covered: u64,
    /// Those of them without colour.
    pub colourless: u64,
    /// Charts.
    pub charts: u64,
    /// Whether it shows the texels of the input at a lower resolution than these have, since they do not fit.
    pub is_reduced: bool,
    /// How far its colours are from those of the input.
    pub colours: ColourError,
    /// The file.
    pub content: Content,
}

impl TileRecord {
    /// Whether nothing is left of the tile on the lattice of its level; it has no file then.
    pub fn is_empty(&self) -> bool {
        self.faces == 0
    }
}

/// What was built of a level.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct LevelFigures {
    /// Number of the level; 0 is the finest.
    pub level: u32,
    /// Tiles.
    pub tiles: u64,
    /// Triangles of its mesh.
    pub mesh_faces: u64,
    /// Triangles of its tiles, with those that cuts add and those of the skirts.
    pub faces: u64,
    /// Most triangles of a tile.
    pub faces_max: u64,
    /// Tiles with more triangles than they should have, since they cannot be divided.
    pub oversized: u64,
    /// Texels of all images.
    pub texels: u64,
    /// Most texels of an image.
    pub texels_max: u64,
    /// Share of the images that charts cover.
    pub fill: f64,
    /// Texels without colour.
    pub colourless: u64,
    /// Charts.
    pub charts: u64,
    /// Tiles whose texels had to be longer than those of the level, to fit an image.
    pub reduced: u64,
    /// Root mean square of the difference of colour, 0 to 255, to the input as the best texels of this length show it.
    pub colour_rms: f64,
    /// Length of a texel's side, in the mesh's unit of length.
    pub texel: f64,
    /// Distance within which 99 % of the level lies from the input, in the same unit.
    pub to_input_p99: f64,
    /// Distance within which 99 % of the input lies from the level.
    pub from_input_p99: f64,
    /// Geometric error.
    pub geometric_error: f64,
    /// Bytes of the files.
    pub bytes: u64,
}

impl Recalled for TileRecord {
    /// The file that it should be.
    type Context<'a> = &'a Path;

    fn is_sound(&self, path: &&Path) -> bool {
        self.is_empty() || Content::of(path).is_ok_and(|content| content == self.content)
    }
}

impl LevelFigures {
    /// The figures with those of the tiles of a level, which should have at most `limit` triangles each.
    pub fn of_tiles(self, mesh: &PassMesh, records: &[TileRecord], limit: u64) -> Self {
        let sum = |of: fn(&TileRecord) -> u64| records.iter().map(of).sum::<u64>();
        let most = |of: fn(&TileRecord) -> u64| records.iter().map(of).max().unwrap_or(0);
        Self {
            tiles: records.iter().filter(|record| !record.is_empty()).count() as u64,
            mesh_faces: mesh.faces,
            faces: sum(|tile| tile.faces),
            faces_max: most(|tile| tile.faces),
            oversized: records.iter().filter(|tile| tile.faces > limit).count() as u64,
            texels: sum(|tile| tile.texels),
            texels_max: most(|tile| tile.texels),
            fill: sum(|tile| tile.covered) as f64 / sum(|tile| tile.texels).max(1) as f64,
            colourless: sum(|tile| tile.colourless),
            charts: sum(|tile| tile.charts),
            reduced: sum(|tile| u64::from(tile.is_reduced)),
            colour_rms: records.iter().fold(ColourError::default(), |sum, tile| sum.plus(tile.colours)).rms(),
            to_input_p99: mesh.to_input.p99,
            from_input_p99: mesh.from_input.p99,
            bytes: sum(|tile| if tile.is_empty() { 0 } else { tile.content.bytes }),
            ..self
        }
    }
}

//! The steps of a pyramid, by which a work folder knows them.

use super::tree::TileId;
use crate::job::StepKey;

/// A step of a pyramid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum TileStep {
    /// The surface after a pass is kept and measured.
    Surface {
        /// Number of the pass, from 1.
        pass: u32,
    },
    /// The tree of tiles.
    Tree,
    /// A level is cut into tiles.
    Cut {
        /// Number of the level.
        level: u32,
    },
    /// A tile is written.
    Tile {
        /// Number of the level.
        level: u32,
        /// Node of the tree.
        tile: TileId,
    },
    /// A tile is kept for those of the next level.
    Raw {
        /// Number of the level.
        level: u32,
        /// Node of the tree.
        tile: TileId,
    },
}

impl TileStep {
    /// What the keys of steps begin with that record tiles which another process made.
    pub fn prefix_of_tiles(level: u32) -> String {
        format!("tile-made-{level:02}")
    }

    /// Its key.
    pub fn key(self) -> StepKey {
        match self {
            Self::Surface { pass } => StepKey::numbered(format!("tile-level-{pass:02}")),
            Self::Tree => StepKey::fixed("tile-tree"),
            Self::Cut { level } => StepKey::numbered(format!("tile-cut-{level:02}")),
            Self::Tile { level, tile } => StepKey::numbered(format!("tile-{level:02}-{:06}", tile.number())),
            Self::Raw { level, tile } => StepKey::numbered(format!("tile-raw-{level:02}-{:06}", tile.number())),
        }
    }
}

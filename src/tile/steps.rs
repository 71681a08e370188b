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
    /// Tiles among some are made by another process.
    Made {
        /// Number of the level.
        level: u32,
        /// The first.
        first: TileId,
        /// How many nodes there are to the last one.
        count: u32,
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
            Self::Made { level, first, count } => {
                StepKey::numbered(format!("{}-{:06}-{count}", Self::prefix_of_tiles(level), first.number()))
            }
            Self::Raw { level, tile } => StepKey::numbered(format!("tile-raw-{level:02}-{:06}", tile.number())),
        }
    }

    /// The step of a key; `None` for a key of anything else.
    pub fn of(key: &StepKey) -> Option<Self> {
        let mut words = key.name().strip_prefix("tile-")?.split('-');
        let number = |word: Option<&str>| word?.parse::<u32>().ok();
        let first = words.next()?;
        let mut next = || number(words.next());
        let step = match first {
            "level" => Self::Surface { pass: next()? },
            "tree" => Self::Tree,
            "cut" => Self::Cut { level: next()? },
            "made" => Self::Made { level: next()?, first: TileId::new(next()?), count: next()? },
            "raw" => Self::Raw { level: next()?, tile: TileId::new(next()?) },
            level => Self::Tile { level: number(Some(level))?, tile: TileId::new(next()?) },
        };
        (step.key() == *key).then_some(step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_names_its_step() {
        let tile = TileId::new(12_345_678);
        for step in [
            TileStep::Surface { pass: 3 },
            TileStep::Tree,
            TileStep::Cut { level: 0 },
            TileStep::Tile { level: 39, tile },
            TileStep::Made { level: 1, first: tile, count: 64 },
            TileStep::Raw { level: 2, tile },
        ] {
            assert_eq!(TileStep::of(&step.key()), Some(step));
        }
        for other in ["tile-", "tile-cut", "tile-cut-1", "tile-00-1", "tile-00-000001-2", "scan-mesh", "pass-0-mesh"] {
            assert_eq!(TileStep::of(&StepKey::fixed(other)), None, "{other}");
        }
    }
}

//! The file that names all tiles: 3D Tiles 1.1, explicit tiling.
//!
//! ```text
//! tileset.json    asset, geometric error, root ── children ── children ── …     each with a box and an error
//! 2/0.glb, 1/3.glb, 0/17.glb                                                    level / node
//! ```
//! # Source
//! Open Geospatial Consortium, 3D Tiles 1.1 (22-025r4).

use glam::{DMat4, DVec3};
use serde_json::{Value, json};

use super::node_counts::LevelTiles;
use super::tree::{ROOT, TileId, TileTree};
use crate::geometry::boxtree::Bounds;

/// Name of the file that names all tiles.
pub const TILESET: &str = "tileset.json";

/// A tile as the tileset names it.
#[derive(Debug, Clone, PartialEq)]
pub struct ListedTile {
    /// Its node.
    pub node: TileId,
    /// The smallest box around it, relative to the origin of the scene.
    pub bounds: Bounds,
    /// Geometric error by itself, in the mesh's unit of length.
    pub error: f64,
}

/// A level as the tileset names it.
#[derive(Debug, Clone, PartialEq)]
pub struct ListedLevel {
    /// Which nodes are tiles of the level.
    pub tiles: LevelTiles,
    /// Those with triangles, by node.
    pub listed: Vec<ListedTile>,
}

/// What a tileset says.
pub struct TilesetDocument<'a> {
    /// The tree.
    pub tree: &'a TileTree,
    /// The levels, level 0 first.
    pub levels: &'a [ListedLevel],
    /// From the scene to the world.
    pub transform: DMat4,
}

/// Name of a tile's file in the folder of the result.
pub fn tile_name(level: u32, node: TileId) -> String {
    format!("{level}/{}.glb", node.number())
}

impl TilesetDocument<'_> {
    /// The document.
    pub fn to_json(&self) -> Value {
        let mut tiles = self.below(self.levels.len() - 1, ROOT);
        let mut root = match tiles.len() {
            1 => tiles.remove(0),
            // A level that does not fit one tile has a root without content.
            _ => NamedTile::around(tiles),
        };
        root.tile["transform"] = json!(self.transform.to_cols_array());
        json!({
            "asset": { "version": "1.1", "generator": concat!("drystone ", env!("CARGO_PKG_VERSION")) },
            "geometricError": root.bounds.diagonal().max(2.0 * root.error),
            "root": root.tile,
        })
    }

    /// The tiles of a level in and below a node.
    fn below(&self, level: usize, node: TileId) -> Vec<NamedTile> {
        let ListedLevel { tiles, listed } = &self.levels[level];
        if !tiles.is_tile[node] {
            let children = self.tree.children(node).into_iter().flatten();
            return children.flat_map(|child| self.below(level, child)).collect();
        }
        let children = if level > 0 { self.below(level - 1, node) } else { Vec::new() };
        // Where a level has lost all triangles, those of the finer one take its place.
        let Ok(at) = listed.binary_search_by_key(&node, |tile| tile.node) else { return children };
        let bounds = children.iter().fold(listed[at].bounds, |all, child| all.with(child.bounds));
        let error = children.iter().fold(listed[at].error, |most, child| most.max(child.error));
        let mut tile = json!({
            "boundingVolume": box_of(bounds),
            "geometricError": error,
            "refine": "REPLACE",
            "content": { "uri": tile_name(level as u32, node) },
        });
        if !children.is_empty() {
            tile["children"] = children.into_iter().map(|child| child.tile).collect();
        }
        vec![NamedTile { tile, bounds, error }]
    }
}

/// A tile with all below it.
struct NamedTile {
    tile: Value,
    bounds: Bounds,
    error: f64,
}

impl NamedTile {
    /// A tile without content around others.
    fn around(tiles: Vec<Self>) -> Self {
        let bounds = tiles.iter().fold(Bounds::EMPTY, |all, tile| all.with(tile.bounds));
        let error = 2.0 * tiles.iter().fold(0.0, |most: f64, tile| most.max(tile.error));
        let children: Vec<Value> = tiles.into_iter().map(|tile| tile.tile).collect();
        let tile = json!({
            "boundingVolume": box_of(bounds), "geometricError": error, "refine": "REPLACE", "children": children,
        });
        Self { tile, bounds, error }
    }
}

/// A box along the axes: its middle, and half of each side.
fn box_of(bounds: Bounds) -> Value {
    let middle: DVec3 = 0.5 * (bounds.low + bounds.high);
    let half = 0.5 * (bounds.high - bounds.low);
    json!({ "box": [middle.x, middle.y, middle.z, half.x, 0.0, 0.0, 0.0, half.y, 0.0, 0.0, 0.0, half.z] })
}

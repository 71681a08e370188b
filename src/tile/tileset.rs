//! The files that name all tiles: 3D Tiles 1.1, explicit tiling.
//!
//! ```text
//! tileset.json          asset, geometric error, root ── children ── children ── …     each with a box and an error
//! tileset-4-12.json     the same for what lies below a tile of level 4
//! 7/0.glb, 4/12.glb     level / node
//! ```
//! A file has [`LEVELS_OF_FILE`] levels, so that a viewer reads of a large pyramid what it shows.
//!
//! # Source
//! Open Geospatial Consortium, 3D Tiles 1.1 (22-025r4).

use glam::{DMat4, DVec3};
use serde_json::{Value, json};

use super::node_counts::LevelTiles;
use super::tree::{ROOT, TileId, TileTree};
use crate::geometry::boxtree::Bounds;

/// Name of the file that names all tiles.
pub const TILESET: &str = "tileset.json";

/// What the tileset says besides the standard, in `asset.extras`: geometric error by the distance from the input, and
/// the origin of the tiles in the coordinates of the input.
pub const ERROR_FACTOR: &str = "errorFactor";
pub const SCENE_ORIGIN: &str = "origin";

/// Levels that a file names.
const LEVELS_OF_FILE: usize = 4;

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
    /// Geometric error by the larger of a tile's texel and its distance from the input.
    pub error_factor: f64,
    /// Least error of a root that has no content of its own: that of a level above the coarsest one.
    pub bare_root_error: f64,
    /// Origin of the scene in the coordinates of the input; `None` if the input was moved.
    pub origin: Option<DVec3>,
}

/// Name of a tile's file in the folder of the result.
pub fn tile_name(level: u32, node: TileId) -> String {
    format!("{level}/{}.glb", node.number())
}

impl TilesetDocument<'_> {
    /// The files by name, [`TILESET`] last.
    pub fn files(&self) -> Vec<(String, Value)> {
        let mut files = Vec::new();
        let mut tiles = self.below(self.levels.len() - 1, ROOT, &mut files);
        let mut root = match tiles.len() {
            1 => tiles.remove(0),
            // A level that does not fit one tile has a root without content. Viewers look below it only if it has an error.
            _ => {
                let most = tiles.iter().fold(0.0, |most: f64, tile| most.max(tile.error));
                NamedTile::around(tiles, (2.0 * most).max(self.bare_root_error))
            }
        };
        root.tile["transform"] = json!(self.transform.to_cols_array());
        let error = root.bounds.diagonal().max(2.0 * root.error);
        let mut tileset = document(error, root.tile);
        let extras = &mut tileset["asset"]["extras"];
        extras[ERROR_FACTOR] = json!(self.error_factor);
        if let Some(origin) = self.origin {
            extras[SCENE_ORIGIN] = json!(origin.to_array());
        }
        files.push((TILESET.to_owned(), tileset));
        files
    }

    /// The tiles of a level in and below a node; adds the files that name those below.
    fn below(&self, level: usize, node: TileId, files: &mut Vec<(String, Value)>) -> Vec<NamedTile> {
        let ListedLevel { tiles, listed } = &self.levels[level];
        if !tiles.is_tile[node] {
            let children = self.tree.children(node).into_iter().flatten();
            return children.flat_map(|child| self.below(level, child, files)).collect();
        }
        let children = if level > 0 { self.below(level - 1, node, files) } else { Vec::new() };
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
        let is_last = (self.levels.len() - level).is_multiple_of(LEVELS_OF_FILE);
        if is_last && !children.is_empty() {
            let name = format!("tileset-{level}-{}.json", node.number());
            let below = NamedTile::around(children, error);
            tile["children"] = json!([{
                "boundingVolume": box_of(below.bounds),
                "geometricError": error,
                "refine": "REPLACE",
                "content": { "uri": name },
            }]);
            files.push((name, document(error, below.tile)));
        } else if !children.is_empty() {
            tile["children"] = children.into_iter().map(|child| child.tile).collect();
        }
        vec![NamedTile { tile, bounds, error }]
    }
}

fn document(error: f64, root: Value) -> Value {
    let asset = json!({ "version": "1.1", "generator": concat!("drystone ", env!("CARGO_PKG_VERSION")) });
    json!({ "asset": asset, "geometricError": error, "root": root })
}

/// A tile with all below it.
struct NamedTile {
    tile: Value,
    bounds: Bounds,
    error: f64,
}

impl NamedTile {
    /// A tile without content around others.
    fn around(tiles: Vec<Self>, error: f64) -> Self {
        let bounds = tiles.iter().fold(Bounds::EMPTY, |all, tile| all.with(tile.bounds));
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

//! The files that name all tiles: 3D Tiles 1.1, explicit tiling.
//!
//! ```text
//! tileset.json          asset, geometric error, root ── children ── children ── …     each with a box and an error
//! tileset-4-12.json     the same for what lies below a tile of level 4
//! 7/0.glb, 4/12.glb     level / node
//! ```
//! A file has [`LEVELS_OF_FILE`] levels, so that a viewer reads of a large pyramid what it shows.
//!
//! # Memory
//! About 300 bytes for each tile that the file under way names; 64 for each of the others.
//!
//! # Source
//! Open Geospatial Consortium, 3D Tiles 1.1 (22-025r4).

use glam::{DMat4, DVec3};
use serde_json::{Value, json};

use super::node_counts::LevelTiles;
use super::tree::{ROOT, TileId, TileTree};
use crate::base::Result;
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
    /// Passes the files to `write`, each with its name and text: those below a tile as soon as they are complete,
    /// [`TILESET`] last.
    ///
    /// # Errors
    /// Those of `write`.
    pub fn write(&self, mut write: impl FnMut(&str, &str) -> Result<()>) -> Result<()> {
        let mut tiles = self.below(self.levels.len() - 1, ROOT, &mut write)?;
        let root = match tiles.len() {
            1 => tiles.remove(0),
            // A level that does not fit one tile has a root without content. Viewers look below it only if it has an error.
            _ => {
                let most = tiles.iter().fold(0.0, |most: f64, tile| most.max(tile.error));
                NamedTile::around(&tiles, (2.0 * most).max(self.bare_root_error))
            }
        };
        let error = root.bounds.diagonal().max(2.0 * root.error);
        let mut extras = json!({ ERROR_FACTOR: self.error_factor });
        if let Some(origin) = self.origin {
            extras[SCENE_ORIGIN] = json!(origin.to_array());
        }
        let transform = json!(self.transform.to_cols_array());
        let root = format!("{},\"transform\":{transform}}}", root.text.strip_suffix('}').unwrap_or_default());
        write(TILESET, &document(Some(extras), error, &root))
    }

    /// The tiles of a level in and below a node; writes the files that name those below.
    fn below(
        &self,
        level: usize,
        node: TileId,
        write: &mut impl FnMut(&str, &str) -> Result<()>,
    ) -> Result<Vec<NamedTile>> {
        let ListedLevel { tiles, listed } = &self.levels[level];
        if !tiles.is_tile[node] {
            let mut all = Vec::new();
            for child in self.tree.children(node).into_iter().flatten() {
                all.append(&mut self.below(level, child, write)?);
            }
            return Ok(all);
        }
        let children = if level > 0 { self.below(level - 1, node, write)? } else { Vec::new() };
        // Where a level has lost all triangles, those of the finer one take its place.
        let Ok(at) = listed.binary_search_by_key(&node, |tile| tile.node) else { return Ok(children) };
        let bounds = children.iter().fold(listed[at].bounds, |all, child| all.with(child.bounds));
        let error = children.iter().fold(listed[at].error, |most, child| most.max(child.error));
        let own = tile_name(level as u32, node);
        let is_last = (self.levels.len() - level).is_multiple_of(LEVELS_OF_FILE);
        let text = if is_last && !children.is_empty() {
            let name = format!("tileset-{level}-{}.json", node.number());
            let below = NamedTile::around(&children, error);
            write(&name, &document(None, error, &below.text))?;
            let named = tile_text(below.bounds, None, Some(&name), error);
            tile_text(bounds, Some(&named), Some(&own), error)
        } else {
            let within = Some(joined(&children)).filter(|_| !children.is_empty());
            tile_text(bounds, within.as_deref(), Some(&own), error)
        };
        Ok(vec![NamedTile { text, bounds, error }])
    }
}

/// A file that names tiles: JSON whose keys are sorted, as those of all its objects are.
fn document(extras: Option<Value>, error: f64, root: &str) -> String {
    let mut asset = json!({ "version": "1.1", "generator": concat!("drystone ", env!("CARGO_PKG_VERSION")) });
    if let Some(extras) = extras {
        asset["extras"] = extras;
    }
    format!("{{\"asset\":{asset},\"geometricError\":{},\"root\":{root}}}", json!(error))
}

/// A tile with all below it. Its text takes a tenth of the memory of a tree of values.
struct NamedTile {
    text: String,
    bounds: Bounds,
    error: f64,
}

impl NamedTile {
    /// A tile without content around others.
    fn around(tiles: &[Self], error: f64) -> Self {
        let bounds = tiles.iter().fold(Bounds::EMPTY, |all, tile| all.with(tile.bounds));
        Self { text: tile_text(bounds, Some(&joined(tiles)), None, error), bounds, error }
    }
}

/// The texts of tiles, one after the other.
fn joined(tiles: &[NamedTile]) -> String {
    let mut text = String::with_capacity(tiles.iter().map(|tile| tile.text.len() + 1).sum());
    for tile in tiles {
        if !text.is_empty() {
            text.push(',');
        }
        text.push_str(&tile.text);
    }
    text
}

/// The text of a tile, with the texts of its children and the name of what it shows.
fn tile_text(bounds: Bounds, children: Option<&str>, content: Option<&str>, error: f64) -> String {
    let children = children.map_or(String::new(), |text| format!("\"children\":[{text}],"));
    let content = content.map_or(String::new(), |name| format!("\"content\":{},", json!({ "uri": name })));
    format!(
        "{{\"boundingVolume\":{},{children}{content}\"geometricError\":{},\"refine\":\"REPLACE\"}}",
        box_of(bounds),
        json!(error)
    )
}

/// A box along the axes: its middle, and half of each side.
fn box_of(bounds: Bounds) -> Value {
    let middle: DVec3 = 0.5 * (bounds.low + bounds.high);
    let half = 0.5 * (bounds.high - bounds.low);
    json!({ "box": [middle.x, middle.y, middle.z, half.x, 0.0, 0.0, 0.0, half.y, 0.0, 0.0, 0.0, half.z] })
}

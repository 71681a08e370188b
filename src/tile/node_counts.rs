//! Counts what each node of the tree would hold of a level, and chooses the tiles of the level.
//!
//! In: the surface of a level. Out: the nodes that become its tiles. Invariant: a tile of a level is a tile of the next
//! coarser one, or lies inside of one.

use std::collections::HashMap;

use foldhash::fast::FixedState;
use serde::{Deserialize, Serialize};

use super::clip::{ClipCorner, ClipEdge, Clipper, TakeParts};
use super::settings::FACES_OF_STRIP;
use super::tree::{ROOT, TileId, TileLimits, TileTree};
use super::triangles::LevelTriangles;
use crate::base::id::TiVec;
use crate::base::ordered::map_in_order;
use crate::base::{Progress, Result, WorkLimits};
use crate::geometry::triangle::area;

/// What a node holds of a level.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct NodeCount {
    /// Triangles.
    pub faces: u64,
    /// Edges along the planes of the node.
    pub border_edges: u64,
    /// Texels that its triangles cover.
    pub texels: f64,
}

impl NodeCount {
    fn add(&mut self, other: Self) {
        self.faces += other.faces;
        self.border_edges += other.border_edges;
        self.texels += other.texels;
    }
}

/// The tiles of a level.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LevelTiles {
    /// Nodes with triangles, ascending.
    pub tiles: Vec<TileId>,
    /// Whether a node is a tile of this level, with triangles or without.
    pub is_tile: TiVec<TileId, bool>,
}

/// Counts what the nodes hold of a level.
///
/// # Errors
/// If the job was stopped, and on failed reads.
pub fn count(
    level: &LevelTriangles<'_>,
    tree: &TileTree,
    limits: WorkLimits,
    progress: &dyn Progress,
) -> Result<TiVec<TileId, NodeCount>> {
    let mut counts: TiVec<TileId, NodeCount> = vec![NodeCount::default(); tree.nodes.len()].into();
    let count_cell = |cell: usize| {
        let mut counter = NodeCounter { counts: HashMap::default(), density: 0.0 };
        let mut clipper = Clipper::new(tree);
        level.each(cell, |triangle| {
            counter.density = triangle.density;
            clipper.cut(triangle.corners, &mut counter);
        })?;
        Ok(counter.counts)
    };
    let cells = 0..level.surface.cells.len();
    map_in_order(cells, limits.threads, limits.threads + 1, count_cell, |own| {
        own.into_iter().for_each(|(node, own)| counts[node].add(own));
        progress.check_stopped()
    })?;
    Ok(counts)
}

struct NodeCounter {
    /// Of the nodes that the cell reaches: few of all.
    counts: HashMap<TileId, NodeCount, FixedState>,
    /// Texels on a unit of the triangle's area.
    density: f64,
}

impl TakeParts for NodeCounter {
    fn part(&mut self, node: TileId, polygon: &[ClipCorner]) -> bool {
        let first = polygon[0].position;
        let areas = polygon[1..].windows(2).map(|side| area([first, side[0].position, side[1].position]));
        self.counts.entry(node).or_default().add(NodeCount {
            faces: polygon.len() as u64 - 2,
            border_edges: polygon.iter().filter(|corner| corner.edge != ClipEdge::Own).count() as u64,
            texels: areas.sum::<f64>() * self.density,
        });
        true
    }
}

impl LevelTiles {
    /// The coarsest nodes that fit a tile, or that cannot be divided, inside of which those of the level below lie. Nodes
    /// may be known to be too large for other reasons.
    pub fn choose(
        counts: &TiVec<TileId, NodeCount>,
        tree: &TileTree,
        limits: &TileLimits,
        is_too_large: &TiVec<TileId, bool>,
        below: Option<&Self>,
    ) -> Self {
        let fits = |node: TileId| {
            let count = &counts[node];
            count.faces + FACES_OF_STRIP * count.border_edges <= limits.faces
                && count.texels <= limits.texels
                && !is_too_large[node]
        };
        let mut is_tile: TiVec<TileId, bool> = vec![false; tree.nodes.len()].into();
        let mut tiles = Vec::new();
        let mut pending = vec![ROOT];
        while let Some(node) = pending.pop() {
            match Self::parts(tree, below, node) {
                Some(parts) if !fits(node) => pending.extend(parts),
                _ => {
                    is_tile[node] = true;
                    if counts[node].faces > 0 {
                        tiles.push(node);
                    }
                }
            }
        }
        tiles.sort_unstable();
        Self { tiles, is_tile }
    }

    /// The nodes into which one can be divided; `None` for a leaf, and for a tile of the level below, whatever they hold.
    pub fn parts(tree: &TileTree, below: Option<&Self>, node: TileId) -> Option<[TileId; 2]> {
        tree.children(node).filter(|_| below.is_none_or(|below| !below.is_tile[node]))
    }

    /// Reports whether a recalled value fits a tree.
    pub fn is_sound(&self, tree: &TileTree) -> bool {
        self.is_tile.len() == tree.nodes.len()
            && self.tiles.iter().all(|&tile| self.is_tile.get(tile) == Some(&true))
            && self.tiles.is_sorted()
    }
}

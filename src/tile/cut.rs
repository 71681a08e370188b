//! Cuts the surface of a level into its tiles.
//!
//! ```text
//! cells of the level ── clip at the planes ──▶ triangles by tile, on the lattice ──▶ tile-cut-1.buckets
//! ```
//! Invariant: two tiles that meet along a plane have the same edges there, to the bit.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, IVec3};

use super::census::{LevelTiles, each_triangle};
use super::clip::{ClipCorner, Clipper, EdgeKind, Polygon, TakeParts, triangulate};
use super::lattice::Lattice;
use super::scene::Scene;
use super::tree::{TileId, TileTree};
use crate::base::ordered::map_in_order;
use crate::base::{Progress, Result, WorkLimits};
use crate::file::buckets::{BucketWriter, Buckets, Sorted, Verbatim};
use crate::surface::cells::SurfaceCells;

/// A triangle of a tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct TileTriangle {
    /// Places of its corners on the lattice of the level.
    pub corners: [[i32; 3]; 3],
    /// Two bits for the edge from each corner: 0 inside of the tile, else 1 + the axis that is normal to the border.
    pub border: u32,
}

impl Verbatim for TileTriangle {}

/// The triangles of a level, by tile: the index of the tile among those of the level.
pub type CutLevel = Buckets<TileTriangle>;

/// A level that is cut.
#[derive(Clone, Copy)]
pub struct Cutting<'a> {
    /// The tree of tiles.
    pub tree: &'a TileTree,
    /// The tiles of the level.
    pub tiles: &'a LevelTiles,
    /// Where they lie.
    pub scene: &'a Scene,
    /// Number of the level.
    pub level: u32,
}

impl Cutting<'_> {
    /// Cuts the surface of the level into `path`.
    ///
    /// # Errors
    /// If the job was stopped; on a full disk, failed reads and writes.
    pub fn cut(
        &self,
        surface: &SurfaceCells,
        path: &std::path::Path,
        limits: WorkLimits,
        progress: &dyn Progress,
    ) -> Result<CutLevel> {
        let lattice = self.scene.lattice(self.level);
        let mut writer = BucketWriter::create(path, self.tiles.tiles.len())?;
        let cut_cell = |cell: usize| {
            let mut clipper = Clipper::new(self.tree);
            let mut parts = TileParts { tiles: self.tiles, parts: Vec::new() };
            let mut triangles = Vec::new();
            each_triangle(surface, cell, self.scene, lattice, |corners| {
                parts.parts.clear();
                clipper.cut(corners, &mut parts);
                for (tile, polygon) in &parts.parts {
                    put_triangles(*tile, &clipper.completed(polygon), lattice, &mut triangles);
                }
            })?;
            Ok(Sorted::new(&triangles))
        };
        let cells = 0..surface.cells.len();
        map_in_order(cells, limits.threads, limits.threads + 1, cut_cell, |sorted| {
            progress.check_stopped()?;
            writer.append(sorted)
        })?;
        writer.finish_durable()
    }
}

/// The parts of a triangle in the tiles of a level.
struct TileParts<'a> {
    tiles: &'a LevelTiles,
    parts: Vec<(usize, Polygon)>,
}

impl TakeParts for TileParts<'_> {
    fn part(&mut self, node: TileId, polygon: &[ClipCorner]) -> bool {
        if !self.tiles.is_tile[node] {
            return true;
        }
        if let Ok(index) = self.tiles.tiles.binary_search(&node) {
            self.parts.push((index, polygon.to_vec()));
        }
        false
    }
}

/// Puts the corners of a part on the lattice, and divides it into triangles.
fn put_triangles(tile: usize, polygon: &[ClipCorner], lattice: Lattice, out: &mut Vec<(usize, TileTriangle)>) {
    let mut places: Vec<(IVec3, u32)> = Vec::with_capacity(polygon.len());
    for corner in polygon {
        let place = lattice.place(corner.position);
        let border = match corner.edge {
            EdgeKind::Own => 0,
            EdgeKind::Cut { axis, .. } => 1 + u32::from(axis),
        };
        match places.last_mut() {
            // Of an edge without length, the next one remains.
            Some(last) if last.0 == place => last.1 = border,
            _ => places.push((place, border)),
        }
    }
    while places.len() > 1 && places.first().map(|first| first.0) == places.last().map(|last| last.0) {
        places.pop();
    }
    let positions: Vec<DVec3> = places.iter().map(|(place, _)| place.as_dvec3()).collect();
    for ids in triangulate(&positions) {
        let corners = ids.map(|id| places[id].0);
        if corners[0] == corners[1] || corners[1] == corners[2] || corners[2] == corners[0] {
            continue;
        }
        let border_of = |at: usize| {
            let (id, next) = (ids[at], ids[(at + 1) % 3]);
            if (id + 1) % places.len() == next { places[id].1 } else { 0 }
        };
        let border = (0..3).fold(0, |bits, at| bits | border_of(at) << (2 * at));
        out.push((tile, TileTriangle { corners: corners.map(|corner| corner.to_array()), border }));
    }
}

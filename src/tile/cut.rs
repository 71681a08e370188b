//! Cuts the surface of a level into its tiles.
//!
//! ```text
//! cells of the level ── clip at the planes ──▶ triangles by tile, on the lattice ──▶ tile-cut-1.buckets
//! ```
//! Invariant: two tiles that meet along a plane have the same edges there, to the bit.

use std::path::Path;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, IVec3};

use super::clip::{ClipCorner, ClipEdge, Clipper, Polygon, TakeParts, triangulate};
use super::lattice::Lattice;
use super::node_counts::LevelTiles;
use super::tree::{TileId, TileTree};
use super::triangles::LevelTriangles;
use crate::base::ordered::map_in_order;
use crate::base::{Progress, Result, WorkLimits};
use crate::file::buckets::{BucketWriter, Buckets, Sorted};
use crate::file::record::Verbatim;
use crate::model::id::ImageId;

/// A triangle of a tile. One that repeats a corner is a line: it says that the border lies there.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct TileTriangle {
    /// Places of its corners on the lattice of the level.
    pub corners: [[i32; 3]; 3],
    /// Two bits for the edge from each corner: 0 inside of the tile, else 1 + the axis that is normal to the border.
    pub border: u32,
    /// What it shows; none in a level that does not keep its texels.
    pub image: ImageId,
    /// Texture coordinates of its corners.
    pub texcoords: [[f32; 2]; 3],
}

impl Verbatim for TileTriangle {}

/// The triangles of a level, by tile: the index of the tile among those of the level.
pub type CutLevel = Buckets<TileTriangle>;

/// Cuts a level into tiles, into the file `path`.
///
/// # Errors
/// If the job was stopped; on a full disk, failed reads and writes.
pub fn cut(
    level: &LevelTriangles<'_>,
    tree: &TileTree,
    tiles: &LevelTiles,
    path: &Path,
    limits: WorkLimits,
    progress: &dyn Progress,
) -> Result<CutLevel> {
    let lattice = level.scene.lattice(level.level);
    let mut writer = BucketWriter::create(path, tiles.tiles.len())?;
    let cut_cell = |cell: usize| {
        let mut clipper = Clipper::new(tree);
        let mut parts = TileParts { tiles, parts: Vec::new() };
        let mut triangles = Vec::new();
        level.each(cell, |triangle| {
            parts.parts.clear();
            clipper.cut(triangle.corners, &mut parts);
            for (tile, polygon) in &parts.parts {
                put_triangles(*tile, &clipper.completed(polygon), triangle.image, lattice, &mut triangles);
            }
        })?;
        let (tiles, triangles): (Vec<usize>, Vec<TileTriangle>) = triangles.into_iter().unzip();
        Ok(Sorted::new(&tiles, &triangles))
    };
    let cells = 0..level.surface.cells.len();
    map_in_order(cells, limits.threads, limits.threads + 1, cut_cell, |sorted| {
        progress.check_stopped()?;
        writer.append(sorted)
    })?;
    writer.finish_durable()
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
fn put_triangles(
    tile: usize,
    polygon: &[ClipCorner],
    image: ImageId,
    lattice: Lattice,
    out: &mut Vec<(usize, TileTriangle)>,
) {
    let mut corners: Vec<PlacedCorner> = Vec::with_capacity(polygon.len());
    for corner in polygon {
        let placed = PlacedCorner::new(corner, lattice);
        match corners.last_mut() {
            // Of an edge without length, the next one remains.
            Some(last) if last.place == placed.place => *last = placed,
            _ => corners.push(placed),
        }
    }
    while corners.len() > 1 && corners[0].place == corners[corners.len() - 1].place {
        corners.pop();
    }
    let mut put = |ids: [usize; 3]| {
        let border_of = |at: usize| {
            let (id, next) = (ids[at], ids[(at + 1) % 3]);
            if (id + 1) % corners.len() == next { corners[id].border } else { 0 }
        };
        let border = (0..3).fold(0, |bits, at| bits | border_of(at) << (2 * at));
        let (places, texcoords) = (ids.map(|id| corners[id].place), ids.map(|id| corners[id].texcoord));
        out.push((tile, TileTriangle { corners: places.map(|place| place.to_array()), border, image, texcoords }));
    };
    match corners.len() {
        0 | 1 => {}
        // The part is thinner than the lattice: its two edges are one.
        2 => put([0, 1, 1]),
        _ => {
            let positions: Vec<DVec3> = corners.iter().map(|corner| corner.place.as_dvec3()).collect();
            triangulate(&positions).into_iter().for_each(&mut put);
        }
    }
}

/// A corner of a part on the lattice.
#[derive(Clone, Copy)]
struct PlacedCorner {
    place: IVec3,
    texcoord: [f32; 2],
    /// Of the edge that begins here, as in [`TileTriangle`].
    border: u32,
}

impl PlacedCorner {
    fn new(corner: &ClipCorner, lattice: Lattice) -> Self {
        let border = match corner.edge {
            ClipEdge::Own => 0,
            ClipEdge::Cut { axis, .. } => 1 + u32::from(axis),
        };
        Self { place: lattice.place(corner.position), texcoord: corner.texcoord.as_vec2().to_array(), border }
    }
}

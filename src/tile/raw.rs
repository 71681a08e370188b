//! What the tiles of the next coarser level are baked from: the mesh of a tile, and its image at half of its size.
//!
//! An image at half of its size has texels as long as those of the next level, and each of them is the mean of four: what a
//! texel of the next level shows is found at one place.
//!
//! # Files
//! `tile-raw-<level>-<node>.cells` and `.texels`; they go once the next level is complete.

use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::mesh::TileMesh;
use super::paint::PaintedTile;
use super::steps::TileStep;
use super::tree::TileId;
use crate::bake::{Original, PaintedImage};
use crate::base::Result;
use crate::image::stored::StoredImage;
use crate::job::{Recalled, Step, WorkFolder};
use crate::mesh::id::{FaceId, LocalVertex};
use crate::model::id::ImageId;
use crate::surface::cell::{Cell, CellDraft, CellFace, CellWriter};
use crate::surface::cells::SurfaceCells;

/// A tile that others are baked from.
#[derive(Debug, Serialize, Deserialize)]
pub struct RawTile {
    cell: Cell,
    image: StoredImage,
}

impl Recalled for RawTile {
    type Context<'a> = ();

    fn locate(&mut self, folder: &Path, (): &()) {
        self.cell.locate(folder);
        self.image.locate(folder);
    }

    fn is_sound(&self, (): &()) -> bool {
        self.cell.is_sound() && self.image.is_sound()
    }
}

/// What is kept of a tile, before it is written.
#[derive(Debug, Serialize, Deserialize)]
pub struct RawDraft {
    /// Positions are relative to this.
    origin: DVec3,
    positions: Vec<DVec3>,
    faces: Vec<RawFace>,
    /// The image at half of its size: three bytes a texel.
    rgb: Vec<u8>,
    size: [usize; 2],
}

/// A triangle: its vertices and their texture coordinates.
type RawFace = ([u32; 3], [[f32; 2]; 3]);

/// Largest side of an image of a tile in texels.
const SIDE_MAX: usize = 1 << 14;

impl RawDraft {
    /// What is kept of a tile with this mesh, whose positions are relative to `origin`; `None` if it has no triangles with
    /// texels.
    pub fn of(mesh: &TileMesh, tile: &PaintedTile, origin: DVec3) -> Option<Self> {
        let image = tile.image.as_ref().filter(|_| !tile.texcoords.is_empty())?;
        let face =
            |&(face, texcoords): &(FaceId, [[f32; 2]; 3])| (mesh.faces[face].map(LocalVertex::number), texcoords);
        let faces = tile.texcoords.iter().map(face).collect();
        let (rgb, size) = halved(image);
        Some(Self { origin, positions: mesh.positions.raw.clone(), faces, rgb, size })
    }

    /// Reports whether its parts fit together.
    pub fn is_sound(&self) -> bool {
        let is_vertex = |&vertex: &u32| (vertex as usize) < self.positions.len();
        let [width, height] = self.size;
        let are_sides = self.size.iter().all(|side| (1..=SIDE_MAX).contains(side));
        are_sides
            && 3 * width * height == self.rgb.len()
            && self.faces.iter().all(|(vertices, _)| vertices.iter().all(is_vertex))
    }

    /// Writes the tile `node` of a level, the one with this index among those of its level, and records it.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes.
    pub fn keep(self, work: &WorkFolder, level: u32, node: TileId, index: usize) -> Result<Option<RawTile>> {
        let key = TileStep::Raw { level, tile: node }.key();
        let place = |ending: &str| work.path().join(format!("{}.{ending}", key.name()));
        let image = ImageId::from(index);
        let faces: Vec<CellFace> =
            self.faces.iter().map(|&(vertices, texcoords)| CellFace { vertices, image, texcoords }).collect();
        let mut writer = CellWriter::create(&place("cells"), self.origin)?;
        writer.append(CellDraft::new(self.origin, self.positions, &faces, Vec::new()))?;
        let (cells, _) = writer.finish()?;
        let image = StoredImage::store(&self.rgb, self.size, &place("texels"))?;
        let Some(cell) = cells.into_iter().next() else { return Ok(None) };
        let raw = RawTile { cell, image };
        let step = Step::new(key.clone()).from([TileStep::Cut { level }.key()]);
        work.keep(step, [raw.cell.path(), raw.image.path()], &raw)?;
        Ok(Some(raw))
    }
}

impl RawTile {
    /// The surface of all tiles of a level, with texels of this length.
    pub fn join(tiles: &[Option<Self>], texel: f64) -> Original {
        let images = tiles.iter().map(|tile| tile.as_ref().map(|tile| tile.image.clone())).collect();
        let cells: Vec<Cell> = tiles.iter().flatten().map(|tile| tile.cell.clone()).collect();
        Original::of_stored(SurfaceCells::from(cells), images, texel)
    }

    /// Removes its files, on a best-effort basis: they go with the work folder otherwise.
    pub fn remove(&self) {
        for path in [self.cell.path(), self.image.path()] {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// An image at half of its size, each texel the mean of four.
fn halved(image: &PaintedImage) -> (Vec<u8>, [usize; 2]) {
    let [width, height] = image.size;
    let size = image.size.map(|side| side.div_ceil(2));
    let mut rgb = Vec::with_capacity(3 * size[0] * size[1]);
    let mean = |four: [u8; 4]| ((four.into_iter().map(u16::from).sum::<u16>() + 2) / 4) as u8;
    for row in 0..size[1] {
        let rows = [2 * row, (2 * row + 1).min(height - 1)];
        let [upper, lower] = rows.map(|row| &image.rgb[3 * width * row..3 * width * (row + 1)]);
        let ((pairs, upper_last), (below, lower_last)) = (upper.as_chunks::<6>(), lower.as_chunks::<6>());
        for (a, b) in pairs.iter().zip(below) {
            rgb.extend_from_slice(
                &[0, 1, 2].map(|channel| mean([a[channel], a[channel + 3], b[channel], b[channel + 3]])),
            );
        }
        // A last column without another one beside it.
        rgb.extend(upper_last.iter().zip(lower_last).map(|(&a, &b)| mean([a, a, b, b])));
    }
    (rgb, size)
}

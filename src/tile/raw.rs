//! What the tiles of the next coarser level are baked from: the mesh of a tile, and its image at half of its size.
//!
//! An image at half of its size has texels as long as those of the next level, and each of them is the mean of four: what a
//! texel of the next level shows is found at one place.
//!
//! # Files
//! `tile-raw-<level>-<node>.cells` and `.texels`; they go once the next level is complete.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::mesh::TileMesh;
use super::paint::PaintedTile;
use super::scene::TileScene;
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

/// Where a tile belongs.
#[derive(Clone, Copy)]
pub struct RawPlace<'a> {
    /// The folder for its files, and its steps.
    pub work: &'a WorkFolder,
    /// Its node.
    pub node: TileId,
    /// Number of the tile among those of its level.
    pub index: usize,
    /// Where the level lies.
    pub scene: &'a TileScene,
    /// Number of the level.
    pub level: u32,
}

impl RawTile {
    /// Keeps a tile; `None` if it has no triangles with texels.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes.
    pub fn keep(mesh: &TileMesh, tile: &PaintedTile, place: &RawPlace<'_>) -> Result<Option<Self>> {
        let (Some(image), false) = (&tile.image, tile.texcoords.is_empty()) else { return Ok(None) };
        let key = TileStep::Raw { level: place.level, tile: place.node }.key();
        let name = key.name();
        let folder = place.work.path();
        let origin = place.scene.origin + place.scene.lattice(place.level).position(mesh.middle);
        let shown = ImageId::from(place.index);
        let face = |(face, texcoords): &(FaceId, [[f32; 2]; 3])| CellFace {
            vertices: mesh.faces[*face].map(LocalVertex::number),
            image: shown,
            texcoords: *texcoords,
        };
        let faces: Vec<CellFace> = tile.texcoords.iter().map(face).collect();
        let path = folder.join(format!("{name}.cells"));
        let mut writer = CellWriter::create(&path, origin)?;
        writer.append(CellDraft::new(origin, mesh.positions.raw.clone(), &faces, Vec::new()))?;
        let (cells, _) = writer.finish()?;
        let (rgb, size) = halved(image);
        let image = StoredImage::store(&rgb, size, &folder.join(format!("{name}.texels")))?;
        let Some(cell) = cells.into_iter().next() else { return Ok(None) };
        let raw = Self { cell, image };
        let step = Step::new(key).from([TileStep::Cut { level: place.level }.key()]);
        place.work.keep(step, [path.as_path(), raw.image.path()], &raw)?;
        Ok(Some(raw))
    }

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
    for row in 0..size[1] {
        for column in 0..size[0] {
            let rows = [2 * row, (2 * row + 1).min(height - 1)];
            let columns = [2 * column, (2 * column + 1).min(width - 1)];
            rgb.extend([0, 1, 2].map(|channel| {
                let at = |row: usize, column: usize| u16::from(image.rgb[3 * (row * width + column) + channel]);
                let sum: u16 = rows.iter().map(|&row| at(row, columns[0]) + at(row, columns[1])).sum();
                ((sum + 2) / 4) as u8
            }));
        }
    }
    (rgb, size)
}

//! The images of the input, decoded once into files of square tiles, from which colours are read at random.
//!
//! ```text
//! image ── decode ──▶ rows ──▶ | tile 0,0: 64 × 64 pixels, 12 KiB | tile 1,0 | … |      a reader keeps recent tiles
//! ```
//! In: image files, not trusted. Out: [`StoredImage`]s, and the colours of a [`TexelReader`]. Invariant: an image that
//! does not fit the memory is stored at a lower resolution, which is noted.
//!
//! # Memory
//! While an image is decoded, that of [`DecodePlan`](crate::image::decode::DecodePlan). A reader: 3 MiB of tiles.
//!
//! # Files
//! `bake-image-<number>.texels`, 3 bytes a pixel.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::base::id::TiSlice;
use crate::base::{Error, Result};
use crate::file::RecordFile;
use crate::file::codec;
use crate::file::header::HEADER_BYTES;
use crate::image::decode::Image;
use crate::model::id::ImageId;

/// Side of a tile in pixels.
const TILE: usize = 64;
/// Bytes of a tile.
const TILE_BYTES: usize = TILE * TILE * 3;
/// Tiles that a reader keeps: a power of two.
const TILES_KEPT: usize = 256;

/// An image in a file of tiles.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StoredImage {
    #[serde(with = "codec::path")]
    path: PathBuf,
    /// Width and height in pixels, as stored.
    size: [u32; 2],
}

impl StoredImage {
    /// Writes a decoded image.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn write(image: &Image, path: &Path) -> Result<Self> {
        let [width, height] = image.size();
        let mut file = RecordFile::create(path)?;
        let mut tile = vec![0; TILE_BYTES];
        for top in (0..height).step_by(TILE) {
            for left in (0..width).step_by(TILE) {
                for (row, line) in tile.chunks_exact_mut(3 * TILE).enumerate() {
                    let (y, end) = ((top + row).min(height - 1), (left + TILE).min(width));
                    line[..3 * (end - left)].copy_from_slice(image.row(y, left..end));
                }
                file.put(&tile)?;
            }
        }
        file.finish(*b"texels  ", 0, (width.div_ceil(TILE) * height.div_ceil(TILE)) as u64)?;
        Ok(Self { path: path.to_owned(), size: [width as u32, height as u32] })
    }

    /// Its file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Sets the folder of the file of a recalled value.
    pub fn locate(&mut self, folder: &Path) {
        if let Some(name) = self.path.file_name() {
            self.path = folder.join(name);
        }
    }

    /// Reports whether a recalled and located value is consistent with its file.
    pub fn is_sound(&self) -> bool {
        let [across, down] = self.tiles();
        let bytes = HEADER_BYTES + (across * down) as u64 * TILE_BYTES as u64;
        self.size.iter().all(|&side| (1..1 << 24).contains(&side))
            && self.path.metadata().is_ok_and(|file| file.len() == bytes)
    }

    fn tiles(&self) -> [usize; 2] {
        self.size.map(|side| (side as usize).div_ceil(TILE))
    }
}

/// How coordinates beyond an image are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beyond {
    /// As the nearest pixel of the image.
    Edge,
    /// As the image repeated.
    Repeat,
}

/// Number of no tile.
const NO_TILE: [u32; 2] = [u32::MAX; 2];

/// Reads colours from stored images.
pub struct TexelReader<'a> {
    images: &'a TiSlice<ImageId, Option<StoredImage>>,
    /// Image and number of each tile that is kept, by a hash of both.
    kept: Vec<[u32; 2]>,
    pixels: Vec<u8>,
    open: Option<(ImageId, File)>,
}

impl<'a> TexelReader<'a> {
    /// A reader that keeps no tile yet.
    pub fn new(images: &'a TiSlice<ImageId, Option<StoredImage>>) -> Self {
        Self { images, kept: vec![NO_TILE; TILES_KEPT], pixels: vec![0; TILES_KEPT * TILE_BYTES], open: None }
    }

    /// Colour (red, green, blue; 0 to 255) at a texture coordinate, with (0, 0) at the lower left, mixed of the four
    /// pixels around it; `None` if the image could not be read.
    ///
    /// # Errors
    /// On failed reads.
    pub fn colour(&mut self, image: ImageId, texcoord: [f32; 2], beyond: Beyond) -> Result<Option<Vec3>> {
        let Some(stored) = self.images.get(image).and_then(Option::as_ref) else { return Ok(None) };
        let [width, height] = stored.size;
        let x = texcoord[0] * width as f32 - 0.5;
        let y = (1.0 - texcoord[1]) * height as f32 - 0.5;
        let (left, top) = (x.floor(), y.floor());
        let (right_share, lower_share) = (x - left, y - top);
        let within = |at: f32, side: u32| match beyond {
            Beyond::Edge => at.clamp(0.0, (side - 1) as f32) as usize,
            Beyond::Repeat => (at as i64).rem_euclid(i64::from(side)) as usize,
        };
        let columns = [left, left + 1.0].map(|at| within(at, width));
        let rows = [top, top + 1.0].map(|at| within(at, height));
        let [upper_left, upper_right, lower_left, lower_right] = if columns[0] / TILE == columns[1] / TILE
            && rows[0] / TILE == rows[1] / TILE
        {
            let tile = self.tile(image, [columns[0] / TILE, rows[0] / TILE])?;
            [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[column, row]| pixel(tile, columns[column], rows[row]))
        } else {
            let mut far = |column: usize, row: usize| -> Result<Vec3> {
                Ok(pixel(self.tile(image, [column / TILE, row / TILE])?, column, row))
            };
            [far(columns[0], rows[0])?, far(columns[1], rows[0])?, far(columns[0], rows[1])?, far(columns[1], rows[1])?]
        };
        let upper = upper_left.lerp(upper_right, right_share);
        Ok(Some(upper.lerp(lower_left.lerp(lower_right, right_share), lower_share)))
    }

    /// The pixels of a tile.
    #[inline]
    fn tile(&mut self, image: ImageId, [across, down]: [usize; 2]) -> Result<&[u8]> {
        let Some(stored) = self.images.get(image).and_then(Option::as_ref) else { return Ok(&[]) };
        let tile = (down * stored.tiles()[0] + across) as u32;
        // Neighbours of a tile, and tiles of other images, have other places.
        let slot = (down % 16 * 16 + across % 16 + image.number() as usize * 37) % TILES_KEPT;
        if self.kept[slot] != [image.number(), tile] {
            self.load(image, tile, slot)?;
        }
        Ok(&self.pixels[slot * TILE_BYTES..][..TILE_BYTES])
    }

    #[cold]
    fn load(&mut self, image: ImageId, tile: u32, slot: usize) -> Result<()> {
        let Some(stored) = self.images.get(image).and_then(Option::as_ref) else { return Ok(()) };
        let wrap = |error| Error::io(&stored.path, "read", error);
        if self.open.as_ref().is_none_or(|(open, _)| *open != image) {
            self.open = Some((image, File::open(&stored.path).map_err(wrap)?));
        }
        let Some((_, file)) = &mut self.open else { return Ok(()) };
        self.kept[slot] = NO_TILE;
        file.seek(SeekFrom::Start(HEADER_BYTES + u64::from(tile) * TILE_BYTES as u64)).map_err(wrap)?;
        file.read_exact(&mut self.pixels[slot * TILE_BYTES..][..TILE_BYTES]).map_err(wrap)?;
        self.kept[slot] = [image.number(), tile];
        Ok(())
    }
}

/// The pixel of a tile at a column and row of its image.
#[inline]
fn pixel(tile: &[u8], column: usize, row: usize) -> Vec3 {
    let at = 3 * (row % TILE * TILE + column % TILE);
    let [red, green, blue] = [0, 1, 2].map(|channel| f32::from(tile[at + channel]));
    Vec3::new(red, green, blue)
}

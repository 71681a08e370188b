//! Images decoded once into files of square tiles, from which colours are read at random.
//!
//! ```text
//! image ── decode ──▶ rows ──▶ | tile 0,0: 64 × 64 pixels, 12 KiB | tile 1,0 | … |      a reader keeps recent tiles
//! ```
//! In: image files, not trusted. Out: [`StoredImage`]s, and the colours of a [`TexelReader`]. Invariant: an image that
//! does not fit the memory is stored at a lower resolution, which is noted.
//!
//! # Memory
//! While an image is decoded, that of [`DecodePlan`](crate::image::decode::DecodePlan). A reader: 4 MiB of tiles.
//!
//! # Files
//! A file for each image, 3 bytes a pixel.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use glam::{Vec3, Vec4};
use serde::{Deserialize, Serialize};

use super::decode::{self, DecodePlan, Image};
use crate::base::error::escape_path;
use crate::base::id::TiSlice;
use crate::base::ordered::map_within;
use crate::base::{Error, Findings, Result};
use crate::file::RecordFile;
use crate::file::codec;
use crate::file::header::HEADER_BYTES;
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
    /// Width and height in the image file.
    full_size: [u32; 2],
}

impl StoredImage {
    /// Decodes an image file into tiles, as planned; `None`, with a finding, if it cannot be decoded. One that is
    /// stored at a lower resolution is a finding, too.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn decode(
        image: &Path,
        plan: std::result::Result<DecodePlan, String>,
        path: &Path,
        findings: &mut Findings,
    ) -> Result<Option<Self>> {
        match plan.and_then(|plan| Ok((plan, decode::decode(image, &plan)?))) {
            Ok((plan, pixels)) => {
                if plan.reduction > 1 {
                    findings.note("reduced_image", || {
                        format!("{}: read at 1/{} of its size", escape_path(image), plan.reduction)
                    });
                }
                Ok(Some(Self { full_size: plan.size, ..Self::write(&pixels, path)? }))
            }
            Err(why) => {
                findings.note("unreadable_image", || format!("{}: {why}", escape_path(image)));
                Ok(None)
            }
        }
    }

    /// Writes a decoded image.
    fn write(image: &Image, path: &Path) -> Result<Self> {
        Self::store(image.pixels(), image.size(), path)
    }

    /// Writes an image: red, green and blue of each pixel, row by row.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn store(pixels: &[u8], [width, height]: [usize; 2], path: &Path) -> Result<Self> {
        let mut file = RecordFile::create(path)?;
        let mut tile = vec![0; TILE_BYTES];
        for top in (0..height).step_by(TILE) {
            for left in (0..width).step_by(TILE) {
                for (row, line) in tile.chunks_exact_mut(3 * TILE).enumerate() {
                    let (y, end) = ((top + row).min(height - 1), (left + TILE).min(width));
                    line[..3 * (end - left)].copy_from_slice(&pixels[3 * (y * width + left)..3 * (y * width + end)]);
                }
                file.put(&tile)?;
            }
        }
        file.finish(*b"texels  ", 0, (width.div_ceil(TILE) * height.div_ceil(TILE)) as u64)?;
        let size = [width as u32, height as u32];
        Ok(Self { path: path.to_owned(), size, full_size: size })
    }

    /// Its file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Width and height in pixels, as stored.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Width and height of the image file in pixels.
    pub fn full_size(&self) -> [u32; 2] {
        self.full_size
    }

    /// Sets the folder of the file of a recalled value.
    pub fn locate(&mut self, folder: &Path) {
        if let Some(name) = self.path.file_name() {
            self.path = folder.join(name);
        }
    }

    /// Reports whether a recalled and located value is consistent with its file.
    pub fn is_sound(&self) -> bool {
        let bytes = || {
            let [across, down] = self.tiles();
            HEADER_BYTES + (across * down) as u64 * TILE_BYTES as u64
        };
        self.size.iter().all(|&side| (1..1 << 24).contains(&side))
            && self.path.metadata().is_ok_and(|file| file.len() == bytes())
    }

    fn tiles(&self) -> [usize; 2] {
        self.size.map(|side| (side as usize).div_ceil(TILE))
    }
}

/// Decodes image files, as many at once as fit the memory: `decode` gets the plan of each, `take` what it made, in order.
///
/// # Errors
/// Those of `decode` and `take`.
pub fn decode_within<'p, T: Send>(
    work_bytes: u64,
    files: impl Iterator<Item = (ImageId, &'p Path)> + Send,
    decode: impl Fn(ImageId, std::result::Result<DecodePlan, String>) -> Result<T> + Sync,
    mut take: impl FnMut(ImageId, T) -> Result<()>,
) -> Result<()> {
    let plan = |path: &Path| decode::plan(path, work_bytes);
    let cost_bytes = |(_, path): &(ImageId, &Path)| plan(path).map_or(0, |plan| plan.bytes);
    let read = |(image, path): (ImageId, &Path)| Ok((image, decode(image, plan(path))?));
    map_within(work_bytes, cost_bytes, files, read, |(image, decoded)| take(image, decoded))
}

/// How coordinates beyond an image are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Beyond {
    /// As the nearest pixel of the image.
    Edge,
    /// As the image repeated.
    Repeat,
}

/// In which direction pixels lie side by side, by its axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelLine {
    Rightwards = 0,
    Upwards = 1,
}

/// Number of no tile.
const NO_TILE: [u32; 2] = [u32::MAX; 2];

/// Reads colours from stored images.
pub struct TexelReader<'a> {
    images: &'a TiSlice<ImageId, Option<StoredImage>>,
    /// Image and number of each tile that is kept, by a hash of both.
    kept: Vec<[u32; 2]>,
    /// Red, green, blue, and nothing.
    pixels: Vec<[u8; 4]>,
    /// A tile as it is read.
    bytes: Vec<u8>,
    open: Option<(ImageId, File)>,
}

impl<'a> TexelReader<'a> {
    /// A reader that keeps no tile yet.
    pub fn new(images: &'a TiSlice<ImageId, Option<StoredImage>>) -> Self {
        let pixels = vec![[0; 4]; TILES_KEPT * TILE * TILE];
        Self { images, kept: vec![NO_TILE; TILES_KEPT], pixels, bytes: vec![0; TILE_BYTES], open: None }
    }

    /// Colour (red, green, blue; 0 to 255) at a texture coordinate, with (0, 0) at the lower left, mixed of the four
    /// pixels around it; `None` if the image could not be read.
    ///
    /// # Errors
    /// On failed reads.
    #[inline(always)]
    pub fn colour(&mut self, image: ImageId, texcoord: [f32; 2], beyond: Beyond) -> Result<Option<Vec3>> {
        let Some(Some(stored)) = self.images.get(image) else { return Ok(None) };
        let [width, height] = stored.size;
        let (columns, right_share) = beyond.pair(texcoord[0] * width as f32 - 0.5, width);
        let (rows, lower_share) = beyond.pair((1.0 - texcoord[1]) * height as f32 - 0.5, height);
        let pixels = if columns[0] / TILE == columns[1] / TILE && rows[0] / TILE == rows[1] / TILE {
            let tile = self.tile(stored, image, [columns[0] / TILE, rows[0] / TILE])?;
            let [left, right] = [columns[0] % TILE, columns[1] % TILE];
            let [upper, lower] = [rows[0] % TILE * TILE, rows[1] % TILE * TILE];
            [tile[upper + left], tile[upper + right], tile[lower + left], tile[lower + right]]
        } else {
            self.pixels_of_tiles(stored, image, columns, rows)?
        };
        Ok(Some(mixed(pixels, right_share, lower_share)))
    }

    /// Copies red, green and blue of neighbouring pixels, from that in a column and row on, which are counted from the
    /// upper left; leaves them as they are if the image could not be read.
    ///
    /// # Errors
    /// On failed reads.
    pub fn copy(
        &mut self,
        image: ImageId,
        from: [i64; 2],
        line: PixelLine,
        beyond: Beyond,
        mut pixels: &mut [[u8; 3]],
    ) -> Result<()> {
        let Some(Some(stored)) = self.images.get(image) else { return Ok(()) };
        let mut from = from;
        let axis = line as usize;
        while !pixels.is_empty() {
            let [column, row] = [0, 1].map(|axis| beyond.within(from[axis], stored.size[axis]));
            let along = [column, row][axis];
            let in_tile = match line {
                PixelLine::Rightwards => TILE.min(stored.size[0] as usize - column / TILE * TILE) - column % TILE,
                PixelLine::Upwards => row % TILE + 1,
            };
            // Beyond an edge, the pixel stays the same.
            let is_same = beyond == Beyond::Edge && from[axis] != along as i64;
            let count = if is_same { 1 } else { in_tile.min(pixels.len()) };
            let (now, later) = pixels.split_at_mut(count);
            let tile = self.tile(stored, image, [column / TILE, row / TILE])?;
            let first = row % TILE * TILE + column % TILE;
            let copy = |(to, &[red, green, blue, _]): (&mut [u8; 3], &[u8; 4])| *to = [red, green, blue];
            match line {
                PixelLine::Rightwards => now.iter_mut().zip(&tile[first..]).for_each(copy),
                PixelLine::Upwards => now.iter_mut().zip(tile[..=first].iter().rev().step_by(TILE)).for_each(copy),
            }
            from[axis] += if line == PixelLine::Upwards { -(count as i64) } else { count as i64 };
            pixels = later;
        }
        Ok(())
    }

    /// Four pixels that lie in several tiles.
    fn pixels_of_tiles(
        &mut self,
        stored: &StoredImage,
        image: ImageId,
        [left, right]: [usize; 2],
        [upper, lower]: [usize; 2],
    ) -> Result<[[u8; 4]; 4]> {
        let mut pixels = [[0; 4]; 4];
        let places = [[left, upper], [right, upper], [left, lower], [right, lower]];
        for (pixel, [column, row]) in pixels.iter_mut().zip(places) {
            *pixel = self.tile(stored, image, [column / TILE, row / TILE])?[row % TILE * TILE + column % TILE];
        }
        Ok(pixels)
    }

    /// The pixels of a tile.
    #[inline]
    fn tile(
        &mut self,
        stored: &StoredImage,
        image: ImageId,
        [across, down]: [usize; 2],
    ) -> Result<&[[u8; 4]; TILE * TILE]> {
        let tile = (down * stored.tiles()[0] + across) as u32;
        // Neighbours of a tile, and tiles of other images, have other places.
        let slot = (down % 16 * 16 + across % 16 + image.number() as usize * 37) % TILES_KEPT;
        if self.kept[slot] != [image.number(), tile] {
            self.load(stored, image, tile, slot)?;
        }
        Ok(&self.pixels.as_chunks().0[slot])
    }

    #[cold]
    fn load(&mut self, stored: &StoredImage, image: ImageId, tile: u32, slot: usize) -> Result<()> {
        let wrap = |error| Error::io(&stored.path, "read", error);
        if self.open.as_ref().is_none_or(|(open, _)| *open != image) {
            self.open = Some((image, File::open(&stored.path).map_err(wrap)?));
        }
        let Some((_, file)) = &mut self.open else { return Ok(()) };
        self.kept[slot] = NO_TILE;
        file.seek(SeekFrom::Start(HEADER_BYTES + u64::from(tile) * TILE_BYTES as u64)).map_err(wrap)?;
        file.read_exact(&mut self.bytes).map_err(wrap)?;
        let pixels = &mut self.pixels[slot * TILE * TILE..][..TILE * TILE];
        for (pixel, &[red, green, blue]) in pixels.iter_mut().zip(self.bytes.as_chunks().0) {
            *pixel = [red, green, blue, 0];
        }
        self.kept[slot] = [image.number(), tile];
        Ok(())
    }
}

impl Beyond {
    /// The pixel that is shown at a place along an axis of `side` pixels.
    #[inline]
    fn within(self, at: i64, side: u32) -> usize {
        match self {
            Self::Edge => at.clamp(0, i64::from(side) - 1) as usize,
            Self::Repeat => at.rem_euclid(i64::from(side)) as usize,
        }
    }

    /// The two pixels between whose middles a place lies, of `side` pixels, and the share of the second one.
    #[inline]
    fn pair(self, at: f32, side: u32) -> ([usize; 2], f32) {
        match self {
            Self::Edge => {
                // No number becomes 0, by the order of both.
                let at = at.max(0.0).min((side - 1) as f32);
                let first = at as u32;
                ([first as usize, (first + 1).min(side - 1) as usize], at - first as f32)
            }
            Self::Repeat => {
                let whole = (at as i64).clamp(-(1 << 62), 1 << 62);
                let first = whole - i64::from(whole as f32 > at);
                let pixel = |number: i64| number.rem_euclid(i64::from(side)) as usize;
                ([pixel(first), pixel(first + 1)], at - first as f32)
            }
        }
    }
}

/// Mixes four pixels by the share of those on the right and that of the lower ones.
#[inline]
fn mixed(pixels: [[u8; 4]; 4], right_share: f32, lower_share: f32) -> Vec3 {
    let [a, b, c, d] = pixels.map(|[red, green, blue, rest]| {
        Vec4::from_array([f32::from(red), f32::from(green), f32::from(blue), f32::from(rest)])
    });
    let [left_share, upper_share] = [1.0 - right_share, 1.0 - lower_share];
    let [upper, lower] = [a * left_share + b * right_share, c * left_share + d * right_share];
    (upper * upper_share + lower * lower_share).truncate()
}

//! Paints a tile into one image, however many charts it has.
//!
//! ```text
//!   +---------------+-------+
//!   | charts that   | ▪ ▪ ▪ |      a chart that found no room gets a block of one colour
//!   | found room    | ▪ ▪ ▪ |
//!   +---------------+-------+
//! ```
//! A chart takes its texels and a gutter around them, so longer texels help only up to some thousand charts. Leaves of
//! trees and other loose triangles have more.

use glam::DVec2;

use crate::bake::{PaintedImage, PatchBaker, PatchSurface};
use crate::base::Result;
use crate::unwrap::{ImageSize, PlacedChart, Unwrapped};

/// Texels get longer by this factor until all charts fit one image, this often at most.
const COARSER: f64 = 1.1;
const TRIES_MAX: usize = 100;
/// Tries, and the share of the images that they leave at most: where gutters take the room, longer texels bring nothing.
const TRIES_OF_GAIN: usize = 8;
const GAIN: f64 = 0.75;
/// Largest side of a chart that may be shown in one colour, in texels.
const BLOCK_EXTENT: f64 = 2.0;
/// How often texels may be doubled until all other charts are smaller than that.
const DOUBLINGS_MAX: usize = 40;
/// Side of a block of one colour in texels, if there is room; half of it at half of the image's size.
const BLOCK: usize = 2;
/// Sides of the part of an image that blocks take are multiples of this.
const STRIDE: usize = 8;

/// A patch in one image.
pub(super) struct PaintedPatch {
    pub unwrapped: Unwrapped,
    /// `None` for a patch without triangles to unwrap.
    pub image: Option<PaintedImage>,
    /// Whether its texels are longer than those of the level.
    pub is_reduced: bool,
}

/// Unwraps a patch into one image, with longer texels if it has to be, and paints it.
///
/// # Errors
/// If the job was stopped, and on failed reads.
pub(super) fn paint_in_one(baker: &PatchBaker<'_>, patch: &PatchSurface<'_>) -> Result<PaintedPatch> {
    let (mut unwrapped, mut coarser) = (baker.unwrap(patch, 1.0)?, 1.0);
    let mut before = unwrapped.images.len();
    for number in 1..=TRIES_MAX {
        if unwrapped.images.len() <= 1 {
            break;
        }
        if number % TRIES_OF_GAIN == 0 {
            if unwrapped.images.len() as f64 > GAIN * before as f64 {
                break;
            }
            before = unwrapped.images.len();
        }
        coarser *= COARSER;
        unwrapped = baker.unwrap(patch, coarser)?;
    }
    match unwrapped.images.len() {
        0 => Ok(PaintedPatch { unwrapped, image: None, is_reduced: false }),
        1 => {
            let image = Some(baker.paint(patch, &unwrapped, 0)?);
            Ok(PaintedPatch { unwrapped, image, is_reduced: coarser > 1.0 })
        }
        _ => {
            let (unwrapped, image) = paint_with_blocks(baker, patch)?;
            Ok(PaintedPatch { unwrapped, image: Some(image), is_reduced: true })
        }
    }
}

/// Whether a chart is so small that one colour shows it.
fn fits_block(chart: &PlacedChart) -> bool {
    let places = || chart.faces.iter().flat_map(|(_, flat)| flat).copied();
    let low = places().fold(DVec2::INFINITY, DVec2::min);
    (places().fold(DVec2::NEG_INFINITY, DVec2::max) - low).max_element() <= BLOCK_EXTENT
}

/// Paints the charts of the first image, of half the side, and shows all others in one colour each.
fn paint_with_blocks(baker: &PatchBaker<'_>, patch: &PatchSurface<'_>) -> Result<(Unwrapped, PaintedImage)> {
    let half = baker.side() / 2;
    let mut coarser = 1.0;
    let mut unwrapped = baker.unwrap_within(patch, coarser, half)?;
    for _ in 0..DOUBLINGS_MAX {
        if unwrapped.charts.iter().filter(|chart| chart.image > 0).all(fits_block) {
            break;
        }
        coarser *= 2.0;
        unwrapped = baker.unwrap_within(patch, coarser, half)?;
    }
    let mut image = baker.paint(patch, &unwrapped, 0)?;
    let mut colours: Vec<([u8; 3], usize)> = Vec::new();
    for number in 1..unwrapped.images.len() {
        let other = baker.paint(patch, &unwrapped, number)?;
        image.painted.covered += other.painted.covered;
        image.painted.colourless += other.painted.colourless;
        let charts = unwrapped.charts.iter().enumerate().filter(|(_, chart)| chart.image as usize == number);
        colours.extend(charts.map(|(at, chart)| (mean_colour(&other, chart), at)));
    }
    if colours.is_empty() {
        return Ok((unwrapped, image));
    }
    // Similar colours beside each other: an encoder that loses some mixes these.
    colours.sort_by_key(|&([red, green, blue], at)| (2 * u32::from(red) + 5 * u32::from(green) + u32::from(blue), at));
    let blocks = Blocks::beside(&image, colours.len(), half as usize);
    let image = blocks.add(image, &colours);
    for (number, &(_, at)) in colours.iter().enumerate() {
        let chart = &mut unwrapped.charts[at];
        let middle = blocks.middle(number);
        chart.faces.iter_mut().for_each(|(_, flat)| *flat = [middle; 3]);
        chart.image = 0;
    }
    let [width, height] = image.size.map(|side| side as u32);
    unwrapped.images = vec![ImageSize { width, height }];
    Ok((unwrapped, image))
}

/// The mean of what the middles of a chart's triangles show.
fn mean_colour(image: &PaintedImage, chart: &PlacedChart) -> [u8; 3] {
    let mut sum = [0u64; 3];
    for (_, [a, b, c]) in &chart.faces {
        let middle = (*a + *b + *c) / 3.0;
        let [x, y] =
            [(middle.x, image.size[0]), (middle.y, image.size[1])].map(|(at, side)| (at as usize).min(side - 1));
        let texel = &image.rgb[3 * (y * image.size[0] + x)..][..3];
        sum.iter_mut().zip(texel).for_each(|(sum, &channel)| *sum += u64::from(channel));
    }
    sum.map(|sum| (sum / chart.faces.len().max(1) as u64) as u8)
}

/// The part of an image with blocks of one colour, on its right.
#[derive(Debug, Clone, Copy)]
struct Blocks {
    /// First column.
    left: usize,
    /// Side of a block in texels.
    side: usize,
    /// Blocks of a row, and rows.
    grid: [usize; 2],
    /// Charts that share them: more than there is room for show the colour of one that is similar.
    charts: usize,
}

impl Blocks {
    /// Room for the blocks of `charts` charts beside an image, with sides of at most `most` texels.
    fn beside(image: &PaintedImage, charts: usize, most: usize) -> Self {
        let side = if charts <= (most / BLOCK).pow(2) { BLOCK } else { 1 };
        let columns = (charts as f64).sqrt().ceil() as usize;
        let columns = (columns * side).next_multiple_of(STRIDE).min(most) / side;
        let rows = charts.div_ceil(columns).clamp(1, most / side);
        Self { left: image.size[0], side, grid: [columns, rows], charts }
    }

    /// Column and row of a chart's block.
    fn block(&self, number: usize) -> [usize; 2] {
        let blocks = self.grid[0] * self.grid[1];
        let block = if self.charts > blocks { number * blocks / self.charts } else { number };
        [block % self.grid[0], block / self.grid[0]]
    }

    /// The place in the image, in texels, that a chart shows.
    fn middle(&self, number: usize) -> DVec2 {
        let [column, row] = self.block(number).map(|at| (at as f64 + 0.5) * self.side as f64);
        DVec2::new(self.left as f64 + column, row)
    }

    /// The image with the blocks beside it; below the lower of the two, the last row goes on.
    fn add(&self, image: PaintedImage, colours: &[([u8; 3], usize)]) -> PaintedImage {
        let [columns, rows] = self.grid.map(|blocks| blocks * self.side);
        let last = colours.last().map_or([0; 3], |&(colour, _)| colour);
        let mut blocks = vec![last; self.grid[0] * self.grid[1]];
        for (number, &(colour, _)) in colours.iter().enumerate() {
            let [column, row] = self.block(number);
            blocks[row * self.grid[0] + column] = colour;
        }
        let height = image.size[1].max(rows.next_multiple_of(STRIDE));
        let mut rgb = Vec::with_capacity(3 * height * (image.size[0] + columns));
        for row in 0..height {
            let own = 3 * image.size[0] * row.min(image.size[1] - 1);
            rgb.extend_from_slice(&image.rgb[own..own + 3 * image.size[0]]);
            let first = self.grid[0] * (row / self.side).min(self.grid[1] - 1);
            let colour_of = |column: usize| blocks[first + column / self.side];
            (0..columns).for_each(|column| rgb.extend_from_slice(&colour_of(column)));
        }
        PaintedImage { rgb, size: [image.size[0] + columns, height], ..image }
    }
}

//! Packs charts into images, the largest first, each where it is free uppermost.
//!
//! ```text
//!   +--------------+
//!   | ▟█▙ ▗█▖ ▟█▙  |     a chart takes the cells of 2 × 2 texels that its triangles touch, and GUTTER texels more on all
//!   | ███▗███▖▜██▙ |     sides; it may lie in a hole of another one, and turned by a quarter
//!   | ▜█▛▝███▘ ▜█▛ |
//! ```

use glam::DVec2;

use super::flat::FlatChart;
use super::image_size::{CELL, GUTTER, ImageSize};
use super::mask::Mask;
use super::sheet::{Sheet, SheetPlace};
use super::types::{ChartRoom, PlacedChart, Unwrapped};
use crate::mesh::id::FaceId;

/// Images that are tried before a new one begins.
const OPEN_IMAGES: usize = 2;
/// Share of an image that charts with their gutters are taken to fill.
const FILL: f64 = 0.85;
/// Smallest width of an image in texels, and what all widths are multiples of.
const WIDTH_MIN: u32 = 64;
const WIDTH_STEP: u32 = 16;
/// What heights of images are multiples of, as compression in blocks of 4 × 4 texels wants it.
const HEIGHT_STEP: u32 = 4;
/// Up to this number of charts are packed into images of several widths, of which each is wider than the one before by a
/// share of the first; the smallest image is taken.
const FEW: usize = 256;
const TRIES: u32 = 12;
const TRY_STEP: f64 = 0.03;

/// A chart in texels, and what it takes of an image.
struct Shape {
    faces: Vec<(FaceId, [DVec2; 3])>,
    mask: Mask,
    /// The mask turned by a quarter.
    turned: Mask,
}

/// Longest side of a chart that fits an image of this side, in texels.
pub fn room(side: u32) -> f64 {
    f64::from(side - 2 * GUTTER - CELL)
}

/// Packs charts into images with sides of up to `side` texels; charts that are too long shrink. If these charts were packed
/// before, `width` is that of the images then: no other one is tried.
pub fn pack(charts: Vec<FlatChart>, side: u32, width: Option<u32>) -> Unwrapped {
    let room = room(side);
    let mut unwrapped = Unwrapped::default();
    let mut shapes: Vec<Shape> = Vec::with_capacity(charts.len());
    for chart in charts {
        let longest = chart.size.max_element();
        let shrink = if longest > room { room / longest } else { 1.0 };
        unwrapped.shrunk += u64::from(longest > room);
        shapes.push(Shape::new(chart, shrink));
    }
    // A stable sort: of equally large ones, the first stays first.
    shapes.sort_by_key(|shape| std::cmp::Reverse(shape.mask.cells));
    let smaller = |best: Option<Packed>, width| {
        let limit = best.as_ref().map_or(u64::MAX, |best| best.cells);
        Packed::below(limit, &shapes, [width, side / CELL]).or(best)
    };
    let best = widths(&shapes, side / CELL, width).into_iter().fold(None, smaller).unwrap_or_default();
    let placed = shapes.into_iter().zip(best.places);
    unwrapped.charts = placed.map(|(shape, (image, place))| shape.placed(image as u32, place)).collect();
    unwrapped.charts.sort_by_key(|chart| chart.image);
    unwrapped.images = best
        .images
        .into_iter()
        .map(|[width, height]| ImageSize { width: width * CELL, height: height * CELL })
        .collect();
    unwrapped
}

/// Widths in cells that are tried: about that of a square that all charts fill, the better of many if there are few charts.
fn widths(shapes: &[Shape], side: u32, known: Option<u32>) -> Vec<u32> {
    let taken: usize = shapes.iter().map(|shape| shape.mask.cells).sum();
    let widest = shapes.iter().map(|shape| shape.mask.size[0] as u32).max().unwrap_or(1);
    if let Some(known) = known {
        return vec![(known / CELL).max(widest).min(side)];
    }
    let usual = (taken as f64 / FILL).sqrt();
    let tries = if shapes.len() <= FEW { TRIES } else { 1 };
    let mut widths: Vec<u32> = (0..tries)
        .map(|number| {
            let width = (usual * (1.0 + TRY_STEP * f64::from(number))).ceil() as u32;
            width.max(widest).max(WIDTH_MIN / CELL).next_multiple_of(WIDTH_STEP / CELL).min(side)
        })
        .collect();
    widths.dedup();
    widths
}

/// Places for charts.
#[derive(Default)]
struct Packed {
    /// Image and place of each chart.
    places: Vec<(usize, Placed)>,
    /// Width and height of each image in cells.
    images: Vec<[u32; 2]>,
    /// Cells of all images.
    cells: u64,
}

/// Where a chart lies, and whether it is turned by a quarter.
#[derive(Debug, Clone, Copy)]
struct Placed {
    place: SheetPlace,
    is_turned: bool,
}

impl Packed {
    /// Packs charts into images of a width and a largest height; `None` if they take `limit` cells or more.
    fn below(limit: u64, shapes: &[Shape], [width, height]: [u32; 2]) -> Option<Self> {
        let mut sheets: Vec<Sheet> = Vec::new();
        let mut packed = Self { places: Vec::with_capacity(shapes.len()), ..Self::default() };
        for shape in shapes {
            let first = sheets.len().saturating_sub(OPEN_IMAGES);
            let found = (first..sheets.len()).find_map(|image| Some((image, shape.find(&mut sheets[image])?)));
            let (image, placed) = found.unwrap_or_else(|| {
                if let Some(sheet) = sheets.len().checked_sub(OPEN_IMAGES) {
                    sheets[sheet].close();
                }
                sheets.push(Sheet::new([width, height].map(|side| side as usize)));
                packed.images.push([width, 0]);
                (sheets.len() - 1, Placed { place: SheetPlace { row: 0, column: 0 }, is_turned: false })
            });
            sheets[image].take(if placed.is_turned { &shape.turned } else { &shape.mask }, placed.place);
            packed.places.push((image, placed));
            let rows = &mut packed.images[image][1];
            let before = *rows;
            *rows = (sheets[image].height as u32).next_multiple_of(HEIGHT_STEP / CELL).min(height);
            packed.cells += u64::from(width) * u64::from(*rows - before);
            if packed.cells >= limit {
                return None;
            }
        }
        Some(packed)
    }
}

impl Shape {
    fn new(chart: FlatChart, scale: f64) -> Self {
        let offset = f64::from(GUTTER);
        // Rows go down, the second axis of a chart goes up.
        let place = |corner: DVec2| DVec2::new(corner.x, chart.size.y - corner.y) * scale + offset;
        let faces: Vec<_> = chart.faces.into_iter().map(|(face, corners)| (face, corners.map(place))).collect();
        let cells = |length: f64| (((length * scale).ceil() as u32 + 2 * GUTTER).div_ceil(CELL)) as usize;
        let size = [cells(chart.size.x), cells(chart.size.y)];
        let mask = Mask::of(size, faces.iter().map(|(_, corners)| *corners));
        let turned = mask.turned();
        Self { faces, mask, turned }
    }

    /// The place where the chart reaches least far down, upright or turned.
    fn find(&self, sheet: &mut Sheet) -> Option<Placed> {
        let upright = sheet.find(&self.mask, usize::MAX);
        let end = upright.map(|place| place.row + self.mask.size[1]);
        let last = end.map_or(Some(usize::MAX), |end| end.checked_sub(self.turned.size[1] + 1));
        let turned = last.and_then(|last| sheet.find(&self.turned, last));
        let place = turned.or(upright)?;
        Some(Placed { place, is_turned: turned.is_some() })
    }

    fn placed(self, image: u32, Placed { place, is_turned }: Placed) -> PlacedChart {
        let shift = DVec2::new((place.column as u32 * CELL).into(), (place.row as u32 * CELL).into());
        let size = self.mask.size.map(|side| side as u32 * CELL);
        let height = f64::from(size[1]);
        // Turned by a quarter, what was above is on the right.
        let turn = |at: DVec2| if is_turned { DVec2::new(height - at.y, at.x) } else { at };
        let faces = self.faces.iter().map(|(face, corners)| (*face, corners.map(|at| turn(at) + shift)));
        let mask = if is_turned { self.turned } else { self.mask };
        let cells = mask.runs.into_iter().map(|run| (run.row as u32, run.columns.start as u32..run.columns.end as u32));
        let room = ChartRoom {
            corner: [place.column as u32 * CELL, place.row as u32 * CELL],
            size,
            is_turned,
            cells: cells.collect(),
        };
        PlacedChart { image, faces: faces.collect(), room }
    }
}

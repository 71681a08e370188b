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
use super::sheet::{Place, Sheet};
use super::types::{PlacedChart, UnwrapSettings, Unwrapped};
use crate::mesh::id::FaceId;

/// Images that are tried before a new one begins.
const OPEN_IMAGES: usize = 2;
/// Share of an image that charts with their gutters are taken to fill.
const FILL: f64 = 0.85;
/// Smallest width of an image in texels.
const WIDTH_MIN: u32 = 64;

/// A chart in texels, and what it takes of an image.
#[derive(Clone)]
struct Shape {
    faces: Vec<(FaceId, [DVec2; 3])>,
    mask: Mask,
}

/// Packs charts.
pub(super) fn pack(charts: Vec<FlatChart>, settings: &UnwrapSettings<'_>) -> Unwrapped {
    let room = f64::from(settings.side - 2 * GUTTER - CELL);
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
    let taken: usize = shapes.iter().map(|shape| shape.mask.cells).sum();
    let widest = shapes.iter().map(|shape| shape.mask.size[0]).max().unwrap_or(0);
    let width = ((taken as f64 / FILL).sqrt().ceil() as usize).max(widest) * CELL as usize;
    let width = (width as u32).next_power_of_two().clamp(WIDTH_MIN.min(settings.side), settings.side);
    let cells = [width, settings.side].map(|side| (side / CELL) as usize);
    let mut sheets: Vec<Sheet> = Vec::new();
    for shape in shapes {
        let first = sheets.len().saturating_sub(OPEN_IMAGES);
        let found = (first..sheets.len()).find_map(|image| {
            let (shape, place) = shape.clone().turned_to_fit(&mut sheets[image])?;
            Some((image, shape, place))
        });
        let (image, shape, place) = found.unwrap_or_else(|| {
            sheets.push(Sheet::new(cells));
            (sheets.len() - 1, shape, Place { row: 0, column: 0 })
        });
        sheets[image].take(&shape.mask, place);
        unwrapped.charts.push(shape.placed(image as u32, place));
    }
    unwrapped.charts.sort_by_key(|chart| chart.image);
    unwrapped.images =
        sheets.iter().map(|sheet| ImageSize { width, height: (sheet.height as u32 * CELL).max(1) }).collect();
    unwrapped
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
        Self { faces, mask }
    }

    /// The shape turned by a quarter: what was above is on the right.
    fn turned(&self) -> Self {
        let height = f64::from(self.mask.size[1] as u32 * CELL);
        let turn = |corner: DVec2| DVec2::new(height - corner.y, corner.x);
        let faces = self.faces.iter().map(|&(face, corners)| (face, corners.map(turn)));
        Self { faces: faces.collect(), mask: self.mask.turned() }
    }

    /// The shape, turned if it reaches less far down then, and its place.
    fn turned_to_fit(self, sheet: &mut Sheet) -> Option<(Self, Place)> {
        let turned = self.turned();
        let upright = sheet.find(&self.mask, usize::MAX);
        let height = |shape: &Self| shape.mask.size[1];
        let last =
            upright.map_or(Some(usize::MAX), |place| (place.row + height(&self)).checked_sub(height(&turned) + 1));
        match (last.and_then(|last| sheet.find(&turned.mask, last)), upright) {
            (Some(place), _) => Some((turned, place)),
            (None, upright) => upright.map(|place| (self, place)),
        }
    }

    fn placed(self, image: u32, place: Place) -> PlacedChart {
        let shift = DVec2::new((place.column as u32 * CELL).into(), (place.row as u32 * CELL).into());
        let faces = self.faces.into_iter().map(|(face, corners)| (face, corners.map(|corner| corner + shift)));
        PlacedChart { image, faces: faces.collect() }
    }
}

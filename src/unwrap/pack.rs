//! Packs charts into images, the tallest first, each where it reaches least far down.
//!
//! ```text
//!   +--------------+
//!   | ▟█▙ ▗█▖ ▟█▙  |     a chart takes, of each column of 4 texels, the rows between its first and its last texel, and
//!   | ███▗███▖▜██▙ |     GUTTER more on all sides; it sinks as far as the others let it
//!   | ▜█▛▝███▘ ▜█▛ |
//! ```
//!
//! # Source
//! Lévy, Petitjean, Ray & Maillot 2002, "Least squares conformal maps", section 4 (packing by horizons).

use glam::DVec2;

use super::flat::FlatChart;
use super::image_size::{COLUMN, GUTTER, ImageSize};
use super::skyline::{Profile, Skyline, SkylinePlace};
use super::types::{PlacedChart, UnwrapSettings, Unwrapped};
use crate::mesh::id::FaceId;

/// Images that are tried before a new one begins.
const OPEN_IMAGES: usize = 2;
/// Share of an image that charts are taken to fill.
const FILL: f64 = 0.6;
/// Smallest width of an image in texels.
const WIDTH_MIN: u32 = 64;

/// A chart in texels, and what it takes of an image.
struct Shape {
    faces: Vec<(FaceId, [DVec2; 3])>,
    profile: Profile,
    height: u32,
}

/// Packs charts.
pub(super) fn pack(charts: Vec<FlatChart>, settings: &UnwrapSettings<'_>) -> Unwrapped {
    let room = f64::from(settings.side - 2 * GUTTER - COLUMN);
    let mut unwrapped = Unwrapped::default();
    let mut shapes: Vec<Shape> = Vec::with_capacity(charts.len());
    for chart in charts {
        let longest = chart.size.max_element();
        let shrink = if longest > room { room / longest } else { 1.0 };
        unwrapped.shrunk += u64::from(longest > room);
        shapes.push(Shape::new(chart, shrink));
    }
    // A stable sort: of equally tall ones, the first stays first.
    shapes.sort_by_key(|shape| std::cmp::Reverse(shape.height));
    let taken: u64 = shapes.iter().map(Shape::texels).sum();
    let width = ((taken as f64 / FILL).sqrt().ceil() as u32).next_power_of_two();
    let widest = shapes.iter().map(|shape| shape.profile.len() as u32 * COLUMN).max().unwrap_or(0);
    let width = width.max(widest.next_power_of_two()).clamp(WIDTH_MIN.min(settings.side), settings.side);
    let columns = (width / COLUMN) as usize;
    let mut skylines: Vec<Skyline> = Vec::new();
    for shape in shapes {
        let first = skylines.len().saturating_sub(OPEN_IMAGES);
        let open = skylines[first..].iter().zip(first..);
        let turned = shape.turned();
        let found = open.into_iter().find_map(|(skyline, image)| {
            let [upright, turned] = [&shape, &turned].map(|shape| skyline.find(&shape.profile, settings.side));
            let best = upright.into_iter().chain(turned).min()?;
            Some((image, best.place, upright != Some(best)))
        });
        let (image, place, is_turned) = found.unwrap_or_else(|| {
            skylines.push(Skyline::new(columns));
            (skylines.len() - 1, SkylinePlace { column: 0, row: 0 }, false)
        });
        let shape = if is_turned { turned } else { shape };
        skylines[image].take(&shape.profile, place);
        unwrapped.charts.push(shape.placed(image as u32, place));
    }
    unwrapped.charts.sort_by_key(|chart| chart.image);
    unwrapped.images = skylines
        .iter()
        .map(|skyline| ImageSize { width, height: skyline.height().next_multiple_of(COLUMN).clamp(1, settings.side) })
        .collect();
    unwrapped
}

impl Shape {
    fn new(chart: FlatChart, scale: f64) -> Self {
        let offset = f64::from(GUTTER);
        // Rows go down, the second axis of a chart goes up.
        let place = |corner: DVec2| DVec2::new(corner.x, chart.size.y - corner.y) * scale + offset;
        let faces: Vec<_> = chart.faces.into_iter().map(|(face, corners)| (face, corners.map(place))).collect();
        let width = (chart.size.x * scale).ceil() as u32 + 2 * GUTTER;
        let columns = width.div_ceil(COLUMN) as usize;
        // Rows between which the chart lies in each column.
        let mut spans = vec![[f64::INFINITY, f64::NEG_INFINITY]; columns];
        for (_, corners) in &faces {
            for k in 0..3 {
                note_edge(&mut spans, corners[k], corners[(k + 1) % 3]);
            }
        }
        let around = (GUTTER / COLUMN) as usize;
        let profile: Profile = (0..columns)
            .map(|column| {
                let near = &spans[column.saturating_sub(around)..(column + around + 1).min(columns)];
                let low = near.iter().fold(f64::INFINITY, |low, span| low.min(span[0]));
                let high = near.iter().fold(0.0, |high: f64, span| high.max(span[1]));
                let first = (low - offset).floor().max(0.0) as u32;
                [first, ((high + offset).ceil() as u32).max(first + 1)]
            })
            .collect();
        let height = profile.iter().map(|&[_, end]| end).max().unwrap_or(1);
        Self { faces, profile, height }
    }

    /// The shape turned by half a turn.
    fn turned(&self) -> Self {
        let width = f64::from(self.profile.len() as u32 * COLUMN);
        let far = DVec2::new(width, f64::from(self.height));
        let faces = self.faces.iter().map(|&(face, corners)| (face, corners.map(|corner| far - corner)));
        let upside_down = |&[first, end]: &[u32; 2]| [self.height - end, self.height - first];
        Self {
            faces: faces.collect(),
            profile: self.profile.iter().rev().map(upside_down).collect(),
            height: self.height,
        }
    }

    fn texels(&self) -> u64 {
        self.profile.iter().map(|[first, end]| u64::from(end - first) * u64::from(COLUMN)).sum()
    }

    fn placed(self, image: u32, place: SkylinePlace) -> PlacedChart {
        let shift = DVec2::new(f64::from(place.column as u32 * COLUMN), f64::from(place.row));
        let faces = self.faces.into_iter().map(|(face, corners)| (face, corners.map(|corner| corner + shift)));
        PlacedChart { image, faces: faces.collect() }
    }
}

/// Widens the spans of the columns that an edge passes through.
fn note_edge(spans: &mut [[f64; 2]], from: DVec2, to: DVec2) {
    let (left, right) = if from.x <= to.x { (from, to) } else { (to, from) };
    let column_of = |x: f64| ((x / f64::from(COLUMN)) as usize).min(spans.len() - 1);
    let columns = column_of(left.x)..=column_of(right.x);
    for (span, column) in spans[columns.clone()].iter_mut().zip(columns) {
        let row_at = |x: f64| {
            let share = (x - left.x) / (right.x - left.x);
            if share.is_finite() { left.y + (right.y - left.y) * share.clamp(0.0, 1.0) } else { left.y }
        };
        let edges = [column as u32 * COLUMN, (column as u32 + 1) * COLUMN].map(f64::from);
        let rows = if right.x > left.x { edges.map(row_at) } else { [left.y, right.y] };
        *span = [span[0].min(rows[0]).min(rows[1]), span[1].max(rows[0]).max(rows[1])];
    }
}

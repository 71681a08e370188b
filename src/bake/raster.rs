//! Which triangle of a chart each texel belongs to, inside the chart and in the gutter around it.
//!
//! ```text
//!   . g g g .        a texel belongs to the triangle that covers its middle; around the chart, a texel belongs to
//!   g ▒ ▒ g .        that of a neighbour, GUTTER texels far
//!   g ▒ ▒ ▒ g
//! ```

use glam::DVec2;

use crate::unwrap::{GUTTER, ImageSize, PlacedChart};

/// Marks a texel of no triangle.
pub(super) const NOBODY: u32 = u32::MAX;

/// A part of an image, with the triangle that each texel belongs to.
pub(super) struct Owners {
    /// Column and row of the first texel in the image.
    pub first: [usize; 2],
    /// Width and height.
    pub size: [usize; 2],
    /// Index of the chart's triangle for each texel, row by row.
    pub of: Vec<u32>,
    /// Number of texels whose middle a triangle covers.
    pub covered: u64,
}

impl Owners {
    /// Finds the triangles of a chart's texels.
    pub fn of(chart: &PlacedChart, image: ImageSize) -> Self {
        let corners = || chart.faces.iter().flat_map(|(_, corners)| *corners);
        let low = corners().fold(DVec2::INFINITY, DVec2::min);
        let high = corners().fold(DVec2::NEG_INFINITY, DVec2::max);
        let gutter = f64::from(GUTTER);
        let end = |at: f64, side: u32| ((at + gutter).ceil().max(1.0) as usize).min(side as usize);
        let first = [low.x, low.y].map(|at| (at - gutter).floor().max(0.0) as usize);
        let size = [end(high.x, image.width) - first[0], end(high.y, image.height) - first[1]];
        let mut owners = Self { first, size, of: vec![NOBODY; size[0] * size[1]], covered: 0 };
        for (number, (_, corners)) in chart.faces.iter().enumerate() {
            owners.cover(number as u32, *corners);
        }
        if owners.covered == 0 {
            // No triangle covers the middle of a texel: each takes the one that it lies in.
            for (number, (_, corners)) in chart.faces.iter().enumerate() {
                let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
                let [x, y] = [middle.x as usize - first[0], middle.y as usize - first[1]];
                let at = y.min(size[1] - 1) * size[0] + x.min(size[0] - 1);
                if owners.of[at] == NOBODY {
                    owners.of[at] = number as u32;
                }
            }
        }
        (0..GUTTER).for_each(|_| owners.widen());
        owners
    }

    /// Gives the texels whose middle a triangle covers to it, unless they have an owner.
    fn cover(&mut self, number: u32, corners: [DVec2; 3]) {
        let shift = DVec2::new(self.first[0] as f64, self.first[1] as f64) + 0.5;
        let [a, b, c] = corners.map(|corner| corner - shift);
        let (low, high) = (a.min(b).min(c).ceil().max(DVec2::ZERO), a.max(b).max(c).floor());
        if !(low.x <= high.x && low.y <= high.y) {
            return;
        }
        let turn = (b - a).perp_dot(c - a).signum();
        for y in low.y as usize..=(high.y as usize).min(self.size[1] - 1) {
            for x in low.x as usize..=(high.x as usize).min(self.size[0] - 1) {
                let point = DVec2::new(x as f64, y as f64);
                let is_left = |from: DVec2, to: DVec2| (to - from).perp_dot(point - from) * turn >= 0.0;
                let owner = &mut self.of[y * self.size[0] + x];
                if *owner == NOBODY && is_left(a, b) && is_left(b, c) && is_left(c, a) {
                    *owner = number;
                    self.covered += 1;
                }
            }
        }
    }

    /// Gives each texel beside one with an owner to that owner.
    fn widen(&mut self) {
        let [width, height] = self.size;
        let before = self.of.clone();
        for y in 0..height {
            for x in 0..width {
                if before[y * width + x] != NOBODY {
                    continue;
                }
                let beside = [(0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];
                let owner_of = |&(right, down): &(isize, isize)| {
                    let (x, y) = (x.checked_add_signed(right)?, y.checked_add_signed(down)?);
                    let owner = if x < width && y < height { before[y * width + x] } else { NOBODY };
                    (owner != NOBODY).then_some(owner)
                };
                if let Some(owner) = beside.iter().find_map(owner_of) {
                    self.of[y * width + x] = owner;
                }
            }
        }
    }
}

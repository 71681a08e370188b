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

/// Flag of a texel in the gutter; the other bits are the index of its triangle.
pub(super) const IN_GUTTER: u32 = 1 << 31;
/// Steps to the texels around one: beside it first.
const AROUND: [(isize, isize); 8] = [(0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];

/// A part of an image, with the triangle that each texel belongs to.
pub(super) struct Owners {
    /// Column and row of the first texel in the image.
    pub first: [usize; 2],
    /// Width and height.
    pub size: [usize; 2],
    /// Index of the chart's triangle for each texel, row by row, with [`IN_GUTTER`]; or [`NOBODY`].
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
        owners.widen();
        owners
    }

    /// The upper left corner of the first texel, in the image.
    pub fn corner(&self) -> DVec2 {
        DVec2::new(self.first[0] as f64, self.first[1] as f64)
    }

    /// Gives the texels whose middle a triangle covers to it, unless they have an owner.
    fn cover(&mut self, number: u32, corners: [DVec2; 3]) {
        let shift = self.corner() + 0.5;
        let corners = corners.map(|corner| corner - shift);
        let [a, b, c] = corners;
        let (low, high) = (a.min(b).min(c).ceil().max(DVec2::ZERO), a.max(b).max(c).floor());
        let last_row = high.y.min((self.size[1] - 1) as f64);
        let mut row = low.y;
        while row <= last_row {
            // Between where the row enters the triangle and where it leaves it.
            let [mut enter, mut leave] = [f64::INFINITY, f64::NEG_INFINITY];
            for k in 0..3 {
                let (from, to) = (corners[k], corners[(k + 1) % 3]);
                if from.y.min(to.y) <= row && row <= from.y.max(to.y) {
                    let share = (row - from.y) / (to.y - from.y);
                    let ends = if share.is_finite() { [from.x + (to.x - from.x) * share; 2] } else { [from.x, to.x] };
                    enter = enter.min(ends[0]).min(ends[1]);
                    leave = leave.max(ends[0]).max(ends[1]);
                }
            }
            let line = row as usize * self.size[0];
            let end = leave.floor().min((self.size[0] - 1) as f64);
            let mut column = enter.ceil().max(0.0);
            while column <= end {
                let owner = &mut self.of[line + column as usize];
                if *owner == NOBODY {
                    *owner = number;
                    self.covered += 1;
                }
                column += 1.0;
            }
            row += 1.0;
        }
    }

    /// Gives the texels around those with an owner to that owner, ring by ring.
    fn widen(&mut self) {
        let [width, height] = self.size;
        let beside = |at: usize, (right, down): (isize, isize)| {
            let (x, y) = ((at % width).checked_add_signed(right)?, (at / width).checked_add_signed(down)?);
            (x < width && y < height).then_some(y * width + x)
        };
        let is_at_the_edge = |&at: &usize| {
            let (x, y) = (at % width, at / width);
            let is_inside = x > 0 && y > 0 && x + 1 < width && y + 1 < height;
            let is_free = |at: usize| self.of[at] == NOBODY;
            self.of[at] != NOBODY
                && is_inside
                && (is_free(at - 1) || is_free(at + 1) || is_free(at - width) || is_free(at + width))
        };
        let mut ring: Vec<usize> = (0..self.of.len()).filter(is_at_the_edge).collect();
        for _ in 0..GUTTER {
            let mut next = Vec::with_capacity(ring.len() + 8);
            for &at in &ring {
                for step in AROUND {
                    if let Some(other) = beside(at, step).filter(|&other| self.of[other] == NOBODY) {
                        self.of[other] = self.of[at] | IN_GUTTER;
                        next.push(other);
                    }
                }
            }
            ring = next;
        }
    }
}

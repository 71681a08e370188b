//! Which triangle of a chart each texel belongs to, inside the chart and in the gutter around it.
//!
//! ```text
//!   . g g g .        a texel belongs to the triangle that covers its middle; around the chart, a texel belongs to
//!   g ▒ ▒ g .        that of a neighbour, GUTTER texels far
//!   g ▒ ▒ ▒ g
//! ```
//! A sliver covers few middles, or none. Where that leaves texels that it touches, or those beside, to nobody, it gets
//! the texels that it touches.

use glam::DVec2;

use crate::unwrap::{GUTTER, ImageSize, PlacedChart, touched_rows};

/// Marks a texel of no triangle.
pub(super) const NOBODY: u32 = u32::MAX;

/// Flag of a texel in the gutter; the other bits are the index of its triangle.
pub(super) const IN_GUTTER: u32 = 1 << 31;
/// A triangle longer than this times its height is pointed: from a tip to the first middle that it is sure to cover, it
/// may be more than [`GUTTER`] texels.
const POINTED: f64 = 2.0;
/// Steps to the texels around one: beside it first.
const AROUND: [(isize, isize); 8] = [(0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];

/// Texels of an image: columns and rows from `first` up to, but without, `end`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TexelRect {
    pub first: [usize; 2],
    pub end: [usize; 2],
}

impl TexelRect {
    /// The texels of a chart and of the gutter around it.
    pub fn around(chart: &PlacedChart, image: ImageSize) -> Self {
        let corners = || chart.faces.iter().flat_map(|(_, corners)| *corners);
        let low = corners().fold(DVec2::INFINITY, DVec2::min);
        let high = corners().fold(DVec2::NEG_INFINITY, DVec2::max);
        let gutter = f64::from(GUTTER);
        let end = |at: f64, side: u32| ((at + gutter).ceil().max(1.0) as usize).min(side as usize);
        let end = [end(high.x, image.width), end(high.y, image.height)];
        let first = |at: f64, end: usize| ((at - gutter).floor().max(0.0) as usize).min(end - 1);
        Self { first: [first(low.x, end[0]), first(low.y, end[1])], end }
    }

    /// With `margin` texels more on each side, as far as they lie in `limits`.
    pub fn grown(self, margin: usize, limits: Self) -> Self {
        Self {
            first: [0, 1].map(|axis| self.first[axis].saturating_sub(margin).max(limits.first[axis])),
            end: [0, 1].map(|axis| (self.end[axis] + margin).min(limits.end[axis])),
        }
    }

    /// With a texel more; it begins with a rectangle of none, at its first texel.
    pub fn with(self, texel: [usize; 2]) -> Self {
        Self {
            first: [0, 1].map(|axis| self.first[axis].min(texel[axis])),
            end: [0, 1].map(|axis| self.end[axis].max(texel[axis] + 1)),
        }
    }

    /// The same texels counted from `first` on.
    pub fn from(self, first: [usize; 2]) -> Self {
        let Self { first: own, end } = self;
        Self { first: [0, 1].map(|axis| own[axis] - first[axis]), end: [0, 1].map(|axis| end[axis] - first[axis]) }
    }

    /// Squares of a side, or what of them lies in it, row by row.
    pub fn squares(self, side: usize) -> impl Iterator<Item = Self> {
        let Self { first: [left, top], end: [right, bottom] } = self;
        let at = move |x: usize, y: usize| Self { first: [x, y], end: [(x + side).min(right), (y + side).min(bottom)] };
        (top..bottom).step_by(side).flat_map(move |y| (left..right).step_by(side).map(move |x| at(x, y)))
    }

    /// Column and row of each texel, row by row.
    pub fn texels(self) -> impl Iterator<Item = [usize; 2]> {
        let Self { first: [left, top], end: [right, bottom] } = self;
        (top..bottom).flat_map(move |row| (left..right).map(move |column| [column, row]))
    }

    /// With `margin` texels less on each side.
    fn shrunk(self, margin: usize) -> Self {
        Self { first: self.first.map(|first| first + margin), end: self.end.map(|end| end.saturating_sub(margin)) }
    }

    /// Whether the smallest rectangle around a triangle meets it.
    fn meets(self, [a, b, c]: [DVec2; 3]) -> bool {
        let (low, high) = (a.min(b).min(c).to_array(), a.max(b).max(c).to_array());
        (0..2).all(|axis| low[axis] <= self.end[axis] as f64 && self.first[axis] as f64 <= high[axis])
    }

    /// Passes each texel in it that a triangle touches to `see`.
    fn touched(self, corners: [DVec2; 3], mut see: impl FnMut([usize; 2])) {
        let ([left, top], [width, height]) = (self.first, self.size());
        let shift = DVec2::new(left as f64, top as f64);
        touched_rows(corners.map(|corner| corner - shift), height, |row, [low, high]| {
            let end = (high.floor() + 1.0).clamp(0.0, width as f64) as usize;
            (low.max(0.0) as usize..end).for_each(|column| see([left + column, top + row]));
        });
    }

    /// Width and height.
    pub fn size(self) -> [usize; 2] {
        [0, 1].map(|axis| self.end[axis] - self.first[axis])
    }

    /// Whether a texel lies in it.
    #[inline]
    pub fn contains(self, texel: [usize; 2]) -> bool {
        (0..2).all(|axis| (self.first[axis]..self.end[axis]).contains(&texel[axis]))
    }

    /// Number of a texel in it, row by row.
    #[inline]
    pub fn index(self, [column, row]: [usize; 2]) -> usize {
        (row - self.first[1]) * (self.end[0] - self.first[0]) + column - self.first[0]
    }
}

/// The triangle that each texel of a part of an image belongs to.
pub(super) struct Owners {
    rect: TexelRect,
    /// Index of the chart's triangle for each texel, row by row, with [`IN_GUTTER`]; or [`NOBODY`].
    of: Vec<u32>,
}

impl Owners {
    /// Finds the triangles of a chart's texels, and of those around them that [`GUTTER`] steps inside of `rect` reach.
    pub fn of(chart: &PlacedChart, rect: TexelRect) -> Self {
        let [width, height] = rect.size();
        let mut owners = Self { rect, of: vec![NOBODY; width * height] };
        let (mut is_covered, mut thin) = (false, Vec::new());
        for (number, (_, corners)) in chart.faces.iter().enumerate() {
            let covers = owners.cover(number as u32, *corners);
            is_covered |= covers;
            if !covers || is_pointed(*corners) {
                thin.push(number as u32);
            }
        }
        if !is_covered {
            // No triangle covers the middle of a texel: each takes the one that it lies in.
            for (number, (_, corners)) in chart.faces.iter().enumerate() {
                let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
                let texel = [middle.x as usize, middle.y as usize];
                if rect.contains(texel) {
                    let owner = &mut owners.of[rect.index(texel)];
                    *owner = (*owner).min(number as u32);
                }
            }
        }
        owners.widen();
        owners.mend(chart, &thin);
        owners
    }

    /// Gives texels that thin triangles touch to them where otherwise a place on them would show what belongs to nobody.
    fn mend(&mut self, chart: &PlacedChart, thin: &[u32]) {
        // The owners of the outermost texels may lie beyond the part.
        let known = self.rect.shrunk(GUTTER as usize);
        let is_bare = |[column, row]: [usize; 2]| {
            let mixed =
                TexelRect { first: [column.saturating_sub(1), row.saturating_sub(1)], end: [column + 2, row + 2] };
            mixed.texels().any(|texel| known.contains(texel) && self.owner(texel) == NOBODY)
        };
        let mut bare: Vec<(usize, u32)> = Vec::new();
        for &number in thin {
            let (_, corners) = chart.faces[number as usize];
            if known.meets(corners) {
                self.rect.touched(corners, |texel| {
                    bare.extend(is_bare(texel).then(|| (self.rect.index(texel), number)));
                });
            }
        }
        if bare.is_empty() {
            return;
        }
        self.of.iter_mut().filter(|owner| **owner & IN_GUTTER != 0).for_each(|owner| *owner = NOBODY);
        for (at, number) in bare {
            if self.of[at] == NOBODY {
                self.of[at] = number;
            }
        }
        self.widen();
    }

    /// The owner of a texel.
    #[inline]
    pub fn owner(&self, texel: [usize; 2]) -> u32 {
        self.of[self.rect.index(texel)]
    }

    /// Gives the texels whose middle a triangle covers to it, unless they have an owner; returns whether there are any.
    fn cover(&mut self, number: u32, corners: [DVec2; 3]) -> bool {
        let [width, height] = self.rect.size();
        let shift = DVec2::new(self.rect.first[0] as f64, self.rect.first[1] as f64) + 0.5;
        let corners = corners.map(|corner| corner - shift);
        let [a, b, c] = corners;
        let mut is_covering = false;
        let (low, high) = (a.min(b).min(c).ceil().max(DVec2::ZERO), a.max(b).max(c).floor());
        let last_row = high.y.min((height - 1) as f64);
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
            let line = row as usize * width;
            let end = leave.floor().min((width - 1) as f64);
            let mut column = enter.ceil().max(0.0);
            while column <= end {
                let owner = &mut self.of[line + column as usize];
                if *owner == NOBODY {
                    *owner = number;
                }
                is_covering = true;
                column += 1.0;
            }
            row += 1.0;
        }
        is_covering
    }

    /// Gives the texels around those with an owner to that owner, ring by ring.
    fn widen(&mut self) {
        let [width, height] = self.rect.size();
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

/// Whether a triangle is long for its height.
fn is_pointed([a, b, c]: [DVec2; 3]) -> bool {
    let longest_sq = [b - a, c - b, a - c].into_iter().map(DVec2::length_squared).fold(0.0, f64::max);
    longest_sq > POINTED * (b - a).perp_dot(c - a).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::id::FaceId;
    use crate::unwrap::ChartRoom;

    const RECT: TexelRect = TexelRect { first: [10, 20], end: [110, 60] };

    /// The owners of the texels of a chart of triangles.
    fn owners(triangles: &[[[f64; 2]; 3]]) -> Owners {
        let room = ChartRoom { corner: [0; 2], size: [128; 2], is_turned: false, cells: Vec::new() };
        let face = |(number, corners): (u32, &[[f64; 2]; 3])| (FaceId::new(number), corners.map(DVec2::from_array));
        Owners::of(&PlacedChart { image: 0, faces: (0..).zip(triangles).map(face).collect(), room }, RECT)
    }

    /// Whether all texels that are mixed at places along a line have an owner.
    fn has_texels_along(owners: &Owners, [from, to]: [[f64; 2]; 2]) -> bool {
        (0..=200).all(|step| {
            let at = DVec2::from(from).lerp(DVec2::from(to), f64::from(step) / 200.0);
            let low = (at - 0.5).floor();
            let mixed =
                TexelRect { first: [low.x as usize, low.y as usize], end: [low.x as usize + 2, low.y as usize + 2] };
            mixed.texels().all(|texel| owners.owner(texel) != NOBODY)
        })
    }

    #[test]
    fn a_sliver_has_texels_along_all_of_it() {
        let level = [[20.3, 40.1], [100.7, 40.1], [60.0, 40.3]];
        assert!(has_texels_along(&owners(&[level]), [level[0], level[1]]));
        assert!([20, 40, 80, 100].into_iter().all(|column| owners(&[level]).owner([column, 40]) == 0));
        // It covers the middle of a texel where it crosses a row, and of none elsewhere.
        let tilted = [[20.3, 40.1], [100.7, 41.3], [60.0, 40.71]];
        assert!(has_texels_along(&owners(&[tilted]), [tilted[0], tilted[1]]));
        // The tip of a triangle that covers many at its other end.
        let tip = [[20.3, 40.1], [100.7, 40.1], [100.7, 44.0]];
        assert!(has_texels_along(&owners(&[tip]), [tip[0], tip[1]]));
        // What it touches beside texels that it covers stays gutter.
        assert_eq!(owners(&[tip]).owner([60, 42]), IN_GUTTER);
    }

    #[test]
    fn a_ribbon_of_small_triangles_has_texels_along_all_of_it() {
        // Two triangles side by side, and a ribbon thinner than a texel that begins at their corner.
        let mut triangles =
            vec![[[20.0, 40.0], [24.0, 40.0], [24.0, 44.0]], [[20.0, 40.0], [24.0, 44.0], [20.0, 44.0]]];
        for step in 0..200 {
            let x = 24.0 + 0.3 * f64::from(step);
            triangles.push([[x, 40.1], [x + 0.3, 40.1], [x, 40.4]]);
            triangles.push([[x + 0.3, 40.1], [x + 0.3, 40.4], [x, 40.4]]);
        }
        let owners = owners(&triangles);
        assert!((TexelRect { first: [20, 39], end: [85, 42] }).texels().all(|texel| owners.owner(texel) != NOBODY));
        assert!((30..84).all(|column| owners.owner([column, 40]) & IN_GUTTER == 0));
    }

    #[test]
    fn what_a_plump_triangle_touches_and_does_not_cover_is_gutter() {
        let owners = owners(&[[[30.2, 30.2], [50.3, 30.2], [50.3, 50.3]]]);
        let found: Vec<u32> = [49, 50, 53, 54].into_iter().map(|column| owners.owner([column, 40])).collect();
        assert_eq!(found, [0, IN_GUTTER, IN_GUTTER, NOBODY]);
    }
}

//! Charts of the texture atlas, and triangles that are folded in it.
//!
//! ```text
//!   texture space        a chart whose triangle c is turned over lies on itself there:
//!   +-----+-----+        the texture is torn on one of the two sides of the fold
//!   | a  /|\ c /
//!   |  /  | \ /          a mirrored chart has all its triangles turned over, and none is folded
//!   |/  b |  +
//!   +-----+
//! ```

use glam::DVec2;
use serde::Serialize;

use crate::geometry::triangle::is_flat;

/// Triangles in texture space.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct UvCounts {
    /// Triangles whose corners run clockwise in texture space.
    pub uv_negative: u64,
    /// Triangles whose corners run counter-clockwise in texture space.
    pub uv_positive: u64,
    /// Triangles without area in texture space.
    pub uv_degenerate: u64,
    /// Triangles whose orientation in texture space differs from the majority (by area) of their chart.
    pub folded_uv: u64,
}

impl UvCounts {
    pub(super) fn add(&mut self, other: &Self) {
        self.uv_negative += other.uv_negative;
        self.uv_positive += other.uv_positive;
        self.uv_degenerate += other.uv_degenerate;
        self.folded_uv += other.folded_uv;
    }

    /// Adds a whole chart.
    pub(super) fn add_chart(&mut self, chart: &Chart) {
        self.uv_negative += chart.negative;
        self.uv_positive += chart.positive;
        self.uv_degenerate += chart.degenerate;
        if chart.area < 0.0 {
            self.folded_uv += chart.positive;
        }
        if chart.area > 0.0 {
            self.folded_uv += chart.negative;
        }
    }
}

/// A chart, or the part of it in a cell: faces that are connected in texture space.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Chart {
    /// Sum of the triangles' areas in texture space, negative for those that are turned over.
    area: f64,
    negative: u64,
    positive: u64,
    degenerate: u64,
}

impl Chart {
    /// Adds a triangle of a mesh whose largest texture coordinate is `largest`.
    pub(super) fn add_face(&mut self, [a, b, c]: [DVec2; 3], largest: f64) {
        let area = (b - a).perp_dot(c - a);
        let longest_sq = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
        if is_flat(area.abs(), longest_sq, largest) {
            self.degenerate += 1;
            return;
        }
        self.area += area;
        self.negative += u64::from(area < 0.0);
        self.positive += u64::from(area > 0.0);
    }

    /// Adds another part of the chart.
    pub(super) fn add(&mut self, other: &Self) {
        self.area += other.area;
        self.negative += other.negative;
        self.positive += other.positive;
        self.degenerate += other.degenerate;
    }
}

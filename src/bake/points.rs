//! Points whose closest places are wanted, in groups that lie near each other.

use std::ops::Range;

use glam::DVec3;

use crate::geometry::boxtree::Bounds;

/// Points whose closest places are wanted, in groups that lie near each other.
#[derive(Default)]
pub(super) struct PointSet {
    pub points: Vec<DVec3>,
    pub runs: Vec<PointRun>,
    groups: Vec<PointGroup>,
}

/// Points of a group that face the same way: those up to `end`.
pub(super) struct PointRun {
    pub end: usize,
    pub normal: DVec3,
}

/// Points that lie near each other.
pub(super) struct PointGroup {
    /// Indices of its runs; they have points.
    pub runs: Range<usize>,
    /// Index of its first point.
    pub first: usize,
    /// The middle of their box.
    pub middle: DVec3,
    /// Largest distance of a point from it.
    pub radius: f64,
}

impl PointSet {
    /// Takes all points out.
    pub fn clear(&mut self) {
        self.points.clear();
        self.runs.clear();
        self.groups.clear();
    }

    /// Adds a point.
    #[inline]
    pub fn push(&mut self, point: DVec3) {
        self.points.push(point);
    }

    /// The points since the last run face along `normal`.
    pub fn end_run(&mut self, normal: DVec3) {
        let end = self.points.len();
        if self.runs.last().map_or(0, |run| run.end) < end {
            self.runs.push(PointRun { end, normal });
        }
    }

    /// The runs since the last group lie near each other.
    pub fn end_group(&mut self) {
        let runs = self.groups.last().map_or(0, |group| group.runs.end)..self.runs.len();
        if runs.is_empty() {
            return;
        }
        let first = if runs.start == 0 { 0 } else { self.runs[runs.start - 1].end };
        let own = &self.points[first..];
        let bounds = Bounds::around(own.iter().copied());
        let middle = 0.5 * (bounds.low + bounds.high);
        let radius_sq = own.iter().map(|point| point.distance_squared(middle)).fold(0.0, f64::max);
        self.groups.push(PointGroup { runs, first, middle, radius: radius_sq.sqrt() });
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// The groups.
    pub fn groups(&self) -> &[PointGroup] {
        &self.groups
    }
}

//! Finds, for groups of points, the closest places of the original surface.
//!
//! ```text
//! cells ── tree of each: triangles near a region ──▶ Nearby ── few candidates of each group ──▶ closest places
//! ```
//! A triangle that faces away from a group counts as [`away`](ClosestPlaces::new) farther, so that the two sides of a
//! wall do not mix.
//!
//! # Memory
//! That of [`Nearby`], for at most [`GATHERED_MAX`] triangles, and [`OPEN_BYTES`] of open cells: [`FINDER_BYTES`].

use glam::DVec3;

use super::nearby::Nearby;
use super::original::Original;
use super::points::{PointGroup, PointSet};
use super::prism::{FourPlaces, Shown};
use crate::base::Result;
use crate::geometry::boxtree::Bounds;
use crate::geometry::triangle::area;
use crate::geometry::triangle_tree::Question;
use crate::geometry::{closest_point, distance_sq};
use crate::surface::cell::{Cell, CellView};
use crate::surface::order::{order_by_distance, sort_by_distance};

/// Memory of a finder in bytes.
pub const FINDER_BYTES: u64 = OPEN_BYTES + (2 << 20);
/// Bytes of the cells that are kept open at once, if they are more than one.
const OPEN_BYTES: u64 = 6 << 20;
/// Cells that are put in order for each block of texels; the others stay in that of the patch.
const BLOCK_CELLS: usize = 64;
/// Triangles near a region above which it is halved.
const NEAR_MAX: usize = 256;
/// Triangles that are gathered for a group at most: more lie across each other, and some of them are as good as all.
const GATHERED_MAX: usize = 4096;
/// Pairs and triangles that one search may visit; only triangles that lie across each other by the thousand need more.
const LOOKS_MAX: u64 = 20_000;

/// Factor on a bound of distances, so that no triangle as near as the nearest one is left out.
const BOUND_MARGIN: f64 = 1.01;
/// Rounding of a distance, by the largest coordinate.
const ROUNDING: f64 = 1e-10;

/// What hears of the closest places of up to four points: the index of the first, their number, the places.
pub(super) type HearPlaces<'f> = &'f mut dyn FnMut(usize, usize, &FourPlaces<'_>) -> Result<()>;

/// Finds closest places.
pub(super) struct ClosestPlaces<'a> {
    original: &'a Original,
    /// What a triangle that faces away counts as farther.
    away: f64,
    views: Vec<(u32, CellView)>,
    /// Cells by their squared distance from the present patch; the first [`BLOCK_CELLS`] by that from the present block.
    order: Vec<(f64, u32)>,
    /// The same, all by the distance from the patch.
    patch_order: Vec<(f64, u32)>,
    /// How many cells are in order of the distance from the block.
    of_block: usize,
    /// The present block.
    block: Bounds,
    nearby: Nearby,
    /// The cell and the place there of the triangle that was nearest last.
    last: Option<(u32, u32)>,
}

impl<'a> ClosestPlaces<'a> {
    /// Finds places of a surface.
    pub fn new(original: &'a Original, away: f64) -> Self {
        Self {
            original,
            away,
            views: Vec::new(),
            order: Vec::new(),
            patch_order: Vec::new(),
            of_block: 0,
            block: Bounds::EMPTY,
            nearby: Nearby::default(),
            last: None,
        }
    }

    /// The next blocks lie in a box.
    pub fn begin_patch(&mut self, bounds: Bounds) {
        order_by_distance(self.cells(), bounds, &mut self.patch_order);
        self.order.clone_from(&self.patch_order);
        (self.of_block, self.block) = (0, bounds);
        // What is found must not depend on the patches before.
        self.last = None;
    }

    /// Closes all cells but the `most` that were opened last, which frees the memory that they are mapped to.
    pub fn close_but(&mut self, most: usize) {
        self.views.truncate(most);
    }

    /// The next groups lie in a box.
    pub fn begin_block(&mut self, bounds: Bounds) {
        self.order[..self.of_block].copy_from_slice(&self.patch_order[..self.of_block]);
        (self.of_block, self.block) = (self.order.len().min(BLOCK_CELLS), bounds);
        let cells = self.cells();
        let near = &mut self.order[..self.of_block];
        near.iter_mut().for_each(|entry| entry.0 = cells[entry.1 as usize].bounds.between_sq(bounds));
        sort_by_distance(near);
    }

    fn cells(&self) -> &'a [Cell] {
        &self.original.surface.cells
    }

    /// Calls `found` with the closest places of all points, up to four at once. Points of an empty mesh have none.
    ///
    /// # Errors
    /// On failed reads, and those of `found`.
    pub fn of_points(&mut self, points: &PointSet, found: HearPlaces<'_>) -> Result<()> {
        self.of_groups(points, points.groups(), found)
    }

    fn of_groups(&mut self, points: &PointSet, groups: &[PointGroup], found: HearPlaces<'_>) -> Result<()> {
        if groups.is_empty() {
            return Ok(());
        }
        if !self.gather_for(groups)? {
            let (left, right) = groups.split_at(groups.len() / 2);
            self.of_groups(points, left, &mut *found)?;
            return self.of_groups(points, right, found);
        }
        groups.iter().try_for_each(|group| self.nearby.of_group(points, group, self.away, &mut *found))
    }

    /// Gathers the triangles that may be closest to a point of some groups; returns whether these are few, or of a
    /// single group.
    fn gather_for(&mut self, groups: &[PointGroup]) -> Result<bool> {
        let middles = Bounds::around(groups.iter().map(|group| group.middle));
        let middle = 0.5 * (middles.low + middles.high);
        // Candidates of a group lie within this of the middle, with the distance of the group's closest triangle.
        let span = |group: &PointGroup| group.middle.distance(middle) + 2.0 * group.radius + self.away;
        let spans: Vec<f64> = groups.iter().map(span).collect();
        let limit = if groups.len() > 1 { NEAR_MAX } else { GATHERED_MAX };
        self.nearby.begin(middle);
        let Some((.., nearest)) = self.nearest(middle)? else { return Ok(true) };
        let rounding = ROUNDING * middle.abs().max_element();
        let guess = spans.iter().copied().fold(0.0, f64::max) + nearest + rounding;
        self.gather(middle, guess, limit)?;
        if groups.len() > 1 && self.nearby.len() == limit {
            return Ok(false);
        }
        let reaches = groups.iter().zip(&spans).map(|(group, span)| span + self.nearby.reach(group.middle));
        let reach = reaches.fold(0.0, f64::max);
        if reach > guess {
            self.nearby.begin(middle);
            self.gather(middle, reach, limit)?;
        }
        Ok(groups.len() == 1 || self.nearby.len() < limit)
    }

    /// Calls `visit` with the cells that may be nearer than a squared distance; it returns the next such distance.
    fn visit_cells(&mut self, limit_sq: f64, mut visit: impl FnMut(&mut Self, u32) -> Result<f64>) -> Result<()> {
        let mut limit_sq = limit_sq;
        for range in [0..self.of_block, self.of_block..self.order.len()] {
            for at in range {
                let (least_sq, cell) = self.order[at];
                if least_sq > limit_sq {
                    break;
                }
                limit_sq = visit(self, cell)?;
            }
        }
        Ok(())
    }

    /// What the nearest triangle shows, and its area.
    ///
    /// # Errors
    /// On failed reads.
    pub fn nearest_triangle(&mut self, point: DVec3) -> Result<Option<(Shown, f64)>> {
        let Some((cell, place, _)) = self.nearest(point)? else { return Ok(None) };
        let original = self.original;
        let view = self.open(cell)?;
        Ok(Some((original.shown(view, place), area(view.triangle(place)))))
    }

    /// The cell of the nearest triangle, its place there and its distance.
    fn nearest(&mut self, point: DVec3) -> Result<Option<(u32, u32, f64)>> {
        let bound_sq = self.bound_sq(point);
        // A search that ends early may find nothing within the bound.
        let mut found = self.nearest_within(point, bound_sq)?;
        if found.is_none() && bound_sq.is_finite() {
            found = self.nearest_within(point, f64::INFINITY)?;
        }
        self.last = found.map(|(cell, place, _)| (cell, place));
        Ok(found)
    }

    fn nearest_within(&mut self, point: DVec3, bound_sq: f64) -> Result<Option<(u32, u32, f64)>> {
        let (mut best, mut best_sq) = (None, bound_sq);
        self.visit_cells(best_sq, |search, cell| {
            if search.cells()[cell as usize].bounds.distance_sq(point) < best_sq {
                let view = search.open(cell)?;
                let point = point - view.origin;
                let question = Question { point, bound_sq: best_sq, enough_sq: -1.0, looks: LOOKS_MAX };
                if let Some((place, distance_sq)) = view.ask(&question).nearest {
                    (best, best_sq) = (Some((cell, place)), distance_sq);
                }
            }
            Ok(best_sq)
        })?;
        Ok(best.map(|(cell, place)| (cell, place, best_sq.sqrt())))
    }

    /// The square of a distance within which there is a triangle, beyond doubt: the one that was nearest last, as the next
    /// points lie near it.
    fn bound_sq(&self, point: DVec3) -> f64 {
        let last =
            self.last.and_then(|(cell, place)| Some((self.views.iter().find(|(open, _)| *open == cell)?, place)));
        let Some(((_, view), place)) = last else { return f64::INFINITY };
        let local = point - view.origin;
        let distance = closest_point(local, view.triangle(place)).distance(local);
        let bound = distance * BOUND_MARGIN + ROUNDING * point.abs().max_element();
        (bound * bound).max(f64::MIN_POSITIVE)
    }

    /// Gathers triangles no farther than `distance` from a point, at most `limit`.
    fn gather(&mut self, point: DVec3, distance: f64, limit: usize) -> Result<()> {
        let original = self.original;
        let mut nearby = std::mem::take(&mut self.nearby);
        let limit_sq = distance * distance;
        self.visit_cells(limit_sq, |search, cell| {
            if original.surface.cells[cell as usize].bounds.distance_sq(point) <= limit_sq {
                let view = search.open(cell)?;
                let local = point - view.origin;
                view.tree().visit_within(local, limit_sq, |place| {
                    let corners = view.triangle(place).map(|corner| corner - local);
                    if distance_sq(DVec3::ZERO, corners) <= limit_sq {
                        nearby.add(corners, original.shown(view, place));
                    }
                    nearby.len() >= limit
                });
            }
            Ok(if nearby.len() < limit { limit_sq } else { -1.0 })
        })?;
        self.nearby = nearby;
        Ok(())
    }

    /// Calls `visit` with the corners of each triangle whose box meets a box, and with what it shows, until it returns
    /// that it has seen enough.
    ///
    /// # Errors
    /// On failed reads.
    pub fn visit_meeting(&mut self, bounds: Bounds, mut visit: impl FnMut([DVec3; 3], Shown) -> bool) -> Result<()> {
        let original = self.original;
        let mut is_enough = false;
        // A cell that meets the box is no farther from the block than the box reaches out of it.
        let beyond = (self.block.low - bounds.low).max(bounds.high - self.block.high).max(DVec3::ZERO);
        let limit_sq = beyond.length_squared();
        self.visit_cells(limit_sq, |search, cell| {
            if original.surface.cells[cell as usize].bounds.between_sq(bounds) == 0.0 {
                let view = search.open(cell)?;
                let own = Bounds { low: bounds.low - view.origin, high: bounds.high - view.origin };
                view.tree().visit_meeting(own, |place| {
                    let corners = view.triangle(place).map(|corner| corner + view.origin);
                    let meets = bounds.between_sq(Bounds::around(corners)) == 0.0;
                    is_enough = meets && visit(corners, original.shown(view, place));
                    is_enough
                });
            }
            Ok(if is_enough { -1.0 } else { limit_sq })
        })
    }

    /// Opens a cell unless it is open, and closes those opened first while all have more than [`OPEN_BYTES`].
    fn open(&mut self, cell: u32) -> Result<&CellView> {
        let at = match self.views.iter().position(|(open, _)| *open == cell) {
            Some(at) => at,
            None => {
                let view = self.cells()[cell as usize].view()?;
                self.views.insert(0, (cell, view));
                let fits = |bytes: &mut u64, (open, _): &(u32, CellView)| {
                    *bytes += self.original.surface.cells[*open as usize].bytes();
                    Some(*bytes <= OPEN_BYTES)
                };
                let most = self.views.iter().scan(0, fits).take_while(|&fits| fits).count();
                self.views.truncate(most.max(1));
                0
            }
        };
        Ok(&self.views[at].1)
    }
}

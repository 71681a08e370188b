//! Finds, for points that lie near each other and face the same way, the closest places of the original surface.
//!
//! A triangle that faces away from a point counts as [`reach`](ClosestPlaces::new) farther, so that the two sides of a
//! wall do not mix.
//!
//! ```text
//!        . . p . .         the nearest triangle of the middle is d away, the points lie within r of the middle:
//!   ─────────────────      so the nearest one of each of them is at most d + 2 r away from the middle
//! ```
//! So the tree is asked twice for a group of points, not once for each.
//!
//! # Memory
//! 200 bytes for each triangle near a group, and the touched pages of [`VIEWS`] cells.

use glam::DVec3;

use crate::base::Result;
use crate::geometry::boxtree::Bounds;
use crate::geometry::triangle_tree::Question;
use crate::geometry::{closest_weights, distance_sq};
use crate::surface::cell::{Cell, CellFace, CellView};

/// Cells kept open at once.
const VIEWS: usize = 8;
/// Pairs and triangles that one search may visit; only triangles that lie across each other by the thousand need more.
const LOOKS_MAX: u64 = 20_000;
/// Triangles near a group above which it is halved, if it has this many points.
const NEAR_MAX: usize = 96;
const POINTS_MIN: usize = 4;

/// A place of the original surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// The triangle.
    pub face: CellFace,
    /// Colours of its corners, the fourth byte 0 where there is none.
    pub colours: Option<[[u8; 4]; 3]>,
    /// Barycentric weights of the place.
    pub weights: [f64; 3],
}

/// A triangle near a group.
struct Near {
    /// Its distance from the middle of the group, with what it counts for facing away.
    least: f64,
    away: f64,
    corners: [DVec3; 3],
    face: CellFace,
    colours: Option<[[u8; 4]; 3]>,
}

/// Finds closest places.
pub(super) struct ClosestPlaces<'a> {
    cells: &'a [Cell],
    /// What a triangle that faces away counts as farther.
    reach: f64,
    views: Vec<(u32, CellView)>,
    /// Cells by their squared distance from the present chart.
    order: Vec<(f64, u32)>,
    near: Vec<Near>,
}

impl<'a> ClosestPlaces<'a> {
    /// Finds places in these cells.
    pub fn new(cells: &'a [Cell], reach: f64) -> Self {
        Self { cells, reach, views: Vec::new(), order: Vec::new(), near: Vec::new() }
    }

    /// The next groups lie in a box.
    pub fn begin(&mut self, bounds: Bounds) {
        let distance_sq =
            |other: Bounds| (other.low - bounds.high).max(bounds.low - other.high).max(DVec3::ZERO).length_squared();
        self.order.clear();
        self.order.extend(self.cells.iter().zip(0..).map(|(cell, number)| (distance_sq(cell.bounds), number)));
        self.order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }

    /// Calls `found` with the number of each point of a group and its place; points of an empty mesh have none.
    ///
    /// # Errors
    /// On failed reads, and those of `found`.
    pub fn of_group(
        &mut self,
        points: &[DVec3],
        normal: DVec3,
        found: &mut dyn FnMut(usize, Place) -> Result<()>,
    ) -> Result<()> {
        self.search(points, 0, normal, found)
    }

    fn search(
        &mut self,
        points: &[DVec3],
        first: usize,
        normal: DVec3,
        found: &mut dyn FnMut(usize, Place) -> Result<()>,
    ) -> Result<()> {
        let bounds = Bounds::around(points.iter().copied());
        let middle = 0.5 * (bounds.low + bounds.high);
        let radius = points.iter().map(|point| point.distance(middle)).fold(0.0, f64::max);
        let Some(nearest) = self.nearest(middle, normal)? else { return Ok(()) };
        self.gather(middle, normal, nearest + 2.0 * radius)?;
        if self.near.len() > NEAR_MAX && points.len() > POINTS_MIN {
            let (left, right) = points.split_at(points.len() / 2);
            self.search(left, first, normal, found)?;
            return self.search(right, first + left.len(), normal, found);
        }
        for (point, number) in points.iter().zip(first..) {
            let from_middle = point.distance(middle);
            let at = *point - middle;
            let mut best = (f64::INFINITY, 0);
            for (place, near) in self.near.iter().enumerate() {
                if near.least - from_middle >= best.0 {
                    break;
                }
                let distance = distance_sq(at, near.corners).sqrt() + near.away;
                if distance < best.0 {
                    best = (distance, place);
                }
            }
            if let Some(near) = self.near.get(best.1) {
                let weights = closest_weights(at, near.corners);
                found(number, Place { face: near.face, colours: near.colours, weights })?;
            }
        }
        Ok(())
    }

    /// What a triangle with these corners counts as farther.
    #[inline]
    fn away(&self, normal: DVec3, corners: [DVec3; 3]) -> f64 {
        let faces = (corners[1] - corners[0]).cross(corners[2] - corners[0]).dot(normal);
        if faces > 0.0 { 0.0 } else { self.reach }
    }

    /// Distance of the nearest triangle.
    fn nearest(&mut self, point: DVec3, normal: DVec3) -> Result<Option<f64>> {
        let mut best_sq = f64::INFINITY;
        for at in 0..self.order.len() {
            let (group_distance_sq, cell) = self.order[at];
            if group_distance_sq >= best_sq {
                break;
            }
            if self.cells[cell as usize].bounds.distance_sq(point) >= best_sq {
                continue;
            }
            let open = self.open(cell)?;
            let view = &self.views[open].1;
            let local = point - view.origin;
            let question = Question { point: local, bound_sq: best_sq, enough_sq: -1.0, looks: LOOKS_MAX };
            let measure_sq = |face: u32| {
                let corners = view.triangle(face);
                let distance = distance_sq(local, corners).sqrt() + self.away(normal, corners);
                distance * distance
            };
            if let Some((_, distance_sq)) = view.tree().ask_by(&question, measure_sq).nearest {
                best_sq = distance_sq;
            }
        }
        Ok(best_sq.is_finite().then(|| best_sq.sqrt()))
    }

    /// Gathers all triangles that count as no farther than `distance` from a point, the nearest first.
    fn gather(&mut self, point: DVec3, normal: DVec3, distance: f64) -> Result<()> {
        let mut gathered = std::mem::take(&mut self.near);
        gathered.clear();
        let limit_sq = distance * distance;
        for at in 0..self.order.len() {
            let (group_distance_sq, cell) = self.order[at];
            if group_distance_sq > limit_sq {
                break;
            }
            if self.cells[cell as usize].bounds.distance_sq(point) > limit_sq {
                continue;
            }
            let open = self.open(cell)?;
            let view = &self.views[open].1;
            let local = point - view.origin;
            view.tree().visit_within(local, limit_sq, |place| {
                let corners = view.triangle(place).map(|corner| corner - local);
                let away = self.away(normal, corners);
                let least = distance_sq(DVec3::ZERO, corners).sqrt() + away;
                if least <= distance {
                    let face = view.faces[place as usize];
                    let of_corner = |vertex: u32| view.colours.get(vertex as usize).copied();
                    let [a, b, c] = face.vertices.map(of_corner);
                    let colours = a.zip(b).zip(c).map(|((a, b), c)| [a, b, c]);
                    gathered.push(Near { least, away, corners, face, colours });
                }
            });
        }
        gathered.sort_by(|a, b| a.least.total_cmp(&b.least));
        self.near = gathered;
        Ok(())
    }

    /// Opens a cell unless it is open, closing the least recently used one; returns its place.
    fn open(&mut self, cell: u32) -> Result<usize> {
        match self.views.iter().position(|(open, _)| *open == cell) {
            Some(at) => self.views[..=at].rotate_right(1),
            None => {
                self.views.truncate(VIEWS - 1);
                self.views.insert(0, (cell, self.cells[cell as usize].view()?));
            }
        }
        Ok(0)
    }
}

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

use glam::{DVec3, DVec4, Vec3, Vec4};

use crate::base::Result;
use crate::geometry::boxtree::Bounds;
use crate::geometry::triangle::area;
use crate::geometry::triangle_tree::Question;
use crate::geometry::{closest_weights, distance_sq};
use crate::surface::cell::{Cell, CellFace, CellView};

/// Cells kept open at once.
const VIEWS: usize = 8;
/// Cells that are put in order for each chart; the others stay in that of the patch.
const CHART_CELLS: usize = 64;
/// Triangles that are gathered for a group at most: more lie across each other, and some of them are as good as all.
const GATHERED_MAX: usize = 4096;
/// Pairs and triangles that one search may visit; only triangles that lie across each other by the thousand need more.
const LOOKS_MAX: u64 = 20_000;
/// Cosine between normals below which a triangle faces away: the back of a wall does, the folds of a crumpled surface do
/// not.
const AWAY: f64 = -0.5;
/// A triangle lower than this, per length of its sides, is measured without its prism.
const THIN: f64 = 1e-3;
/// Factor on lower bounds of squared distances that were computed in single precision.
const BOUND_MARGIN: f64 = 0.999;
/// Triangles near a group above which it is halved, if it has this many points.
const NEAR_MAX: usize = 96;
const POINTS_MIN: usize = 4;

/// A place of the original surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct OriginalPlace {
    /// The triangle.
    pub face: CellFace,
    /// Colours of its corners, the fourth byte 0 where there is none.
    pub colours: Option<[[u8; 4]; 3]>,
    /// Its area in space.
    pub area: f64,
    /// Barycentric weights of the place.
    pub weights: [f64; 3],
}

/// A triangle near a group.
struct Near {
    /// Its distance from the middle of the group, with what it counts for facing away.
    least: f64,
    away: f64,
    prism: Option<Prism>,
    corners: [DVec3; 3],
    face: CellFace,
    colours: Option<[[u8; 4]; 3]>,
}

impl Near {
    fn new(corners: [DVec3; 3], away: f64, face: CellFace, colours: Option<[[u8; 4]; 3]>) -> Self {
        let least = distance_sq(DVec3::ZERO, corners).sqrt() + away;
        Self { least, away, prism: Prism::over(corners), corners, face, colours }
    }

    /// What it counts as far from a point, if that is less than `bound`; else any number from `bound` on.
    #[inline]
    fn distance(&self, point: DVec3, bound: f64) -> f64 {
        let Some(prism) = &self.prism else { return distance_sq(point, self.corners).sqrt() + self.away };
        let beyond = prism.beyond(point);
        let outside = beyond.y.max(beyond.z).max(beyond.w);
        if outside <= 0.0 {
            return f64::from(beyond.x.abs()) + self.away;
        }
        let least_sq = f64::from(beyond.x * beyond.x + outside * outside) * BOUND_MARGIN;
        let room = (bound - self.away).max(0.0);
        if least_sq >= room * room { f64::INFINITY } else { distance_sq(point, self.corners).sqrt() + self.away }
    }

    /// Barycentric weights of its place closest to a point.
    #[inline]
    fn weights(&self, point: DVec3) -> [f64; 3] {
        if let Some(prism) = &self.prism {
            let beyond = prism.beyond(point);
            if beyond.y.max(beyond.z).max(beyond.w) <= 0.0 {
                let [a, b] = [beyond.y / prism.depths.x, beyond.z / prism.depths.y].map(|share| f64::from(-share));
                return [a, b, (1.0 - a - b).max(0.0)];
            }
        }
        closest_weights(point, self.corners)
    }
}

/// The prism of all points over a triangle: a point outside of a side is at least as far from the triangle as from that
/// side's plane. The planes of the triangle and of the sides opposite to its corners, side by side:
struct Prism {
    /// Normals of the planes, those of the sides away from the triangle.
    x: Vec4,
    y: Vec4,
    z: Vec4,
    /// Distances of the planes from the origin.
    limit: Vec4,
    /// Distance of each corner from the opposite side.
    depths: Vec3,
}

impl Prism {
    /// `None` over a triangle that is nearly a line.
    fn over(corners: [DVec3; 3]) -> Option<Self> {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).try_normalize()?;
        let side = |corner: usize| {
            let (from, to) = (corners[(corner + 1) % 3], corners[(corner + 2) % 3]);
            let outwards = (to - from).cross(normal).try_normalize()?;
            let limit = outwards.dot(from);
            Some((outwards, limit, limit - corners[corner].dot(outwards)))
        };
        let sides = [side(0)?, side(1)?, side(2)?];
        let longest = corners[0].distance(corners[1]).max(corners[1].distance(corners[2]));
        if sides.iter().any(|&(_, _, depth)| depth <= THIN * longest) {
            return None;
        }
        let [a, b, c] = sides;
        let column = |axis: usize| DVec4::new(normal[axis], a.0[axis], b.0[axis], c.0[axis]).as_vec4();
        let limit = DVec4::new(normal.dot(corners[0]), a.1, b.1, c.1).as_vec4();
        let depths = DVec3::new(a.2, b.2, c.2).as_vec3();
        Some(Self { x: column(0), y: column(1), z: column(2), limit, depths })
    }

    /// How far a point lies beyond each plane: above the triangle, and outside of its sides.
    #[inline]
    fn beyond(&self, point: DVec3) -> Vec4 {
        let point = point.as_vec3();
        self.x * point.x + self.y * point.y + self.z * point.z - self.limit
    }
}

/// Finds closest places.
pub(super) struct ClosestPlaces<'a> {
    cells: &'a [Cell],
    /// What a triangle that faces away counts as farther.
    reach: f64,
    views: Vec<(u32, CellView)>,
    /// Cells by their squared distance from the present patch; the first [`CHART_CELLS`] by that from the present chart.
    order: Vec<(f64, u32)>,
    /// The same, all by the distance from the patch.
    patch_order: Vec<(f64, u32)>,
    /// How many cells are in order of the distance from the chart.
    of_chart: usize,
    near: Vec<Near>,
}

impl<'a> ClosestPlaces<'a> {
    /// Finds places in these cells.
    pub fn new(cells: &'a [Cell], reach: f64) -> Self {
        Self {
            cells,
            reach,
            views: Vec::new(),
            order: Vec::new(),
            patch_order: Vec::new(),
            of_chart: 0,
            near: Vec::new(),
        }
    }

    /// The next charts lie in a box.
    pub fn begin_patch(&mut self, bounds: Bounds) {
        self.order.clear();
        self.order.extend(self.cells.iter().zip(0..).map(|(cell, number)| (between_sq(cell.bounds, bounds), number)));
        sort(&mut self.order);
        self.patch_order = self.order.clone();
        self.of_chart = 0;
    }

    /// The next groups lie in a box.
    pub fn begin_chart(&mut self, bounds: Bounds) {
        self.order.clone_from(&self.patch_order);
        self.of_chart = self.order.len().min(CHART_CELLS);
        let near = &mut self.order[..self.of_chart];
        near.iter_mut().for_each(|entry| entry.0 = between_sq(self.cells[entry.1 as usize].bounds, bounds));
        sort(near);
    }

    /// Calls `visit` with the cells that may be nearer than a squared distance; it returns the next such distance.
    fn visit_cells(&mut self, limit_sq: f64, mut visit: impl FnMut(&mut Self, u32, f64) -> Result<f64>) -> Result<()> {
        let mut limit_sq = limit_sq;
        for range in [0..self.of_chart, self.of_chart..self.order.len()] {
            for at in range {
                let (least_sq, cell) = self.order[at];
                if least_sq > limit_sq {
                    break;
                }
                limit_sq = visit(self, cell, limit_sq)?;
            }
        }
        Ok(())
    }

    /// Calls `found` with the number of each point of a group and its place; points of an empty mesh have none.
    ///
    /// # Errors
    /// On failed reads, and those of `found`.
    pub fn of_group(
        &mut self,
        points: &[DVec3],
        normal: DVec3,
        found: &mut dyn FnMut(usize, OriginalPlace) -> Result<()>,
    ) -> Result<()> {
        self.search(points, 0, normal, found)
    }

    fn search(
        &mut self,
        points: &[DVec3],
        first: usize,
        normal: DVec3,
        found: &mut dyn FnMut(usize, OriginalPlace) -> Result<()>,
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
        let mut last = 0;
        for (point, number) in points.iter().zip(first..) {
            let from_middle = point.distance(middle);
            let at = *point - middle;
            // Mostly the triangle of the point before.
            let mut best = (self.near.get(last).map_or(f64::INFINITY, |near| near.distance(at, f64::INFINITY)), last);
            for (place, near) in self.near.iter().enumerate() {
                if near.least - from_middle >= best.0 {
                    break;
                }
                let distance = near.distance(at, best.0);
                if distance < best.0 {
                    best = (distance, place);
                }
            }
            last = best.1;
            if let Some(near) = self.near.get(best.1) {
                let weights = near.weights(at);
                let area = area(near.corners);
                found(number, OriginalPlace { face: near.face, colours: near.colours, area, weights })?;
            }
        }
        Ok(())
    }

    /// What a triangle with these corners counts as farther.
    #[inline]
    fn away(&self, normal: DVec3, corners: [DVec3; 3]) -> f64 {
        let across = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        if across.dot(normal) >= AWAY * across.length() { 0.0 } else { self.reach }
    }

    /// Distance of the nearest triangle.
    fn nearest(&mut self, point: DVec3, normal: DVec3) -> Result<Option<f64>> {
        let mut best_sq = f64::INFINITY;
        self.visit_cells(best_sq, |search, cell, _| {
            if search.cells[cell as usize].bounds.distance_sq(point) < best_sq {
                search.open(cell)?;
                let view = &search.views[0].1;
                let local = point - view.origin;
                let question = Question { point: local, bound_sq: best_sq, enough_sq: -1.0, looks: LOOKS_MAX };
                let measure_sq = |face: u32| {
                    let corners = view.triangle(face);
                    let distance = distance_sq(local, corners).sqrt() + search.away(normal, corners);
                    distance * distance
                };
                if let Some((_, distance_sq)) = view.tree().ask_by(&question, measure_sq).nearest {
                    best_sq = distance_sq;
                }
            }
            Ok(best_sq)
        })?;
        Ok(best_sq.is_finite().then(|| best_sq.sqrt()))
    }

    /// Gathers the triangles that count as no farther than `distance` from a point, the nearest first; at most
    /// [`GATHERED_MAX`].
    fn gather(&mut self, point: DVec3, normal: DVec3, distance: f64) -> Result<()> {
        let mut gathered = std::mem::take(&mut self.near);
        gathered.clear();
        let limit_sq = distance * distance;
        self.visit_cells(limit_sq, |search, cell, _| {
            if search.cells[cell as usize].bounds.distance_sq(point) <= limit_sq {
                search.open(cell)?;
                let view = &search.views[0].1;
                let local = point - view.origin;
                view.tree().visit_within(local, limit_sq, |place| {
                    let corners = view.triangle(place).map(|corner| corner - local);
                    let away = search.away(normal, corners);
                    if distance_sq(DVec3::ZERO, corners).sqrt() + away <= distance {
                        let face = view.faces[place as usize];
                        let of_corner = |vertex: u32| view.colours.get(vertex as usize).copied();
                        let [a, b, c] = face.vertices.map(of_corner);
                        let colours = a.zip(b).zip(c).map(|((a, b), c)| [a, b, c]);
                        gathered.push(Near::new(corners, away, face, colours));
                    }
                    gathered.len() >= GATHERED_MAX
                });
            }
            Ok(limit_sq)
        })?;
        gathered.sort_by(|a, b| a.least.total_cmp(&b.least));
        self.near = gathered;
        Ok(())
    }

    /// Opens a cell unless it is open, as the first of the views, and closes the least recently used one.
    fn open(&mut self, cell: u32) -> Result<()> {
        match self.views.iter().position(|(open, _)| *open == cell) {
            Some(at) => self.views[..=at].rotate_right(1),
            None => {
                self.views.truncate(VIEWS - 1);
                self.views.insert(0, (cell, self.cells[cell as usize].view()?));
            }
        }
        Ok(())
    }
}

/// Squared distance between two boxes.
fn between_sq(a: Bounds, b: Bounds) -> f64 {
    (a.low - b.high).max(b.low - a.high).max(DVec3::ZERO).length_squared()
}

fn sort(order: &mut [(f64, u32)]) {
    order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
}

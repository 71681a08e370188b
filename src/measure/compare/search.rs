//! The closest points of a mesh in cells, for points that lie near each other.
//!
//! ```text
//!   +-------+-------+
//!   |   .   |       |     each point first asks the cell whose box is nearest;
//!   |  . *--|--o    |     then every cell whose box is nearer than what was found so far
//!   +-------+-------+
//! ```
//! The result is exact to the rounding of coordinates: every cell whose box is nearer than the returned distance is
//! searched. Where thousands of triangles overlap each other's boxes, each point would have to visit most of them.
//! There only some points are searched to the end; the searches of the others are abandoned, and counted
//! ([`Search::cut_count`]):
//!
//! ```text
//!   . . o . . . o . . . o .      of points whose search was abandoned, those at o are searched to the end, and each of
//!   |-------|-------|-----|      them represents its stretch: the result is exact, for fewer points
//! ```
//!
//! # Memory
//! 130 bytes a point, and the touched pages of [`VIEWS`] cells.

use glam::DVec3;

use crate::base::Result;
use crate::geometry::boxtree::Bounds;
use crate::geometry::closest_point;
use crate::geometry::triangle::{area, barycentric, texture_area, unit_normal};
use crate::geometry::triangle_tree::Question;
use crate::model::id::ImageId;
use crate::surface::cell::{CellFace, CellView};
use crate::surface::cells::SurfaceCells;
use crate::surface::order::order_by_distance;

/// Number of cells kept open at once.
pub const VIEWS: usize = 4;
/// Points that are searched together: cells are chosen by the box around them.
const GROUP_POINTS: usize = 512;

/// A triangle within this many roundings of the largest coordinate counts as nearest; where many triangles meet at a
/// point, the others need not be visited.
const ROUNDINGS: f64 = 4.0;

/// Pairs and triangles that the search for a point may visit.
const LOOKS_OF_POINT: u64 = 128;
/// Further visits that the points of a batch share, for each point of the batch.
const LOOKS_TO_SHARE: u64 = 128;

/// A point, by its index among the points asked for, and what is nearest to it.
pub type Spoken = (usize, Found);

/// The farthest of some points.
#[derive(Debug, Clone, Copy)]
pub struct Farthest {
    /// The farthest of those that were searched to the end; `None` if none is farther than was known.
    pub point: Option<Spoken>,
    /// Square of an upper bound of all distances.
    pub bound_sq: f64,
}

/// Triangle nearest to a point.
#[derive(Debug, Clone, Copy)]
pub struct Found {
    /// Squared distance; infinite until a triangle is found.
    pub distance_sq: f64,
    /// Cell of the closest triangle.
    pub cell: u32,
    /// The closest triangle of that cell.
    pub face: u32,
    looks: u64,
    is_cut: bool,
}

const NOTHING: Found = Found { distance_sq: f64::INFINITY, cell: u32::MAX, face: 0, looks: 0, is_cut: false };

/// The closest point of a triangle, with its normal and texture.
#[derive(Debug, Clone, Copy)]
pub struct Closest {
    /// The point.
    pub position: DVec3,
    /// Normal of the triangle; zero if it has no area.
    pub normal: DVec3,
    /// Texture image of the triangle, or none.
    pub image: ImageId,
    /// Texture coordinate of the point.
    pub texcoord: [f32; 2],
    /// Length in texture space per length in space.
    pub density: f32,
}

/// A search in one mesh.
pub struct Search<'a> {
    mesh: &'a SurfaceCells,
    views: Vec<Open>,
    order: Vec<(f64, u32)>,
    /// Squared distance up to which a triangle counts as nearest.
    least_sq: f64,
    /// Shared visits that are left.
    looks: u64,
    /// Number of points whose search was abandoned.
    cut_count: u64,
}

/// An open cell.
struct Open {
    cell: u32,
    /// The triangle found last in it.
    last: u32,
    view: CellView,
}

impl<'a> Search<'a> {
    /// A search with no cell open.
    pub fn new(mesh: &'a SurfaceCells) -> Self {
        let largest = mesh.bounds.low.abs().max(mesh.bounds.high.abs()).max_element();
        let least_sq = (ROUNDINGS * f64::EPSILON * largest).powi(2);
        Self { mesh, views: Vec::new(), order: Vec::new(), least_sq, looks: 0, cut_count: 0 }
    }

    /// Number of points whose search was abandoned.
    pub fn cut_count(&self) -> u64 {
        self.cut_count
    }

    /// For each point its representative, which is the point itself unless its search was abandoned, with what is
    /// closest to that; and the square of an upper bound of all distances. At most `probes` points, at least one,
    /// represent others.
    ///
    /// # Errors
    /// On failed reads.
    pub fn nearest(&mut self, points: &[DVec3], probes: usize) -> Result<(Vec<Spoken>, f64)> {
        self.looks = LOOKS_TO_SHARE * points.len() as u64;
        let mut found = vec![NOTHING; points.len()];
        for (group, found) in points.chunks(GROUP_POINTS).zip(found.chunks_mut(GROUP_POINTS)) {
            self.look_for(group, self.least_sq, found)?;
        }
        let bound_sq = found.iter().fold(0.0, |most: f64, found| most.max(found.distance_sq));
        let cut: Vec<usize> = (0..points.len()).filter(|&number| self.is_open(&found[number], self.least_sq)).collect();
        self.cut_count += cut.len() as u64;
        let mut spoken: Vec<Spoken> = found.into_iter().enumerate().collect();
        for stretch in cut.chunks(cut.len().div_ceil(probes.max(1)).max(1)) {
            let probe = stretch[stretch.len() / 2];
            let mut whole = [Found { looks: 0, is_cut: false, ..spoken[probe].1 }];
            self.looks = u64::MAX;
            self.look_for(&points[probe..=probe], self.least_sq, &mut whole)?;
            stretch.iter().for_each(|&number| spoken[number] = (probe, whole[0]));
        }
        Ok((spoken, bound_sq))
    }

    /// The point that is farthest from the mesh, and farther than the root of `known_sq`; the first of several.
    ///
    /// Points found to be nearer than the farthest so far are not searched to the end.
    ///
    /// # Errors
    /// On failed reads.
    pub fn farthest(&mut self, points: &[DVec3], known_sq: f64) -> Result<Farthest> {
        self.looks = LOOKS_TO_SHARE * points.len() as u64;
        let (mut most_sq, mut point) = (known_sq.max(self.least_sq), None);
        let mut given_up = Vec::new();
        for (group, first) in points.chunks(GROUP_POINTS).zip((0..).step_by(GROUP_POINTS)) {
            let mut found = vec![NOTHING; group.len()];
            let enough_sq = most_sq;
            self.look_for(group, enough_sq, &mut found)?;
            for (found, number) in found.into_iter().zip(first..) {
                if self.is_open(&found, enough_sq) {
                    given_up.push(found.distance_sq);
                } else if found.distance_sq.is_finite() && found.distance_sq > most_sq {
                    most_sq = found.distance_sq;
                    point = Some((number, found));
                }
            }
        }
        // The distance that is known by now decides some of the points whose search was abandoned before.
        given_up.retain(|&bound_sq| bound_sq > most_sq);
        self.cut_count += given_up.len() as u64;
        Ok(Farthest { point, bound_sq: given_up.into_iter().fold(most_sq, f64::max) })
    }

    /// Whether the search for a point was abandoned before it was known to be no farther than the root of `enough_sq`.
    fn is_open(&self, found: &Found, enough_sq: f64) -> bool {
        found.is_cut && found.distance_sq > enough_sq
    }

    /// Looks for triangles that are closer to each point than what was found. The search for a point ends when it is
    /// known to be no farther than the root of `enough_sq`.
    fn look_for(&mut self, points: &[DVec3], enough_sq: f64, found: &mut [Found]) -> Result<()> {
        self.sort_cells(Bounds::around(points.iter().copied()));
        let mut homes: Vec<(u32, usize)> = points.iter().map(|&point| self.home(point)).zip(0..).collect();
        homes.sort_unstable();
        for same in homes.chunk_by(|a, b| a.0 == b.0) {
            let cell = self.order[same[0].0 as usize].1;
            for &(_, point) in same {
                self.ask(cell, points[point], enough_sq, &mut found[point])?;
            }
        }
        for at in 0..self.order.len() {
            let (group_distance_sq, cell) = self.order[at];
            let open = found.iter().filter(|found| found.distance_sq > enough_sq);
            let most = open.fold(0.0f64, |most, found| most.max(found.distance_sq));
            if group_distance_sq >= most {
                break;
            }
            let bounds = self.mesh.cells[cell as usize].bounds;
            for &(home, point) in &homes {
                let (position, found) = (points[point], &mut found[point]);
                let may_be_nearer = bounds.distance_sq(position) < found.distance_sq;
                if home as usize != at && may_be_nearer && found.distance_sq > enough_sq {
                    self.ask(cell, position, enough_sq, found)?;
                }
            }
        }
        Ok(())
    }

    /// Sorts the cells by their distance from a box.
    fn sort_cells(&mut self, bounds: Bounds) {
        order_by_distance(&self.mesh.cells, bounds, &mut self.order);
    }

    /// Index in the order of the cell whose box is nearest; of several, of that whose centre is nearest.
    fn home(&self, point: DVec3) -> u32 {
        let mut best = (f64::INFINITY, f64::INFINITY, 0);
        for (&(group_distance_sq, cell), at) in self.order.iter().zip(0..) {
            if group_distance_sq > best.0 {
                break;
            }
            let bounds = self.mesh.cells[cell as usize].bounds;
            let distance = (bounds.distance_sq(point), (bounds.low + bounds.high - point * 2.0).length_squared());
            if distance < (best.0, best.1) {
                best = (distance.0, distance.1, at);
            }
        }
        best.2
    }

    /// Asks a cell for a triangle that is nearer than what was found; the triangle that it returned last is tried
    /// first.
    fn ask(&mut self, cell: u32, point: DVec3, enough_sq: f64, found: &mut Found) -> Result<()> {
        let shared = self.looks;
        let open = self.open(cell)?;
        let point = point - open.view.origin;
        let again_sq = closest_point(point, open.view.triangle(open.last)).distance_squared(point);
        if again_sq < found.distance_sq {
            *found = Found { distance_sq: again_sq, cell, face: open.last, ..*found };
        }
        if found.distance_sq > enough_sq {
            let own = LOOKS_OF_POINT.saturating_sub(found.looks);
            let question =
                Question { point, bound_sq: found.distance_sq, enough_sq, looks: own.saturating_add(shared) };
            let answer = open.view.ask(&question);
            if let Some((face, distance_sq)) = answer.nearest {
                *found = Found { distance_sq, cell, face, ..*found };
                open.last = face;
            }
            found.looks += answer.looks;
            found.is_cut |= answer.is_cut;
            self.looks = shared.saturating_sub(answer.looks.saturating_sub(own));
        }
        Ok(())
    }

    /// Opens a cell unless it is open, and closes the least recently used one.
    fn open(&mut self, cell: u32) -> Result<&mut Open> {
        match self.views.iter().position(|open| open.cell == cell) {
            Some(0) => {}
            Some(at) => self.views[..=at].rotate_right(1),
            None => {
                self.views.truncate(VIEWS - 1);
                self.views.insert(0, Open { cell, last: 0, view: self.mesh.cells[cell as usize].view()? });
            }
        }
        Ok(&mut self.views[0])
    }

    /// The closest point to `point` on the triangle that was found; there must be one.
    ///
    /// # Errors
    /// On failed reads.
    pub fn closest(&mut self, point: DVec3, found: &Found) -> Result<Closest> {
        let view = &self.open(found.cell)?.view;
        let triangle = view.triangle(found.face);
        let face = view.faces[found.face as usize];
        let position = closest_point(point - view.origin, triangle);
        let weights = barycentric(position, triangle);
        Ok(Closest {
            position: position + view.origin,
            normal: unit_normal(triangle),
            image: face.image,
            texcoord: texcoord_at(&face.texcoords, weights),
            density: density(triangle, &face),
        })
    }
}

/// Texture coordinate at a point of a triangle, shifted by whole numbers to between 0 and 1.
pub fn texcoord_at(texcoords: &[[f32; 2]; 3], weights: [f64; 3]) -> [f32; 2] {
    [0, 1].map(|axis| {
        let at = (0..3).map(|corner| f64::from(texcoords[corner][axis]) * weights[corner]).sum::<f64>();
        (at - at.floor()) as f32
    })
}

/// Length in texture space per length in space on a triangle; 0 if it shows no image or has no area.
pub fn density(triangle: [DVec3; 3], face: &CellFace) -> f32 {
    let density = (texture_area(face.texcoords) / area(triangle)).sqrt();
    if face.image != ImageId::NONE && density.is_finite() { density as f32 } else { 0.0 }
}

//! Probes of the input: sample points and triangles by which the result is measured after the input's files are
//! deleted.
//!
//! ```text
//!   .  ▒▒▒▒▒▒▒   .     points on the input, denser where error is expected: each finds the nearest point of the result
//!      ▒▒┌──┐▒▒    .
//!    . ▒▒│  │▒▒        cells of space, chosen by a hash: each point of the result in one finds the nearest point among
//!      ▒▒└──┘▒▒  .     the input's triangles that lie in the cell or within half its side around it
//!  .   ▒▒▒▒▒▒▒
//! ```
//! A cell is chosen by its coordinates alone, at most one per block of cells, so that every cluster finds its own
//! triangles. For a point of the result farther from the input than half a side, the measured distance may be too
//! large.
//!
//! # Memory
//! 32 bytes for each of up to 4 × 32,768 points, about 24 for each of some 37,000 triangles; 24 bytes per vertex and 32
//! per face of the cluster that is probed.

use std::cell::Cell;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::random_points::{area_of, point_on};
use crate::base::chance::{INCREMENT, mixed, unit};
use crate::base::id::{TiVec, ids};
use crate::job::Recalled;
use crate::mesh::ClusterMesh;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::partition::ClusterId;

/// Faces of the input per point on it; the number of points is clamped to `POINTS_MIN..=POINTS_MAX`.
const FACES_PER_POINT: u64 = 64;
const POINTS_MIN: u64 = 2048;
const POINTS_MAX: u64 = 32_768;
/// Largest number of points in the chosen cells, on each of the two surfaces.
const CELL_POINTS_MAX: u64 = 4096;
/// Shares of the points that are distributed by area, by face, and by expected error.
const BY_AREA: f64 = 0.4;
const BY_FACES: f64 = 0.2;
const BY_STAKES: f64 = 0.4;
/// Bend below which a vertex counts as flat. Bend: 1 minus the length of the mean unit normal around the vertex.
const BEND_MIN: f32 = 1e-6;
/// Expected number of faces of the input in all chosen cells.
const CHOSEN_FACES: f64 = 3072.0;
/// Faces of the input in a flat cell, for targets of a tenth of the faces or more.
const CELL_FACES: f64 = 32.0;
/// Largest factor on the faces per cell for smaller targets, where distances are larger.
const CELL_GROWTH_MAX: f64 = 8.0;
/// Expected number of triangles kept per face in a chosen cell.
const TRIANGLES_PER_FACE: f64 = 12.0;
/// Area of an equilateral triangle divided by the square of its side.
const SHAPE: f64 = 0.433;
/// Largest binary logarithm of the number of cells along the side of a block.
const BLOCK_BITS_MAX: f64 = 6.0;
/// Units per side of a cell; positions are rounded down to them.
const SIDE_PARTS: i64 = 256;
/// A triangle is small if its bounding box is shorter than this share of a cell's side along each axis. Less than a
/// half.
const SMALL: f64 = 0.49;
/// Largest absolute coordinate, in units; farther positions are clamped to it.
const PLACE_MAX: i64 = 1 << 60;
/// A triangle whose bounding box meets more blocks than this is kept without testing the cells.
const BLOCKS_MAX: i128 = 64;
/// Slots of the caches of blocks and of cells.
const SLOTS: usize = 512;
/// Largest number of triangles kept per cluster: `EXCESS` times the expected number plus `EXCESS_MORE`.
const EXCESS: u64 = 4;
const EXCESS_MORE: u64 = 64;

ids! {
    /// A vertex of the triangles that are kept.
    ProbeVertex;
    /// A triangle that is kept.
    ProbeTriangle;
}

thread_local! {
    static SCRATCH: Cell<ProbeBuffers> = Cell::default();
}

/// Scratch buffers for probing a cluster.
#[derive(Debug, Default)]
struct ProbeBuffers {
    /// Running sums of the faces' sampling weights.
    ends: Vec<f64>,
    /// Each vertex of the mesh among the kept ones, or none.
    kept: TiVec<LocalVertex, ProbeVertex>,
    /// Around each vertex: sum of the cross products of the faces, and sum of their lengths.
    normals: TiVec<LocalVertex, [f32; 4]>,
    /// Bend at each vertex: 1 minus the length of the mean unit normal.
    bends: TiVec<LocalVertex, f32>,
    /// Area of each face, and the square of its longest side.
    sizes: TiVec<FaceId, (f64, f32)>,
    /// Expected error of each face if it is removed: area × bend × length².
    stakes: Vec<f32>,
    sorted: Vec<f32>,
}

/// Parameters of probing; the same for all clusters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Probing {
    /// Approximate number of points on the input.
    pub points: u64,
    /// Side of a cell, in units of length.
    side: f64,
    /// Binary logarithm of the number of cells along the side of a block.
    block_bits: u32,
    /// Probability that a block has a chosen cell.
    odds: f64,
    faces: u64,
    /// Faces wanted in the result.
    target: u64,
}

/// Probes of the input.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Probes {
    /// Parameters they were taken with.
    pub probing: Probing,
    /// Points on the input.
    #[serde(with = "crate::base::records")]
    pub points: Vec<DVec3>,
    /// Area that each point represents.
    #[serde(with = "crate::base::records")]
    pub weights: Vec<f64>,
    /// Area of each cluster.
    areas: Vec<f64>,
    /// Triangles in and around the chosen cells.
    #[serde(with = "crate::base::records")]
    triangles: TiVec<ProbeTriangle, [ProbeVertex; 3]>,
    /// Chosen cells, by their low corners, some of whose triangles were not kept because there are too many; ascending.
    #[serde(with = "crate::base::records")]
    crowded: Vec<GridPosition>,
    /// The vertices of the triangles.
    #[serde(with = "crate::base::records")]
    vertices: TiVec<ProbeVertex, DVec3>,
}

/// Sum of the squared longest sides of faces, and their number.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LongestSides {
    sum: f64,
    count: u64,
}

impl LongestSides {
    /// Sums over a cluster.
    pub fn of(mesh: &ClusterMesh) -> Self {
        let longest_sq =
            |[a, b, c]: [DVec3; 3]| a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
        let sides = triangles(mesh, DVec3::ZERO).map(|triangle| Self { sum: longest_sq(triangle), count: 1 });
        sides.fold(Self::default(), Self::with)
    }

    /// Adds the sums of other faces.
    pub fn with(self, other: Self) -> Self {
        Self { sum: self.sum + other.sum, count: self.count + other.count }
    }

    /// Their mean square; 0 without faces.
    pub fn mean_sq(self) -> f64 {
        self.sum / self.count.max(1) as f64
    }
}

impl Probing {
    /// Parameters for a mesh of `faces` faces of which `target` are wanted; `side_sq` is the mean square of their
    /// longest sides.
    pub fn new(faces: u64, target: u64, side_sq: f64) -> Self {
        let share = (CHOSEN_FACES / faces.max(1) as f64).min(1.0);
        let block_bits = (share.recip().log2() / 3.0).clamp(0.0, BLOCK_BITS_MAX) as u32;
        let growth = (0.1 * faces as f64 / target.max(1) as f64).sqrt().clamp(1.0, CELL_GROWTH_MAX);
        let side = (CELL_FACES * growth * SHAPE * side_sq).sqrt();
        Self {
            points: (faces / FACES_PER_POINT).clamp(POINTS_MIN, POINTS_MAX),
            side: if side.is_normal() { side } else { 1.0 },
            block_bits,
            odds: share * f64::from(1 << (3 * block_bits)),
            faces,
            target,
        }
    }

    /// Parameters for a mesh of which `patch` is all or a representative part.
    pub(super) fn of([faces, target]: [u64; 2], patch: &ClusterMesh) -> Self {
        Self::new(faces, target, LongestSides::of(patch).mean_sq())
    }

    /// Reports whether recalled parameters fit a mesh of `faces` faces.
    pub(super) fn is_sound(&self, faces: u64) -> bool {
        self.side.is_normal()
            && self.side > 0.0
            && *self == Self { side: self.side, ..Self::new(faces, self.target, 1.0) }
    }

    /// Approximate number of points in the chosen cells, on each of the two surfaces.
    pub fn cell_points(&self) -> u64 {
        self.points.min(CELL_POINTS_MAX)
    }

    /// Share of space that lies in chosen cells.
    pub fn share(&self) -> f64 {
        self.odds / f64::from(1 << (3 * self.block_bits))
    }

    /// Probes a cluster of the input; its number seeds the points.
    pub(super) fn take(&self, mesh: &ClusterMesh, origin: DVec3, cluster: ClusterId) -> Probes {
        let share = mesh.corners.len() as f64 / self.faces.max(1) as f64;
        let most = |expected: f64| (EXCESS as f64 * expected * share) as usize + EXCESS_MORE as usize;
        let triangles_max = most(TRIANGLES_PER_FACE * CHOSEN_FACES);
        let mut chosen = ChosenCells::new(*self);
        let mut scratch = SCRATCH.take();
        let kept = &mut scratch.kept;
        kept.clear();
        kept.resize(mesh.positions.len(), ProbeVertex::NONE);
        let (mut triangles, mut vertices, mut crowded) = (TiVec::new(), TiVec::new(), Vec::new());
        for face in mesh.face_ids() {
            let [a, b, c] = mesh.triangle(face);
            let is_near = chosen.are_near([a, b, c].map(|corner| origin + corner));
            if is_near && triangles.len() == triangles_max {
                chosen.each_near([a, b, c].map(|corner| origin + corner), |cell| crowded.push(cell));
            } else if is_near {
                triangles.push(mesh.vertices(face).map(|vertex| {
                    let kept = &mut kept[vertex];
                    if *kept == ProbeVertex::NONE {
                        *kept = vertices.push_and_get_key(origin + mesh.positions[vertex]);
                    }
                    *kept
                }));
            }
        }
        let left = self.target as f64 / self.faces.max(1) as f64;
        let area = scratch.weigh(mesh, left);
        let count = if area > 0.0 { (self.points as f64 * share).ceil() as usize } else { 0 };
        let mut hash = mixed(u64::from(cluster.number()));
        let (mut points, mut weights) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let ends = &scratch.ends;
        let all = ends.last().copied().unwrap_or(0.0);
        for part in 0..count {
            hash = mixed(hash);
            let place = (part as f64 + unit(hash)) / count as f64 * all;
            let face = ends.partition_point(|&end| end <= place).min(ends.len() - 1);
            let chance = ends[face] - if face > 0 { ends[face - 1] } else { 0.0 };
            let triangle = mesh.triangle(FaceId::from(face));
            points.push(point_on(triangle.map(|corner| origin + corner), &mut hash));
            weights.push(finite(area_of(triangle)) / chance.max(f64::MIN_POSITIVE) * all / count as f64);
        }
        SCRATCH.set(scratch);
        crowded.sort_unstable();
        crowded.dedup();
        Probes { probing: *self, points, weights, areas: vec![area], triangles, crowded, vertices }
    }
}

impl Recalled for Probes {
    type Context<'a> = ();

    fn is_sound(&self, (): &()) -> bool {
        self.fit(self.faces())
    }
}

impl ProbeBuffers {
    /// Fills `ends` with running sums of the sampling weights and returns the area. A share of the weight goes by area,
    /// a share by face, and the rest by expected error: area × bend × length². The last is capped at the value that a
    /// share `left` of the faces exceeds, since those faces stay.
    fn weigh(&mut self, mesh: &ClusterMesh, left: f64) -> f64 {
        self.normals.clear();
        self.normals.resize(mesh.positions.len(), [0.0; 4]);
        self.sizes.clear();
        let (mut area, mut with_area) = (0.0, 0u64);
        for face in mesh.face_ids() {
            let [a, b, c] = mesh.triangle(face);
            let (ab, ac) = (b - a, c - a);
            let normal = ab.cross(ac);
            let length = finite(normal.length());
            let longest_sq = ab.length_squared().max(ac.length_squared()).max(b.distance_squared(c));
            self.sizes.push((0.5 * length, longest_sq as f32));
            if length == 0.0 {
                continue;
            }
            area += 0.5 * length;
            with_area += 1;
            let sum = [normal.x, normal.y, normal.z, length].map(|x| x as f32);
            for vertex in mesh.vertices(face) {
                let of_vertex = &mut self.normals[vertex];
                (0..4).for_each(|k| of_vertex[k] += sum[k]);
            }
        }
        self.bends.clear();
        self.bends.extend(self.normals.iter().map(|&[x, y, z, length]| {
            let bend = 1.0 - (x * x + y * y + z * z).sqrt() / length;
            if bend > BEND_MIN { bend } else { 0.0 }
        }));
        self.stakes.clear();
        for (face, &(area, longest_sq)) in self.sizes.iter_enumerated() {
            let bends = mesh.vertices(face).map(|vertex| self.bends[vertex]);
            let bend = bends.into_iter().fold(0.0, f32::max);
            let stake = area as f32 * bend * longest_sq;
            self.stakes.push(if stake.is_finite() { stake } else { 0.0 });
        }
        self.sorted.clear();
        self.sorted.extend(self.stakes.iter().filter(|&&stake| stake > 0.0));
        let most = match self.sorted.len() {
            0 => 0.0,
            count => {
                let place = ((1.0 - left).max(0.0) * count as f64) as usize;
                *self.sorted.select_nth_unstable_by(place.min(count - 1), f32::total_cmp).1
            }
        };
        let stakes: f64 = self.stakes.iter().map(|stake| f64::from(stake.min(most))).sum();
        self.ends.clear();
        let mut end = 0.0;
        let (by_area, by_faces) = (BY_AREA / area, BY_FACES / with_area as f64);
        let by_stakes = if stakes > 0.0 { BY_STAKES / stakes } else { 0.0 };
        for (&(own, _), stake) in self.sizes.iter().zip(&self.stakes) {
            if own > 0.0 {
                end += by_area * own + by_faces + by_stakes * f64::from(stake.min(most));
            }
            self.ends.push(end);
        }
        area
    }
}

/// Returns the number, or 0 if it is not finite.
fn finite(number: f64) -> f64 {
    if number.is_finite() { number } else { 0.0 }
}

/// A position in units of a cell's side / `SIDE_PARTS`.
pub type GridPosition = [i64; 3];

/// Finds chosen cells; caches recent answers.
#[derive(Debug)]
pub struct ChosenCells {
    probing: Probing,
    parts: f64,
    /// Cached blocks, each in its slot, with their chosen cells.
    seen: Vec<Option<(GridPosition, Option<GridPosition>)>>,
    /// Cached cells, each in its slot, with the chosen cells around them.
    around: Vec<Option<(GridPosition, CellNeighbourhood)>>,
}

/// Chosen cells among a cell and its 26 neighbours, by their low corners.
#[derive(Debug, Clone, Copy, PartialEq)]
enum CellNeighbourhood {
    None,
    One(GridPosition),
    Many,
}

impl ChosenCells {
    /// The chosen cells for these parameters.
    pub fn new(probing: Probing) -> Self {
        Self { probing, parts: SIDE_PARTS as f64 / probing.side, seen: vec![None; SLOTS], around: vec![None; SLOTS] }
    }

    /// Low corner of the chosen cell that contains a position, or `None`.
    pub fn holding(&mut self, position: DVec3) -> Option<GridPosition> {
        let (place, mut holding) = (self.place(position), None);
        self.any_between(place, place, |cell| {
            holding = Some(cell);
            true
        });
        holding
    }

    /// Reports whether the bounding box of a triangle meets a chosen cell.
    pub fn are_met(&mut self, triangle: [DVec3; 3]) -> bool {
        self.are_within(triangle, 0)
    }

    /// Reports whether the bounding box of a triangle is within half a side of a chosen cell.
    fn are_near(&mut self, [a, b, c]: [DVec3; 3]) -> bool {
        let (low, high, side) = (a.min(b).min(c), a.max(b).max(c), self.probing.side);
        // Most triangles are smaller than half a side; all of their corners are then within one side of the cell.
        let is_small = (high - low).max_element() < SMALL * side;
        match if is_small { self.around(a) } else { CellNeighbourhood::Many } {
            CellNeighbourhood::None => false,
            CellNeighbourhood::One(cell) => {
                let cell = DVec3::from_array(cell.map(|place| place as f64 / self.parts));
                cell.cmple(high + 0.5 * side).all() && low.cmple(cell + 1.5 * side).all()
            }
            CellNeighbourhood::Many => self.are_within([a, b, c], SIDE_PARTS / 2),
        }
    }

    /// Visits the chosen cells near a triangle; visits none if its bounding box meets more than [`BLOCKS_MAX`] blocks.
    fn each_near(&mut self, triangle: [DVec3; 3], mut visit: impl FnMut(GridPosition)) {
        let [low, high] = self.places_around(triangle, SIDE_PARTS / 2);
        self.any_between(low, high, |cell| {
            visit(cell);
            false
        });
    }

    /// Chosen cells among the cell of a position and its neighbours.
    fn around(&mut self, position: DVec3) -> CellNeighbourhood {
        let cell = self.place(position).map(|place| place >> SIDE_PARTS.trailing_zeros());
        let slot = slot_of(cell);
        if let Some((last, around)) = self.around[slot]
            && last == cell
        {
            return around;
        }
        let low = cell.map(|place| (place - 1) * SIDE_PARTS);
        let mut around = CellNeighbourhood::None;
        self.any_between(low, low.map(|place| place + 3 * SIDE_PARTS - 1), |cell| {
            around =
                if around == CellNeighbourhood::None { CellNeighbourhood::One(cell) } else { CellNeighbourhood::Many };
            false
        });
        self.around[slot] = Some((cell, around));
        around
    }

    /// Reports whether a chosen cell meets the bounding box of a triangle, grown by `margin` units.
    fn are_within(&mut self, triangle: [DVec3; 3], margin: i64) -> bool {
        let [low, high] = self.places_around(triangle, margin);
        self.any_between(low, high, |_| true)
    }

    /// Low and high corner of the bounding box of a triangle, grown by `margin` units.
    fn places_around(&self, [a, b, c]: [DVec3; 3], margin: i64) -> [GridPosition; 2] {
        let (low, high) = (self.place(a.min(b).min(c)), self.place(a.max(b).max(c)));
        [low.map(|p| p.saturating_sub(margin)), high.map(|p| p.saturating_add(margin))]
    }

    /// Reports whether `accept` returns true for a chosen cell that meets a box. Also true, without a call, if the box
    /// meets more than [`BLOCKS_MAX`] blocks.
    fn any_between(
        &mut self,
        low: GridPosition,
        high: GridPosition,
        mut accept: impl FnMut(GridPosition) -> bool,
    ) -> bool {
        let shift = self.probing.block_bits + SIDE_PARTS.trailing_zeros();
        let [from, to] = [low, high].map(|place| place.map(|p| p >> shift));
        let mut accept_in = |block: GridPosition| {
            let meets = |cell: &GridPosition| {
                (0..3).all(|axis| cell[axis] <= high[axis] && low[axis] < cell[axis] + SIDE_PARTS)
            };
            self.cell(block).filter(meets).is_some_and(&mut accept)
        };
        if from == to {
            return accept_in(from);
        }
        let counts = [0, 1, 2].map(|axis| i128::from(to[axis]) - i128::from(from[axis]) + 1);
        if counts.iter().product::<i128>() > BLOCKS_MAX {
            return true;
        }
        (from[0]..=to[0]).any(|x| (from[1]..=to[1]).any(|y| (from[2]..=to[2]).any(|z| accept_in([x, y, z]))))
    }

    fn place(&self, position: DVec3) -> GridPosition {
        (position * self.parts).to_array().map(|c| {
            let whole = c as i64;
            whole.saturating_sub(i64::from(whole as f64 > c)).clamp(-PLACE_MAX, PLACE_MAX)
        })
    }

    /// Low corner of the chosen cell of a block, or `None`.
    fn cell(&mut self, block: GridPosition) -> Option<GridPosition> {
        let seen = &mut self.seen[slot_of(block)];
        if let Some((last, cell)) = *seen
            && last == block
        {
            return cell;
        }
        let mut hash = block.iter().fold(0, |hash, &b| mixed(hash ^ b as u64));
        let cell = (unit(hash) < self.probing.odds).then(|| {
            let bits = self.probing.block_bits;
            block.map(|b| {
                hash = mixed(hash);
                ((b << bits) + (hash & ((1 << bits) - 1)) as i64) * SIDE_PARTS
            })
        });
        *seen = Some((block, cell));
        cell
    }
}

/// Cache slot of a block or a cell.
fn slot_of(place: GridPosition) -> usize {
    let hash = place.iter().fold(0, |hash, &p| (hash ^ p as u64).wrapping_mul(INCREMENT));
    (hash >> 32) as usize % SLOTS
}

impl Probes {
    /// Adds the probes of other clusters.
    pub(super) fn add(&mut self, other: Self) {
        if other.areas.is_empty() {
            return;
        }
        self.probing = other.probing;
        self.points.extend(other.points);
        self.weights.extend(other.weights);
        self.areas.extend(other.areas);
        let first = self.vertices.next_key();
        let moved = |vertices: [ProbeVertex; 3]| vertices.map(|vertex| first.plus(vertex.number()));
        self.triangles.extend(other.triangles.into_iter().map(moved));
        self.vertices.extend(other.vertices);
        self.crowded.extend(other.crowded);
        self.crowded.sort_unstable();
        self.crowded.dedup();
    }

    /// Reports whether all triangles near a chosen cell were kept.
    pub fn has_all_near(&self, cell: GridPosition) -> bool {
        self.crowded.binary_search(&cell).is_err()
    }

    /// Returns unused capacity.
    pub(super) fn shrink(&mut self) {
        self.points.shrink_to_fit();
        self.weights.shrink_to_fit();
        self.triangles.shrink_to_fit();
        self.vertices.shrink_to_fit();
    }

    /// Reports whether no cluster was probed.
    pub fn is_empty(&self) -> bool {
        self.areas.is_empty()
    }

    /// Number of triangles in and around the chosen cells.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len()
    }

    /// A triangle in or around a chosen cell.
    pub fn triangle(&self, triangle: ProbeTriangle) -> [DVec3; 3] {
        self.triangles[triangle].map(|vertex| self.vertices[vertex])
    }

    /// Faces of the input.
    pub fn faces(&self) -> u64 {
        self.probing.faces
    }

    /// Area of the input.
    pub fn area(&self) -> f64 {
        self.areas.iter().sum()
    }

    /// Reports whether recalled probes fit a mesh of `faces` faces.
    pub(super) fn fit(&self, faces: u64) -> bool {
        self.probing.is_sound(faces)
            && self.areas.iter().chain(&self.weights).all(|&area| area.is_finite() && area >= 0.0)
            && self.weights.len() == self.points.len()
            && self.points.iter().all(|point| point.is_finite())
            && self.vertices.iter().all(|vertex| vertex.is_finite())
            && self.crowded.is_sorted()
            && self.triangles.iter().flatten().all(|&vertex| vertex < self.vertices.next_key())
    }
}

fn triangles(mesh: &ClusterMesh, origin: DVec3) -> impl Iterator<Item = [DVec3; 3]> {
    mesh.living_faces().map(move |face| mesh.triangle(face).map(|p| origin + p))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::mesh::cluster::samples;

    fn corner() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-40.0f64..40.0).prop_map(DVec3::from_array)
    }

    proptest! {
        #[test]
        fn triangles_near_a_point_in_a_chosen_cell_are_kept(
            point in corner(),
            ends in prop::array::uniform3(corner()),
            faces in 1u64..10_000_000,
        ) {
            let probing = Probing::new(faces, faces / 10, 1.0);
            let mut chosen = ChosenCells::new(probing);
            let steps = (0..4_000_000).map(|step| point + DVec3::new(0.31, 0.17, 0.05) * probing.side * f64::from(step));
            let point = steps.into_iter().find(|point| chosen.holding(*point).is_some()).unwrap();
            // A triangle with a corner less than half a side away.
            let near = point + ends[0].normalize_or_zero() * 0.49 * probing.side;
            prop_assert!(chosen.are_near([near, ends[1], ends[2]]));
            let small = ends.map(|end| near + (end - ends[0]).normalize_or_zero() * 0.3 * probing.side);
            prop_assert!(chosen.are_near(small));
        }
    }

    #[test]
    fn a_cell_that_lacks_triangles_near_it_is_crowded() {
        // A cluster with a thousandth of all faces, more of which are near chosen cells than it may keep.
        let probing = Probing::new(20_000_000, 2_000_000, 1.0);
        let mut chosen = ChosenCells::new(probing);
        let steps = (0..9_000_000).map(|step| DVec3::new(0.31, 0.17, 0.05) * probing.side * f64::from(step));
        let inside: Vec<DVec3> = steps.filter(|point| chosen.holding(*point).is_some()).collect();
        let (few, many) = (inside[0], *inside.last().unwrap());
        assert!(few.distance(many) > 9.0 * probing.side);
        let mut mesh = ClusterMesh::default();
        let mut hash = 3;
        for face in 0..20_000u32 {
            let mut coordinate = |size: f64| {
                hash = mixed(hash);
                (unit(hash) - 0.5) * size * probing.side
            };
            let middle = if face < 100 { few } else { many };
            let middle = middle + DVec3::new(coordinate(6.0), coordinate(6.0), coordinate(6.0));
            for _ in 0..3 {
                let corner = middle + DVec3::new(coordinate(0.6), coordinate(0.6), coordinate(0.6));
                let vertex = mesh.push_vertex(corner, 0);
                mesh.push_wedge(vertex, glam::DVec2::NAN);
            }
            samples::add_faces(&mut mesh, &[[3 * face, 3 * face + 1, 3 * face + 2]]);
        }
        let probes = probing.take(&mesh, DVec3::ZERO, ClusterId::new(0));
        let (mut whole, mut kept) = (0, 0);
        for face in mesh.face_ids() {
            let triangle = mesh.triangle(face);
            if !chosen.are_near(triangle) {
                continue;
            }
            let is_kept = probes.triangles.iter().any(|&[a, _, _]| probes.vertices[a] == triangle[0]);
            kept += usize::from(is_kept);
            chosen.each_near(triangle, |cell| {
                assert!(is_kept || !probes.has_all_near(cell));
                whole += usize::from(probes.has_all_near(cell));
            });
        }
        assert!(kept == probes.triangle_count() && !probes.crowded.is_empty() && whole > 0, "{whole}");
    }

    #[test]
    fn probes_of_no_mesh_are_not_sound() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::ONE].map(|corner| (corner, glam::DVec2::NAN));
        let mesh = samples::mesh_of(corners, &[[0, 1, 2], [2, 1, 3]]);
        let whole = Probing::new(2, 1, 1.0).take(&mesh, DVec3::ZERO, ClusterId::new(0));
        assert!(whole.fit(2) && whole.triangle_count() == 2 && !whole.points.is_empty());
        let changes: [fn(&mut Probes); 15] = [
            |probes| probes.probing = Probing::new(1 << 40, 1, 1.0),
            |probes| probes.probing.side = 0.0,
            |probes| probes.probing.side = -1.0,
            |probes| probes.probing.side = f64::NAN,
            |probes| probes.probing.points += 1,
            |probes| probes.areas[0] = f64::INFINITY,
            |probes| probes.areas[0] = -1.0,
            |probes| probes.areas[0] = f64::NAN,
            |probes| probes.weights[0] = f64::INFINITY,
            |probes| probes.weights.push(1.0),
            |probes| probes.points[0].y = f64::NAN,
            |probes| probes.points.truncate(1),
            |probes| probes.vertices.raw[1].z = f64::INFINITY,
            |probes| probes.triangles.raw[1][2] = probes.vertices.next_key(),
            |probes| probes.crowded = vec![[1; 3], [0; 3]],
        ];
        for (i, change) in changes.into_iter().enumerate() {
            let mut changed = whole.clone();
            change(&mut changed);
            assert!(!changed.fit(2), "change {i}");
        }
        // A surface of zero area is valid.
        let mut flat = whole;
        flat.areas[0] = 0.0;
        assert!(flat.fit(2));
    }

    #[test]
    fn the_chosen_cells_take_their_share_of_space() {
        for faces in [1_000, 100_000, 3_000_000] {
            let probing = Probing::new(faces, faces / 10, 1.0);
            let mut chosen = ChosenCells::new(probing);
            let mut hash = 1;
            let mut coordinate = || {
                hash = mixed(hash);
                (unit(hash) - 0.5) * 2000.0
            };
            let count = 400_000;
            let held = (0..count)
                .filter(|_| chosen.holding(DVec3::new(coordinate(), coordinate(), coordinate())).is_some())
                .count();
            let quotient = held as f64 / f64::from(count) / probing.share();
            assert!((0.8..1.2).contains(&quotient), "{faces} faces: {quotient}");
        }
    }
}

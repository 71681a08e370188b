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
//! 32 bytes for each of up to 4 × 32,768 points, about 24 for each of some 37,000 triangles; 25 bytes per vertex and 32
//! per face of the cluster that is probed.

use std::cell::Cell;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::chosen_cells::{CHOSEN_FACES, CellGrid, ChosenCells, GridPosition};
use super::face_weights::{FaceWeights, finite};
use super::random_points::point_on;
use crate::base::chance::{mixed, unit};
use crate::base::id::{TiVec, ids};
use crate::geometry::triangle::area;
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
/// Faces of the input in a flat cell, for targets of a tenth of the faces or more.
const CELL_FACES: f64 = 32.0;
/// Largest factor on the faces per cell for smaller targets, where distances are larger.
const CELL_GROWTH_MAX: f64 = 8.0;
/// Area of an equilateral triangle divided by the square of its side.
const SHAPE: f64 = 0.433;
/// Expected number of triangles kept per face in a chosen cell.
const TRIANGLES_PER_FACE: f64 = 12.0;
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
    /// Each vertex of the mesh among the kept ones, or none.
    kept: TiVec<LocalVertex, ProbeVertex>,
    /// Whether no chosen cell is near a small triangle with this vertex.
    is_far: TiVec<LocalVertex, bool>,
    weights: FaceWeights,
}

/// Parameters of probing; the same for all clusters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Probing {
    /// Approximate number of points on the input.
    pub points: u64,
    /// Where triangles are kept.
    pub grid: CellGrid,
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
        let growth = (0.1 * faces as f64 / target.max(1) as f64).sqrt().clamp(1.0, CELL_GROWTH_MAX);
        let side = (CELL_FACES * growth * SHAPE * side_sq).sqrt();
        Self {
            points: (faces / FACES_PER_POINT).clamp(POINTS_MIN, POINTS_MAX),
            grid: CellGrid::new(side, faces),
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
        let grid = CellGrid::new(self.grid.side, faces);
        self.grid.side > 0.0 && *self == Self { grid, ..Self::new(faces, self.target, 1.0) }
    }

    /// Approximate number of points in the chosen cells, on each of the two surfaces.
    pub fn cell_points(&self) -> u64 {
        self.points.min(CELL_POINTS_MAX)
    }

    /// Probes a cluster of the input; its number seeds the points.
    pub fn take(&self, mesh: &ClusterMesh, origin: DVec3, cluster: ClusterId) -> Probes {
        let share = mesh.corners.len() as f64 / self.faces.max(1) as f64;
        let most = |expected: f64| (EXCESS as f64 * expected * share) as usize + EXCESS_MORE as usize;
        let triangles_max = most(TRIANGLES_PER_FACE * CHOSEN_FACES);
        let mut chosen = ChosenCells::new(self.grid);
        let mut scratch = SCRATCH.take();
        let ProbeBuffers { kept, is_far, weights: face_weights } = &mut scratch;
        kept.clear();
        kept.resize(mesh.positions.len(), ProbeVertex::NONE);
        is_far.clear();
        is_far.extend(mesh.positions.iter().map(|&position| chosen.are_far_from(origin + position)));
        face_weights.begin(mesh.positions.len());
        let (mut triangles, mut vertices, mut crowded) = (TiVec::new(), TiVec::new(), Vec::new());
        for face in mesh.face_ids() {
            let (corners, triangle) = (mesh.vertices(face), mesh.triangle(face));
            let longest_sq = face_weights.measure(corners, triangle);
            if is_far[corners[0]] && longest_sq < chosen.small_sq() {
                continue;
            }
            let triangle = triangle.map(|corner| origin + corner);
            let is_near = chosen.are_near(triangle);
            if is_near && triangles.len() == triangles_max {
                chosen.each_near(triangle, |cell| crowded.push(cell));
            } else if is_near {
                triangles.push(corners.map(|vertex| {
                    let kept = &mut kept[vertex];
                    if *kept == ProbeVertex::NONE {
                        *kept = vertices.push_and_get_key(origin + mesh.positions[vertex]);
                    }
                    *kept
                }));
            }
        }
        let left = self.target as f64 / self.faces.max(1) as f64;
        let surface_area = face_weights.weigh(mesh, left);
        let count = if surface_area > 0.0 { (self.points as f64 * share).ceil() as usize } else { 0 };
        let mut hash = mixed(u64::from(cluster.number()));
        let (mut points, mut weights) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let ends = &face_weights.ends;
        let all = ends.last().copied().unwrap_or(0.0);
        for part in 0..count {
            hash = mixed(hash);
            let place = (part as f64 + unit(hash)) / count as f64 * all;
            let face = ends.partition_point(|&end| end <= place).min(ends.len() - 1);
            let chance = ends[face] - if face > 0 { ends[face - 1] } else { 0.0 };
            let triangle = mesh.triangle(FaceId::from(face));
            points.push(point_on(triangle.map(|corner| origin + corner), &mut hash));
            weights.push(finite(area(triangle)) / chance.max(f64::MIN_POSITIVE) * all / count as f64);
        }
        SCRATCH.set(scratch);
        crowded.sort_unstable();
        crowded.dedup();
        Probes { probing: *self, points, weights, areas: vec![surface_area], triangles, crowded, vertices }
    }
}

impl Recalled for Probes {
    type Context<'a> = ();

    fn is_sound(&self, (): &()) -> bool {
        self.fit(self.faces())
    }
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
        let [a, b, c] = self.triangles[triangle];
        [self.vertices[a], self.vertices[b], self.vertices[c]]
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
            let mut chosen = ChosenCells::new(probing.grid);
            let steps = (0..4_000_000).map(|step| point + DVec3::new(0.31, 0.17, 0.05) * probing.grid.side * f64::from(step));
            let point = steps.into_iter().find(|point| chosen.holding(*point).is_some()).unwrap();
            // A triangle with a corner less than half a side away.
            let near = point + ends[0].normalize_or_zero() * 0.49 * probing.grid.side;
            prop_assert!(chosen.are_near([near, ends[1], ends[2]]));
            let small = ends.map(|end| near + (end - ends[0]).normalize_or_zero() * 0.3 * probing.grid.side);
            prop_assert!(chosen.are_near(small));
        }
    }

    #[test]
    fn a_cell_that_lacks_triangles_near_it_is_crowded() {
        // A cluster with a thousandth of all faces, more of which are near chosen cells than it may keep.
        let probing = Probing::new(20_000_000, 2_000_000, 1.0);
        let mut chosen = ChosenCells::new(probing.grid);
        let steps = (0..9_000_000).map(|step| DVec3::new(0.31, 0.17, 0.05) * probing.grid.side * f64::from(step));
        let inside: Vec<DVec3> = steps.filter(|point| chosen.holding(*point).is_some()).collect();
        let (few, many) = (inside[0], *inside.last().unwrap());
        assert!(few.distance(many) > 9.0 * probing.grid.side);
        let mut mesh = ClusterMesh::default();
        let mut hash = 3;
        for face in 0..20_000u32 {
            let mut coordinate = |size: f64| {
                hash = mixed(hash);
                (unit(hash) - 0.5) * size * probing.grid.side
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
            |probes| probes.probing.grid.side = 0.0,
            |probes| probes.probing.grid.side = -1.0,
            |probes| probes.probing.grid.side = f64::NAN,
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
}

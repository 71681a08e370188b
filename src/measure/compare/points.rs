//! Points of a mesh: by area, at its vertices, and by length on its edges; a few thousand of a cell at a time.
//!
//! ```text
//!   |----|------|--|-----------|---|   faces one after the other, each as long as its area
//!   ^  ^   ^  ^   ^   ^  ^  ^   ^ ^    point k lies somewhere in the k-th of equal parts of the whole
//! ```
//! The points depend on the mesh, the seed and their number alone. If distances are taken at vertices, the vertices
//! replace the points by area, and there are no points on edges; a vertex of several cells counts once in each.
//!
//! # Source
//! Metro (Cignoni, Rocchini and Scopigno 1998), for the choice of points.

use std::ops::Range;

use glam::DVec3;

use super::options::Spread;
use crate::base::chance;
use crate::geometry::triangle::{area, perimeter};
use crate::surface::cell::CellView;
use crate::surface::cells::SurfaceCells;

/// Maximum number of points of a batch.
pub const BATCH_POINTS: u64 = 1 << 14;
/// Number of points on edges for each point by area.
const EDGE_SHARE: f64 = 0.25;

/// Kind of the points of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PointKind {
    /// Points by area.
    Area,
    /// All vertices of the cell's triangles.
    Vertices,
    /// Points by length on edges.
    Edges,
}

/// Points of one cell that are processed together.
#[derive(Debug, Clone)]
pub struct Batch {
    /// The cell.
    pub cell: usize,
    /// Kind of the points.
    pub kind: PointKind,
    /// Range of point numbers in the whole mesh, or of vertices in the cell. Points by area and by length that lie in
    /// another cell belong to that cell's batches.
    range: Range<u64>,
}

/// A point on a triangle.
#[derive(Debug, Clone, Copy)]
pub struct SamplePoint {
    /// Its position.
    pub position: DVec3,
    /// Triangle of the cell. For a vertex: the last triangle that has it if distances are taken at vertices, else
    /// meaningless.
    pub face: u32,
    /// Barycentric weights of the triangle's corners.
    pub weights: [f64; 3],
}

/// Sampling of a mesh.
#[derive(Debug)]
pub struct Sampling<'a> {
    mesh: &'a SurfaceCells,
    seed: u64,
    spread: Spread,
    areas: Steps,
    lengths: Steps,
}

/// The cells one after the other, divided into equal parts.
#[derive(Debug)]
struct Steps {
    /// Where each cell begins, and where the last one ends.
    starts: Vec<f64>,
    /// Length of a part; 0 if there is nothing to divide.
    step: f64,
    count: u64,
}

impl Steps {
    fn new(amounts: impl Iterator<Item = f64>, count: u64) -> Self {
        let mut starts = vec![0.0];
        let mut sum = 0.0;
        for amount in amounts {
            sum += amount;
            starts.push(sum);
        }
        let is_something = sum > 0.0 && sum.is_finite() && count > 0;
        let step = if is_something { sum / count as f64 } else { 0.0 };
        Self { starts, step, count: if is_something { count } else { 0 } }
    }

    /// Range of the parts that a cell overlaps.
    fn parts(&self, cell: usize) -> Range<u64> {
        if self.count == 0 || self.starts[cell] == self.starts[cell + 1] {
            return 0..0;
        }
        let [first, last] = [self.starts[cell], self.starts[cell + 1]].map(|start| (start / self.step) as u64);
        first.min(self.count)..last.saturating_add(1).min(self.count)
    }

    /// Position of a point in its cell; `None` if it lies in another cell. `at` is its position in its part.
    fn place(&self, cell: usize, part: u64, at: f64) -> Option<f64> {
        let place = (part as f64 + at) * self.step;
        let is_last = cell + 2 == self.starts.len();
        let is_inside = place >= self.starts[cell] && (place < self.starts[cell + 1] || is_last);
        is_inside.then(|| place - self.starts[cell])
    }
}

impl<'a> Sampling<'a> {
    /// Points by area, a quarter as many on edges, and all vertices; or the vertices alone, as `spread` says.
    pub fn new(mesh: &'a SurfaceCells, spread: Spread, seed: u64) -> Self {
        let samples = spread.by_area().unwrap_or(0);
        let edge_samples = (samples as f64 * EDGE_SHARE).ceil() as u64;
        Self {
            mesh,
            seed,
            spread,
            areas: Steps::new(mesh.cells.iter().map(|cell| cell.area), samples),
            lengths: Steps::new(mesh.cells.iter().map(|cell| cell.side_length), edge_samples),
        }
    }

    /// Kind of the points that means are taken over.
    pub fn measured(&self) -> PointKind {
        match self.spread {
            Spread::Area(_) => PointKind::Area,
            Spread::Vertices => PointKind::Vertices,
        }
    }

    /// All batches, those by area first.
    pub fn batches(&self) -> Vec<Batch> {
        let mut batches = Vec::new();
        for kind in [PointKind::Area, PointKind::Vertices, PointKind::Edges] {
            for cell in 0..self.mesh.cells.len() {
                let all = match kind {
                    PointKind::Area => self.areas.parts(cell),
                    PointKind::Vertices => 0..self.mesh.cells[cell].vertex_count(),
                    PointKind::Edges => self.lengths.parts(cell),
                };
                let starts = all.clone().step_by(BATCH_POINTS as usize);
                batches.extend(starts.map(|start| {
                    let range = start..(start + BATCH_POINTS).min(all.end);
                    Batch { cell, kind, range }
                }));
            }
        }
        batches
    }

    /// The points of a batch.
    pub fn points(&self, batch: &Batch, view: &CellView) -> Vec<SamplePoint> {
        match batch.kind {
            PointKind::Vertices => {
                let range = batch.range.start as usize..batch.range.end as usize;
                let point = |&at: &DVec3| SamplePoint { position: view.origin + at, face: 0, weights: [1.0, 0.0, 0.0] };
                let mut points: Vec<SamplePoint> = view.positions[range.clone()].iter().map(point).collect();
                if self.spread == Spread::Vertices {
                    put_on_faces(&mut points, view, range.start);
                }
                points
            }
            PointKind::Area => {
                let ends = running_sums(view, area);
                self.spread(&self.areas, batch, 0, |part, place| {
                    let face = face_at(&ends, place);
                    let [across, along] = [1, 2].map(|stream| chance::of_stream(self.seed, part, stream));
                    at(view, face, chance::place_on_triangle(across, along))
                })
            }
            PointKind::Edges => {
                let ends = running_sums(view, perimeter);
                self.spread(&self.lengths, batch, 3, |_, place| {
                    let face = face_at(&ends, place);
                    let before = if face == 0 { 0.0 } else { ends[face as usize - 1] };
                    at(view, face, on_sides(view.triangle(face), place - before))
                })
            }
        }
    }

    fn spread(
        &self,
        steps: &Steps,
        batch: &Batch,
        stream: u64,
        point: impl Fn(u64, f64) -> SamplePoint,
    ) -> Vec<SamplePoint> {
        let place =
            |part: u64| Some((part, steps.place(batch.cell, part, chance::of_stream(self.seed, part, stream))?));
        batch.range.clone().filter_map(place).map(|(part, place)| point(part, place)).collect()
    }
}

/// Sets the face and the weights of vertices of a cell, from the vertex `first` on.
fn put_on_faces(vertices: &mut [SamplePoint], view: &CellView, first: usize) {
    for (number, face) in view.faces.iter().enumerate() {
        for (corner, &vertex) in face.vertices.iter().enumerate() {
            if let Some(point) = (vertex as usize).checked_sub(first).and_then(|at| vertices.get_mut(at)) {
                point.face = number as u32;
                point.weights = [0.0; 3];
                point.weights[corner] = 1.0;
            }
        }
    }
}

fn running_sums(view: &CellView, amount: impl Fn([DVec3; 3]) -> f64) -> Vec<f64> {
    let mut sum = 0.0;
    let faces = 0..view.faces.len() as u32;
    faces
        .map(|face| {
            sum += amount(view.triangle(face));
            sum
        })
        .collect()
}

/// The first face that ends beyond `place`.
fn face_at(ends: &[f64], place: f64) -> u32 {
    ends.partition_point(|&end| end <= place).min(ends.len() - 1) as u32
}

fn at(view: &CellView, face: u32, weights: [f64; 3]) -> SamplePoint {
    let [a, b, c] = view.triangle(face);
    let position = view.origin + a * weights[0] + b * weights[1] + c * weights[2];
    SamplePoint { position, face, weights }
}

/// Weights of the corners at a position along the three sides.
fn on_sides([a, b, c]: [DVec3; 3], mut place: f64) -> [f64; 3] {
    let lengths = [a.distance(b), b.distance(c), c.distance(a)];
    for (side, &length) in lengths.iter().enumerate() {
        if place <= length && length > 0.0 {
            let along = place / length;
            let mut weights = [0.0; 3];
            weights[side] = 1.0 - along;
            weights[(side + 1) % 3] = along;
            return weights;
        }
        place -= length;
    }
    [1.0, 0.0, 0.0]
}

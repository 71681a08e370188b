//! Cuts a patch into charts, by merging triangles.
//!
//! Each triangle begins as a chart of its own. Of two charts that share edges, those merge first that lose least: whose
//! triangles then deviate least from their common normal, with the shortest outline. A chart grows as long as all its
//! triangles face within [`FACING`] of its normal.
//!
//! ```text
//!  merge 7                  each merge is kept: a chart that overlaps itself when it is laid flat
//!   ├─ merge 5              falls apart into the two that it was made of, and so on; a triangle never does
//!   │   ├─ triangle 2
//!   │   └─ triangle 3
//!   └─ triangle 9
//! ```
//!
//! # Source
//! Garland, Willmott & Heckbert 2001, "Hierarchical face clustering on polygonal surfaces": merging in order of cost,
//! with a term for compact outlines (section 3.2). Cohen-Steiner, Alliez & Desbrun 2004, "Variational shape
//! approximation": the deviation of normals, Σ area |n − N|² (equation 2).

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::flat::{FlatChart, lay_flat};
use super::types::Triangles;
use crate::base::Result;
use crate::base::id::{TiSlice, TiVec};
use crate::base::pool::check_stopped;
use crate::geometry::boxtree::Bounds;
use crate::geometry::triangle::{area, unit_normal};
use crate::mesh::id::{FaceId, LocalVertex};

/// Smallest cosine between the normal of a chart and that of each of its triangles: 80 degrees.
const FACING: f64 = 0.17;
/// Deviation that every merge costs, so that the outline counts on flat ground, too.
const FLAT_COST: f64 = 0.02;
/// Square of the outline's length by that of a circle of the same area, above which charts do not merge.
const RAGGEDNESS_MAX: f64 = 30.0;

/// A chart while it grows.
struct Growing {
    /// Σ area · normal.
    normal_sum: DVec3,
    area: f64,
    /// Area in texels.
    texels: f64,
    /// Length of the outline.
    outline: f64,
    bounds: Bounds,
    faces: Vec<FaceId>,
    /// The charts that it shares edges with, ascending, and the length of these edges.
    beside: Vec<(u32, f64)>,
    /// The two charts that it was merged from.
    halves: Option<[u32; 2]>,
    is_merged: bool,
}

impl Growing {
    /// Where another chart is, or would be, among those beside it.
    fn find(&self, other: u32) -> std::result::Result<usize, usize> {
        self.beside.binary_search_by_key(&other, |&(other, _)| other)
    }

    /// Length of the edges that it shares with another chart.
    fn shared(&self, other: u32) -> f64 {
        self.find(other).map_or(0.0, |at| self.beside[at].1)
    }

    /// Adds to that length.
    fn share(&mut self, other: u32, length: f64) {
        match self.find(other) {
            Ok(at) => self.beside[at].1 += length,
            Err(at) => self.beside.insert(at, (other, length)),
        }
    }

    /// Takes another chart out.
    fn leave(&mut self, other: u32) {
        if let Ok(at) = self.find(other) {
            self.beside.remove(at);
        }
    }
}

/// Two charts that may merge.
#[derive(PartialEq)]
struct Merge {
    cost: f64,
    charts: [u32; 2],
}

impl Eq for Merge {}

impl Ord for Merge {
    /// The cheapest is the greatest; of equal ones, the first.
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.charts.cmp(&self.charts))
    }
}

impl PartialOrd for Merge {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Makes charts whose sides are at most `room` texels long, and lays them flat.
///
/// # Errors
/// [`Error::Stopped`](crate::base::Error::Stopped).
pub(super) fn charts(mesh: Triangles<'_>, texels: &TiSlice<FaceId, f64>, room: f64) -> Result<Vec<FlatChart>> {
    let mut merging = Merging::begin(mesh, texels, room);
    merging.run()?;
    merging.lay_flat()
}

struct Merging<'a> {
    mesh: Triangles<'a>,
    /// Longest side of a chart in texels.
    room: f64,
    normals: TiVec<FaceId, DVec3>,
    charts: Vec<Growing>,
    queue: BinaryHeap<Merge>,
}

impl<'a> Merging<'a> {
    fn begin(mesh: Triangles<'a>, texels: &TiSlice<FaceId, f64>, room: f64) -> Self {
        let faces = || mesh.vertices.keys();
        let normals: TiVec<FaceId, DVec3> = faces().map(|face| unit_normal(mesh.corners(face))).collect();
        let grown = |face: FaceId| {
            let corners = mesh.corners(face);
            Growing {
                normal_sum: normals[face] * area(corners),
                area: area(corners),
                texels: area(corners) / (texels[face] * texels[face]),
                outline: 0.0,
                bounds: Bounds::around(corners),
                faces: vec![face],
                beside: Vec::new(),
                halves: None,
                is_merged: false,
            }
        };
        let charts = faces().map(grown).collect();
        let mut merging = Self { mesh, room, normals, charts, queue: BinaryHeap::new() };
        merging.join_neighbours();
        merging
    }

    /// Notes which triangles share an edge, and queues their merges.
    fn join_neighbours(&mut self) {
        for [left, right, length_of] in shared_edges(self.mesh) {
            let [from, to] = [LocalVertex::new(length_of), self.next_of(left, length_of)];
            let length = self.mesh.positions[from].distance(self.mesh.positions[to]);
            self.charts[left as usize].share(right, length);
            self.charts[right as usize].share(left, length);
        }
        for chart in 0..self.charts.len() as u32 {
            let corners = self.mesh.corners(FaceId::new(chart));
            self.charts[chart as usize].outline =
                (0..3).map(|k| corners[k].distance(corners[(k + 1) % 3])).sum::<f64>();
            let first = self.charts[chart as usize].beside.partition_point(|&(other, _)| other < chart);
            for at in first..self.charts[chart as usize].beside.len() {
                self.queue_merge([chart, self.charts[chart as usize].beside[at].0]);
            }
        }
    }

    /// The vertex after `vertex` in a triangle.
    fn next_of(&self, face: u32, vertex: u32) -> LocalVertex {
        let vertices = self.mesh.vertices[FaceId::new(face)];
        let at = vertices.iter().position(|&other| other.number() == vertex).unwrap_or(0);
        vertices[(at + 1) % 3]
    }

    /// Queues a merge, if the merged chart would be compact enough.
    fn queue_merge(&mut self, charts: [u32; 2]) {
        let [a, b] = charts.map(|chart| &self.charts[chart as usize]);
        let shared = a.shared(charts[1]);
        let (sum, area) = (a.normal_sum + b.normal_sum, a.area + b.area);
        let outline = (a.outline + b.outline - 2.0 * shared).max(0.0);
        let circle = 4.0 * std::f64::consts::PI * area;
        // Triangles without area join whatever is beside them.
        let raggedness = if a.area.min(b.area) > 0.0 { outline * outline / circle } else { 0.0 };
        let extent = a.bounds.with(b.bounds);
        let texel = (area / (a.texels + b.texels)).sqrt();
        // Of charts without area, the size does not matter.
        let is_small = extent.diagonal() <= self.room * texel || area == 0.0;
        if raggedness <= RAGGEDNESS_MAX && is_small {
            let deviation = if area > 0.0 { 1.0 - sum.length() / area } else { 0.0 };
            self.queue.push(Merge { cost: (deviation + FLAT_COST) * raggedness, charts });
        }
    }

    fn run(&mut self) -> Result<()> {
        while let Some(Merge { charts, .. }) = self.queue.pop() {
            check_stopped()?;
            let are_there = charts.iter().all(|&chart| !self.charts[chart as usize].is_merged);
            if are_there && self.face_alike(charts) {
                self.merge(charts);
            }
        }
        Ok(())
    }

    /// Whether all triangles of two charts face along their common normal.
    fn face_alike(&self, charts: [u32; 2]) -> bool {
        let [a, b] = charts.map(|chart| &self.charts[chart as usize]);
        let normal = (a.normal_sum + b.normal_sum).normalize_or_zero();
        let faces_along = |&face: &FaceId| {
            let own = self.normals[face];
            own == DVec3::ZERO || own.dot(normal) >= FACING
        };
        // The smaller one has the larger deviation.
        let (few, many) = if a.faces.len() < b.faces.len() { (a, b) } else { (b, a) };
        few.faces.iter().all(faces_along) && many.faces.iter().all(faces_along)
    }

    fn merge(&mut self, charts: [u32; 2]) {
        let new = self.charts.len() as u32;
        let shared = self.charts[charts[0] as usize].shared(charts[1]);
        let [of_a, of_b] = charts.map(|chart| {
            let chart = &mut self.charts[chart as usize];
            chart.is_merged = true;
            std::mem::take(&mut chart.beside)
        });
        let beside = joined(&of_a, &of_b, charts);
        for &(other, length) in &beside {
            let theirs = &mut self.charts[other as usize];
            charts.iter().for_each(|&chart| theirs.leave(chart));
            // It has the greatest number of all.
            theirs.beside.push((new, length));
        }
        let [a, b] = charts.map(|chart| &self.charts[chart as usize]);
        let merged = Growing {
            normal_sum: a.normal_sum + b.normal_sum,
            area: a.area + b.area,
            texels: a.texels + b.texels,
            outline: (a.outline + b.outline - 2.0 * shared).max(0.0),
            bounds: a.bounds.with(b.bounds),
            faces: a.faces.iter().chain(&b.faces).copied().collect(),
            beside,
            halves: Some(charts),
            is_merged: false,
        };
        self.charts.push(merged);
        for at in 0..self.charts[new as usize].beside.len() {
            self.queue_merge([self.charts[new as usize].beside[at].0, new]);
        }
    }

    /// Lays the charts flat; one that overlaps itself falls apart.
    fn lay_flat(self) -> Result<Vec<FlatChart>> {
        let mut flat = Vec::new();
        let mut waiting: Vec<u32> =
            (0..self.charts.len() as u32).rev().filter(|&chart| !self.charts[chart as usize].is_merged).collect();
        while let Some(number) = waiting.pop() {
            let chart = &self.charts[number as usize];
            let texel = (chart.area / chart.texels).sqrt();
            match (lay_flat(self.mesh, &chart.faces, chart.normal_sum, texel)?, chart.halves) {
                (Some(laid), _) => flat.push(laid),
                (None, Some(halves)) => waiting.extend(halves),
                // A triangle of any shape can be laid flat.
                (None, None) => {}
            }
        }
        Ok(flat)
    }
}

/// What lies beside either of two charts, with the lengths of both, ascending; without the two.
fn joined(a: &[(u32, f64)], b: &[(u32, f64)], charts: [u32; 2]) -> Vec<(u32, f64)> {
    let others = a.iter().chain(b).copied().filter(|(other, _)| !charts.contains(other));
    let mut joined: Vec<(u32, f64)> = others.collect();
    joined.sort_by_key(|&(other, _)| other);
    joined.dedup_by(|next, kept| {
        let is_same = next.0 == kept.0;
        if is_same {
            kept.1 += next.1;
        }
        is_same
    });
    joined
}

/// Edges that two triangles share in opposite directions and no other has: both triangles, and the vertex from which
/// the edge leads in the first of them.
fn shared_edges(mesh: Triangles<'_>) -> Vec<[u32; 3]> {
    let mut edges: Vec<([u32; 2], u32, u32)> = Vec::with_capacity(3 * mesh.vertices.len());
    for (face, vertices) in mesh.vertices.iter_enumerated() {
        for k in 0..3 {
            let [from, to] = [vertices[k].number(), vertices[(k + 1) % 3].number()];
            edges.push(([from.min(to), from.max(to)], face.number(), from));
        }
    }
    edges.sort_unstable();
    let same = edges.chunk_by(|a, b| a.0 == b.0);
    let pairs = same.filter(|same| same.len() == 2 && same[0].2 != same[1].2 && same[0].1 != same[1].1);
    pairs.map(|pair| [pair[0].1, pair[1].1, pair[0].2]).collect()
}

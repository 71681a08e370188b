//! One centre for each cell: the point on the edges inside it with the least quadric error.
//!
//! The error is the squared distance to the planes of the faces around the cell's vertices, weighted by area. On flat
//! ground all points have the same error; there a weak spring to the cell's centre of mass decides.

use glam::DVec3;

use super::cells::{VertexCells, VoronoiCell};
use super::queue::splittable;
use crate::base::id::{TiSlice, TiVec};
use crate::cost::Quadric;
use crate::cost::planes::plane_of;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::mesh::ring::Rings;
use crate::mesh::split::EdgePoint;

/// A point within this share of its edge from an end is moved to that end.
const SNAP_SHARE: f64 = 0.25;

/// The centre of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Centre {
    /// At one of its vertices.
    Vertex(LocalVertex),
    /// On one of its edges.
    Edge(EdgePoint),
}

/// The vertices of each cell, as compressed sparse rows.
#[derive(Debug)]
pub struct Members {
    starts: Vec<u32>,
    vertices: Vec<LocalVertex>,
}

impl Members {
    /// Collects the vertices of the cells below `count`, in order of their ids.
    pub fn new(cells: &VertexCells, count: usize) -> Self {
        let mut starts = vec![0u32; count + 1];
        for &cell in cells.iter().filter(|cell| cell.index() < count) {
            starts[cell.index() + 1] += 1;
        }
        for cell in 0..count {
            starts[cell + 1] += starts[cell];
        }
        let mut next = starts.clone();
        let mut vertices = vec![LocalVertex::NONE; starts[count] as usize];
        for (vertex, cell) in cells.iter_enumerated().filter(|(_, cell)| cell.index() < count) {
            let next = &mut next[cell.index()];
            vertices[*next as usize] = vertex;
            *next += 1;
        }
        Self { starts, vertices }
    }

    /// The cells.
    pub fn cells(&self) -> impl Iterator<Item = VoronoiCell> + use<> {
        VoronoiCell::first(self.starts.len() - 1)
    }

    /// Vertices of a cell.
    pub fn of(&self, cell: VoronoiCell) -> &[LocalVertex] {
        &self.vertices[self.starts[cell.index()] as usize..self.starts[cell.index() + 1] as usize]
    }
}

/// The centre of every cell. A held vertex is the centre of its own cell, and edges of unsound faces are not split.
pub fn centres(
    mesh: &ClusterMesh,
    rings: &Rings,
    members: &Members,
    cells: &VertexCells,
    (is_held, is_sound): (&TiSlice<LocalVertex, bool>, &TiSlice<FaceId, bool>),
    spring: f64,
) -> TiVec<VoronoiCell, Centre> {
    let mut ends = Vec::new();
    let of_cell = |cell| {
        let vertices = members.of(cell);
        match vertices.iter().find(|&&vertex| is_held[vertex]) {
            Some(&held) => Centre::Vertex(held),
            None => match vertices {
                &[only] => Centre::Vertex(only),
                _ => least_error(mesh, rings, is_sound, (vertices, cells), spring, &mut ends),
            },
        }
    };
    members.cells().map(of_cell).collect()
}

/// The point of least error on the vertices and edges of a cell.
fn least_error(
    mesh: &ClusterMesh,
    rings: &Rings,
    is_sound: &TiSlice<FaceId, bool>,
    (vertices, cells): (&[LocalVertex], &VertexCells),
    spring: f64,
    ends: &mut Vec<LocalVertex>,
) -> Centre {
    let origin = mesh.positions[vertices[0]];
    let (mut quadric, mut middle, mut area_sum) = (Quadric::default(), DVec3::ZERO, 0.0);
    for &vertex in vertices {
        let at = mesh.positions[vertex] - origin;
        for face in rings.faces(mesh, vertex) {
            let Some((normal, area)) = plane_of(mesh.triangle(face)) else { continue };
            quadric += Quadric::plane(normal, -normal.dot(at), area);
            middle += at * area;
            area_sum += area;
        }
    }
    middle /= f64::max(area_sum, f64::MIN_POSITIVE);
    let spring = spring * quadric.diagonal.element_sum();
    let held_back = Quadric {
        diagonal: quadric.diagonal + spring,
        linear: quadric.linear - middle * spring,
        constant: quadric.constant + spring * middle.length_squared(),
        ..quadric
    };
    let mut best = (f64::INFINITY, Centre::Vertex(vertices[0]));
    let mut offer = |error: f64, centre| {
        if error < best.0 {
            best = (error, centre);
        }
    };
    for &a in vertices {
        let from = mesh.positions[a] - origin;
        offer(held_back.at(from), Centre::Vertex(a));
        splittable(mesh, rings, is_sound, a, ends);
        for &b in ends.iter().filter(|&&b| cells[b] == cells[a]) {
            let along = mesh.positions[b] - origin - from;
            let share = -(held_back.apply(from) + held_back.linear).dot(along) / held_back.apply(along).dot(along);
            if share > SNAP_SHARE && share < 1.0 - SNAP_SHARE {
                offer(held_back.at(from + along * share), Centre::Edge(EdgePoint { ends: [a, b], share }));
            }
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::v;

    fn centre_of(mesh: &ClusterMesh, spring: f64, held: Option<LocalVertex>) -> Centre {
        let mut rings = Rings::default();
        rings.build(mesh);
        let only = VoronoiCell::new(0);
        let cells = mesh.per_vertex(only);
        let is_held: TiVec<LocalVertex, bool> = mesh.vertex_ids().map(|v| Some(v) == held).collect();
        let is_sound = mesh.per_face(true);
        centres(mesh, &rings, &Members::new(&cells, 1), &cells, (&is_held, &is_sound), spring)[only]
    }

    //  a ridge along x = 1, and slopes to both sides of it
    #[test]
    fn the_centre_of_a_roof_lies_on_its_ridge() {
        let mut mesh = samples::grid(2, 0.0);
        mesh.positions.iter_mut().for_each(|p| p.z = -(p.x - 1.0).abs() * 2.0);
        let x = match centre_of(&mesh, 1e-6, None) {
            Centre::Vertex(vertex) => mesh.positions[vertex].x,
            Centre::Edge(point) => point.position(&mesh).x,
        };
        assert_eq!(x, 1.0);
    }

    #[test]
    fn the_centre_on_flat_ground_is_the_middle_and_a_held_vertex_stays_one() {
        let mesh = samples::grid(2, 0.0);
        assert_eq!(centre_of(&mesh, 1e-3, None), Centre::Vertex(v(4)));
        assert_eq!(centre_of(&mesh, 1e-3, Some(v(7))), Centre::Vertex(v(7)));
    }

    #[test]
    fn an_edge_that_crosses_the_middle_carries_the_centre() {
        let mesh = samples::grid(1, 0.0);
        let Centre::Edge(point) = centre_of(&mesh, 1e-3, None) else { panic!("the diagonal crosses the middle") };
        assert_eq!(point.ends, [0, 3].map(v));
        assert!((point.share - 0.5).abs() < 1e-9);
    }
}

//! The dual triangulation: every cell shrinks to its centre.
//!
//! ```text
//!    a a|b b                 a-----b       a face with corners in three cells is left as a triangle of their
//!    a A|B b        ──▶      |\   /|       centres; one in two cells becomes an edge, one in a single cell a point
//!    a_a|b_b                 | \ / |
//!     c c C c                   c
//! ```
//! Cells shrink by collapses of edges inside them, each of which is legal by itself. The result is the dual wherever
//! that is a valid mesh. If a cell is no disc, or its triangles would fold in space or in texture space, some of its
//! vertices are left. Junctions, where three cells or more meet, also stay if they are farther from the planes around
//! them than the queue's threshold: they become vertices of the dual.

use glam::DVec2;

use super::cells::{VertexCells, VoronoiCell};
use super::queue::{quadric_error, weighted_normals};
use crate::base::id::{TiSlice, TiVec};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::LocalVertex;
use crate::mesh::ring::Rings;
use crate::simplify::edge_star::{EdgeStar, VanishingFan};

/// Fate of the vertices that are no centres.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Shrunk {
    /// Vertices that vanished.
    pub gone: u64,
    /// Junctions that became vertices of the dual.
    pub junctions: u64,
    /// Vertices that stayed, because no legal collapse takes them to their centre.
    pub kept: u64,
}

/// Gives junctions whose collapse has an error above `most` cells of their own; returns how many.
pub fn keep_junctions(
    mesh: &ClusterMesh,
    rings: &Rings,
    cells: &mut VertexCells,
    centres: &mut TiVec<VoronoiCell, LocalVertex>,
    most: f64,
    is_held: impl Fn(LocalVertex) -> bool,
) -> u64 {
    if most == f64::INFINITY {
        return 0;
    }
    let normals = weighted_normals(mesh);
    let mut junctions = Vec::new();
    for vertex in mesh.vertex_ids() {
        let own = cells[vertex];
        if rings.of(vertex).is_empty() || is_held(vertex) || centres[own] == vertex {
            continue;
        }
        let ring = || rings.of(vertex).iter().map(|&corner| mesh.vertex_of(corner.next()));
        let Some(second) = ring().map(|v| cells[v]).find(|&cell| cell != own) else { continue };
        if ring().all(|v| [own, second].contains(&cells[v])) {
            continue;
        }
        let to_centre = mesh.positions[centres[own]] - mesh.positions[vertex];
        if quadric_error(rings, &normals, vertex, to_centre) > most {
            junctions.push(vertex);
        }
    }
    for &vertex in &junctions {
        cells[vertex] = centres.push_and_get_key(vertex);
    }
    junctions.len() as u64
}

/// Shrinks every cell to its centre, as far as that is legal. Held vertices stay.
pub fn shrink(
    mesh: &mut ClusterMesh,
    cells: &VertexCells,
    centres: &TiSlice<VoronoiCell, LocalVertex>,
    is_held: impl Fn(LocalVertex) -> bool,
) -> Shrunk {
    let mut rings = Rings::default();
    rings.build(mesh);
    let mut waiting: Vec<LocalVertex> =
        cells.keys().filter(|&v| !rings.of(v).is_empty() && !is_held(v) && centres[cells[v]] != v).collect();
    let touched = mesh.per_vertex(0);
    let mut shrinker = Shrinker { star: EdgeStar::default(), uvs: Vec::new(), touched, round: 0 };
    shrinker.star.reset(mesh.positions.len());
    let wanted = waiting.len() as u64;
    // Collapse towards the centre first; when no vertex can, to any vertex of the cell.
    let mut anywhere = false;
    while !waiting.is_empty() {
        let before = waiting.len();
        shrinker.round += 1;
        waiting.retain(|&vertex| !shrinker.collapse(mesh, &rings, cells, centres, vertex, anywhere));
        if waiting.len() == before {
            if anywhere {
                break;
            }
            anywhere = true;
            continue;
        }
        anywhere = false;
        mesh.compact_faces();
        rings.build(mesh);
    }
    Shrunk { gone: wanted - waiting.len() as u64, junctions: 0, kept: waiting.len() as u64 }
}

struct Shrinker {
    star: EdgeStar,
    /// New texture coordinate of each wedge pair.
    uvs: Vec<DVec2>,
    /// Last round in which each vertex took part in a collapse: its row in the rings is outdated until the next.
    touched: TiVec<LocalVertex, u32>,
    round: u32,
}

impl Shrinker {
    /// Collapses a vertex onto the neighbour in its cell that is nearest to the centre, or, if that is illegal, onto
    /// the next nearest. Unless it may go `anywhere`, the neighbour must be nearer to the centre than the vertex.
    fn collapse(
        &mut self,
        mesh: &mut ClusterMesh,
        rings: &Rings,
        cells: &VertexCells,
        centres: &TiSlice<VoronoiCell, LocalVertex>,
        vertex: LocalVertex,
        anywhere: bool,
    ) -> bool {
        if self.touched[vertex] == self.round {
            return false;
        }
        let cell = cells[vertex];
        let centre = mesh.positions[centres[cell]];
        let reach = |v: LocalVertex| (mesh.positions[v].distance_squared(centre), v);
        let mut targets: Vec<(f64, LocalVertex)> = rings
            .of(vertex)
            .iter()
            .filter(|&&corner| mesh.living(corner).is_some())
            .map(|&corner| mesh.vertex_of(corner.next()))
            .filter(|&v| cells[v] == cell && self.touched[v] != self.round)
            .map(reach)
            .filter(|target| anywhere || *target < reach(vertex))
            .collect();
        targets.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        targets.into_iter().any(|(_, to)| self.try_collapse(mesh, rings, vertex, to))
    }

    fn try_collapse(&mut self, mesh: &mut ClusterMesh, rings: &Rings, from: LocalVertex, to: LocalVertex) -> bool {
        self.star.gather(mesh, rings, from, to);
        if self.star.check_topology(mesh, rings, from, to, VanishingFan::default()).is_err() {
            return false;
        }
        self.uvs.clear();
        self.uvs.extend(self.star.wedges.iter().map(|pair| mesh.wedge_uv[pair.to]));
        let position = mesh.positions[to];
        if self.star.check_faces(mesh, rings, &[from], position, &self.uvs, f64::INFINITY).is_err() {
            return false;
        }
        self.star.apply(mesh, rings, from, to);
        self.touched[from] = self.round;
        self.touched[to] = self.round;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::triangle::regularity;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::v;

    /// A grid of 9 × 9 squares with cells of 3 × 3 vertices inside; borders are held, and cells of their own.
    fn cells_of_nine() -> (ClusterMesh, TiVec<LocalVertex, VoronoiCell>, TiVec<VoronoiCell, LocalVertex>) {
        let mesh = samples::grid(10, 0.0);
        let (mut cells, mut centres) = (mesh.per_vertex(VoronoiCell::NONE), TiVec::new());
        for at in 0..121u32 {
            let (x, y) = (at % 11, at / 11);
            if is_border(v(at)) {
                cells[v(at)] = centres.push_and_get_key(v(at));
            } else if (x - 1) % 3 == 1 && (y - 1) % 3 == 1 {
                let cell = centres.push_and_get_key(v(at));
                for near in [at - 12, at - 11, at - 10, at - 1, at, at + 1, at + 10, at + 11, at + 12] {
                    cells[v(near)] = cell;
                }
            }
        }
        (mesh, cells, centres)
    }

    fn is_border(vertex: LocalVertex) -> bool {
        samples::is_on_rim(10, vertex)
    }

    #[test]
    fn nine_cells_become_nine_vertices() {
        let (mut mesh, cells, centres) = cells_of_nine();
        let shrunk = shrink(&mut mesh, &cells, &centres, is_border);
        assert_eq!(shrunk, Shrunk { gone: 72, junctions: 0, kept: 0 });
        // V - E + F = 1 with 40 border edges: F = 2 V - 2 - 40.
        assert_eq!(mesh.face_count, 2 * 49 - 42);
        let area: f64 = mesh
            .face_ids()
            .map(|face| {
                let [a, b, c] = mesh.triangle(face);
                0.5 * (b - a).cross(c - a).z
            })
            .sum();
        assert!((area - 100.0).abs() < 1e-9, "no face folds: {area}");
        assert!(mesh.face_ids().all(|face| regularity(mesh.triangle(face)) > 0.02));
    }

    #[test]
    fn a_cell_around_another_keeps_what_it_cannot_give_up() {
        let (mut mesh, mut cells, mut centres) = cells_of_nine();
        // The middle vertex is a cell inside the ring of the cell around it.
        let inner = v(60);
        centres[cells[inner]] = v(59);
        cells[inner] = centres.push_and_get_key(inner);
        let shrunk = shrink(&mut mesh, &cells, &centres, is_border);
        assert!(shrunk.kept >= 1, "{shrunk:?}");
        let mut rings = Rings::default();
        rings.build(&mesh);
        assert!(!rings.of(inner).is_empty());
    }

    #[test]
    fn junctions_off_the_planes_around_them_are_kept() {
        let (mut mesh, mut cells, mut centres) = cells_of_nine();
        // Vertex 36 is a corner of a cell, where four cells meet.
        mesh.positions[v(36)].z = 0.8;
        let mut rings = Rings::default();
        rings.build(&mesh);
        let count = centres.len();
        let kept = |most: f64, cells: &mut VertexCells, centres: &mut TiVec<VoronoiCell, LocalVertex>| {
            keep_junctions(&mesh, &rings, cells, centres, most, is_border)
        };
        assert_eq!(kept(f64::INFINITY, &mut cells.clone(), &mut centres.clone()), 0);
        assert!(kept(0.01, &mut cells, &mut centres) >= 1);
        assert_eq!(centres[cells[v(36)]], v(36));
        assert!(centres.len() > count);
    }
}

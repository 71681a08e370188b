//! Improves cells along the mesh: a vertex moves to a neighbouring cell if that lowers the energy.
//!
//! ```text
//!   [9-11]  F = Σi ( |zi|² Σj Mj  -  2 zi · Σj Mj γj )      zi: the centre, fixed; Mj, γj: mass, position of a vertex
//! ```
//! With fixed centres the masses cancel from a single vertex's choice: it moves to the nearer centre. With centroidal
//! centres (Valette & Chassery 2004) a cell's part is -|Σ Mγ|² / Σ M, and centres follow their vertices.
//!
//! A vertex leaves its cell only if the cell stays connected around it, and joins another only if it touches that along
//! one stretch of its ring. So cells stay connected, and no cell closes around another.

use glam::DVec3;

use super::cells::{VertexCells, VoronoiCell};
use crate::base::id::{TiSlice, TiVec};
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::LocalVertex;
use crate::mesh::ring::Rings;

/// The centres during the clustering.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pull {
    /// At their points.
    Fixed,
    /// At the centroids of their cells.
    Centroidal,
}

/// Mass, and mass × position, of a cell.
#[derive(Debug, Clone, Copy, Default)]
struct Weight {
    mass: f64,
    moment: DVec3,
}

impl Weight {
    /// -|Σ Mγ|² / Σ M.
    fn energy(&self) -> f64 {
        if self.mass > 0.0 { -self.moment.length_squared() / self.mass } else { 0.0 }
    }

    fn with(&self, mass: f64, position: DVec3) -> Self {
        Self { mass: self.mass + mass, moment: self.moment + position * mass }
    }
}

/// The clustering of vertices into cells.
pub struct Clustering<'a> {
    /// The mesh.
    pub mesh: &'a ClusterMesh,
    /// Its rings.
    pub rings: &'a Rings,
    /// Mass of each vertex.
    pub masses: &'a TiSlice<LocalVertex, f64>,
    /// Centre of each cell: a vertex.
    pub centres: &'a TiSlice<VoronoiCell, LocalVertex>,
    /// Where the centres are.
    pub pull: Pull,
}

impl Clustering<'_> {
    /// Moves vertices between cells in at most `sweeps` sweeps; returns the number of sweeps that changed a cell.
    /// Centres and held vertices stay.
    pub fn improve(&self, cells: &mut VertexCells, sweeps: u32, is_held: impl Fn(LocalVertex) -> bool) -> u32 {
        let mut weights = self.weights(cells);
        for sweep in 0..sweeps {
            let mut moved = false;
            for vertex in self.mesh.vertex_ids() {
                let own = cells[vertex];
                if self.rings.of(vertex).is_empty() || self.centres[own] == vertex || is_held(vertex) {
                    continue;
                }
                if let Some(better) = self.better_cell(vertex, cells, &weights) {
                    let (mass, position) = (self.masses[vertex], self.mesh.positions[vertex]);
                    weights[own] = weights[own].with(-mass, position);
                    weights[better] = weights[better].with(mass, position);
                    cells[vertex] = better;
                    moved = true;
                }
            }
            if !moved {
                return sweep;
            }
        }
        sweeps
    }

    /// F \[9-11\]; with centroidal centres the sum of the cells' parts.
    pub fn energy(&self, cells: &VertexCells) -> f64 {
        let weights = self.weights(cells);
        let of_cell = |(weight, &centre): (&Weight, &LocalVertex)| match self.pull {
            Pull::Fixed => {
                let z = self.mesh.positions[centre];
                z.length_squared() * weight.mass - 2.0 * z.dot(weight.moment)
            }
            Pull::Centroidal => weight.energy(),
        };
        weights.iter().zip(self.centres).map(of_cell).sum()
    }

    fn weights(&self, cells: &VertexCells) -> TiVec<VoronoiCell, Weight> {
        let mut weights: TiVec<_, _> = vec![Weight::default(); self.centres.len()].into();
        for (vertex, &cell) in cells.iter_enumerated() {
            if let Some(weight) = weights.get_mut(cell) {
                *weight = weight.with(self.masses[vertex], self.mesh.positions[vertex]);
            }
        }
        weights
    }

    /// The neighbouring cell of least energy for a vertex; `None` if that is its own, or if a cell would become
    /// disconnected.
    fn better_cell(
        &self,
        vertex: LocalVertex,
        cells: &VertexCells,
        weights: &TiSlice<VoronoiCell, Weight>,
    ) -> Option<VoronoiCell> {
        let own = cells[vertex];
        let links = || self.rings.of(vertex).iter().map(|&c| self.mesh.others_of(c));
        if links().all(|[a, _]| cells[a] == own) || stretches(links(), cells, own) != 1 {
            return None;
        }
        let (mass, position) = (self.masses[vertex], self.mesh.positions[vertex]);
        let cost = |cell: VoronoiCell| match self.pull {
            Pull::Fixed => self.mesh.positions[self.centres[cell]].distance_squared(position),
            // Increase of the cell's energy due to the vertex.
            Pull::Centroidal if cell == own => weights[cell].energy() - weights[cell].with(-mass, position).energy(),
            Pull::Centroidal => weights[cell].with(mass, position).energy() - weights[cell].energy(),
        };
        let mut best = (cost(own), own);
        for [a, _] in links() {
            let cell = cells[a];
            if cell != best.1 && cell != own {
                let found = cost(cell);
                if found < best.0 && stretches(links(), cells, cell) == 1 {
                    best = (found, cell);
                }
            }
        }
        (best.1 != own).then_some(best.1)
    }
}

/// Number of stretches that a cell has on a closed ring of links; the cell must have some vertices of the ring, but not
/// all.
fn stretches(links: impl Iterator<Item = [LocalVertex; 2]>, cells: &VertexCells, cell: VoronoiCell) -> usize {
    links.filter(|&[a, b]| (cells[a] == cell) && (cells[b] != cell)).count()
}

#[cfg(test)]
mod tests {
    use super::super::cells::short::cell;
    use super::*;
    use crate::mesh::cluster::samples::{self, is_on_rim};
    use crate::mesh::id::short::v;
    use proptest::prelude::*;

    /// The energy by its definition: masses times squared distances from the centres, summed over all vertices.
    fn plain_energy(clustering: &Clustering, cells: &VertexCells) -> f64 {
        let Clustering { mesh, masses, centres, .. } = clustering;
        let of = |cell: VoronoiCell| cells.keys().filter(move |&v| cells[v] == cell);
        let centre = |cell: VoronoiCell| match clustering.pull {
            Pull::Fixed => mesh.positions[centres[cell]],
            Pull::Centroidal => {
                let moment: DVec3 = of(cell).map(|v| mesh.positions[v] * masses[v]).sum();
                moment / of(cell).map(|v| masses[v]).sum::<f64>()
            }
        };
        let term = |cell, v: LocalVertex| masses[v] * mesh.positions[v].distance_squared(centre(cell));
        centres.keys().flat_map(|cell| of(cell).map(move |v| (cell, v))).map(|(cell, v)| term(cell, v)).sum()
    }

    /// Number of connected components of a cell among the vertices around one.
    fn plain_pieces(mesh: &ClusterMesh, vertex: LocalVertex, cells: &VertexCells, cell: VoronoiCell) -> usize {
        let faces = mesh.corner_vertices.iter().filter(|face| face.contains(&vertex));
        let sides: Vec<Vec<LocalVertex>> =
            faces.map(|face| face.iter().copied().filter(|&v| v != vertex && cells[v] == cell).collect()).collect();
        let mut pieces: Vec<Vec<LocalVertex>> = Vec::new();
        for side in sides.iter().filter(|side| !side.is_empty()) {
            let (touched, apart): (Vec<_>, Vec<_>) =
                pieces.into_iter().partition(|piece| piece.iter().any(|v| side.contains(v)));
            let joined = touched.into_iter().flatten().chain(side.iter().copied()).collect();
            pieces = apart;
            pieces.push(joined);
        }
        pieces.len()
    }

    /// One sweep that tries every cell around every vertex, and sums the whole energy each time.
    fn plain_sweep(clustering: &Clustering, cells: &mut VertexCells, is_held: impl Fn(LocalVertex) -> bool) {
        for vertex in cells.keys() {
            let own = cells[vertex];
            if is_held(vertex) || clustering.centres.contains(&vertex) {
                continue;
            }
            let ring =
                |v: LocalVertex| clustering.mesh.corner_vertices.iter().any(|f| f.contains(&v) && f.contains(&vertex));
            let around: Vec<LocalVertex> = cells.keys().filter(|&v| v != vertex && ring(v)).collect();
            if around.iter().all(|&v| cells[v] == own) || plain_pieces(clustering.mesh, vertex, cells, own) != 1 {
                continue;
            }
            let mut best = (plain_energy(clustering, cells), own);
            for cell in around.iter().map(|&v| cells[v]).filter(|&cell| cell != own).collect::<Vec<_>>() {
                if plain_pieces(clustering.mesh, vertex, cells, cell) == 1 {
                    cells[vertex] = cell;
                    let energy = plain_energy(clustering, cells);
                    if energy < best.0 {
                        best = (energy, cell);
                    }
                }
            }
            cells[vertex] = best.1;
        }
    }

    proptest! {
        #[test]
        fn a_sweep_does_what_a_plain_one_does(
            jitter in prop::collection::vec(prop::array::uniform3(-0.3f64..0.3), 49),
            masses in prop::collection::vec(0.1f64..5.0, 49),
            cuts in prop::array::uniform2(1u32..6),
            centroidal in any::<bool>(),
        ) {
            let mut mesh = samples::grid(6, 0.0);
            mesh.positions.iter_mut().zip(jitter).for_each(|(p, by)| *p += DVec3::from(by));
            let mut rings = Rings::default();
            rings.build(&mesh);
            // three cells, parted by a column above a row and by that row
            let cell_of = |at: u32| if at / 7 >= cuts[1] { 2 } else { u32::from(at % 7 >= cuts[0]) };
            let mut cells: TiVec<LocalVertex, VoronoiCell> = (0..49).map(|at| cell(cell_of(at))).collect();
            let centres: TiVec<VoronoiCell, LocalVertex> =
                VoronoiCell::first(3).map(|cell| cells.rposition(|&c| c == cell).unwrap()).collect();
            let masses: TiVec<LocalVertex, f64> = masses.into();
            let pull = if centroidal { Pull::Centroidal } else { Pull::Fixed };
            let clustering = Clustering { mesh: &mesh, rings: &rings, masses: &masses, centres: &centres, pull };
            let is_border = |vertex| is_on_rim(6, vertex);
            let mut expected = cells.clone();
            for _ in 0..3 {
                plain_sweep(&clustering, &mut expected, is_border);
            }
            clustering.improve(&mut cells, 3, is_border);
            prop_assert_eq!(cells, expected);
        }
    }

    /// Two cells of a grid of 6 × 6 with centres at its third points, wrongly divided; borders are held.
    fn divided(pull: Pull) -> (ClusterMesh, TiVec<VoronoiCell, LocalVertex>, TiVec<LocalVertex, VoronoiCell>) {
        let mesh = samples::grid(6, 0.0);
        let centres = vec![v(3 * 7 + 2), v(3 * 7 + 4)].into();
        let middle = if pull == Pull::Fixed { 3 } else { 4 };
        let cells = (0..49).map(|at| cell(u32::from(at % 7 >= middle))).collect();
        (mesh, centres, cells)
    }

    fn improve(pull: Pull, masses: &TiSlice<LocalVertex, f64>) -> (f64, f64, TiVec<LocalVertex, VoronoiCell>) {
        let (mesh, centres, mut cells) = divided(pull);
        (0..7).for_each(|row| cells[v(7 * row + 4)] = cell(u32::from(row == 3)));
        let mut rings = Rings::default();
        rings.build(&mesh);
        let clustering = Clustering { mesh: &mesh, rings: &rings, masses, centres: &centres, pull };
        let before = clustering.energy(&cells);
        clustering.improve(&mut cells, 50, |vertex| is_on_rim(6, vertex));
        (before, clustering.energy(&cells), cells)
    }

    #[test]
    fn vertices_go_to_the_nearer_centre_and_the_energy_falls() {
        let masses: TiVec<LocalVertex, f64> = (0..49).map(|at| f64::from(at % 5 + 1)).collect();
        let (before, after, cells) = improve(Pull::Fixed, &masses);
        assert!(after < before, "{before} {after}");
        for row in 1..6 {
            assert_eq!([1, 4].map(|column| cells[v(7 * row + column)]), [0, 1].map(cell), "row {row}");
        }
    }

    #[test]
    fn centroidal_cells_lower_their_energy_too() {
        let (before, after, _) = improve(Pull::Centroidal, TiSlice::from_ref(&[1.0; 49]));
        assert!(after < before, "{before} {after}");
    }

    #[test]
    fn the_energy_is_that_of_its_definition() {
        let (mesh, centres, cells) = divided(Pull::Fixed);
        let masses: TiVec<LocalVertex, f64> = (0..49).map(|at| f64::from(at % 3 + 1)).collect();
        let mut rings = Rings::default();
        rings.build(&mesh);
        let clustering =
            Clustering { mesh: &mesh, rings: &rings, masses: &masses, centres: &centres, pull: Pull::Fixed };
        // Σ M |γ - z|² = F + Σ M |γ|².
        let (mut spread, mut about_origin) = (0.0, 0.0);
        for (v, &p) in mesh.positions.iter_enumerated() {
            spread += masses[v] * p.distance_squared(mesh.positions[centres[cells[v]]]);
            about_origin += masses[v] * p.length_squared();
        }
        assert!((clustering.energy(&cells) + about_origin - spread).abs() < 1e-9);
    }

    //  . . . . .
    //  a a b a .      b is nearer to the other centre, above it, but may not leave: its cell would become disconnected
    //  . . . . .
    #[test]
    fn a_cell_stays_in_one_piece() {
        let mesh = samples::grid(4, 0.0);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let mut cells = mesh.per_vertex(cell(1));
        (10..14).for_each(|at| cells[v(at)] = cell(0));
        let (masses, centres) = (mesh.per_vertex(1.0), TiVec::from(vec![v(10), v(7)]));
        let clustering =
            Clustering { mesh: &mesh, rings: &rings, masses: &masses, centres: &centres, pull: Pull::Fixed };
        clustering.improve(&mut cells, 1, |vertex| is_on_rim(4, vertex) || vertex == v(13));
        assert_eq!(cells[v(12)], cell(0));
    }
}

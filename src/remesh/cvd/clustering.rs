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

use super::cells::{Cells, VoronoiCell};
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
    pub fn improve(&self, cells: &mut Cells, sweeps: u32, is_held: impl Fn(LocalVertex) -> bool) -> u32 {
        let mut weights = self.weights(cells);
        for sweep in 0..sweeps {
            let mut moved = false;
            for vertex in cells.keys() {
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
    pub fn energy(&self, cells: &Cells) -> f64 {
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

    fn weights(&self, cells: &Cells) -> TiVec<VoronoiCell, Weight> {
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
        cells: &Cells,
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
fn stretches(links: impl Iterator<Item = [LocalVertex; 2]>, cells: &Cells, cell: VoronoiCell) -> usize {
    links.filter(|&[a, b]| (cells[a] == cell) && (cells[b] != cell)).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;
    use proptest::prelude::*;

    /// The energy by its definition: masses times squared distances from the centres, summed over all vertices.
    fn plain_energy(clustering: &Clustering, cells: &[u32]) -> f64 {
        let of = |cell: u32| (0..cells.len()).filter(move |&v| cells[v] == cell);
        let centre = |cell: u32| match clustering.pull {
            Pull::Fixed => clustering.mesh.positions[clustering.centres[cell as usize] as usize],
            Pull::Centroidal => {
                let moment: DVec3 = of(cell).map(|v| clustering.mesh.positions[v] * clustering.masses[v]).sum();
                moment / of(cell).map(|v| clustering.masses[v]).sum::<f64>()
            }
        };
        let term =
            |cell: u32, v: usize| clustering.masses[v] * clustering.mesh.positions[v].distance_squared(centre(cell));
        (0..clustering.centres.len() as u32)
            .flat_map(|cell| of(cell).map(move |v| (cell, v)))
            .map(|(c, v)| term(c, v))
            .sum()
    }

    /// Number of connected components of a cell among the vertices around one.
    fn plain_pieces(mesh: &ClusterMesh, vertex: LocalVertex, cells: &[u32], cell: u32) -> usize {
        let faces = mesh.corner_vertices.iter().filter(|face| face.contains(&vertex));
        let sides: Vec<Vec<u32>> =
            faces.map(|face| face.iter().copied().filter(|&v| v != vertex && cells[v] == cell).collect()).collect();
        let mut pieces: Vec<Vec<u32>> = Vec::new();
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
    fn plain_sweep(clustering: &Clustering, cells: &mut [u32], is_held: impl Fn(u32) -> bool) {
        for vertex in 0..cells.len() as u32 {
            let own = cells[vertex];
            if is_held(vertex) || clustering.centres.contains(&vertex) {
                continue;
            }
            let ring =
                |v: LocalVertex| clustering.mesh.corner_vertices.iter().any(|f| f.contains(&v) && f.contains(&vertex));
            let around: Vec<u32> = (0..cells.len() as u32).filter(|&v| v != vertex && ring(v)).collect();
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
            let mut cells: Vec<u32> =
                (0..49).map(|v| if v / 7 >= cuts[1] { 2 } else { u32::from(v % 7 >= cuts[0]) }).collect();
            let centres: Vec<u32> = (0..3).map(|cell| cells.iter().rposition(|&c| c == cell).unwrap() as u32).collect();
            let pull = if centroidal { Pull::Centroidal } else { Pull::Fixed };
            let clustering = Clustering { mesh: &mesh, rings: &rings, masses: &masses, centres: &centres, pull };
            let is_border = |v: LocalVertex| [0, 6].contains(&(v % 7)) || [0, 6].contains(&(v / 7));
            let mut expected = cells.clone();
            for _ in 0..3 {
                plain_sweep(&clustering, &mut expected, is_border);
            }
            clustering.improve(&mut cells, 3, is_border);
            prop_assert_eq!(cells, expected);
        }
    }

    /// Two cells of a grid of 6 × 6 with centres at its third points, wrongly divided; borders are held.
    fn divided(pull: Pull) -> (ClusterMesh, Vec<u32>, Vec<u32>) {
        let mesh = samples::grid(6, 0.0);
        let centres = vec![3 * 7 + 2, 3 * 7 + 4];
        let cells = (0..49).map(|v| u32::from(v % 7 >= if pull == Pull::Fixed { 3 } else { 4 })).collect();
        (mesh, centres, cells)
    }

    fn improve(pull: Pull, masses: &[f64]) -> (f64, f64, Vec<u32>) {
        let (mesh, centres, mut cells) = divided(pull);
        (0..7).for_each(|row| cells[7 * row + 4] = u32::from(row == 3));
        let mut rings = Rings::default();
        rings.build(&mesh);
        let clustering = Clustering { mesh: &mesh, rings: &rings, masses, centres: &centres, pull };
        let before = clustering.energy(&cells);
        let is_border = |v: LocalVertex| [0, 6].contains(&(v % 7)) || [0, 6].contains(&(v / 7));
        clustering.improve(&mut cells, 50, is_border);
        (before, clustering.energy(&cells), cells)
    }

    #[test]
    fn vertices_go_to_the_nearer_centre_and_the_energy_falls() {
        let masses: Vec<f64> = (0..49).map(|v| f64::from(v % 5 + 1)).collect();
        let (before, after, cells) = improve(Pull::Fixed, &masses);
        assert!(after < before, "{before} {after}");
        for row in 1..6 {
            assert_eq!(cells[7 * row + 4], 1, "row {row}");
            assert_eq!(cells[7 * row + 1], 0, "row {row}");
        }
    }

    #[test]
    fn centroidal_cells_lower_their_energy_too() {
        let (before, after, _) = improve(Pull::Centroidal, &[1.0; 49]);
        assert!(after < before, "{before} {after}");
    }

    #[test]
    fn the_energy_is_that_of_its_definition() {
        let (mesh, centres, cells) = divided(Pull::Fixed);
        let masses: Vec<f64> = (0..49).map(|v| f64::from(v % 3 + 1)).collect();
        let mut rings = Rings::default();
        rings.build(&mesh);
        let clustering =
            Clustering { mesh: &mesh, rings: &rings, masses: &masses, centres: &centres, pull: Pull::Fixed };
        // Σ M |γ - z|² = F + Σ M |γ|².
        let (mut spread, mut about_origin) = (0.0, 0.0);
        for v in 0..49 {
            let (p, z) = (mesh.positions[v], mesh.positions[centres[cells[v] as usize] as usize]);
            spread += masses[v] * p.distance_squared(z);
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
        let mut cells = vec![1; 25];
        (10..14).for_each(|v| cells[v] = 0);
        let centres = vec![10, 7];
        let clustering =
            Clustering { mesh: &mesh, rings: &rings, masses: &[1.0; 25], centres: &centres, pull: Pull::Fixed };
        let is_border = |v: LocalVertex| [0, 4].contains(&(v % 5)) || [0, 4].contains(&(v / 5));
        let mut moved = cells.clone();
        clustering.improve(&mut moved, 1, |v| is_border(v) || v == 13);
        assert_eq!(moved[12], 0);
    }
}

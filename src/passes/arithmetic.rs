//! A checksum of what is made of a small mesh: processes whose processor or mathematics differ have another one, and would
//! write other bytes.

use glam::{DVec2, DVec3};
use xxhash_rust::xxh3::Xxh3;

use super::metric_engine::{EngineRules, Simplified};
use super::options::Cost;
use super::stop_rule::{ClusterStop, Wanted};
use crate::base::id::TiVec;
use crate::cost::Weights;
use crate::cost::mesh_stats::MeshStats;
use crate::mesh::ClusterMesh;
use crate::model::id::{PartId, Texcoord};
use crate::model::{Catalogue, Face};
use crate::partition::TextureScale;
use crate::partition::id::PartitionVertex;
use crate::partition::reading::ClusterFaces;
use crate::remesh::cvd::{self, CvdSettings, FrozenStatistics};
use crate::remesh::relax;

/// Vertices along a side of the mesh.
const SIDE: u32 = 24;
/// Faces that are left of it.
const LEFT: u64 = 300;
/// Vertices along a ring and across it.
const AROUND: u32 = 40;
const ACROSS: u32 = 6;
/// Faces that are left of it: so few that it is cut.
const LEFT_OF_RING: u64 = 12;

/// Simplifies a small textured hill and a small ring by this cost, and moves the vertices that are left; returns a
/// checksum of the results.
pub fn of_collapses(cost: Cost) -> u64 {
    let mut hash = Xxh3::new();
    let cutting = EngineRules { frees_topology: true, seeks_handles: true, ..EngineRules::default() };
    for (mesh, rules, left) in [(hill(), EngineRules::default(), LEFT), (ring(), cutting, LEFT_OF_RING)] {
        let mut left = simplified(mesh, cost, &rules, left).mesh.unwrap_or_default();
        put(&left, &mut hash);
        relax(&mut left);
        put(&left, &mut hash);
    }
    hash.digest()
}

fn simplified(mesh: ClusterMesh, cost: Cost, rules: &EngineRules, left: u64) -> Simplified {
    let mut engine = cost.engine();
    if engine.needs_statistics() {
        let mut stats = MeshStats::default();
        mesh.positions.iter().for_each(|&position| stats.enclose(position));
        engine.count(mesh.clone(), &mut stats);
        engine.normalise(&stats);
    }
    engine.simplify(mesh, rules, &ClusterStop::Faces(vec![0.5, 0.2, 0.1, 0.05], left), Wanted::Mesh)
}

/// Remeshes it by these settings; returns a checksum of the result.
pub fn of_remeshing(settings: &CvdSettings) -> u64 {
    let mut mesh = hill();
    let frame = FrozenStatistics::of_one(&mesh, settings);
    cvd::reconstruct(&mut mesh, settings, &frame);
    of_mesh(&mesh)
}

/// Checksum for tasks that only read.
pub fn of_any() -> u64 {
    of_collapses(Cost::Surface(Weights::default()))
}

fn of_mesh(mesh: &ClusterMesh) -> u64 {
    let mut hash = Xxh3::new();
    put(mesh, &mut hash);
    hash.digest()
}

fn put(mesh: &ClusterMesh, hash: &mut Xxh3) {
    for face in mesh.living_faces() {
        hash.update(bytemuck::cast_slice(&mesh.triangle(face).map(|p| p.to_array())));
        hash.update(bytemuck::cast_slice(&mesh.uv_triangle(face).map(|p| p.to_array())));
    }
}

/// A small textured hill.
pub fn hill() -> ClusterMesh {
    let vertex = |x: u32, y: u32| SIDE * y + x;
    let of_all = |make: &dyn Fn(f64, f64) -> DVec3| -> Vec<DVec3> {
        (0..SIDE * SIDE).map(|i| make(f64::from(i % SIDE), f64::from(i / SIDE))).collect()
    };
    let positions: TiVec<PartitionVertex, DVec3> =
        of_all(&|x, y| DVec3::new(x, y, libm::sin(0.9 * x) * libm::cos(0.7 * y) + libm::sqrt(x * y + 0.3))).into();
    let texcoords = of_all(&|x, y| DVec3::new(x, y, 0.0) / f64::from(SIDE)).iter().map(|p| p.truncate()).collect();
    let mut faces = Vec::new();
    for (x, y) in (0..SIDE - 1).flat_map(|y| (0..SIDE - 1).map(move |x| (x, y))) {
        let [a, b, c, d] = [vertex(x, y), vertex(x + 1, y), vertex(x + 1, y + 1), vertex(x, y + 1)];
        for corners in [[a, b, c], [a, c, d]] {
            let (vertices, texcoords) = (corners.map(PartitionVertex::new), corners.map(Texcoord::new));
            faces.push(Face { vertices, texcoords, part: PartId::new(0), ..Face::default() });
        }
    }
    whole(faces, &positions, texcoords)
}

/// A closed ring of wire without texture: a component with a handle.
fn ring() -> ClusterMesh {
    let vertex = |x: u32, y: u32| PartitionVertex::new(AROUND * (y % ACROSS) + x % AROUND);
    let [whole_turn, across] = [AROUND, ACROSS].map(|count| std::f64::consts::TAU / f64::from(count));
    let position = |number: u32| {
        let (s, t) = (f64::from(number % AROUND) * whole_turn, f64::from(number / AROUND) * across);
        let out = 30.0 + libm::cos(t);
        DVec3::new(out * libm::cos(s), out * libm::sin(s), libm::sin(t))
    };
    let positions: Vec<DVec3> = (0..AROUND * ACROSS).map(position).collect();
    let mut faces = Vec::new();
    for (x, y) in (0..ACROSS).flat_map(|y| (0..AROUND).map(move |x| (x, y))) {
        let [a, b, c, d] = [vertex(x, y), vertex(x + 1, y), vertex(x + 1, y + 1), vertex(x, y + 1)];
        let of = |vertices| Face { vertices, part: PartId::new(0), ..Face::default() };
        faces.extend([[a, b, c], [a, c, d]].map(of));
    }
    whole(faces, &positions.into(), Vec::new())
}

fn whole(
    faces: Vec<Face<PartitionVertex>>,
    positions: &TiVec<PartitionVertex, DVec3>,
    texcoords: Vec<DVec2>,
) -> ClusterMesh {
    let catalogue = Catalogue::default();
    let scale = TextureScale::none(&catalogue);
    ClusterFaces::whole(faces, positions, texcoords, false, false).into_whole(&catalogue, &scale).mesh
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cost::Weights;

    #[test]
    fn it_is_the_same_each_time_and_another_one_for_another_cost() {
        let cost = Cost::Surface(Weights::default());
        assert_eq!(of_collapses(cost), of_collapses(cost));
        assert_ne!(of_collapses(cost), of_collapses(Cost::Surface(Weights { uv: 0.0, ..Weights::default() })));
    }

    #[test]
    fn the_ring_is_cut_and_what_is_left_of_the_hill_moves() {
        let cost = Cost::Surface(Weights::default());
        let cutting = EngineRules { frees_topology: true, seeks_handles: true, ..EngineRules::default() };
        let cut = simplified(ring(), cost, &cutting, LEFT_OF_RING);
        assert!(cut.changes.handles_cut > 0 && cut.faces_out <= LEFT_OF_RING, "{:?}", cut.changes);
        let mut left = simplified(hill(), cost, &EngineRules::default(), LEFT).mesh.unwrap();
        let before = of_mesh(&left);
        assert!(relax(&mut left) > 10);
        assert_ne!(before, of_mesh(&left));
    }

    #[test]
    fn remeshing_has_one_for_each_settings() {
        let settings = CvdSettings::default();
        let other = CvdSettings { cells: Some(60), ..settings };
        assert_eq!(of_remeshing(&settings), of_remeshing(&settings));
        assert_ne!(of_remeshing(&settings), of_remeshing(&other));
        assert_ne!(of_remeshing(&settings), of_mesh(&hill()));
    }
}

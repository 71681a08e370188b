//! Measures on a sample which cost threshold leaves which share of the faces.
//!
//! The sample is a compact patch from each of up to sixteen evenly spread clusters. All patches are simplified as one
//! mesh with one queue; the cost reached at each stage becomes the threshold of all clusters. The rim of a patch is
//! locked, like that of a cluster; only faces that are free to go count toward the share. The patches for a pass are
//! cut during the previous pass, while its clusters are in memory.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::base::id::{TiSlice, TiVec};
use crate::cost::Metric;
use crate::mesh::cluster::{ClusterMesh, flag};
use crate::mesh::id::{FaceId, LocalVertex, Wedge};
use crate::model::id::PartId;
use crate::partition::ClusterId;
use crate::partition::numbering::{RANK_BYTES, window_bytes};
use crate::partition::reading::ClusterFaces;
use crate::partition::weight::ORDINARY_BYTES;
use crate::simplify::{Engine, LoggedCollapse, Stop};

/// Smallest and largest number of faces in the sample; all faces if the mesh has fewer.
const SAMPLE_FACES: [u64; 2] = [10_000, 60_000];
/// Smallest sample for the pass that must end just above the target: if it ends below, it has to run again.
const LAST_SAMPLE_FACES: u64 = 20_000;
/// Faces of the mesh for each face of the sample, between these limits.
const FACES_PER_SAMPLE_FACE: u64 = 40;
/// The sample is large enough that the remaining passes would leave this many of its faces; fewer say too little about
/// the last costs.
const LEFT_FACES: f64 = 2_800.0;
/// Largest number of patches in the sample.
const PATCHES: usize = 16;

/// Largest power of the reduction in faces by which costs may rise. On real meshes the power is 3 to 8, but 30 and more
/// where no sensible collapse is left. Costlier collapses wait for a pass in which other vertices are free.
const STEEPEST: f64 = 16.0;
/// Largest factor by which costs may rise.
const LEAP_MAX: f64 = 1000.0;
/// Costs below this share of the squared mean face area carry no information: collapses on flat surfaces cost about 0.
pub const NEGLIGIBLE: f32 = 1e-4;

/// Smallest work memory in bytes with which a sample is simplified during partitioning instead of before it.
const ROOM_BYTES: u64 = 96 << 20;
/// Memory of a sample, in bytes.
pub const SAMPLE_BYTES: u64 = SAMPLE_FACES[1] * ORDINARY_BYTES;

/// Reports whether a sample may be simplified during partitioning. If partitioning itself needs much memory, it takes
/// so long that overlapping saves nothing.
pub fn fits_beside_cutting(vertices: u64, work_bytes: u64) -> bool {
    work_bytes >= ROOM_BYTES && RANK_BYTES * vertices <= window_bytes(work_bytes)
}

/// What a sample is for.
#[derive(Debug, Clone, Copy)]
pub struct Purpose {
    /// Share of the faces to be left at the end of all passes.
    pub left: f64,
    /// Whether the pass must end just above the target.
    pub is_last: bool,
}

/// Which clusters give a patch, and the size of a patch.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Survey {
    clusters: Vec<ClusterId>,
    /// Faces of a patch.
    patch_faces: usize,
}

impl Survey {
    /// Chooses evenly spread clusters among those with faces, for a sample of `share` of the ordinary size.
    pub fn new(face_counts: &TiSlice<ClusterId, u64>, purpose: Purpose, share: f64) -> Self {
        let clusters = evenly_spread(face_counts, PATCHES);
        let sample_faces = sample_faces(face_counts.iter().sum(), purpose) as f64 * share;
        let patch_faces = sample_faces as usize / clusters.len().max(1);
        Self { clusters, patch_faces }
    }

    /// The chosen clusters, ascending.
    pub fn clusters(&self) -> &[ClusterId] {
        &self.clusters
    }

    /// Reports whether a cluster was chosen.
    pub fn wants(&self, cluster: ClusterId) -> bool {
        self.clusters.binary_search(&cluster).is_ok()
    }

    /// Number of faces of the patch of a cluster; `None` if the cluster gives none.
    pub fn patch_faces(&self, cluster: ClusterId) -> Option<usize> {
        self.wants(cluster).then_some(self.patch_faces)
    }

    /// Cuts a patch before the mesh of its cluster is built: `make` builds the mesh of the patch's faces alone.
    pub fn patch_of_faces(
        &self,
        mut faces: ClusterFaces,
        make: impl FnOnce(ClusterFaces) -> ClusterMesh,
    ) -> ClusterMesh {
        let (triangle, vertices) = (|face| faces.triangle(face), |face| faces.vertices(face));
        let patch = Patch::choose(faces.face_count(), self.patch_faces, faces.vertex_count(), triangle, vertices);
        faces.keep(&patch.faces);
        let mesh = make(faces);
        patch.cut_from(&mesh, FaceId::first(mesh.corners.len()))
    }
}

/// Number of faces to sample from a mesh with `faces` faces.
pub fn sample_faces(faces: u64, purpose: Purpose) -> u64 {
    let [least, most] = SAMPLE_FACES;
    let least = if purpose.is_last { LAST_SAMPLE_FACES } else { least };
    (faces / FACES_PER_SAMPLE_FACE).max((LEFT_FACES / purpose.left) as u64).clamp(least, most)
}

/// Returns up to `count` of the clusters that have faces, evenly spread, ascending.
pub fn evenly_spread(faces: &TiSlice<ClusterId, u64>, count: usize) -> Vec<ClusterId> {
    let filled: Vec<ClusterId> = faces.keys().filter(|&cluster| faces[cluster] > 0).collect();
    let count = filled.len().min(count);
    (0..count).map(|i| filled[(2 * i + 1) * filled.len() / (2 * count)]).collect()
}

/// Cuts a patch of about `faces` faces out of a cluster.
pub fn patch(mesh: &ClusterMesh, faces: usize) -> ClusterMesh {
    let (triangle, vertices) = (|face| mesh.triangle(face), |face| mesh.vertices(face));
    let patch = Patch::choose(mesh.corners.len(), faces, mesh.positions.len(), triangle, vertices);
    patch.cut_from(mesh, patch.faces.iter().copied())
}

/// Faces of a cluster that form a patch, and the rim of that patch.
#[derive(Debug)]
struct Patch {
    /// The faces, ascending.
    faces: Vec<FaceId>,
    /// Whether a face outside the patch uses the vertex, too.
    is_rim: TiVec<LocalVertex, bool>,
}

impl Patch {
    /// Chooses the `wanted` faces nearest to the middle one of `count` faces with `vertex_count` vertices.
    fn choose(
        count: usize,
        wanted: usize,
        vertex_count: usize,
        triangle: impl Fn(FaceId) -> [DVec3; 3],
        vertices: impl Fn(FaceId) -> [LocalVertex; 3],
    ) -> Self {
        let mut is_rim: TiVec<LocalVertex, bool> = vec![false; vertex_count].into();
        if count == 0 {
            return Self { faces: Vec::new(), is_rim };
        }
        let centre_of = |face: FaceId| triangle(face).into_iter().sum::<DVec3>() / 3.0;
        let middle = centre_of(FaceId::from(count / 2));
        // Squared distance and face in one number: doubles that are not negative are ordered like their bits.
        let place_of = |face: FaceId| {
            let distance_sq = centre_of(face).distance_squared(middle);
            u128::from(distance_sq.to_bits()) << u32::BITS | u128::from(face.number())
        };
        let mut order: Vec<u128> = FaceId::first(count).map(place_of).collect();
        let kept = wanted.min(count);
        if kept < count {
            order.select_nth_unstable(kept);
        }
        let mut are_inside: TiVec<FaceId, bool> = vec![false; count].into();
        order[..kept].iter().for_each(|&place| are_inside[FaceId::new(place as u32)] = true);
        let mut faces = Vec::with_capacity(kept);
        for (face, &is_inside) in are_inside.iter_enumerated() {
            if is_inside {
                faces.push(face);
            } else {
                vertices(face).into_iter().for_each(|v| is_rim[v] = true);
            }
        }
        Self { faces, is_rim }
    }

    /// Builds the patch as a mesh with unlinked wedges from these `faces` of `mesh`.
    fn cut_from(&self, mesh: &ClusterMesh, faces: impl Iterator<Item = FaceId>) -> ClusterMesh {
        let mut patch = ClusterMesh::default();
        // A closed surface has half as many vertices as faces.
        patch.reserve(self.faces.len() / 2, self.faces.len() / 2, self.faces.len());
        let mut vertex_of = mesh.per_vertex(LocalVertex::NONE);
        let mut wedge_of = mesh.per_wedge(Wedge::NONE);
        for face in faces {
            let corners = mesh.corners[face].map(|w| {
                let v = mesh.wedge_vertex[w];
                if vertex_of[v] == LocalVertex::NONE {
                    let rim = if self.is_rim[v] { flag::SHARED | flag::LOCKED } else { 0 };
                    vertex_of[v] = patch.push_vertex(mesh.positions[v], mesh.flags[v] | rim);
                }
                if wedge_of[w] == Wedge::NONE {
                    wedge_of[w] = patch.push_wedge(vertex_of[v], mesh.wedge_uv[w]);
                }
                wedge_of[w]
            });
            patch.push_face(corners, mesh.parts[face]);
        }
        patch
    }
}

/// Adds a patch to the sample.
pub fn append(sample: &mut ClusterMesh, patch: &ClusterMesh) {
    let (vertices, wedges) = (sample.positions.len(), sample.wedge_vertex.len());
    sample.reserve(patch.positions.len(), patch.wedge_vertex.len(), patch.corners.len());
    for (&position, &flags) in patch.positions.iter().zip(&patch.flags) {
        sample.push_vertex(position, flags);
    }
    for (&vertex, &uv) in patch.wedge_vertex.iter().zip(&patch.wedge_uv) {
        sample.push_wedge(LocalVertex::from(vertices + vertex.index()), uv);
    }
    for (corners, &part) in patch.corners.iter().zip(&patch.parts) {
        sample.push_face(corners.map(|w| Wedge::from(wedges + w.index())), part);
    }
}

/// Scales the texture coordinates of a sample that was taken before the scales of the parts were known.
pub fn scale_texture(sample: &mut ClusterMesh, scale_of: impl Fn(PartId) -> f64) {
    let mut scales = sample.per_wedge(1.0);
    for (corners, &part) in sample.corners.iter().zip(&sample.parts) {
        corners.iter().for_each(|&w| scales[w] = scale_of(part));
    }
    sample.wedge_uv.iter_mut().zip(scales).for_each(|(uv, scale)| *uv *= scale);
}

/// Simplifies a sample and returns its cost threshold at each share of the faces.
pub fn thresholds<M: Metric>(engine: &mut Engine<M>, shares: &[f64]) -> Vec<f32> {
    engine.mesh.link_wedges();
    let faces = engine.mesh.face_count;
    let free = engine.count_free_faces();
    let mut before = None;
    let mut threshold = |share: &f64| {
        let cost = cost_at(engine, face_goal(faces, free, *share), before);
        before = Some(cost);
        cost
    };
    shares.iter().map(&mut threshold).collect()
}

/// Simplifies a sample to `goal` faces and returns the cost reached, capped at what the first half of the collapses
/// predicts. If legal collapses run out first, it is also capped at what `threshold`, the cost of the previous stage,
/// predicts.
fn cost_at<M: Metric>(engine: &mut Engine<M>, goal: usize, threshold: Option<f32>) -> f32 {
    let before = engine.mesh.face_count;
    engine.log = Some(Vec::new());
    let result = engine.run(Stop::Faces(goal));
    let log = engine.log.take().unwrap_or_default();
    let mean_area = (engine.area() / before.max(1) as f64) as f32;
    let negligible = NEGLIGIBLE * mean_area * mean_area;
    let left = engine.mesh.face_count;
    let likely = likely_cost(&log, before, goal.max(left)).max(negligible);
    if result.reached {
        return result.cost.min(likely);
    }
    let most = |cost: f32| (cost * rise(before as u64, left as u64, STEEPEST) as f32).max(negligible);
    threshold.map_or(likely, |cost| likely.min(most(cost)))
}

/// Predicts the cost at `goal` faces: the highest cost in the first half of the collapses, times the largest plausible
/// rise.
fn likely_cost(log: &[LoggedCollapse], before: usize, goal: usize) -> f32 {
    let half_way = before - before.saturating_sub(goal) / 2;
    let (mut cost, mut faces) = (0f32, before);
    for next in log {
        if faces <= half_way {
            break;
        }
        cost = cost.max(next.cost);
        faces = next.faces as usize;
    }
    cost * rise(half_way as u64, goal as u64, STEEPEST).min(LEAP_MAX) as f32
}

/// Factor by which the cost of a collapse rises from `before` to `after` faces, if costs rise by this power.
pub fn rise(before: u64, after: u64, power: f64) -> f64 {
    libm::pow(before as f64 / after.max(1) as f64, power)
}

/// Faces left if `free` of them are reduced to `share` and the others stay, but at least `share` of all faces.
pub fn face_goal(faces: usize, free: usize, share: f64) -> usize {
    (faces as f64 - free as f64 * (1.0 - share)).max(faces as f64 * share).round() as usize
}

#[cfg(test)]
mod tests {
    use std::collections::{HashMap, HashSet};

    use super::*;
    use crate::cost::SurfaceCost;
    use crate::mesh::cluster::samples;

    fn place(position: DVec3) -> [u64; 3] {
        position.to_array().map(f64::to_bits)
    }

    /// Number of faces around each position.
    fn faces_around(mesh: &ClusterMesh) -> HashMap<[u64; 3], usize> {
        let mut around = HashMap::new();
        for face in mesh.face_ids() {
            mesh.triangle(face).iter().for_each(|&corner| *around.entry(place(corner)).or_default() += 1);
        }
        around
    }

    #[test]
    fn a_patch_is_compact_and_locked_where_it_was_cut_off() {
        let mut mesh = samples::grid(20, 0.3);
        // The part of each face is its number.
        mesh.parts = mesh.face_ids().map(|face| PartId::new(face.number())).collect();
        let face_of = |&part: &PartId| FaceId::new(part.number());
        let cluster = ClusterId::new;
        let survey_of =
            |faces: &[u64], share| Survey::new(TiSlice::from_ref(faces), Purpose { left: 0.5, is_last: false }, share);
        let survey = survey_of(&[800, 0, 800], 0.04);
        assert_eq!(survey.clusters(), [cluster(0), cluster(2)]);
        assert!(survey.patch_faces(cluster(1)).is_none());
        let patch = patch(&mesh, survey.patch_faces(cluster(2)).unwrap());
        assert_eq!(patch.corners.len(), 200);
        assert!(patch.parts.is_sorted() && patch.parts.iter().all(|part| part.index() < 800));
        for (face, part) in patch.parts.iter_enumerated() {
            assert_eq!(patch.triangle(face), mesh.triangle(face_of(part)));
        }
        // Each vertex occurs once, with its own wedge.
        assert_eq!(patch.positions.iter().map(|&at| place(at)).collect::<HashSet<_>>().len(), patch.positions.len());
        assert_eq!(patch.wedge_vertex.len(), patch.positions.len());
        let (all, own) = (faces_around(&mesh), faces_around(&patch));
        for (&position, &flags) in patch.positions.iter().zip(&patch.flags) {
            let is_cut_off = own[&place(position)] < all[&place(position)];
            assert_eq!(flags & flag::LOCKED != 0, is_cut_off, "{position}");
            assert_eq!(flags & flag::SHARED != 0, is_cut_off, "{position}");
        }
        // No face outside the patch is nearer to its middle than those inside.
        let centre = |face: FaceId| mesh.triangle(face).into_iter().sum::<DVec3>() / 3.0;
        let away = |face: FaceId| centre(face).distance(centre(FaceId::new(400)));
        let farthest = patch.parts.iter().map(|part| away(face_of(part))).fold(0.0, f64::max);
        let is_outside = |face: &FaceId| !patch.parts.contains(&PartId::new(face.number()));
        assert!(mesh.face_ids().filter(is_outside).all(|face| away(face) >= farthest));
        let whole = super::patch(&mesh, survey_of(&[800], 1.0).patch_faces(cluster(0)).unwrap());
        assert_eq!(whole.corners.len(), 800);
        assert!(whole.flags.iter().all(|&flags| flags == 0));
    }

    #[test]
    fn a_sample_is_its_patches_side_by_side_and_each_part_is_scaled() {
        let mut sample = ClusterMesh::default();
        let (one, mut other) = (samples::grid(2, 0.0), samples::grid(3, 0.0));
        other.parts.fill(PartId::new(1));
        append(&mut sample, &one);
        append(&mut sample, &other);
        assert_eq!(sample.corners.len(), 8 + 18);
        for (face, appended) in other.face_ids().zip(sample.face_ids().skip(8)) {
            assert_eq!(sample.triangle(appended), other.triangle(face));
        }
        scale_texture(&mut sample, |part| [2.0, 3.0][part.index()]);
        let (first, second) = sample.wedge_uv.raw.split_at(one.wedge_uv.len());
        assert!(first.iter().zip(&one.wedge_uv).all(|(scaled, &uv)| *scaled == 2.0 * uv));
        assert!(second.iter().zip(&other.wedge_uv).all(|(scaled, &uv)| *scaled == 3.0 * uv));
    }

    #[test]
    fn a_threshold_leads_near_its_share_and_none_is_infinite() {
        let engine = || Engine::<SurfaceCost>::new(samples::grid(30, 0.3), &Default::default());
        let costs = thresholds(&mut engine(), &[0.5, 0.25]);
        assert!(costs[0] > 0.0 && costs[0] < costs[1] && costs[1].is_finite(), "{costs:?}");
        let left = |costs: &[f32]| {
            let mut engine = engine();
            costs.iter().for_each(|&cost| _ = engine.run(Stop::Cost(cost, 0)));
            engine.mesh.face_count as f64 / 1800.0
        };
        let shares = [left(&costs[..1]), left(&costs)];
        assert!((0.45..0.7).contains(&shares[0]) && (0.2..0.35).contains(&shares[1]), "{shares:?}");
        // Where no face can go, the cost is predicted from the collapses before.
        let mut held = samples::grid(30, 0.3);
        held.flags.iter_mut().skip(200).for_each(|flags| *flags |= flag::LOCKED);
        let mut held = Engine::<SurfaceCost>::new(held, &Default::default());
        let [before, after] = [Some(0.01), None].map(|threshold| cost_at(&mut held, 10, threshold));
        assert!(held.mesh.face_count > 10 && before.is_finite() && after.is_finite());
        let spread = rise(1800, held.mesh.face_count as u64, STEEPEST) as f32;
        assert!(before <= 0.01 * spread, "{before} {spread}");
    }

    #[test]
    fn a_sample_waits_where_cutting_takes_the_memory() {
        assert!(fits_beside_cutting(1000, ROOM_BYTES));
        assert!(!fits_beside_cutting(1000, ROOM_BYTES - 1));
        let most = window_bytes(ROOM_BYTES) / RANK_BYTES;
        assert!(fits_beside_cutting(most, ROOM_BYTES) && !fits_beside_cutting(most + 1, ROOM_BYTES));
    }

    #[test]
    fn the_sample_is_spread_over_filled_clusters() {
        let mut counts = vec![10; 100];
        counts[3] = 0;
        let spread = |counts: &[u64], count| evenly_spread(TiSlice::from_ref(counts), count);
        let sampled = spread(&counts, PATCHES);
        assert_eq!(sampled.len(), PATCHES);
        assert!(sampled.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!(spread(&[0, 5, 0], PATCHES), [ClusterId::new(1)]);
        assert_eq!(spread(&[1; 8], 2), [2, 6].map(ClusterId::new));
    }

    #[test]
    fn a_sample_has_more_faces_for_a_far_target_a_last_pass_and_a_large_mesh() {
        let count = |faces, left, is_last| sample_faces(faces, Purpose { left, is_last });
        assert_eq!([count(100_000, 0.5, false), count(100_000, 0.5, true)], [10_000, 20_000]);
        assert_eq!([count(100_000, 0.1, false), count(100_000, 0.1, true)], [28_000; 2]);
        assert_eq!([count(1_600_000, 0.5, false), count(1_600_000, 0.5, true)], [40_000; 2]);
        assert_eq!([count(100_000, 0.001, false), count(9_000_000, 0.5, true)], [60_000; 2]);
    }

    #[test]
    fn what_is_locked_does_not_count_against_the_share() {
        assert_eq!(face_goal(1000, 1000, 0.5), 500);
        assert_eq!(face_goal(1000, 500, 0.5), 750);
    }

    #[test]
    fn no_goal_is_below_the_share_of_all_faces() {
        for share in [0.0, 0.003, 0.5, 1.0] {
            assert_eq!(face_goal(1000, 1020, share), (1000.0 * share) as usize);
        }
    }

    #[test]
    fn a_few_dear_collapses_say_nothing_of_the_others() {
        let collapse = |cost, number: u32| LoggedCollapse { cost, faces: 1000 - 2 * number };
        let log: Vec<_> = (1..=100).map(|number| collapse(if number > 95 { 1e6 } else { 1.0 }, number)).collect();
        let likely = likely_cost(&log, 1000, 800);
        assert!((1.0..8.0).contains(&likely), "{likely}");
        let log: Vec<_> = (1..=490).map(|number| collapse(1.0, number)).collect();
        assert_eq!(likely_cost(&log, 1000, 20), LEAP_MAX as f32);
        assert_eq!(likely_cost(&[], 1000, 800), 0.0);
    }
}

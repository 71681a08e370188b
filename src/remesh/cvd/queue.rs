//! More centres: points on edges, largest collapse error first.
//!
//! The collapse of an edge (a, b) has the error Qa + Qb, where Qa(x) is the area-weighted squared distance from x to
//! the planes of the faces around a. Along the edge that is α t² + β (1 - t)² with α = Qa(b), β = Qb(a):
//!
//! ```text
//!   a ------------ p ------ b      least at t = β / (α + β), where it is αβ / (α + β)
//!          |            |
//!         (a, p)      (p, b)       new candidates; at p the surface bends as interpolated between a and b
//! ```
//! A part that spans a share s of its edge has s² times the error. A candidate's error is therefore at most that of the
//! candidate it came from, and the candidates above a threshold do not depend on the order of picks. The queue over the
//! whole mesh is then just a threshold, found by counting candidates by magnitude in one pass over the clusters.
//!
//! # Memory
//! 512 KiB a cluster while its candidates are counted, 12 bytes for each magnitude that occurs.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::base::id::{TiSlice, TiVec};
use crate::geometry::triangle::regularity;
use crate::mesh::cluster::ClusterMesh;
use crate::mesh::id::{Corner, FaceId, LocalVertex, WedgePair};
use crate::mesh::ring::{Rings, VALENCE_MAX};
use crate::mesh::split::EdgePoint;

/// Depth to which a picked point makes new candidates: at most 7 points an edge.
const DEPTH: u32 = 3;
/// A point stays this share of its part of the edge away from both ends of the part.
const MARGIN: f64 = 0.25;
/// Edges of faces below this regularity, in space or in texture space, are not split.
const REGULARITY_MIN: f64 = 0.05;
/// Nor are those of faces whose texture triangle is no larger than this (relative to the image): texture coordinates
/// are written with six decimals.
const TEXTURE_MIN: f64 = 1e-4;
/// Low bits of a double that a magnitude drops: 64 magnitudes per power of two remain.
const MAGNITUDE_SHIFT: u32 = 46;

/// For each face, whether its edges may be split: neither the face nor its texture triangle, if it has one, is thin or
/// small, and the texture triangle has the sign of most in the cluster. In other faces rounding could fold the parts.
pub fn sound_faces(mesh: &ClusterMesh) -> TiVec<FaceId, bool> {
    let signed = |face: FaceId| {
        let [a, b, c] = mesh.uv_triangle(face);
        (b - a).perp_dot(c - a)
    };
    let turned = mesh.living_faces().filter(|&face| signed(face) < 0.0).count();
    let side = if turned > mesh.living_faces().filter(|&face| signed(face) > 0.0).count() { -1.0 } else { 1.0 };
    let is_sound = |face: FaceId| {
        let uv = mesh.uv_triangle(face);
        let has_texture = uv.iter().all(|t| t.is_finite());
        let is_large = uv[0].distance(uv[1]).max(uv[1].distance(uv[2])) > TEXTURE_MIN;
        let keeps_texture =
            signed(face) * side > 0.0 && is_large && regularity(uv.map(|t| t.extend(0.0))) >= REGULARITY_MIN;
        regularity(mesh.triangle(face)) >= REGULARITY_MIN && (!has_texture || keeps_texture)
    };
    mesh.face_ids().map(|face| !mesh.is_dead(face) && is_sound(face)).collect()
}

/// Writes the other ends of the edges from a vertex to vertices with higher ids that may be split. Such an edge has two
/// sound faces, which run along it in opposite directions and have the same wedges there, and no other cluster has the
/// edge. Edges at a hub stay whole: to look through all its faces for each of them takes too long.
pub fn splittable(
    mesh: &ClusterMesh,
    rings: &Rings,
    is_sound: &TiSlice<FaceId, bool>,
    vertex: LocalVertex,
    ends: &mut Vec<LocalVertex>,
) {
    ends.clear();
    let is_hub = |vertex: LocalVertex| rings.of(vertex).len() > VALENCE_MAX;
    if is_hub(vertex) {
        return;
    }
    for &corner in rings.of(vertex) {
        let far = corner.others();
        for (k, other) in far.map(|c| mesh.vertex_of(c)).into_iter().enumerate() {
            let is_rim = mesh.is_shared(vertex) && mesh.is_shared(other);
            if other <= vertex || is_rim || is_hub(other) || ends.contains(&other) {
                continue;
            }
            let pair_at = |corner, far| WedgePair { from: mesh.wedge_of(corner), to: mesh.wedge_of(far) };
            let wedges = pair_at(corner, far[k]);
            let (mut faces, mut forwards, mut is_whole) = (0, 0, true);
            for &corner in rings.of(vertex) {
                let far = corner.others();
                let Some(k) = far.iter().position(|&c| mesh.vertex_of(c) == other) else { continue };
                faces += 1;
                forwards += 1 - k;
                is_whole &= wedges == pair_at(corner, far[k]);
                is_whole &= is_sound[corner.face()];
            }
            if faces == 2 && forwards == 1 && is_whole {
                ends.push(other);
            }
        }
    }
}

/// Unit normals of faces times the square root of their areas; zero for a dead face or one without area.
pub fn weighted_normals(mesh: &ClusterMesh) -> TiVec<FaceId, DVec3> {
    let normal = |face: FaceId| {
        let [a, b, c] = mesh.triangle(face);
        let across = (b - a).cross(c - a);
        let length = across.length();
        if length > 0.0 { across * (0.5 / length).sqrt() } else { DVec3::ZERO }
    };
    mesh.face_ids().map(|face| if mesh.is_dead(face) { DVec3::ZERO } else { normal(face) }).collect()
}

/// Q of a vertex at a displacement from it, in area × length².
pub fn quadric_error(rings: &Rings, normals: &TiSlice<FaceId, DVec3>, vertex: LocalVertex, displacement: DVec3) -> f64 {
    let square = |corner: &Corner| {
        let distance = normals[corner.face()].dot(displacement);
        distance * distance
    };
    rings.of(vertex).iter().map(square).sum()
}

/// Candidates on the edges of a cluster.
pub struct Queue<'a> {
    mesh: &'a ClusterMesh,
    rings: &'a Rings,
    is_held: &'a TiSlice<LocalVertex, bool>,
    is_sound: &'a TiSlice<FaceId, bool>,
    normals: TiVec<FaceId, DVec3>,
}

impl<'a> Queue<'a> {
    /// The candidates of a mesh. Edges between two held vertices stay whole, as do those of faces that are not sound.
    pub fn new(
        mesh: &'a ClusterMesh,
        rings: &'a Rings,
        is_held: &'a TiSlice<LocalVertex, bool>,
        is_sound: &'a TiSlice<FaceId, bool>,
    ) -> Self {
        Self { mesh, rings, is_held, is_sound, normals: weighted_normals(mesh) }
    }

    /// Counts the errors of the largest candidates, by magnitude; stops before there are more than `most`.
    pub fn count(&self, most: u64) -> ErrorCounts {
        let mut magnitudes = vec![0u32; 1 << (63 - MAGNITUDE_SHIFT)];
        self.each_candidate(f64::MIN_POSITIVE, |_, error| {
            magnitudes[(error.to_bits() >> MAGNITUDE_SHIFT) as usize] += 1;
        });
        let (mut counts, mut seen) = (ErrorCounts::default(), 0);
        for (magnitude, count) in magnitudes.into_iter().enumerate().rev().filter(|&(_, count)| count > 0) {
            seen += u64::from(count);
            if seen > most {
                break;
            }
            counts.magnitudes.insert(magnitude as u32, u64::from(count));
        }
        counts
    }

    /// The candidates whose error is at least `threshold`, sorted by ends and share. If they are more than `most`,
    /// raises the threshold until there are at most `most`.
    pub fn points(&self, threshold: f64, most: u64) -> Vec<EdgePoint> {
        let (mut points, mut found) = (Vec::new(), 0);
        self.each_candidate(threshold.max(f64::MIN_POSITIVE), |point, _| {
            found += 1;
            if found <= most {
                points.push(point);
            }
        });
        if found > most {
            points.clear();
            let own = self.count(most).threshold(most).max(f64::MIN_POSITIVE);
            self.each_candidate(own, |point, _| points.push(point));
        }
        points.sort_unstable_by(|a, b| a.ends.cmp(&b.ends).then(a.share.total_cmp(&b.share)));
        points
    }

    fn each_candidate(&self, least: f64, mut take: impl FnMut(EdgePoint, f64)) {
        let mut ends = Vec::new();
        for a in self.mesh.vertex_ids() {
            splittable(self.mesh, self.rings, self.is_sound, a, &mut ends);
            for &b in ends.iter().filter(|&&b| !(self.is_held[a] && self.is_held[b])) {
                let along = self.mesh.positions[b] - self.mesh.positions[a];
                let bends = [a, b].map(|end| quadric_error(self.rings, &self.normals, end, along));
                let stretch = Stretch { from: 0.0, to: 1.0, bends, most: f64::INFINITY };
                stretch.expand(DEPTH, least, &mut |share, error| take(EdgePoint { ends: [a, b], share }, error));
            }
        }
    }
}

/// A part of an edge.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    from: f64,
    to: f64,
    /// α and β of the whole edge, if it had the bend of the surface at the ends of this part.
    bends: [f64; 2],
    /// Error of the candidate that it came from.
    most: f64,
}

impl Stretch {
    fn expand(&self, depth: u32, least: f64, take: &mut impl FnMut(f64, f64)) {
        let ([a, b], span) = (self.bends, self.to - self.from);
        let error = (span * span * a * b / (a + b)).min(self.most);
        // NOTE: the comparison is also false if nothing bends and the error is NaN.
        if !(error >= least && error.is_finite()) || depth == 0 {
            return;
        }
        let share = (b / (a + b)).clamp(MARGIN, 1.0 - MARGIN);
        let (at, bend) = (self.from + share * span, a + share * (b - a));
        take(at, error);
        Self { to: at, bends: [a, bend], most: error, ..*self }.expand(depth - 1, least, take);
        Self { from: at, bends: [bend, b], most: error, ..*self }.expand(depth - 1, least, take);
    }
}

/// Number of candidates by the magnitude of their error.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorCounts {
    magnitudes: BTreeMap<u32, u64>,
}

impl ErrorCounts {
    /// Adds the counts of another cluster.
    pub fn merge(&mut self, other: &Self) {
        for (&magnitude, &count) in &other.magnitudes {
            *self.magnitudes.entry(magnitude).or_default() += count;
        }
    }

    /// The lowest start of a magnitude that at most `wanted` candidates reach or exceed; infinite if there is none.
    pub fn threshold(&self, wanted: u64) -> f64 {
        let (mut seen, mut threshold) = (0, f64::INFINITY);
        for (&magnitude, &count) in self.magnitudes.iter().rev() {
            seen += count;
            if seen > wanted {
                break;
            }
            threshold = f64::from_bits(u64::from(magnitude) << MAGNITUDE_SHIFT);
        }
        threshold
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::{v, w};

    fn expanded(bends: [f64; 2], least: f64) -> Vec<(f64, f64)> {
        let mut found = Vec::new();
        Stretch { from: 0.0, to: 1.0, bends, most: f64::INFINITY }
            .expand(DEPTH, least, &mut |at, e| found.push((at, e)));
        found
    }

    #[test]
    fn the_first_point_has_the_least_error_of_its_edge() {
        // α = 1, β = 2: t = 2/3, error 2/3.
        let [(at, error)] = expanded([1.0, 2.0], 0.5)[..] else { panic!("one candidate") };
        assert!((at - 2.0 / 3.0).abs() < 1e-12 && (error - 2.0 / 3.0).abs() < 1e-12);
        assert!(expanded([0.0, 3.0], 1e-300).is_empty(), "no error, no candidate");
    }

    #[test]
    fn parts_err_by_the_square_of_their_share() {
        // α = β = 4: error 2 in the middle, a quarter of that on each half, a sixteenth on each quarter.
        let mut found = expanded([4.0, 4.0], 1e-9);
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let expected = [0.125, 0.5, 0.125, 2.0, 0.125, 0.5, 0.125];
        assert_eq!(found.len(), 7);
        for (i, ((at, error), wanted)) in found.iter().zip(expected).enumerate() {
            assert!((at - (i + 1) as f64 / 8.0).abs() < 1e-12 && (error - wanted).abs() < 1e-12, "{at} {error}");
        }
    }

    #[test]
    fn the_threshold_lets_through_what_is_wanted_and_no_more() {
        let mesh = samples::grid(6, 0.4);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let (is_held, is_sound) = (mesh.per_vertex(false), mesh.per_face(true));
        let queue = Queue::new(&mesh, &rings, &is_held, &is_sound);
        let counts = queue.count(u64::MAX);
        for wanted in [0, 1, 10, 60] {
            let points = queue.points(counts.threshold(wanted), u64::MAX);
            assert!(points.len() as u64 <= wanted && points.len() as u64 + 3 >= wanted, "{wanted}: {}", points.len());
        }
        assert!(queue.count(20).threshold(u64::MAX) > counts.threshold(u64::MAX), "the largest alone");
        assert_eq!(queue.points(0.0, 20), queue.points(queue.count(20).threshold(20), u64::MAX));
    }

    #[test]
    fn errors_are_those_of_the_quadrics() {
        use crate::cost::Quadric;
        use crate::cost::planes::plane_of;
        let mesh = samples::grid(3, 0.7);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let normals = weighted_normals(&mesh);
        for (at, displacement) in [(v(5), DVec3::new(0.3, -1.0, 0.2)), (v(10), DVec3::new(1.0, 1.0, -0.4))] {
            let mut quadric = Quadric::default();
            for face in rings.faces(&mesh, at) {
                let (normal, area) = plane_of(mesh.triangle(face)).unwrap();
                quadric += Quadric::plane(normal, -normal.dot(mesh.triangle(face)[0]), area);
            }
            let expected = quadric.at(mesh.positions[at] + displacement);
            assert!((quadric_error(&rings, &normals, at, displacement) - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn a_face_whose_texture_is_turned_over_or_tiny_is_not_sound() {
        let mut mesh = samples::grid(2, 0.0);
        assert!(sound_faces(&mesh).iter().all(|&is_sound| is_sound));
        mesh.wedge_uv[w(0)] = glam::DVec2::new(0.15, 0.15);
        let sound = sound_faces(&mesh);
        assert_eq!(sound.iter().filter(|&&is_sound| !is_sound).count(), 2, "the faces around the corner: {sound:?}");
        mesh.wedge_uv.iter_mut().for_each(|uv| *uv *= 1e-5);
        assert!(sound_faces(&mesh).iter().all(|&is_sound| !is_sound));
    }

    #[test]
    fn seams_borders_and_rims_are_not_split() {
        use crate::mesh::cluster::flag;
        let mut mesh = samples::two_charts(4);
        [6, 11].iter().for_each(|&at| mesh.flags[v(at)] |= flag::SHARED | flag::LOCKED);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let ends = |at| {
            let mut ends = Vec::new();
            splittable(&mesh, &rings, &sound_faces(&mesh), v(at), &mut ends);
            ends.sort_unstable();
            ends.into_iter().map(LocalVertex::number).collect::<Vec<_>>()
        };
        assert_eq!(ends(0), [6], "0-1 and 0-5 are border edges");
        assert_eq!(ends(7), [8, 13], "7-12 lies on the seam");
        assert_eq!(ends(6), [7, 12], "6-11 may be another cluster's, too");
    }

    #[test]
    fn edges_at_a_hub_are_not_split() {
        let mesh = samples::disc(VALENCE_MAX as u32 + 1);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let mut ends = Vec::new();
        splittable(&mesh, &rings, &mesh.per_face(true), v(0), &mut ends);
        assert!(ends.is_empty());
    }
}

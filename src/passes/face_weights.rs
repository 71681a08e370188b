//! Which faces of the input get sample points: a share goes by area, a share by face, the rest by expected error.

use glam::DVec3;

use crate::base::id::TiVec;
use crate::mesh::ClusterMesh;
use crate::mesh::id::{FaceId, LocalVertex};

/// Shares of the points that are distributed by area, by face, and by expected error.
const BY_AREA: f64 = 0.4;
const BY_FACES: f64 = 0.2;
const BY_STAKES: f64 = 0.4;
/// Bend below which a vertex counts as flat. Bend: 1 minus the length of the mean unit normal around the vertex.
const BEND_MIN: f32 = 1e-6;
/// Number of faces, at least, whose expected errors tell where they are capped; all faces if there are fewer.
const QUANTILE_FACES: usize = 4096;

/// Sampling weights of the faces of a cluster, and buffers to compute them.
#[derive(Debug, Default)]
pub(super) struct FaceWeights {
    /// Running sums of the weights.
    pub(super) ends: Vec<f64>,
    /// Around each vertex: sum of the cross products of the faces, and sum of their lengths.
    normals: TiVec<LocalVertex, [f32; 4]>,
    /// Bend at each vertex: 1 minus the length of the mean unit normal.
    bends: TiVec<LocalVertex, f32>,
    /// Area of each face, and the square of its longest side.
    sizes: TiVec<FaceId, (f64, f32)>,
    /// Expected error of each face if it is removed: area × bend × length².
    stakes: Vec<f32>,
    sorted: Vec<f32>,
}

impl FaceWeights {
    /// Begins with a mesh of this many vertices.
    pub(super) fn begin(&mut self, vertices: usize) {
        self.normals.clear();
        self.normals.resize(vertices, [0.0; 4]);
        self.sizes.clear();
    }

    /// Measures the next face; returns the square of its longest side.
    #[inline(always)]
    pub(super) fn measure(&mut self, vertices: [LocalVertex; 3], [a, b, c]: [DVec3; 3]) -> f64 {
        let (ab, ac) = (b - a, c - a);
        let normal = ab.cross(ac);
        let length = finite(normal.length());
        let longest_sq = ab.length_squared().max(ac.length_squared()).max(b.distance_squared(c));
        self.sizes.push((0.5 * length, longest_sq as f32));
        if length > 0.0 {
            let sum = [normal.x, normal.y, normal.z, length].map(|x| x as f32);
            for vertex in vertices {
                let of_vertex = &mut self.normals[vertex];
                (0..4).for_each(|k| of_vertex[k] += sum[k]);
            }
        }
        longest_sq
    }

    /// Fills `ends` with running sums of the sampling weights of the faces, all of which were measured, and returns
    /// their area. A share of the weight goes by area, a share by face, and the rest by expected error: area × bend ×
    /// length². The last is capped at the value that a share `left` of the faces exceeds, since those faces stay.
    pub(super) fn weigh(&mut self, mesh: &ClusterMesh, left: f64) -> f64 {
        self.bends.clear();
        self.bends.extend(self.normals.iter().map(|&[x, y, z, length]| {
            let bend = 1.0 - (x * x + y * y + z * z).sqrt() / length;
            if bend > BEND_MIN { bend } else { 0.0 }
        }));
        self.stakes.clear();
        let (mut area, mut with_area) = (0.0, 0u32);
        for (face, &(own, longest_sq)) in self.sizes.iter_enumerated() {
            let bends = mesh.vertices(face).map(|vertex| self.bends[vertex]);
            let bend = bends.into_iter().fold(0.0, f32::max);
            let stake = own as f32 * bend * longest_sq;
            self.stakes.push(if stake.is_finite() { stake } else { 0.0 });
            area += own;
            with_area += u32::from(own > 0.0);
        }
        let most = self.exceeded_by(left);
        let stakes: f64 = self.stakes.iter().map(|stake| f64::from(stake.min(most))).sum();
        self.ends.clear();
        let mut end = 0.0;
        let (by_area, by_faces) = (BY_AREA / area, BY_FACES / f64::from(with_area));
        let by_stakes = if stakes > 0.0 { BY_STAKES / stakes } else { 0.0 };
        for (&(own, _), stake) in self.sizes.iter().zip(&self.stakes) {
            if own > 0.0 {
                end += by_area * own + by_faces + by_stakes * f64::from(stake.min(most));
            }
            self.ends.push(end);
        }
        area
    }

    /// The expected error that a share `left` of the faces with one exceeds, of a sample of them; 0 without any.
    fn exceeded_by(&mut self, left: f64) -> f32 {
        let step = (self.stakes.len() / QUANTILE_FACES).max(1);
        self.sorted.clear();
        self.sorted.extend(self.stakes.iter().step_by(step).filter(|&&stake| stake > 0.0));
        let count = self.sorted.len();
        if count == 0 {
            return 0.0;
        }
        let place = ((1.0 - left).max(0.0) * count as f64) as usize;
        *self.sorted.select_nth_unstable_by(place.min(count - 1), f32::total_cmp).1
    }
}

/// Returns the number, or 0 if it is not finite.
pub(super) fn finite(number: f64) -> f64 {
    if number.is_finite() { number } else { 0.0 }
}

//! Recomputes bounds on deviations against the surface at the start of a pass.
//!
//! A bound that passes from collapse to collapse adds up moves that cancel each other (`deviation.rs`). Here the
//! current faces of a cluster are compared with its first faces, both ways:
//!
//! ```text
//! input ── bound of each first face ── first faces ── each part near one face ── faces now
//! ```
//! Every part of a current face is within some distance of one first face; its bound is this distance plus the first
//! face's bound. Every part of a first face is within some distance of one current face, which takes this distance plus
//! the first face's bound. A part is cut along the sides of the face nearest to its middle, then halved, until its
//! corners, and therefore all of it, are near enough to one face.
//!
//! # Memory
//! See [`Anchor::with_room`].

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use super::cover::CoveredFace;
use super::parts::{ConvexPolygon, Parts};
use crate::base::id::{TiSlice, TiVec};
use crate::base::pool::in_parallel;
use crate::geometry::boxtree::{Bounds, BoxTree};
use crate::mesh::ClusterMesh;
use crate::mesh::cluster::rounded_up;
use crate::mesh::id::{FaceId, LocalVertex};

/// A part is near enough if its bound is at most this share of the largest bound allowed.
const NEAR_SHARE: f64 = 0.6;
/// A part is also near enough if its bound exceeds the distance of its middle by at most this factor.
const TIGHT: f64 = 1.2;
/// Largest number of parts of a triangle.
const PARTS_MAX: usize = 4096;
/// If fewer faces than this share have bounds that are not near enough, nothing is recomputed.
const FAR_SHARE_MIN: f64 = 0.1;
/// Faces of a run. Each search starts from the face found for the previous one, which bounds it.
const RUN_FACES: usize = 256;

/// The surface of a cluster at the start of a pass.
#[derive(Debug)]
pub struct Anchor {
    vertices: TiVec<LocalVertex, DVec3>,
    faces: TiVec<FaceId, [LocalVertex; 3]>,
    bounds: TiVec<FaceId, f32>,
}

impl Anchor {
    /// Copies the living faces of a cluster and their bounds.
    pub fn of(mesh: &ClusterMesh) -> Self {
        Self {
            vertices: mesh.positions.clone(),
            faces: mesh.living_faces().map(|face| mesh.vertices(face)).collect(),
            bounds: mesh.living_faces().map(|face| mesh.deviations[face]).collect(),
        }
    }

    /// Bytes of a cluster of `cluster_bytes` together with its anchor: 28 bytes a face where the cluster takes 200, and
    /// 32 more while bounds are recomputed.
    pub fn with_room(cluster_bytes: u64) -> u64 {
        cluster_bytes + cluster_bytes / 3
    }

    /// Number of its faces.
    pub fn face_count(&self) -> usize {
        self.faces.len()
    }

    /// Replaces the bounds of the current faces by those computed from their positions, none above `most`, in units of
    /// length. Returns `false`, and changes nothing, if little would be gained, or if a first face lies too far from
    /// the current surface. The mesh must have no dead faces.
    pub fn tighten(&self, mesh: &mut ClusterMesh, most: f64) -> bool {
        let is_near = |bound: f32| f64::from(bound) <= NEAR_SHARE * most;
        let far_count = mesh.deviations.iter().filter(|&&bound| !is_near(bound)).count();
        if (far_count as f64) < FAR_SHARE_MIN * mesh.deviations.len() as f64 {
            return false;
        }
        let now = TriangleSurface::new(&mesh.positions, &mesh.corner_vertices, None);
        let first = TriangleSurface::new(&self.vertices, &self.faces, Some(&self.bounds));
        // Distances are not negative, so their bits order like their values.
        let bounds: TiVec<FaceId, AtomicU64> = mesh.deviations.iter().map(|_| AtomicU64::new(0)).collect();
        let raise = |face: FaceId, bound: f64| bounds[face].fetch_max(bound.to_bits(), Ordering::Relaxed);
        let cover_run = |scratch: &mut Scratch, run: Range<usize>| {
            scratch.last = None;
            run.map(FaceId::from).all(|face| {
                let base = first.base(face);
                let most = (most - base).max(0.0);
                now.cover(first.triangle(face), most, scratch, |at, distance| {
                    raise(at, base + distance);
                })
            })
        };
        let count = self.faces.len();
        if !in_parallel(|| {
            runs(count).par_iter().cloned().map_init(Scratch::default, cover_run).all(|is_found| is_found)
        }) {
            return false;
        }
        let bound_run = |scratch: &mut Scratch, run: Range<usize>| {
            scratch.last = None;
            for face in run.map(FaceId::from) {
                let known = mesh.deviations[face];
                let mut own = 0f64;
                let is_found = !is_near(known)
                    && first.cover(now.triangle(face), most, scratch, |_, distance| own = own.max(distance));
                raise(face, if is_found { own.min(known.into()) } else { known.into() });
            }
        };
        let count = mesh.corner_vertices.len();
        in_parallel(|| runs(count).par_iter().cloned().for_each_init(Scratch::default, bound_run));
        for (kept, bound) in mesh.deviations.iter_mut().zip(bounds) {
            *kept = rounded_up(f64::from_bits(bound.into_inner()));
        }
        true
    }
}

/// The indices of `count` faces, in runs.
fn runs(count: usize) -> Vec<Range<usize>> {
    (0..count).step_by(RUN_FACES).map(|begin| begin..(begin + RUN_FACES).min(count)).collect()
}

/// Triangles in a box tree.
struct TriangleSurface<'a> {
    vertices: &'a TiSlice<LocalVertex, DVec3>,
    faces: &'a TiSlice<FaceId, [LocalVertex; 3]>,
    /// Added to the distance to each face; `None` stands for 0.
    bases: Option<&'a TiSlice<FaceId, f32>>,
    tree: BoxTree,
}

impl<'a> TriangleSurface<'a> {
    fn new(
        vertices: &'a TiSlice<LocalVertex, DVec3>,
        faces: &'a TiSlice<FaceId, [LocalVertex; 3]>,
        bases: Option<&'a TiSlice<FaceId, f32>>,
    ) -> Self {
        let box_of = |face| Bounds::around(faces[FaceId::new(face)].map(|vertex| vertices[vertex]));
        Self { vertices, faces, bases, tree: BoxTree::new(faces.len(), box_of) }
    }

    fn triangle(&self, face: FaceId) -> [DVec3; 3] {
        self.faces[face].map(|vertex| self.vertices[vertex])
    }

    fn base(&self, face: FaceId) -> f64 {
        self.bases.map_or(0.0, |bases| bases[face].into())
    }

    fn target(&self, face: FaceId) -> CoveredFace {
        CoveredFace { corners: self.triangle(face), base: self.base(face) }
    }

    /// The face nearest to a point, and the distance to it, its base included. Starts from `hint`, and returns it if no
    /// face is nearer. `None` if there are no faces.
    fn nearest(&self, point: DVec3, hint: Option<FaceId>) -> Option<(FaceId, f64)> {
        let mut nearest = hint.map(|face| (face, self.target(face).distance(point)));
        let mut least_sq = nearest.map_or(f64::INFINITY, |(_, distance)| distance * distance);
        self.tree.nearest_sq(point, least_sq, |face| {
            let face = FaceId::new(face);
            if Bounds::around(self.triangle(face)).distance_sq(point) >= least_sq {
                return f64::INFINITY;
            }
            let distance = self.target(face).distance(point);
            if distance * distance < least_sq {
                least_sq = distance * distance;
                nearest = Some((face, distance));
            }
            distance * distance
        });
        nearest
    }

    /// Finds, for every part of a triangle, one of the faces and an upper bound on the part's distance to it, the
    /// face's base included. Returns `false` if the bound of some part exceeds `most`, or cannot be proved to be lower.
    fn cover(
        &self,
        triangle: [DVec3; 3],
        most: f64,
        scratch: &mut Scratch,
        mut found: impl FnMut(FaceId, f64),
    ) -> bool {
        let Scratch { cutter, parts, last } = scratch;
        cutter.points.clear();
        parts.clear();
        parts.push((ConvexPolygon::triangle(triangle.map(|corner| cutter.push(corner))), None));
        let (mut made, mut farthest) = (1, NEAR_SHARE * most);
        while let Some((part, hint)) = parts.pop() {
            let corners = || part.corners().iter().map(|&corner| cutter.point(corner));
            let bound_by = |target: &CoveredFace| corners().map(|corner| target.distance(corner)).fold(0.0, f64::max);
            // Often the face found for the whole is near enough to a part of it.
            let near = hint.map(|face| (face, bound_by(&self.target(face)))).filter(|&(_, bound)| bound <= farthest);
            if let Some((face, bound)) = near {
                found(face, bound);
                continue;
            }
            let middle = corners().sum::<DVec3>() / part.corners().len() as f64;
            let Some((face, distance)) = self.nearest(middle, hint.or(*last)) else { return false };
            *last = Some(face);
            let target = self.target(face);
            let bound = bound_by(&target);
            if bound <= most && (bound <= farthest.max(distance * TIGHT) || made >= PARTS_MAX) {
                farthest = farthest.max(bound);
                found(face, bound);
            } else if made >= PARTS_MAX || distance > most * TIGHT {
                return false;
            } else {
                let before = parts.len();
                if !cutter.cut_along(&part, target.sides(), |part| parts.push((part, Some(face)))) {
                    parts.extend(cutter.halves(&part).map(|half| (half, Some(face))));
                }
                made += parts.len() - before - 1;
            }
        }
        true
    }
}

/// Buffers.
#[derive(Default)]
struct Scratch {
    cutter: Parts,
    /// Parts to be covered, each with the face that was nearest to the part it was cut from.
    parts: Vec<(ConvexPolygon, Option<FaceId>)>,
    /// The face nearest to the previous part.
    last: Option<FaceId>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::chance::{mixed, unit};
    use crate::base::pool::Pool;
    use crate::mesh::cluster::samples;
    use proptest::prelude::*;

    /// A grid of `cells` × `cells` squares with vertex heights of 0 to `height`; all faces are bounded by `bound`.
    fn hills(cells: u32, height: f64, bound: f32, seed: u64) -> ClusterMesh {
        let mut mesh = samples::grid(cells, 0.0);
        for (i, position) in (0..).zip(&mut mesh.positions) {
            position.z = height * unit(mixed(seed ^ i));
        }
        mesh.deviations.fill(bound);
        mesh
    }

    /// The same square, flat, in faces of two cells a side.
    fn coarser(cells: u32, bound: f32) -> ClusterMesh {
        let mut mesh = hills(cells / 2, 0.0, bound, 0);
        mesh.positions.iter_mut().for_each(|position| *position *= 2.0);
        mesh
    }

    fn middles(mesh: &ClusterMesh) -> impl Iterator<Item = DVec3> + '_ {
        mesh.face_ids().map(|face| mesh.triangle(face).into_iter().sum::<DVec3>() / 3.0)
    }

    fn surface<'a>(mesh: &'a ClusterMesh, bases: Option<&'a TiSlice<FaceId, f32>>) -> TriangleSurface<'a> {
        TriangleSurface::new(&mesh.positions, &mesh.corner_vertices, bases)
    }

    #[test]
    fn moves_that_cancel_leave_the_bounds_of_the_first_faces() {
        let first = hills(12, 0.5, 0.25, 7);
        let mut now = first.clone();
        now.deviations.fill(0.9);
        assert!(Anchor::of(&first).tighten(&mut now, 1.0));
        assert!(now.deviations.iter().all(|&bound| bound == 0.25), "{:?}", now.deviations);
    }

    #[test]
    fn a_surface_that_left_the_bound_keeps_what_it_has() {
        let first = hills(12, 0.5, 0.25, 7);
        let mut now = first.clone();
        now.positions.iter_mut().for_each(|position| position.z += 2.0);
        now.deviations.fill(0.9);
        assert!(!Anchor::of(&first).tighten(&mut now, 1.0));
        assert!(now.deviations.iter().all(|&bound| bound == 0.9));
        // Where bounds are small, nothing is recomputed.
        now.deviations.fill(0.5);
        assert!(!Anchor::of(&first).tighten(&mut now, 1.0));
    }

    proptest! {
        #[test]
        fn bounds_are_no_less_than_distances_and_no_more_than_before(
            height in 0.0..0.4, base in 0f32..0.2, seed in any::<u64>(),
        ) {
            let first = hills(16, height, base, seed);
            let mut now = coarser(16, 0.9);
            prop_assert!(Anchor::of(&first).tighten(&mut now, 1.0));
            prop_assert!(now.deviations.iter().all(|&bound| (base..=0.9).contains(&bound)), "{:?}", now.deviations);
            let bound_at = |face: FaceId| f64::from(now.deviations[face]);
            let to_first = surface(&first, Some(&first.deviations));
            for (face, middle) in now.face_ids().zip(middles(&now)) {
                prop_assert!(to_first.nearest(middle, None).unwrap().1 <= bound_at(face) + 1e-9);
            }
            // A point of the input is near some face, within that face's bound.
            for middle in middles(&first) {
                let is_near = now.face_ids().any(|face| {
                    let target = CoveredFace { corners: now.triangle(face), base: f64::from(base) };
                    target.distance(middle) <= bound_at(face) + 1e-9
                });
                prop_assert!(is_near);
            }
        }
    }

    #[test]
    fn bounds_do_not_depend_on_the_threads() {
        let first = hills(40, 0.3, 0.1, 3);
        let bounds = [1, 3].map(|threads| {
            let _threads = Pool::new(threads).unwrap().enter();
            let mut now = coarser(40, 0.9);
            assert!(Anchor::of(&first).tighten(&mut now, 1.0));
            now.deviations
        });
        assert_eq!(bounds[0], bounds[1]);
    }
}

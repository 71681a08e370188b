//! Bounds on deviations, found anew against the surface that a pass began with.
//!
//! A bound that goes from collapse to collapse adds up moves that cancel each other (`deviation.rs`). Here the faces of a
//! cluster as they are now are compared with those that it had at first, both ways:
//!
//! ```text
//! input ── bound of each first face ── first faces ── each part near one face ── faces now
//! ```
//! Every part of a face now is within some distance of one first face, and so within that face's bound more of the input;
//! every part of a first face is within some distance of one face now, which takes the first face's bound along. A part is
//! cut along the sides of the face nearest to its middle, then halved, until its corners, and so all of it, are near
//! enough to one face.
//!
//! # Memory
//! See [`Anchor::with_room`].

use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use super::cover::Target;
use super::parts::{Part, Parts};
use crate::mesh::ClusterMesh;
use crate::mesh::boxtree::{Bounds, BoxTree};
use crate::mesh::cluster::rounded_up;

/// A part this near, as a share of the bound, is near enough.
const NEAR_SHARE: f64 = 0.6;
/// So is one whose bound exceeds the distance of its middle by no more than this factor.
const TIGHT: f64 = 1.2;
/// Parts that a triangle is cut into, at most.
const PARTS_MAX: usize = 4096;
/// With fewer faces than this share that are not near enough by the bounds they have, nothing is gained.
const FAR_SHARE_MIN: f64 = 0.1;

/// The surface that a cluster had at first.
#[derive(Debug)]
pub struct Anchor {
    vertices: Vec<DVec3>,
    faces: Vec<[u32; 3]>,
    bounds: Vec<f32>,
}

impl Anchor {
    /// Keeps the living faces of a cluster and their bounds.
    pub fn of(mesh: &ClusterMesh) -> Self {
        let living = || (0..mesh.corners.len() as u32).filter(|&face| !mesh.is_dead(face));
        Self {
            vertices: mesh.positions.clone(),
            faces: living().map(|face| mesh.vertices(face)).collect(),
            bounds: living().map(|face| mesh.deviations[face as usize]).collect(),
        }
    }

    /// Memory of a cluster of so many bytes together with its anchor: 28 bytes of a face of 200, and 32 more while bounds
    /// are found.
    pub fn with_room(cluster_bytes: u64) -> u64 {
        cluster_bytes + cluster_bytes / 3
    }

    /// Number of its faces.
    pub fn face_count(&self) -> usize {
        self.faces.len()
    }

    /// Gives the faces of what the cluster has become the bounds that follow from where they lie, none above `most`;
    /// returns whether it did: not where little would be gained, nor where a first face lies too far from what has become
    /// of it. The mesh must have no dead faces.
    pub fn tighten(&self, mesh: &mut ClusterMesh, most: f64) -> bool {
        let is_near = |bound: f32| f64::from(bound) <= NEAR_SHARE * most;
        let far_count = mesh.deviations.iter().filter(|&&bound| !is_near(bound)).count();
        if (far_count as f64) < FAR_SHARE_MIN * mesh.deviations.len() as f64 {
            return false;
        }
        let now = Surface::new(&mesh.positions, &mesh.corner_vertices, None);
        let first = Surface::new(&self.vertices, &self.faces, Some(&self.bounds));
        // Distances are not negative, so that their bits have the order of their values.
        let bounds: Vec<AtomicU64> = mesh.deviations.iter().map(|_| AtomicU64::new(0)).collect();
        let raise = |face: u32, bound: f64| bounds[face as usize].fetch_max(bound.to_bits(), Ordering::Relaxed);
        let all_found = (0..self.faces.len() as u32).into_par_iter().map_init(Scratch::default, |scratch, face| {
            let base = first.base(face);
            now.cover(first.triangle(face), (most - base).max(0.0), scratch, |at, distance| {
                raise(at, base + distance);
            })
        });
        if !all_found.all(|is_found| is_found) {
            return false;
        }
        (0..mesh.corner_vertices.len() as u32).into_par_iter().for_each_init(Scratch::default, |scratch, face| {
            let known = mesh.deviations[face as usize];
            let mut own = 0f64;
            let is_found = !is_near(known)
                && first.cover(now.triangle(face), most, scratch, |_, distance| own = own.max(distance));
            raise(face, if is_found { own.min(known.into()) } else { known.into() });
        });
        for (kept, bound) in mesh.deviations.iter_mut().zip(bounds) {
            *kept = rounded_up(f64::from_bits(bound.into_inner()));
        }
        true
    }
}

/// Triangles by place.
struct Surface<'a> {
    vertices: &'a [DVec3],
    faces: &'a [[u32; 3]],
    /// What is added to the distance of each, if anything.
    bases: Option<&'a [f32]>,
    tree: BoxTree,
}

impl<'a> Surface<'a> {
    fn new(vertices: &'a [DVec3], faces: &'a [[u32; 3]], bases: Option<&'a [f32]>) -> Self {
        let box_of = |face: u32| Bounds::around(faces[face as usize].map(|vertex| vertices[vertex as usize]));
        Self { vertices, faces, bases, tree: BoxTree::new(faces.len(), box_of) }
    }

    fn triangle(&self, face: u32) -> [DVec3; 3] {
        self.faces[face as usize].map(|vertex| self.vertices[vertex as usize])
    }

    fn base(&self, face: u32) -> f64 {
        self.bases.map_or(0.0, |bases| bases[face as usize].into())
    }

    fn target(&self, face: u32) -> Target {
        Target { corners: self.triangle(face), base: self.base(face) }
    }

    /// The face nearest to a point, its base included, and how far it is; none is looked for that is farther than `hint`, or
    /// nearly as far.
    fn nearest(&self, point: DVec3, hint: Option<u32>) -> Option<(u32, f64)> {
        let mut nearest = hint.map(|face| (face, self.target(face).distance(point)));
        let mut least_sq = nearest.map_or(f64::INFINITY, |(_, distance)| distance * distance);
        self.tree.nearest_sq(point, least_sq, |face| {
            let distance = self.target(face).distance(point);
            if distance * distance < least_sq {
                least_sq = distance * distance;
                nearest = Some((face, distance));
            }
            distance * distance
        });
        nearest
    }

    /// Finds for every part of a triangle one of the faces and how far the part is from it, at most, the face's base
    /// included. Returns false if that would be more than `most` for some part, or cannot be shown to be less.
    fn cover(&self, triangle: [DVec3; 3], most: f64, scratch: &mut Scratch, mut found: impl FnMut(u32, f64)) -> bool {
        let Scratch { cutter, parts } = scratch;
        cutter.points.clear();
        parts.clear();
        parts.push((Part::triangle(triangle.map(|corner| cutter.push(corner))), None));
        let (mut made, mut farthest) = (1, NEAR_SHARE * most);
        while let Some((part, hint)) = parts.pop() {
            let corners = || part.corners().iter().map(|&corner| cutter.point(corner));
            let bound_by = |target: &Target| corners().map(|corner| target.distance(corner)).fold(0.0, f64::max);
            // What the part before was near is often near enough to this one.
            let near = hint.map(|face| (face, bound_by(&self.target(face)))).filter(|&(_, bound)| bound <= farthest);
            if let Some((face, bound)) = near {
                found(face, bound);
                continue;
            }
            let middle = corners().sum::<DVec3>() / part.corners().len() as f64;
            let Some((face, distance)) = self.nearest(middle, hint) else { return false };
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

/// Space that is used again.
#[derive(Default)]
struct Scratch {
    cutter: Parts,
    parts: Vec<(Part, Option<u32>)>,
}

//! Relocation at the end of a stage: a vertex that others collapsed onto moves to its position of least error, and its
//! texture coordinates move along.
//!
//! In: a vertex, and the metric's state for it. Out: its position, and the texture coordinate of each of its wedges.
//! Inside a chart both have the least error. On a seam or border the best texture coordinate may lie outside its chart,
//! where the texture image holds padding, and farther out other content. It then returns half of the way, or more where
//! it would stay far outside, and the position is recomputed.
//!
//! ```text
//!            w            w: the texture coordinate of least error
//!    a ____!____ b        !: the one taken, half-way to the faces of the wedge
//!      \   |   /
//!        \ | /            the chart
//! ```

use glam::{DVec2, DVec3};

use super::deviation::Patches;
use super::fold::FoldCheck;
use super::refusal::Refusal;
use super::triangle_change::{change_of, doubled_uv_area, uv_survives};
use crate::cost::{Metric, MovingWedge};
use crate::geometry::closest_weights;
use crate::mesh::class::Class;
use crate::mesh::cluster::{ClusterMesh, flag};
use crate::mesh::id::{LocalVertex, Wedge};
use crate::mesh::ring::Rings;

/// Shares of the best step that are tried, in this order.
const SHARES: [f64; 2] = [1.0, 0.5];
/// Share of the way back to its chart that a texture coordinate returns at least; the metric's `inset` raises it up to
/// 1.
const LEAST_RETURN: f64 = 0.5;
/// Largest distance outside the chart, relative to the square root of the texture area of the wedge's faces. Farther
/// out, black padding shows as specks along seams.
const REACH: f64 = 0.1;

/// A vertex is relocated only while the faces around it stay below this share of the largest deviation allowed. A move
/// back towards the input also increases the bound, and later collapses lack what it uses up.
const DEVIATION_SHARE: f64 = 0.25;

/// Relocates vertices; holds only buffers.
#[derive(Debug, Default)]
pub struct Relocator {
    wedges: Vec<MovingWedge>,
    uvs: Vec<DVec2>,
    patches: Patches,
    folds: FoldCheck,
}

impl Relocator {
    /// Moves a vertex to its position of least error, or half-way there, if no face around it folds over, and if none
    /// deviates from the input by more than a share of `deviation_max`, in units of length. Otherwise the vertex stays.
    pub fn relocate<M: Metric>(
        &mut self,
        mesh: &mut ClusterMesh,
        rings: &Rings,
        cost: &M,
        vertex: LocalVertex,
        class: Class,
        deviation_max: Option<f64>,
    ) {
        let is_inside_chart = class == Class::Smooth;
        self.gather(mesh, rings, vertex, is_inside_chart);
        let Some(mut best) = cost.best_step(vertex, &self.wedges) else { return };
        if !is_inside_chart && self.hold_back(mesh, rings, cost, vertex, best) {
            let Some(step) = cost.best_step(vertex, &self.wedges) else { return };
            best = step;
        }
        for share in SHARES {
            let step = share * best;
            let position = mesh.positions[vertex] + step;
            self.uvs.clear();
            self.uvs.extend(self.wedges.iter().map(|&MovingWedge { wedge, slide }| {
                let slide = slide.map_or_else(|| cost.best_slide(wedge, step), |slide| share * slide);
                mesh.wedge_uv[wedge] + slide
            }));
            if self.fits(mesh, rings, vertex, class == Class::Complex, position)
                && self.keeps_deviation(mesh, rings, vertex, position, deviation_max).is_ok()
            {
                self.apply(mesh, vertex, position);
                return;
            }
        }
    }

    /// Collects the wedges of a vertex, all without a fixed slide. `has_one` says that it has a single wedge.
    fn gather(&mut self, mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex, has_one: bool) {
        let corners = rings.of(vertex);
        let corners = if has_one { &corners[..1] } else { corners };
        self.wedges.clear();
        for &corner in corners {
            let wedge = mesh.wedge_of(corner);
            if self.place_of(wedge).is_none() {
                self.wedges.push(MovingWedge { wedge, slide: None });
            }
        }
    }

    fn place_of(&self, wedge: Wedge) -> Option<usize> {
        self.wedges.iter().position(|moving| moving.wedge == wedge)
    }

    /// Fixes the slide of the wedges that would leave their charts; returns whether there are any.
    fn hold_back<M: Metric>(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        cost: &M,
        vertex: LocalVertex,
        step: DVec3,
    ) -> bool {
        let share = LEAST_RETURN + (1.0 - LEAST_RETURN) * cost.inset();
        for MovingWedge { wedge, slide } in &mut self.wedges {
            let here = mesh.wedge_uv[*wedge];
            let wanted = here + cost.best_slide(*wedge, step);
            if let Some(RimPoint { place, fan_area }) = way_back(mesh, rings, vertex, *wedge, wanted) {
                let way = wanted - place;
                let reach = REACH * fan_area.sqrt() / way.length();
                *slide = Some(place + way * reach.min(1.0 - share) - here);
            }
        }
        self.wedges.iter().any(|moving| moving.slide.is_some())
    }

    /// Whether no face around the vertex folds over or degenerates, on the surface or in texture space.
    fn fits(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        vertex: LocalVertex,
        is_complex: bool,
        position: DVec3,
    ) -> bool {
        // Faces at non-manifold vertices may run along an edge in the same direction.
        self.folds.begin(is_complex || mesh.is_near_fold(vertex));
        for &corner in rings.of(vertex) {
            let (face, k) = (corner.face(), corner.index_in_face());
            let (before, uv_before) = (mesh.triangle(face), mesh.uv_triangle(face));
            let (mut after, mut uv_after) = (before, uv_before);
            after[k] = position;
            if let Some(i) = self.place_of(mesh.wedge_of(corner)) {
                uv_after[k] = self.uvs[i];
            }
            let Some(change) = change_of(before, after) else { return false };
            if !uv_survives(uv_before, uv_after, change.areas_sq) {
                return false;
            }
            self.folds.push(corner, &change);
        }
        !self.folds.finds(mesh, rings, &[], None, position)
    }

    /// Updates the bounds of the faces around the vertex, if deviations are bounded.
    ///
    /// # Errors
    /// [`Refusal::Deviation`] if a bound would exceed its limit; the bounds are then unchanged.
    fn keeps_deviation(
        &mut self,
        mesh: &mut ClusterMesh,
        rings: &Rings,
        vertex: LocalVertex,
        position: DVec3,
        deviation_max: Option<f64>,
    ) -> Result<(), Refusal> {
        let Some(most) = deviation_max else { return Ok(()) };
        self.patches.clear();
        for &corner in rings.of(vertex) {
            let mut triangle = mesh.triangle(corner.face());
            self.patches.push_old(triangle, mesh.deviations[corner.face()]);
            triangle[corner.index_in_face()] = position;
            self.patches.push_new(triangle);
        }
        for (&corner, bound) in rings.of(vertex).iter().zip(self.patches.bound(DEVIATION_SHARE * most)?) {
            mesh.deviations[corner.face()] = bound;
        }
        Ok(())
    }

    fn apply(&self, mesh: &mut ClusterMesh, vertex: LocalVertex, position: DVec3) {
        mesh.positions[vertex] = position;
        mesh.flags[vertex] |= flag::MOVED;
        for (moving, &uv) in self.wedges.iter().zip(&self.uvs) {
            mesh.wedge_uv[moving.wedge] = uv;
            mesh.wedge_moved[moving.wedge] = true;
        }
    }
}

/// The point of a wedge's faces in texture space that is closest to a texture coordinate outside of them.
#[derive(Debug, PartialEq)]
struct RimPoint {
    place: DVec2,
    /// Texture area of these faces.
    fan_area: f64,
}

/// The closest point of a wedge's faces to a texture coordinate; `None` if it lies inside them, or if they have no
/// texture.
fn way_back(mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex, wedge: Wedge, uv: DVec2) -> Option<RimPoint> {
    let mut best: Option<(f64, DVec2)> = None;
    let mut fan_area = 0.0;
    for &corner in rings.of(vertex).iter().filter(|&&corner| mesh.living(corner) == Some(wedge)) {
        let triangle = mesh.uv_triangle(corner.face());
        let weights = closest_weights(uv.extend(0.0), triangle.map(|t| t.extend(0.0)));
        if weights.iter().all(|&weight| weight > 0.0) {
            return None;
        }
        let at = triangle[0] * weights[0] + triangle[1] * weights[1] + triangle[2] * weights[2];
        let distance_sq = at.distance_squared(uv);
        fan_area += 0.5 * doubled_uv_area(triangle).abs();
        if at.is_finite() && best.is_none_or(|(least, _)| distance_sq < least) {
            best = Some((distance_sq, at));
        }
    }
    best.filter(|(distance_sq, _)| *distance_sq > 0.0).map(|(_, place)| RimPoint { place, fan_area })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::samples;
    use crate::mesh::id::short::{v, w};

    #[test]
    fn what_leaves_the_faces_around_a_wedge_comes_back_to_their_rim() {
        let mesh = samples::grid(4, 0.0);
        let mut rings = Rings::default();
        rings.build(&mesh);
        let back = |at, by: DVec2| way_back(&mesh, &rings, v(at), w(at), mesh.wedge_uv[w(at)] + 0.1 * by);
        assert_eq!(back(12, DVec2::new(0.2, 0.3)), None);
        assert_eq!(back(2, DVec2::ZERO), None);
        let far = back(12, DVec2::new(0.0, 9.0)).unwrap();
        assert_eq!(far.place, mesh.wedge_uv[w(17)]);
        assert!((far.fan_area - 0.03).abs() < 1e-12);
        let beside = back(2, DVec2::new(0.0, -0.4)).unwrap();
        assert_eq!(beside.place, mesh.wedge_uv[w(2)]);
    }

    #[test]
    fn a_wedge_without_a_texture_has_no_way_back() {
        let mut mesh = samples::grid(4, 0.0);
        mesh.wedge_uv.fill(DVec2::NAN);
        let mut rings = Rings::default();
        rings.build(&mesh);
        assert_eq!(way_back(&mesh, &rings, v(12), w(12), DVec2::NAN), None);
    }
}

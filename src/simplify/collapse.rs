//! One edge collapse: checks a candidate, and changes the mesh or returns the reason for refusal.

use glam::{DVec2, DVec3, Vec2};

use super::deviation::Patches;
use super::edge_star::{EdgeStar, VanishingFan};
use super::last_faces::LastFaces;
use super::refusal::Refusal;
use super::shape_rule::ShapeRule;
use super::texture::{insets, uv_on_chain, uv_on_ring};
use crate::cost::{EdgeCase, Metric};
use crate::mesh::cluster::{ClusterMesh, flag};
use crate::mesh::id::{Corner, Edge, FaceId, LocalVertex};
use crate::mesh::ring::{Rings, VALENCE_MAX};

/// Faces, at most, that stand for an isolated face that vanishes: a hub has too many for each.
const KEPT_MAX: usize = 2 * VALENCE_MAX;

/// A collapse candidate.
#[derive(Debug, Clone, Copy)]
pub struct Collapse {
    /// The vertex that vanishes.
    pub from: LocalVertex,
    /// The vertex that stays.
    pub to: LocalVertex,
    /// Whether `to` keeps its texture coordinates.
    pub onto: bool,
    /// Whether `to` also keeps its position.
    pub stays: bool,
    /// Whether the edge lies on a seam or border that both ends follow.
    pub chain: bool,
    /// Properties of the faces around `from`. If these may strand wedges, the wedges move to `to` with their texture
    /// coordinates.
    pub fan: VanishingFan,
    /// Cost in area × squared distance; infinite if the metric has another unit.
    pub cost: f64,
    /// Largest number of faces that may die.
    pub dying_max: usize,
    /// A vertex of the surface nearest to an isolated face that is to vanish.
    pub neighbour: Option<LocalVertex>,
    /// Share of the overhang of the chain beyond its charts by which the texture coordinates of `to` move into the
    /// charts, 0 to 1.
    pub inset: f64,
}

/// Collapses edges of one mesh.
#[derive(Debug, Default)]
pub struct Collapser {
    star: EdgeStar,
    uvs: Vec<DVec2>,
    patches: Patches,
    last_faces: LastFaces,
    /// Faces that change and stay; if none does, faces that stand for those that vanish.
    changed: Vec<FaceId>,
    /// Largest deviation from the input allowed, in units of length; `None` if it is not bounded.
    pub deviation_max: Option<f64>,
}

impl Collapser {
    /// Vertices whose classes may have changed, because the last collapse changed the topology.
    pub fn unsettled(&self) -> &[LocalVertex] {
        &self.star.unsettled
    }

    /// What changed faces must not do.
    pub fn shape_rule(&self) -> ShapeRule {
        self.star.shape_rule
    }

    /// Changes what changed faces must not do.
    pub fn set_shape_rule(&mut self, rule: ShapeRule) {
        self.star.shape_rule = rule;
    }

    /// Non-manifold edges (more than two faces) that the last collapse created, minus those that it resolved.
    pub fn new_non_manifold_edges(&self) -> i64 {
        self.star.new_non_manifold_edges
    }

    /// Prepares for a mesh without dead faces.
    pub fn reset(&mut self, mesh: &ClusterMesh) {
        self.star.reset(mesh.positions.len());
        self.last_faces.count(mesh);
    }

    /// Collapses the edge and returns how many faces died.
    ///
    /// # Errors
    /// The reason for refusal; the mesh is then unchanged.
    pub fn try_collapse<M: Metric>(
        &mut self,
        mesh: &mut ClusterMesh,
        rings: &Rings,
        cost: &mut M,
        collapse: Collapse,
    ) -> Result<usize, Refusal> {
        let Collapse { from, to, onto, stays, .. } = collapse;
        self.star.gather(mesh, rings, from, to);
        self.star.check_topology(mesh, rings, from, to, collapse.fan)?;
        if self.star.dying.len() > collapse.dying_max
            || (M::ENDPOINTS && self.last_faces.are_last(mesh, &self.star.dying))
        {
            return Err(Refusal::Piece);
        }
        let insets = insets(mesh, rings, collapse.inset, Edge { from, to }, &self.star.wedges);
        let position =
            cost.place(mesh, &EdgeCase { from, to, onto, stays, wedges: &self.star.wedges, insets }).position;
        self.choose_uvs(mesh, rings, cost, collapse, position)?;
        self.uvs.iter_mut().zip(insets).for_each(|(uv, inset)| *uv += inset.as_dvec2());
        let collapse = Collapse { onto: onto && insets == [Vec2::ZERO; 2], ..collapse };
        let moving = if stays && collapse.onto { &[from][..] } else { &[from, to][..] };
        if cost.has_guards() {
            self.star.check_faces(mesh, rings, moving, position, &self.uvs, collapse.cost)?;
        }
        self.bound_deviation(mesh, rings, collapse, position)?;
        let edge = EdgeCase { from, to, onto, stays, wedges: &self.star.wedges, insets };
        cost.join(mesh, &edge);
        self.star.stranded.iter().for_each(|&wedge| cost.bring(mesh, &edge, wedge));
        Ok(self.apply(mesh, rings, collapse, position))
    }

    /// Computes the new texture coordinate of each wedge pair.
    ///
    /// # Errors
    /// [`Refusal::Seam`] if the chain cannot be followed.
    fn choose_uvs<M: Metric>(
        &mut self,
        mesh: &ClusterMesh,
        rings: &Rings,
        cost: &M,
        collapse: Collapse,
        position: DVec3,
    ) -> Result<(), Refusal> {
        let Collapse { from, to, onto, stays, .. } = collapse;
        let wedges = &self.star.wedges;
        self.uvs.clear();
        if onto {
            self.uvs.extend(wedges.iter().map(|pair| mesh.wedge_uv[pair.to]));
        } else if cost.texcoords(
            mesh,
            &EdgeCase { from, to, onto, stays, wedges, insets: [Vec2::ZERO; 2] },
            position,
            &mut self.uvs,
        ) {
            return Ok(());
        } else if collapse.chain {
            uv_on_chain(mesh, rings, Edge { from, to }, wedges, position, &mut self.uvs).ok_or(Refusal::Seam)?;
        } else {
            let kept = wedges.first().map_or(DVec2::NAN, |pair| mesh.wedge_uv[pair.to]);
            let uv = uv_on_ring(mesh, rings, &[from, to], position).unwrap_or(kept);
            self.uvs.resize(wedges.len(), uv);
        }
        Ok(())
    }

    /// Sets the bounds of the new faces, if deviations are bounded.
    ///
    /// # Errors
    /// [`Refusal::Deviation`] if a bound would exceed the limit; the mesh is then unchanged.
    fn bound_deviation(
        &mut self,
        mesh: &mut ClusterMesh,
        rings: &Rings,
        collapse: Collapse,
        position: DVec3,
    ) -> Result<(), Refusal> {
        let Some(most) = self.deviation_max else { return Ok(()) };
        self.patches.clear();
        self.changed.clear();
        for (corner, is_dying) in changing_corners(&self.star, mesh, rings, collapse) {
            let face = corner.face();
            let mut triangle = mesh.triangle(face);
            self.patches.push_old(triangle, mesh.deviations[face]);
            if !is_dying {
                triangle[corner.index_in_face()] = position;
                self.patches.push_new(triangle);
                self.changed.push(face);
            }
        }
        // Where the topology changes, faces of `to` alone may die, too.
        let at_to = |&&face: &&FaceId| !mesh.vertices(face).contains(&collapse.from);
        for &face in self.star.dying.iter().filter(at_to) {
            self.patches.push_old(mesh.triangle(face), mesh.deviations[face]);
        }
        if self.changed.is_empty() {
            let beside = rings.faces(mesh, collapse.neighbour.unwrap_or(collapse.to));
            for face in beside.filter(|face| !self.star.dying.contains(face)).take(KEPT_MAX) {
                self.patches.push_kept(mesh.triangle(face), mesh.deviations[face]);
                self.changed.push(face);
            }
        }
        for (&face, bound) in self.changed.iter().zip(self.patches.bound(most)?) {
            mesh.deviations[face] = bound;
        }
        Ok(())
    }

    fn apply(&mut self, mesh: &mut ClusterMesh, rings: &Rings, collapse: Collapse, position: DVec3) -> usize {
        let Collapse { from, to, .. } = collapse;
        self.star.apply(mesh, rings, from, to);
        mesh.flags[to] |= mesh.flags[from] & flag::FOLDS;
        if !collapse.stays && mesh.positions[to] != position {
            mesh.flags[to] |= flag::MOVED;
            mesh.positions[to] = position;
        }
        if !collapse.onto {
            for (pair, &uv) in self.star.wedges.iter().zip(&self.uvs) {
                mesh.wedge_uv[pair.to] = uv;
                mesh.wedge_moved[pair.to] = true;
            }
        }
        self.last_faces.remove(mesh, &self.star.dying);
        self.star.dying.len()
    }
}

/// Corners of living faces that change, at the vertex that vanishes or moves, and whether their faces die. A dying face
/// occurs once.
fn changing_corners<'a>(
    star: &'a EdgeStar,
    mesh: &'a ClusterMesh,
    rings: &'a Rings,
    collapse: Collapse,
) -> impl Iterator<Item = (Corner, bool)> + 'a {
    let living = move |vertex: LocalVertex| rings.living(mesh, vertex);
    let is_dying = |corner: Corner| star.dying.contains(&corner.face());
    let at_to = living(collapse.to).filter(move |&corner| !collapse.stays && !is_dying(corner));
    living(collapse.from).map(move |corner| (corner, is_dying(corner))).chain(at_to.map(|corner| (corner, false)))
}

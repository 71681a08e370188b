//! The tree of tiles: a kd-tree of nested planes, the same for all levels.
//!
//! ```text
//!   +-----+-----------+       A level takes the nodes whose part of its mesh fits a tile: large ones of a coarse level,
//!   |  .  |   .       |       small ones of a fine level. Each of them is a node of the next coarser level, or lies
//!   |.  . +-----+-----+       inside of one.
//!   |  .  | . . | .   |
//!   +-----+-----+-----+       . points, as many on each triangle as it takes of a tile
//! ```
//! In: the surface of the input. Out: planes. Invariant: no plane goes through a place of the lattice of any level.
//!
//! # Memory
//! 24 bytes for each of up to [`POINTS_MAX`] points; 24 bytes a node.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::lattice::Lattice;
use super::scene::TileScene;
use crate::base::Result;
use crate::base::chance;
use crate::base::id::{TiVec, ids};
use crate::geometry::boxtree::Bounds;
use crate::geometry::triangle::{area, unit_normal};
use crate::surface::cells::SurfaceCells;

/// Points for each tile of the finest level, unless these are more than [`POINTS_MAX`].
const POINTS_OF_TILE: f64 = 128.0;
/// Points in all.
const POINTS_MAX: f64 = (1u32 << 20) as f64;
/// A node is split until it holds no more than this share of a tile.
const LEAF_SHARE: f64 = 1.0 / 16.0;
/// A plane goes through the middle of its node: this share of the points lies on either side at least.
const SIDE_SHARE: f64 = 0.4;
/// Places of a plane that are tried.
const PLACES_TRIED: usize = 24;
/// A surface that lies along a plane this near, by the size of the node or in texels of the finest level, may be on the
/// other side of it in another level.
const NEAR_SHARE: f64 = 0.01;
const NEAR_TEXELS: f64 = 8.0;
/// A surface lies along a plane if the cosine of the angle between their normals is above this.
const ALONG_COSINE: f32 = 0.5;
/// Nodes below each other at most.
const DEPTH_MAX: usize = 48;

ids! {
    /// A node of the tree.
    TileId;
}

/// The node that holds all others.
pub const ROOT: TileId = TileId::new(0);

/// A node.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum TileNode {
    /// What lies below the plane is in the node `below`, the rest in the one after it.
    Split {
        /// Axis that is normal to the plane.
        axis: u8,
        /// Where the plane lies on it, relative to the origin of the scene.
        plane: f64,
        /// The lower child.
        below: TileId,
    },
    /// A node without children.
    Leaf,
}

/// The tree of tiles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TileTree {
    /// Its nodes; children come after their parent.
    pub nodes: TiVec<TileId, TileNode>,
}

/// What a tile may hold.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TileLimits {
    /// Triangles.
    pub faces: u64,
    /// Area, in texels squared.
    pub texels: f64,
}

impl TileTree {
    /// Plants the tree for the surface of the input.
    ///
    /// # Errors
    /// On failed reads.
    pub fn plant(surface: &SurfaceCells, scene: &TileScene, limits: &TileLimits) -> Result<Self> {
        let texel = scene.texel;
        let share = |area: f64| (1.0 / limits.faces as f64).max(area / (texel * texel * limits.texels));
        // Each triangle takes at most the sum of both shares.
        let tiles =
            surface.face_count() as f64 / limits.faces as f64 + surface.area() / (texel * texel * limits.texels);
        let each = POINTS_OF_TILE.min(POINTS_MAX / tiles.max(f64::MIN_POSITIVE));
        let mut points = Vec::new();
        let (mut carried, mut number) = (0.5, 0);
        for cell in &surface.cells {
            let view = cell.view()?;
            let shift = view.origin - scene.origin;
            for face in 0..view.faces.len() as u32 {
                let corners = view.triangle(face);
                let normal = unit_normal(corners).as_vec3();
                carried += share(area(corners)) * each;
                while carried >= 1.0 {
                    carried -= 1.0;
                    number += 1;
                    let [across, along] = [0, 1].map(|stream| chance::of_stream(0, number, stream));
                    let [a, b, c] = chance::place_on_triangle(across, along);
                    let position = (shift + corners[0] * a + corners[1] * b + corners[2] * c).as_vec3();
                    points.push(TreePoint { position, normal });
                }
            }
        }
        let mut tree = Self { nodes: vec![TileNode::Leaf].into() };
        let leaf_points = ((each * LEAF_SHARE) as usize).max(2);
        let how = Splitting { leaf_points, lattice: scene.lattice(0), near: NEAR_TEXELS * texel };
        tree.split(ROOT, &mut points, &how, 0);
        Ok(tree)
    }

    fn split(&mut self, node: TileId, points: &mut [TreePoint], how: &Splitting, depth: usize) {
        if points.len() <= how.leaf_points || depth == DEPTH_MAX {
            return;
        }
        let bounds = Bounds::around(points.iter().map(|point| point.position.as_dvec3()));
        let size = bounds.high - bounds.low;
        let axis = (0..3).fold(0, |longest, axis| if size[axis] > size[longest] { axis } else { longest });
        let plane = how.plane(points, axis, size[axis]);
        let (below, above) = partition_by(points, |point| f64::from(point.position[axis]) < plane);
        if below.is_empty() || above.is_empty() {
            return;
        }
        let first = self.nodes.push_and_get_key(TileNode::Leaf);
        self.nodes.push(TileNode::Leaf);
        self.nodes[node] = TileNode::Split { axis: axis as u8, plane, below: first };
        self.split(first, below, how, depth + 1);
        self.split(first.plus(1), above, how, depth + 1);
    }

    /// The children of a node.
    pub fn children(&self, node: TileId) -> Option<[TileId; 2]> {
        match self.nodes[node] {
            TileNode::Split { below, .. } => Some([below, below.plus(1)]),
            TileNode::Leaf => None,
        }
    }

    /// Reports whether a recalled value is a tree.
    pub fn is_tree(&self) -> bool {
        let is_child = |(node, kind): (TileId, &TileNode)| match *kind {
            TileNode::Split { axis, plane, below } => {
                axis < 3 && plane.is_finite() && below > node && below.index() + 1 < self.nodes.len()
            }
            TileNode::Leaf => true,
        };
        !self.nodes.is_empty() && self.nodes.iter_enumerated().all(is_child)
    }
}

struct Splitting {
    /// Points up to which a node is a leaf.
    leaf_points: usize,
    /// The finest lattice.
    lattice: Lattice,
    /// How near a surface is, at least, that may be on the other side of a plane in another level.
    near: f64,
}

/// A point of the surface.
#[derive(Debug, Clone, Copy)]
struct TreePoint {
    /// Relative to the origin of the scene.
    position: Vec3,
    normal: Vec3,
}

impl Splitting {
    /// A plane near the middle of some points, away from what lies along it: such a surface may be on one side of the
    /// plane in a level, on the other in the next one, and in neither tile while both levels are shown.
    fn plane(&self, points: &mut [TreePoint], axis: usize, size: f64) -> f64 {
        let mut quantile = |share: f64| {
            let rank = (share * (points.len() - 1) as f64).round() as usize;
            let order = |a: &TreePoint, b: &TreePoint| a.position[axis].total_cmp(&b.position[axis]);
            f64::from(points.select_nth_unstable_by(rank, order).1.position[axis])
        };
        let [low, median, high] = [SIDE_SHARE, 0.5, 1.0 - SIDE_SHARE].map(&mut quantile);
        let near = self.near.max(NEAR_SHARE * size);
        let mut along: Vec<f64> = points
            .iter()
            .filter(|point| point.normal[axis].abs() > ALONG_COSINE)
            .map(|point| f64::from(point.position[axis]))
            .filter(|at| (low - near..=high + near).contains(at))
            .collect();
        along.sort_unstable_by(f64::total_cmp);
        let count_near = |plane: f64| {
            along.partition_point(|&at| at <= plane + near) - along.partition_point(|&at| at < plane - near)
        };
        let places = (0..=PLACES_TRIED).map(|place| low + (high - low) * place as f64 / PLACES_TRIED as f64);
        let best = std::iter::once(median).chain(places).map(|place| self.lattice.between(place));
        let cost = |&plane: &f64| (count_near(plane), (plane - median).abs());
        best.min_by(|a, b| {
            let ((a_near, a_off), (b_near, b_off)) = (cost(a), cost(b));
            a_near.cmp(&b_near).then(a_off.total_cmp(&b_off))
        })
        .unwrap_or(median)
    }
}

/// Moves the items that `belongs` accepts to the front; returns both parts.
fn partition_by<T>(items: &mut [T], belongs: impl Fn(&T) -> bool) -> (&mut [T], &mut [T]) {
    let mut count = 0;
    for at in 0..items.len() {
        if belongs(&items[at]) {
            items.swap(at, count);
            count += 1;
        }
    }
    items.split_at_mut(count)
}

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
//! 12 bytes for each of up to [`POINTS_MAX`] points; 24 bytes a node.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::lattice::Lattice;
use super::scene::TileScene;
use crate::base::Result;
use crate::base::chance;
use crate::base::id::{TiVec, ids};
use crate::geometry::boxtree::Bounds;
use crate::geometry::triangle::area;
use crate::surface::cells::SurfaceCells;

/// Points for each tile of the finest level, unless these are more than [`POINTS_MAX`].
const POINTS_OF_TILE: f64 = 128.0;
/// Points in all.
const POINTS_MAX: f64 = (1u32 << 20) as f64;
/// A node is split until it holds no more than this share of a tile.
const LEAF_SHARE: f64 = 1.0 / 16.0;
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
                carried += share(area(corners)) * each;
                while carried >= 1.0 {
                    carried -= 1.0;
                    number += 1;
                    let [across, along] = [0, 1].map(|stream| chance::of_stream(0, number, stream));
                    let [a, b, c] = chance::place_on_triangle(across, along);
                    points.push((shift + corners[0] * a + corners[1] * b + corners[2] * c).as_vec3());
                }
            }
        }
        let mut tree = Self { nodes: vec![TileNode::Leaf].into() };
        let leaf_points = ((each * LEAF_SHARE) as usize).max(2);
        tree.split(ROOT, &mut points, &Splitting { leaf_points, lattice: scene.lattice(0) }, 0);
        Ok(tree)
    }

    fn split(&mut self, node: TileId, points: &mut [Vec3], how: &Splitting, depth: usize) {
        if points.len() <= how.leaf_points || depth == DEPTH_MAX {
            return;
        }
        let bounds = Bounds::around(points.iter().map(|point| point.as_dvec3()));
        let size = bounds.high - bounds.low;
        let axis = (0..3).fold(0, |longest, axis| if size[axis] > size[longest] { axis } else { longest });
        let middle = points.len() / 2;
        let (_, median, _) = points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
        let plane = how.lattice.between(f64::from(median[axis]));
        let (below, above) = partition_by(points, |point| f64::from(point[axis]) < plane);
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

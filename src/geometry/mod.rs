//! Triangles and boxes in space: measures, closest points, and search trees.
//!
//! These modules do not depend on meshes, files or thread budgets.

pub mod boxtree;
mod closest;
mod position;
pub mod tilted;
pub mod triangle;
pub mod triangle_tree;

pub use closest::{closest_point, closest_weights, distance_sq};
pub use position::position_key;

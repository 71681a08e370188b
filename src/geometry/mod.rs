//! Triangles and boxes in space: measures, closest points, and the trees that find them.
//!
//! Nothing here knows of meshes, files or threads' budgets.

pub mod boxtree;
mod closest;
mod position;
pub mod tilted;
pub mod triangle;
pub mod triangle_tree;

pub use closest::{closest_point, closest_weights, distance_sq};
pub use position::position_key;

//! The surface of a mesh in cells of neighbouring triangles, each with a search tree, out of core: what comparisons
//! search for closest points, and bakes for colours.

pub mod cell;
pub mod cells;
pub mod order;

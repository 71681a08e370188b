//! Simplifies textured triangle meshes larger than memory.

pub mod base;
pub mod cost;
pub mod measure;
pub mod mesh;
pub mod os;
pub mod partition;
pub mod scan;
pub mod simplify;
pub mod stitch;
pub mod store;
pub mod write;

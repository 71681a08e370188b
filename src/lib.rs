//! Simplifies textured triangle meshes larger than memory.

pub mod base;
pub mod os;
pub mod store;
pub mod scan;
pub mod mesh;
pub mod cost;
pub mod simplify;
pub mod write;
pub mod measure;

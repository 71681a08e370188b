//! Simplifies textured triangle meshes larger than memory.

pub mod base;
pub mod measure;
pub mod os;
pub mod scan;
pub mod store;
pub mod write;

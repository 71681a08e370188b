//! The calls of a program: a mesh in files, a mesh in memory, texture coordinates for one, textures for a file.

#[cfg(feature = "images")]
mod baking;
mod files;
mod memory;
mod unwrapping;

#[cfg(feature = "images")]
pub use self::baking::bake_textures;
pub use self::files::Simplify;
pub use self::memory::{MeshReport, simplify_mesh};
pub use self::unwrapping::unwrap_mesh;

//! The calls of a program: a mesh in files, a mesh in memory, texture coordinates for one.

mod files;
mod memory;
mod unwrapping;

pub use self::files::Simplify;
pub use self::memory::{MeshReport, simplify_mesh};
pub use self::unwrapping::unwrap_mesh;

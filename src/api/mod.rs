//! The calls of a program: a mesh in files, or a mesh in memory.

mod files;
mod memory;

pub use self::files::Simplify;
pub use self::memory::{MeshReport, simplify_mesh};

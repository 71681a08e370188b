//! The mesh as the phases hand it on: faces, vertices and texture coordinates in files, and the catalogue of parts and
//! materials.
//!
//! In: files of records. Out: [`StoredMesh`] and [`Catalogue`]. Invariant: a mesh that is there is whole; nothing changes
//! it.

pub mod id;
pub mod array_file;
pub mod catalogue;
pub mod colour;
pub mod diffuse;
pub mod face;
pub mod face_blocks;
pub mod mesh;
pub mod piece;
pub mod stored_mesh;
pub mod texture_file;
pub mod image_format;
pub mod corners;

pub use catalogue::{Catalogue, Material, Part};
pub use colour::ColourRange;
pub use face::Face;
pub use face_blocks::{FaceBlocks, FaceWriter};
pub use mesh::Mesh;
pub use stored_mesh::{StoredMesh, StoredPiece};

//! Records in files of the work folder: columns of vertices and texture coordinates, blocks of faces, and the stored
//! mesh made of them.
//!
//! In: records in order. Out: read-only windows of them. Invariant: a file has a header that identifies it; it is
//! written once, synced and renamed. A file that can be opened is complete.
//!
//! # Files
//! `docs/reference/work-folder.md` describes every byte.

pub mod column;
pub mod corners;
pub mod decimal;
pub mod face;
pub mod face_blocks;
pub mod mesh;
pub mod packed;
pub mod piece;
pub mod places;
pub mod varint;

pub use column::{Column, ColumnWriter, Segment};
pub use face::{Face, NO_TEXCOORD};
pub use face_blocks::{FaceBlocks, FaceWriter};
pub use mesh::{Catalogue, Material, Part, StoredMesh, StoredPiece};
pub use packed::{Bounds, PackedBlocks, PackedColumn, PackedWriter};
pub use places::{EncodedRun, Places, PlacesWriter};

//! Compresses vertices and triangles of a tile without loss, for `EXT_meshopt_compression` of glTF.
//!
//! ```text
//! triangles ── order ──▶ neighbours follow each other ── triangles ──▶ about a byte each
//! vertices, by first use ────────────────────────────── attributes ──▶ bytes of differences
//! ```
//! The codec keeps the order of triangles and vertices; it may turn a triangle, so that another corner comes first.
//!
//! # Source
//! Khronos, `EXT_meshopt_compression`, appendix A: the modes ATTRIBUTES (version 0) and TRIANGLES (version 1).

mod attributes;
mod order;
mod triangles;

pub use self::attributes::{decode_attributes, encode_attributes};
pub use self::order::{for_reuse, strips_in_rows, vertices_by_use};
pub use self::triangles::{decode_triangles, encode_triangles};

/// Words on what is wrong with compressed bytes.
pub type StreamFault = &'static str;

/// Most bytes that a stream may hold when it is decoded.
pub const DECODED_BYTES_MAX: usize = 1 << 28;

//! The mesh between the three steps: what the reader fills, meshoptimizer changes and the writer walks.
//!
//! A vertex is a wedge: one combination of place, texture coordinate and material. meshoptimizer finds by itself that
//! wedges share a place (it hashes positions) and collapses the wedges of a seam together, so splitting at material
//! borders opens no crack, and every vertex of a triangle has the triangle's material.
//!
//! ```text
//!   place 7 ──┬── wedge 12  (texcoord 40, material 0)
//!             └── wedge 31  (texcoord 96, material 2)
//! ```

/// `place_of` and `material_of` have one entry for each entry of `positions`.
pub struct Mesh {
    /// Where zero lies in the file's coordinates: positions are kept as `f32` relative to it.
    pub origin: [f64; 3],
    pub positions: Vec<[f32; 3]>,
    /// One for each position, or none at all if the file has no `vt`.
    pub texcoords: Vec<[f32; 2]>,
    /// Index of the `v` line that the wedge came from, from 0.
    pub place_of: Vec<u32>,
    pub place_count: usize,
    pub material_of: Vec<u32>,
    /// Names as in `usemtl`; the first, before any `usemtl`, is empty.
    pub materials: Vec<String>,
    pub mtllibs: Vec<String>,
    /// Three wedges a triangle.
    pub indices: Vec<u32>,
}

impl Mesh {
    pub fn face_count(&self) -> usize {
        self.indices.len() / 3
    }
}

//! Measures a mesh: cracks, topology, folded texture triangles, and how far open borders moved.
//!
//! In: a mesh in memory, as a whole. Out: counts and distances. Invariant: nothing here changes a mesh that is
//! written, and the same mesh gives the same numbers in the same order on every machine.
//!
//! ```text
//! StoredMesh ──Surface::load──▶ Surface ──welded──▶ Surface ──check──▶ Check ──compare_checks──▶ regressions
//!                                                      └──border_deviation──▶ max, rms
//! ```
//!
//! # Memory
//! A surface takes 28 bytes a face and 24 bytes a vertex with 16 bytes a texture coordinate; a check adds about 90
//! bytes a face while it runs. Measuring is therefore for results and samples, not for inputs larger than memory.

pub mod border;
pub mod check;
#[cfg(feature = "images")]
pub mod compare;
pub mod figures;
pub mod gauge;
pub mod surface;
pub mod tjunction;

pub use border::{BorderDeviation, border_deviation, border_of};
pub use check::{Check, Regression, check, compare_checks, compare_topology, weld_and_check};
pub use surface::Surface;

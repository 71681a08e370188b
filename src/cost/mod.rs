//! What a collapse costs and where its vertex goes: quadrics and the published cost functions.
//!
//! A cost function sees a cluster's mesh and an edge; it knows of no files, threads or locks. Legality is decided in
//! `simplify` and never looks at a cost.

pub mod metric;
pub mod quadric;
pub mod surface;

pub use metric::Metric;
pub use quadric::{Quadric, WedgeQuadric};
pub use surface::{EdgeCase, Placement, SurfaceCost, Weights};

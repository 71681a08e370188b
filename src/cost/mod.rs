//! What a collapse costs and where its vertex goes: quadrics and the published cost functions.
//!
//! The published systems, one to a file: [`oblique`], [`curvature`], [`terrain`], [`sharpness`], and the baseline that they
//! compare with, [`classic`]; [`surface`] is this program's own.
//!
//! A cost function sees a cluster's mesh and an edge; it knows of no files, threads or locks. Legality is decided in
//! `simplify` and never looks at a cost.

pub mod around;
pub mod census;
pub mod classic;
mod crease;
pub mod curvature;
pub mod fan;
pub mod knob;
pub mod local;
pub mod metric;
pub mod oblique;
pub mod planes;
pub mod quadric;
pub mod sharpness;
pub mod surface;
pub mod terrain;
pub mod weights;
pub mod wide;

pub use classic::ClassicCost;
pub use curvature::CurvatureCost;
pub use metric::{EdgeCase, Metric, Placement, SettlingWedge};
pub use oblique::ObliqueCost;
pub use quadric::{Quadric, WedgeQuadric};
pub use sharpness::SharpnessCost;
pub use surface::SurfaceCost;
pub use terrain::TerrainCost;
pub use weights::Weights;

#[cfg(test)]
mod tests;

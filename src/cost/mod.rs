//! Cost and placement of a collapse: quadrics and the published cost functions.
//!
//! One published system per file: [`oblique`], [`curvature`], [`terrain`], [`sharpness`], and their common baseline
//! [`classic`]. [`surface`] is this program's own cost.
//!
//! A cost function reads a cluster's mesh and an edge; it does not depend on files, threads or locks. `simplify`
//! decides legality, and never reads a cost to do so.

pub mod around;
pub mod mesh_stats;
pub mod classic;
mod crease;
pub mod curvature;
pub mod fan;
pub mod parameter;
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
pub use metric::{EdgeCase, LANES, Metric, MovingWedge, Placement};
pub use oblique::ObliqueCost;
pub use quadric::{Quadric, WedgeQuadric};
pub use sharpness::SharpnessCost;
pub use surface::SurfaceCost;
pub use terrain::TerrainCost;
pub use weights::Weights;

#[cfg(test)]
mod tests;

//! The passes: the same two steps, partition and simplify, again and again on shifted cells.
//!
//! ```text
//! (remesh   every cluster made anew by Voronoi cells, if that is asked for; it takes a number among the passes)
//! pass 1   cells cut at 1/2   borders locked, seams locked     to about 4 × the target
//! pass 2   cells cut at 1/3   the borders of pass 1 are inside to about 2 × the target
//! pass 3   cells cut at 2/3   …                                to the target
//! trim     what is left over the target: the same share of each cluster, or chosen over all of them by cost
//! ```
//! A threshold on the cost, never a count, stops a cluster, so that the faces are spent where one queue over the whole
//! mesh would spend them. The threshold comes from a sample: patches of up to sixteen clusters, simplified as one mesh.
//! Once one cluster holds everything, it is simplified to the face.
//!
//! # Memory
//! A cluster in work takes its [`ClusterWeight`](crate::partition::weight::ClusterWeight); permits keep their sum within
//! the budget. One that is too heavy passes through in blocks, unchanged and counted.
//!
//! # Files
//! Each cluster leaves one piece; a pass leaves a column of shared positions. A finished cluster, plan, partition or pass
//! is kept in the journal; files are removed as soon as what follows from them is kept.

mod again;
mod aim;
mod clusters;
mod goal;
mod kept;
pub mod options;
pub mod outcome;
pub mod pass;
pub mod probes;
mod reconstruct;
pub mod sample;
mod scale;
pub mod schedule;
mod shared;
mod state;
mod stops;
pub mod trim;

pub use options::{Cost, PassOptions, SeamPolicy};
pub use outcome::{PassReport, Passes, RemeshReport};
pub use reconstruct::CELL_PASSES;
pub use state::Start;

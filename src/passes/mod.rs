//! The passes: partition the mesh and simplify its clusters, repeatedly, with shifted cells.
//!
//! ```text
//! (remesh   every cluster is remeshed by Voronoi cells, if asked for; this takes the first pass numbers)
//! pass 1   cells cut at 1/2   borders locked, seams locked     to about 4 × the target
//! pass 2   cells cut at 1/3   the borders of pass 1 are inside to about 2 × the target
//! pass 3   cells cut at 2/3   …                                to the target
//! trim     the faces left over the target: the same share of each cluster, or the cheapest of all clusters
//! ```
//! Before the trim, clusters stop at a threshold on the cost and not at a face count, so that faces are removed where
//! one queue over the whole mesh would remove them. The threshold comes from a sample: patches of up to sixteen
//! clusters, simplified as one mesh. A mesh that fits in one cluster is simplified to an exact face count instead.
//!
//! # Memory
//! A cluster in work takes its [`ClusterWeight`](crate::partition::weight::ClusterWeight) in bytes; permits keep the
//! sum within the budget. A cluster that is too heavy passes through in blocks; its faces are unchanged and counted.
//!
//! # Files
//! Each cluster writes one piece; a pass writes a column of shared positions. The journal records each finished plan,
//! cluster, partition and pass; files are deleted as soon as the results computed from them are recorded.

pub mod options;
pub mod shares;
mod pass_id;
pub mod steps;
mod schedule;
mod floor;
mod goal;
mod targets;
mod stop_rule;
pub mod sample;
mod texture_traits;
mod texture_survey;
pub mod random_points;
pub mod chosen_cells;
mod face_weights;
pub mod probes;
mod metric_engine;
mod cluster_task;
mod sweep_plan;
mod cluster_worker;
pub mod arithmetic;
mod counters;
mod records;
mod sweep_result;
mod state;
mod run;
pub mod lend_sweep;
mod clusters;
pub mod outcome;
mod second_attempt;
mod remesh;
pub mod lend_remesh;
pub mod trim;
mod pass;
pub mod in_memory;

pub use floor::Floor;
pub use options::{Cost, PassOptions, SeamPolicy};
pub use outcome::{PassReport, Passes, RemeshReport};
pub use pass_id::{Pass, PassKind};
pub use run::Run;
pub use schedule::CELL_PASSES;
pub use state::ResumePoint;

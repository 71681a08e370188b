//! Counts edges, borders, seams, components, charts and shapes of triangles.
//!
//! In: clusters of a partition, or a mesh in memory. Out: [`MeshCounts`]. Invariant: the same mesh has the same counts,
//! however it is cut into clusters.
//!
//! ```text
//! mesh in memory ─────────────────┐
//! cluster ── keys of wedges ──────┴─▶ Countable ──count──▶ MeshCounts, and what leaves the cluster
//!                                                                              └──Counter──▶ MeshCounts
//! ```

pub mod atlas;
pub mod cell;
pub mod cluster;
pub mod counts;
pub mod edges;
pub mod id;
pub mod seam_edge;
pub mod shared;

pub use cell::{Countable, count};
pub use cluster::count_cluster;
pub use counts::{MeshCounts, TopologyCounts};
pub use shared::{Counter, Topology};

//! Simplifies one cluster by edge collapses.
//!
//! In: a [`ClusterMesh`](crate::mesh::ClusterMesh) with its locks, and stages with a stop rule each. Out: the same mesh
//! with fewer faces. Invariant: every step is a legal edge collapse of the *whole* mesh, although only the cluster is
//! in memory; locked vertices neither move nor vanish.
//!
//! # Memory
//! See `partition::weight`: about 200 bytes a face with texture, the mesh included.

mod alternatives;
pub mod anchor;
mod caps;
pub mod changes;
pub mod collapse;
pub mod cover;
pub mod deviation;
pub mod edge_star;
pub mod engine;
pub mod fold;
mod handles;
mod last_faces;
pub mod legality;
mod loners;
pub mod parts;
mod proposal;
mod remains;
pub mod refusal;
mod rips;
mod relocate;
mod retreat;
pub mod shape_rule;
mod stage;
pub mod texture;
pub mod triangle_change;
pub mod witness;

pub use anchor::Anchor;
pub use changes::Changes;
pub use engine::Engine;
pub use stage::{LoggedCollapse, Milestone, StageResult, Stop};

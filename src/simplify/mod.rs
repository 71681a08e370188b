//! One cluster becomes a cluster of fewer faces.
//!
//! In: a [`ClusterMesh`](crate::mesh::ClusterMesh) with its locks, and stages that say when to stop. Out: the same mesh
//! with fewer faces. Invariant: every step is a legal edge collapse of the *whole* mesh, though only the cluster is
//! seen; locked vertices neither move nor vanish.
//!
//! # Memory
//! See `partition::weight`: about 200 bytes a face with texture, the mesh included.

pub mod anchor;
mod caps;
pub mod changes;
pub mod collapse;
pub mod cover;
pub mod deviation;
pub mod engine;
mod fold;
mod handles;
mod last_faces;
pub mod legality;
mod loners;
pub mod parts;
mod proposal;
mod remains;
mod rips;
mod settle;
mod stage;
pub mod texture;
pub mod witness;

pub use anchor::Anchor;
pub use changes::Changes;
pub use engine::Engine;
pub use stage::{Milestone, StageResult, Stop};

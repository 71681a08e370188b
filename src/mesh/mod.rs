//! The mesh of one cluster in memory: positions, wedges, faces, one-rings and vertex classes.
//!
//! Faces are connected by vertex, that is by position; texture coordinate and material belong to wedges. A wedge is the
//! set of corners of one vertex that share texture coordinate and material. Nothing here depends on files, costs or
//! threads of the job.

pub mod class;
pub mod cluster;
pub mod compact;
pub mod seam_density;
pub mod doubles;
pub mod edge;
pub mod fold;
pub mod forest;
pub mod id;
pub mod orient;
pub mod pieces;
pub mod polygon;
pub mod ring;
mod simple;
pub mod split;

pub use class::{Class, Classes, Rule};
pub use cluster::ClusterMesh;
pub use id::{Corner, Edge, End, FaceId, LocalVertex, Wedge, WedgePair};
pub use ring::Rings;

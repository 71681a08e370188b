//! One cluster in memory: positions, wedges, faces, rings and vertex classes.
//!
//! Topology is by position; texture coordinate and material live on wedges. A wedge is the corners of one vertex that
//! share texture coordinate and material. Nothing here knows of files, costs or threads.

pub mod class;
pub mod cluster;
pub mod crowding;
pub mod doubles;
pub mod edge;
pub mod fold;
pub mod orient;
pub mod pieces;
pub mod polygon;
pub mod ring;
mod simple;
pub mod split;

pub use class::{Class, Rule};
pub use cluster::ClusterMesh;
pub use ring::Rings;

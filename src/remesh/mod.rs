//! What may be done to a whole cluster beside collapsing its edges.
//!
//! In: a [`ClusterMesh`](crate::mesh::ClusterMesh). Out: the same mesh with vertices moved. Invariant: locked vertices,
//! borders and seams stay; no face folds, in space or in the picture.

pub mod relax;

pub use relax::relax;

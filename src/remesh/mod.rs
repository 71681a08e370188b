//! Operations on a whole cluster besides collapsing its edges.
//!
//! In: a [`ClusterMesh`](crate::mesh::ClusterMesh). Out: the same surface with other vertices ([`cvd`], before the
//! collapse), or the same mesh with vertices moved ([`relax`](mod@relax), after it). Invariant: locked vertices,
//! borders and seams stay; no face folds, in space or in texture space.

pub mod cvd;
pub mod relax;

pub use relax::relax;

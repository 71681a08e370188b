//! Renders meshes in software: what is visible in each pixel of a view.
//!
//! ```text
//! bounds ──Frame──▶ views ──┐
//! triangles, one by one ────┴──▶ Canvas: depth, paint, texture coordinate and light of each pixel
//! clusters of a pass ──────────▶ ClusterMap: which cluster is visible from above, where its border is locked ──▶ PNG
//! ```
//! In: triangles in any order, each once. Out: buffers of pixels, not yet colours: a texture image is needed only once
//! the canvas knows which of its pixels show it. Invariant: the same triangles in the same order give the same
//! rendering; of two that are equally near, the first stays.
//!
//! # Memory
//! A canvas takes 17 bytes a pixel, a map 12; the mesh is never in memory as a whole.

pub mod canvas;
pub mod encode;
pub mod map;
pub mod raster;
pub mod view;

pub use canvas::{Canvas, Paint, Triangle};
pub use map::ClusterMap;
pub use view::{Frame, View};

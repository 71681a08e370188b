//! Pictures of meshes, drawn in software: what is to be seen from where, pixel by pixel.
//!
//! ```text
//! bounds ──Frame──▶ views ──┐
//! triangles, one by one ────┴──▶ Canvas: depth, paint, texture coordinate and light of each pixel
//! clusters of a pass ──────────▶ ClusterMap: which cluster is seen from above, where its border is locked ──▶ PNG
//! ```
//! In: triangles in any order, each once. Out: buffers of pixels, not yet colours: an image is needed only once the
//! canvas knows which of its pixels show it. Invariant: the same triangles give the same picture; where two are equally
//! near, the first one stays.
//!
//! # Memory
//! A canvas takes 17 bytes a pixel, a map 12; the mesh is never held.

pub mod canvas;
pub mod encode;
pub mod map;
pub mod raster;
pub mod view;

pub use canvas::{Canvas, Paint, Triangle};
pub use map::ClusterMap;
pub use view::{Frame, View};

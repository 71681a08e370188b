//! Out-of-core simplification of textured triangle meshes.
//!
//! [`Simplify`] reads a mesh of any size from files, and writes one joined, textured mesh with fewer triangles, without
//! ever holding the mesh in memory:
//!
//! ```
//! use drystone::{Silent, Simplify};
//!
//! # let folder = tempfile::tempdir().unwrap();
//! # let output = folder.path().join("sphere.obj");
//! let report = Simplify::new("fixtures/miniatures/closed_sphere.obj").to(&output).ratio(0.1).run(&Silent)?;
//! assert_eq!(report.faces.output, report.faces.target);
//! # Ok::<(), drystone::Error>(())
//! ```
//!
//! [`simplify_mesh`] does the same to a [`Mesh`] in memory.
//!
//! - **How far:** a [`Target`]: a share or a number of triangles, a bound on the error, or both.
//! - **How:** [`SimplifyOptions`]; the defaults are those of the command line.
//! - **Within what:** [`Limits`]: memory and threads. The output has the same bytes at any number of threads.
//! - **What happened:** a [`Report`]; an [`Error`] has a [`kind`](Error::kind).
//! - **Meanwhile:** a [`Progress`] hears of phases and may stop the run; the same call resumes it.
//! - **On several machines:** [`Hands`] have tasks of a job done elsewhere; [`do_task`] does one.
//!
//! ```text
//! files ── read ──▶ columns ── partition ──▶ clusters ── simplify ──▶ clusters' ── repeat ──▶ … ── write ──▶ file
//! ```

// In the order in which the data flows; imports point up this list, which `tests/suite/layering.rs` checks. What the
// documentation hides is no part of the interface: it is public for the program, its tests and the fuzz targets alone,
// and changes without notice.

// Ground: what every phase stands on.
#[doc(hidden)]
pub mod base;
#[doc(hidden)]
pub mod os;
#[doc(hidden)]
pub mod geometry;
#[doc(hidden)]
pub mod geo;
#[doc(hidden)]
pub mod file;
#[doc(hidden)]
pub mod job;
#[doc(hidden)]
pub mod model;
#[cfg(feature = "images")]
#[doc(hidden)]
pub mod image;

// Road: from files to a file.
#[doc(hidden)]
pub mod read;
#[doc(hidden)]
pub mod mesh;
#[doc(hidden)]
pub mod partition;
#[doc(hidden)]
pub mod lend;
#[doc(hidden)]
pub mod topology;
#[cfg(feature = "images")]
#[doc(hidden)]
pub mod surface;
pub mod unwrap;
#[doc(hidden)]
pub mod render;
#[doc(hidden)]
pub mod cost;
#[doc(hidden)]
pub mod simplify;
#[doc(hidden)]
pub mod remesh;
#[doc(hidden)]
pub mod passes;
#[cfg(feature = "images")]
#[doc(hidden)]
pub mod bake;
#[doc(hidden)]
pub mod write;

// Shore: what a caller sees.
#[doc(hidden)]
pub mod measure;
#[cfg(feature = "images")]
#[doc(hidden)]
pub mod tile;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod serve;
pub mod options;
pub mod report;
#[doc(hidden)]
pub mod plan;
#[doc(hidden)]
pub mod pipeline;
#[doc(hidden)]
pub mod inspect;
mod api;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;

#[cfg(feature = "images")]
pub use api::bake_textures;
pub use api::{MeshReport, Simplify, simplify_mesh, unwrap_mesh};
pub use base::{Error, ErrorKind, Progress, Result, Silent};
pub use job::stage::{Hands, HandsEnd, SharedHands, Stage, TaskRunner};
pub use model::Mesh;
pub use options::{JobOptions, Limits, SimplifyOptions, Target};
pub use os::mmap::map_large_allocations as return_freed_memory;
pub use os::system::claim_process;
pub use pipeline::{TaskEnd, do_task};
pub use report::Report;

//! Simplifies textured triangle meshes larger than memory.
//!
//! ```text
//! OBJ ── read ──▶ columns ── partition ──▶ clusters ── simplify ──▶ clusters' ── stitch ──▶ … ── write ──▶ OBJ
//! ```
//! Reads an OBJ or a PLY (or many) and writes one joined, textured OBJ or PLY with fewer triangles, within a memory
//! budget. The output has the same bytes at any number of threads.
//!
//! ```
//! use std::path::Path;
//! use drystone::{base::Silent, options::SimplifyOptions, pipeline};
//!
//! # let folder = tempfile::tempdir().unwrap();
//! # let output = folder.path().join("sphere.obj");
//! let options = SimplifyOptions { ratio: Some(0.1), ..SimplifyOptions::default() };
//! let input = Path::new("fixtures/miniatures/closed_sphere.obj");
//! let report = pipeline::simplify(input, &output, &options, &Silent)?;
//! assert_eq!(report.faces.output, report.faces.target);
//! # Ok::<(), drystone::base::Error>(())
//! ```

// In the order in which the data flows; imports point up this list, which `tests/layering.rs` checks.
pub mod base;
pub mod os;
pub mod geometry;
pub mod file;
pub mod job;
pub mod model;
pub mod image;
pub mod read;
pub mod mesh;
pub mod partition;
pub mod render;
pub mod cost;
pub mod simplify;
pub mod remesh;
pub mod passes;
pub mod write;
pub mod measure;
pub mod options;
pub mod report;
pub mod plan;
pub mod pipeline;
pub mod inspect;
pub mod cli;

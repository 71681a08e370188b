//! The library's interface for new textures.

use std::path::Path;

use crate::base::{Progress, Result};
use crate::options::SimplifyOptions;
use crate::pipeline;
use crate::read::InputChoice;
use crate::report::BakeFigures;

/// Gives a mesh in a file, which any program may have made, new textures that show what `original` shows there, and
/// writes it to `output`. Works on files of any size, within the memory budget; a call that was stopped or killed is
/// resumed by the same call.
///
/// The original is an OBJ or PLY file, or a folder; the mesh is one file near its surface. The mesh keeps its triangles
/// and loses its texture coordinates, colours and materials. Of the options, `texels`, `atlas`, `image`,
/// `textures_outside`, `limits` and `job` count. How it is done: `docs/explain/baking.md`.
///
/// ```
/// use drystone::{Silent, SimplifyOptions, bake_textures};
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let output = folder.path().join("coarse.obj");
/// # std::fs::write(folder.path().join("coarse_plain.obj"), "v 0 0 0\nv 2 0 0\nv 0 12 0\nf 1 2 3\n").unwrap();
/// # let coarse = folder.path().join("coarse_plain.obj");
/// let options = SimplifyOptions { texels: 0.25, ..SimplifyOptions::default() };
/// let figures = bake_textures("fixtures/miniatures/seam_strip.obj", &coarse, &output, &options, &Silent)?;
/// assert!(figures.images >= 1 && figures.charts >= 1);
/// # Ok::<(), drystone::Error>(())
/// ```
///
/// # Errors
/// See [`Error`](crate::Error). [`Error::Usage`](crate::Error::Usage) also if the mesh is all of the original, or the
/// output one of the files that are read.
pub fn bake_textures(
    original: impl AsRef<Path>,
    mesh: impl AsRef<Path>,
    output: impl AsRef<Path>,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<BakeFigures> {
    pipeline::bake_onto(InputChoice::from(original.as_ref()), mesh.as_ref(), output.as_ref(), options, progress)
}

//! Bakes new textures for a mesh that some other program made.
//!
//! ```text
//! original ──┐          ┌── pieces of the original ──▶ surface in cells ──╮
//!            ├── read ──┤                                                 ├─▶ bake ──▶ mesh with new textures
//! mesh ──────┘          └── piece of the mesh ────────────────────────────╯
//! ```
//! In: the files of both, read as one input, so that a job is resumed only if none of them has changed, and the mesh is
//! the same one. Out: the mesh with its faces as they are, and new texture coordinates. Invariant: as for
//! [`simplify`](super::simplify).

use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::admission::Admission;
use super::input;
use super::output::EarlierOutput;
use super::preflight::Preflight;
use super::publish::{FinalMesh, Publisher};
use super::texturing::Texturing;
use crate::base::error::escape_path;
use crate::base::{Error, Progress, Result};
use crate::job::WorkFolder;
use crate::model::StoredMesh;
use crate::options::{SimplifyOptions, Target, TextureFiles};
use crate::read::{InputChoice, SCAN};
use crate::report::BakeFigures;

/// Bakes new textures for `mesh`, an OBJ or PLY file that lies near the surface of `original`, and writes it with them to
/// `output`.
///
/// Of the options, [`texels`](SimplifyOptions::texels), [`atlas`](SimplifyOptions::atlas),
/// [`image`](SimplifyOptions::image), [`textures_outside`](SimplifyOptions::textures_outside),
/// [`limits`](SimplifyOptions::limits) and [`job`](SimplifyOptions::job) count.
///
/// # Errors
/// Those of [`simplify`](super::simplify); [`Error::Usage`] if the mesh is all of the original.
pub fn bake_onto(
    original: InputChoice,
    mesh: &Path,
    output: &Path,
    options: &SimplifyOptions,
    progress: &dyn Progress,
) -> Result<BakeFigures> {
    let options = SimplifyOptions { target: Target::ratio(1.0), textures: TextureFiles::Bake, ..options.clone() };
    let mut choice = original;
    choice.paths.push(mesh.to_owned());
    let mut preflight = Preflight::check(choice, output, &options)?;
    let number = number_of(mesh, &preflight.inputs)?;
    preflight.manifest.options = with_mesh(&preflight.manifest.options, mesh, number);
    preflight.run(progress, |work| run(&preflight, number, work, progress))
}

/// Number of a file among several.
fn number_of(mesh: &Path, inputs: &[PathBuf]) -> Result<usize> {
    let resolved = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let number = inputs.iter().position(|input| resolved(input) == resolved(mesh));
    number
        .filter(|_| inputs.len() > 1)
        .ok_or_else(|| Error::Usage(format!("{}: expected a file that is not all of the original", escape_path(mesh))))
}

/// The options that shape the result, with the mesh as one more: the input files, in the order of their paths, do not
/// say which of them it is.
fn with_mesh(options: &str, mesh: &Path, number: usize) -> String {
    let mut shaping: Map<String, Value> = serde_json::from_str(options).unwrap_or_default();
    let name = mesh.file_name().map(Path::new).unwrap_or(mesh);
    shaping.insert("mesh".into(), format!("file {} of the input, {}", number + 1, escape_path(name)).into());
    Value::Object(shaping).to_string()
}

/// Reads both, and gives the file of this number new textures.
fn run(job: &Preflight<'_>, number: usize, work: &mut WorkFolder, progress: &dyn Progress) -> Result<BakeFigures> {
    let earlier = EarlierOutput::look(job, work)?;
    let (input, mut start) = input::read(job, work, progress)?;
    let admission = Admission::admit(job, &input, &start, work)?;
    let publisher = Publisher::prepare(job, &input, earlier, work)?;
    let mut mesh = StoredMesh { pieces: vec![start.state.mesh.pieces.remove(number)], ..StoredMesh::default() };
    mesh.drop_colours();
    let texturing = Texturing::prepare(job, &input, &mut start, work, &admission, progress)?;
    let baked = texturing.bake_mesh(&mesh, &SCAN, None, work, progress)?;
    let baked = baked.ok_or_else(|| Error::Usage("`textures`: expected `bake`".into()))?;
    let result = FinalMesh { mesh: &baked.mesh, catalogue: &baked.catalogue };
    publisher.write(&result, &SCAN, work, progress)?;
    Ok(baked.figures)
}

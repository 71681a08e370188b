//! Simplifies a mesh in memory.

use crate::base::{Error, Progress, Result};
use crate::model::Mesh;
use crate::options::{Pieces, SimplifyOptions};
use crate::passes::in_memory;
use crate::simplify::Changes;

/// What became of a mesh in memory.
#[derive(Debug, Clone, Copy)]
pub struct MeshReport {
    /// Triangles of the input.
    pub input: u64,
    /// Triangles asked for; 0 for as few as a bound on the error allows.
    pub target: u64,
    /// Triangles of the result.
    pub output: u64,
    /// Whether the target was met.
    pub is_reached: bool,
    /// Changes of topology.
    pub changes: Changes,
}

/// Simplifies a mesh in memory, with the engine and the schedule of the files' road, on the calling thread and without
/// files.
///
/// Of the options, those of the shape count: target, borders, weld, topology, doubles, seams, `uv_weight`, passes,
/// metric, remeshing, `optimize`. About 220 bytes per triangle are in use at once. A mesh of more than some million
/// triangles is better off in a file: [`Simplify`](crate::Simplify) uses all cores.
///
/// ```
/// use drystone::{Mesh, SimplifyOptions, Silent, Target, simplify_mesh};
///
/// // A flat square of 20 × 20 squares.
/// let mut mesh = Mesh::default();
/// for i in 0..21 * 21 {
///     mesh.positions.push([f64::from(i % 21), f64::from(i / 21), 0.0]);
/// }
/// for i in (0..20 * 21).filter(|i| i % 21 < 20) {
///     mesh.faces.extend([[i, i + 1, i + 22], [i, i + 22, i + 21]]);
/// }
/// let options = SimplifyOptions { target: Target::faces(2), ..SimplifyOptions::default() };
/// let (square, report) = simplify_mesh(&mesh, &options, &Silent)?;
/// assert_eq!((square.faces.len(), square.positions.len()), (2, 4));
/// assert!(report.is_reached);
/// # Ok::<(), drystone::Error>(())
/// ```
///
/// # Errors
/// [`Error::Usage`] for options and indices that cannot be, [`Error::Limit`] for a mesh that is too large,
/// [`Error::Stopped`] if asked to stop.
pub fn simplify_mesh(mesh: &Mesh, options: &SimplifyOptions, progress: &dyn Progress) -> Result<(Mesh, MeshReport)> {
    options.check()?;
    mesh.check()?;
    if options.pieces == Pieces::Drop {
        return Err(Error::Usage("`pieces: drop` needs a mesh in files".into()));
    }
    if options.bakes() {
        return Err(Error::Usage("`textures: bake` needs a mesh in files".into()));
    }
    let pass_options = options.pass_options(mesh.faces.len() as u64, !mesh.face_texcoords.is_empty())?;
    let simplified = in_memory::simplify(mesh, &pass_options, progress)?;
    let report = MeshReport {
        input: pass_options.input,
        target: pass_options.target,
        output: simplified.mesh.faces.len() as u64,
        is_reached: simplified.is_reached,
        changes: simplified.changes,
    };
    Ok((simplified.mesh, report))
}

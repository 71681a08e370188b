//! Reads an OBJ with tobj, simplifies it in memory to 1,000 triangles, and hands it back as models of tobj.
//!
//! `cargo run --release --example mesh_in_memory -- statue.obj`

use std::path::Path;

use drystone::{Mesh, Result, Silent, SimplifyOptions, Target, simplify_mesh};

fn main() -> Result<()> {
    let path = std::env::args().nth(1).expect("give an OBJ");
    run(path.as_ref()).map(drop)
}

/// The simplified models.
pub fn run(path: &Path) -> Result<Vec<tobj::Model>> {
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    let (models, _materials) = tobj::load_obj(path, &options).expect("an OBJ");
    let mesh = Mesh::from(models.as_slice());

    let options = SimplifyOptions { target: Target::faces(1000), ..SimplifyOptions::default() };
    let (simplified, report) = simplify_mesh(&mesh, &options, &Silent)?;

    println!("{} of {} triangles, {} vertices", report.output, report.input, simplified.positions.len());
    Ok(simplified.to_tobj())
}

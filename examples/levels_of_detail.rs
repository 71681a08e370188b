//! Makes a chain of levels of detail of a mesh in memory, each with a quarter of the triangles of the one before.
//!
//! `cargo run --release --example levels_of_detail -- statue.obj`

use drystone::{Mesh, Result, Silent, SimplifyOptions, Target, simplify_mesh};

fn main() -> Result<()> {
    let path = std::env::args().nth(1).expect("give an OBJ");
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    let (models, _materials) = tobj::load_obj(path, &options).expect("an OBJ");
    run(Mesh::from(models.as_slice())).map(drop)
}

/// The mesh and its levels, the finest first.
pub fn run(mesh: Mesh) -> Result<Vec<Mesh>> {
    let options = SimplifyOptions { target: Target::ratio(0.25), ..SimplifyOptions::default() };
    let mut levels = vec![mesh];
    while let Some(finest) = levels.last()
        && finest.faces.len() > 100
        && levels.len() < 6
    {
        let (level, report) = simplify_mesh(finest, &options, &Silent)?;
        println!("level {}: {} triangles", levels.len(), report.output);
        levels.push(level);
    }
    Ok(levels)
}

//! Reads an OBJ with tobj and gives it texture coordinates for images with a texel every so often.
//!
//! `cargo run --release --example new_texcoords -- statue.obj 0.001`

use std::path::Path;

use drystone::{Mesh, Result, unwrap_mesh};

fn main() -> Result<()> {
    let path = std::env::args().nth(1).expect("give an OBJ");
    let texel = std::env::args().nth(2).and_then(|text| text.parse().ok()).expect("give the length of a texel");
    run(path.as_ref(), texel).map(drop)
}

/// The mesh with its new texture coordinates.
pub fn run(path: &Path, texel: f64) -> Result<Mesh> {
    let options = tobj::LoadOptions { triangulate: true, ..tobj::LoadOptions::default() };
    let (models, _materials) = tobj::load_obj(path, &options).expect("an OBJ");
    let mesh = Mesh::from(models.as_slice());

    let (unwrapped, images) = unwrap_mesh(&mesh, texel, 4096)?;

    for image in &images {
        println!("an image of {} x {} texels", image.width, image.height);
    }
    Ok(unwrapped)
}

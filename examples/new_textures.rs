//! Gives a coarse mesh, made by any program, textures that show what its original shows.
//!
//! `cargo run --release --example new_textures -- city.obj coarse.obj textured.obj`

use std::path::Path;

use drystone::{Limits, Result, Silent, SimplifyOptions, bake_textures};

fn main() -> Result<()> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let [original, coarse, output] = &paths[..] else { panic!("give the original, the coarse mesh and the output") };
    run(original.as_ref(), coarse.as_ref(), output.as_ref())
}

/// Bakes a quarter of the original's texels within 512 MiB.
pub fn run(original: &Path, coarse: &Path, output: &Path) -> Result<()> {
    let limits = Limits { memory: Some(512 << 20), ..Limits::default() };
    let options = SimplifyOptions { texels: 0.25, limits, ..SimplifyOptions::default() };

    let figures = bake_textures(original, coarse, output, &options, &Silent)?;

    println!("{} charts in {} images, each texel {} long", figures.charts, figures.images, figures.texel);
    Ok(())
}

//! Keeps a tenth of a file's triangles, within 512 MiB.
//!
//! `cargo run --release --example one_file -- city.obj out/city.obj`

use std::path::Path;

use drystone::{Result, Silent, Simplify};

fn main() -> Result<()> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let [input, output] = paths.as_slice() else { panic!("give an input and an output") };
    run(input.as_ref(), output.as_ref())
}

/// Simplifies a file.
pub fn run(input: &Path, output: &Path) -> Result<()> {
    let report = Simplify::new(input).to(output).ratio(0.1).memory(512 << 20).run(&Silent)?;
    println!("{} of {} triangles are left", report.faces.output, report.faces.input);
    for warning in &report.warnings {
        println!("{warning}");
    }
    Ok(())
}

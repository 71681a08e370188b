//! Reads options from JSON, as a service would get them, and tells the kinds of errors apart.
//!
//! `cargo run --release --example options_from_json -- city.obj out/city.obj '{"ratio": 0.2, "metric": "qem"}'`

use std::path::Path;

use drystone::{ErrorKind, Result, Silent, Simplify, SimplifyOptions};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output, json] = arguments.as_slice() else { panic!("give an input, an output and options") };
    println!("{}", run(input.as_ref(), output.as_ref(), json));
    Ok(())
}

/// The answer of the service.
pub fn run(input: &Path, output: &Path, json: &str) -> String {
    let options: SimplifyOptions = match serde_json::from_str(json) {
        Ok(options) => options,
        Err(error) => return format!("400: {error}"),
    };
    match Simplify::new(input).to(output).with(|all| *all = options).run(&Silent) {
        Ok(report) => format!("200: {} triangles", report.faces.output),
        Err(error) => match error.kind() {
            ErrorKind::Usage | ErrorKind::Budget | ErrorKind::Input => format!("400: {error}"),
            ErrorKind::NoSpace => format!("507: {error}"),
            _ => format!("500: {error}"),
        },
    }
}

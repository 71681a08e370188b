//! meshoptimizer from OBJ to OBJ, in core and on one thread: read, simplify, write.
//!
//! ```text
//! meshopt-obj INPUT OUTPUT --ratio 0.1 [--mode update|uv] [--uv-weight 1]
//! ```
//!
//! * `update`: `meshopt_simplifyWithUpdate` with the texture coordinates as attributes; moves vertices and picture.
//! * `uv`: `meshopt_simplify` on the same vertices; keeps a subset of them.
//!
//! Both without a limit to the error, so that only the target stops them. Prints one line of JSON: counts, the error
//! that meshoptimizer reports (relative to the extent), and seconds for the three steps.

mod mesh;
mod obj_reader;
mod obj_writer;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use meshopt::{SimplifyOptions, VertexDataAdapter};

use crate::mesh::Mesh;

fn main() -> ExitCode {
    match Arguments::read().and_then(|arguments| run(&arguments)) {
        Ok(line) => {
            println!("{line}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("meshopt-obj: {error}");
            ExitCode::FAILURE
        }
    }
}

struct Arguments {
    input: PathBuf,
    output: PathBuf,
    ratio: f64,
    mode: String,
    uv_weight: f32,
}

impl Arguments {
    fn read() -> Result<Self, String> {
        let (mut files, mut ratio, mut mode, mut uv_weight) = (Vec::new(), 0.1, "update".to_owned(), 1.0);
        let mut words = std::env::args().skip(1);
        while let Some(word) = words.next() {
            let mut value = || words.next().ok_or_else(|| format!("{word}: expected a value"));
            match word.as_str() {
                "--ratio" => ratio = value()?.parse().map_err(|error| format!("--ratio: {error}"))?,
                "--uv-weight" => uv_weight = value()?.parse().map_err(|error| format!("--uv-weight: {error}"))?,
                "--mode" => mode = value()?,
                _ => files.push(PathBuf::from(word)),
            }
        }
        let [input, output] =
            <[PathBuf; 2]>::try_from(files).map_err(|files| format!("expected two files, found {}", files.len()))?;
        if !["update", "uv"].contains(&mode.as_str()) {
            return Err(format!("--mode: expected 'update' or 'uv', found '{mode}'"));
        }
        Ok(Self { input, output, ratio, mode, uv_weight })
    }
}

fn run(arguments: &Arguments) -> Result<String, String> {
    let start = Instant::now();
    let mut mesh = obj_reader::read_obj(&arguments.input)?;
    let (faces_in, wedges_in, loaded) = (mesh.face_count(), mesh.positions.len(), Instant::now());

    let target = (faces_in as f64 * arguments.ratio) as usize * 3;
    let error = simplify(&mut mesh, target, &arguments.mode, arguments.uv_weight)?;
    let simplified = Instant::now();

    obj_writer::write_obj(&arguments.output, &mesh, &mesh.mtllibs)
        .map_err(|error| format!("{}: {error}", arguments.output.display()))?;
    Ok(format!(
        "{{\"faces_in\": {faces_in}, \"vertices_in\": {wedges_in}, \"faces_out\": {}, \"error\": {error}, \
         \"read_s\": {:.3}, \"simplify_s\": {:.3}, \"write_s\": {:.3}}}",
        mesh.face_count(),
        (loaded - start).as_secs_f64(),
        (simplified - loaded).as_secs_f64(),
        simplified.elapsed().as_secs_f64(),
    ))
}

/// Leaves at most `target` indices if the topology allows it; returns meshoptimizer's error.
fn simplify(mesh: &mut Mesh, target: usize, mode: &str, uv_weight: f32) -> Result<f32, String> {
    let mut error = 0.0;
    if mode == "update" {
        let weights = if mesh.texcoords.is_empty() { &[][..] } else { &[uv_weight; 2][..] };
        let count = meshopt::simplify_with_update(
            &mut mesh.indices,
            &mut mesh.positions,
            mesh.texcoords.as_flattened_mut(),
            weights,
            size_of_val(weights),
            None,
            target,
            f32::MAX,
            SimplifyOptions::None,
            Some(&mut error),
        );
        mesh.indices.truncate(count);
    } else {
        let bytes = meshopt::typed_to_bytes(&mesh.positions);
        let vertices = VertexDataAdapter::new(bytes, size_of::<[f32; 3]>(), 0).map_err(|error| error.to_string())?;
        mesh.indices =
            meshopt::simplify(&mesh.indices, &vertices, target, f32::MAX, SimplifyOptions::None, Some(&mut error));
    }
    Ok(error)
}

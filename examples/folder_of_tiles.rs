//! Joins all tiles of a folder into one mesh that deviates by at most 5 cm; prints what happens, and stops on request.
//! The same call resumes what was stopped.
//!
//! `cargo run --release --example folder_of_tiles -- tiles/ out/city.obj`

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use drystone::{ErrorKind, Progress, Result, Simplify};

fn main() -> Result<()> {
    let paths: Vec<String> = std::env::args().skip(1).collect();
    let [folder, output] = paths.as_slice() else { panic!("give a folder and an output") };
    run(folder.as_ref(), output.as_ref(), &Log::default())
}

/// Prints phases; asks to stop once `stop` is set.
#[derive(Default)]
pub struct Log {
    /// Whether the run should stop.
    pub stop: AtomicBool,
    done: AtomicU64,
}

impl Progress for Log {
    fn begin(&self, phase: &'static str, total: u64, unit: &'static str) {
        self.done.store(0, Ordering::Relaxed);
        println!("{phase}: {total} {unit}");
    }

    fn advance(&self, units: u64) {
        self.done.fetch_add(units, Ordering::Relaxed);
    }

    fn tell(&self, message: &str) {
        println!("{message}");
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Joins and simplifies a folder.
pub fn run(folder: &Path, output: &Path, log: &Log) -> Result<()> {
    let call = Simplify::new(folder).exclude("*_lod*").to(output).max_error(0.05).threads(2);
    match call.run(log) {
        Ok(report) => println!("{} triangles", report.faces.output),
        Err(error) if error.kind() == ErrorKind::Stopped => println!("stopped; the same call resumes it"),
        Err(error) => return Err(error),
    }
    Ok(())
}

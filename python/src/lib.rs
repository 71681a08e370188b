//! The native half of the Python package `drystone`: runs commands of the program in this process.
//!
//! ```text
//! drystone/*.py ── arguments ──▶ call ──▶ a thread of its own: drystone::cli::call ──▶ JSON ──▶ drystone/report.py
//!                                  ▲ the caller's thread waits without the GIL, hands over events, sees Ctrl-C
//! ```

mod errors;
mod events;
mod hands;
mod job;

use std::ffi::OsString;
use std::panic::catch_unwind;
use std::path::PathBuf;

use drystone::Progress;
use drystone::image::decode::Image;
use pyo3::prelude::*;
use pyo3::types::PyByteArray;

use crate::job::{Stop, run};

#[pymodule]
mod _native {
    #[pymodule_export]
    use super::{call, decode_image, main};
    #[pymodule_export]
    use crate::hands::StageTasks;
    #[pymodule_export]
    use crate::job::Stop;

    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
    #[pymodule_export]
    const BUILD: &str = drystone::cli::LONG_VERSION;
}

/// Runs a command such as `["inspect", "city.obj"]`; returns its exit code and its JSON. `start` starts what has tasks of
/// the job done.
#[pyfunction]
#[pyo3(signature = (arguments, listener=None, stop=None, start=None))]
fn call(
    py: Python<'_>,
    arguments: Vec<OsString>,
    listener: Option<Bound<'_, PyAny>>,
    stop: Option<&Stop>,
    start: Option<Bound<'_, PyAny>>,
) -> PyResult<(u8, String)> {
    let work = move |hands, progress: &dyn Progress| drystone::cli::call(arguments, hands, progress);
    let answer = run(py, listener.as_ref(), stop, start.as_ref(), work)?;
    Ok((answer.code, answer.value.to_string()))
}

/// Decodes an image of the program's own making; returns its height and width, and its colours row by row.
#[pyfunction]
fn decode_image(py: Python<'_>, path: PathBuf) -> PyResult<(usize, usize, Bound<'_, PyByteArray>)> {
    let decoded = py.detach(|| Image::of_bytes(&std::fs::read(&path)?).map_err(std::io::Error::other))?;
    let [width, height] = decoded.size();
    Ok((height, width, PyByteArray::new(py, decoded.pixels())))
}

/// Runs the program with arguments, of which the first is its name; returns the exit code, for a panic that of Rust.
#[pyfunction]
fn main(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    // This process runs nothing else.
    drystone::return_freed_memory();
    drystone::claim_process();
    py.detach(|| catch_unwind(|| drystone::cli::run_with(arguments))).unwrap_or(101)
}

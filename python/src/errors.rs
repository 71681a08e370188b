//! Errors of the library as exceptions of `drystone.errors`.

use std::any::Any;
use std::ffi::OsString;

use drystone::{Error, ErrorKind};
use pyo3::prelude::*;

/// What `drystone.errors.from_native` makes an exception of: kind, message, path; a number: the line of an input, the
/// error number of the system, the bytes of a sufficient budget, the task; and the exit code of a task runner.
type Described = (&'static str, String, Option<OsString>, Option<u64>, Option<i32>);

/// The exception for an error.
pub fn exception(py: Python<'_>, error: &Error) -> PyErr {
    make(py, describe(error))
}

/// The exception for a panic.
pub fn panicked(py: Python<'_>, panic: &(dyn Any + Send)) -> PyErr {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
    make(py, ("internal", text, None, None, None))
}

/// The exception in a process that was forked from the one where the job runs.
pub fn forked(py: Python<'_>) -> PyErr {
    make(py, ("forked", String::new(), None, None, None))
}

fn make(py: Python<'_>, described: Described) -> PyErr {
    let made = py.import("drystone.errors").and_then(|module| module.call_method1("from_native", described));
    made.map_or_else(|error| error, PyErr::from_value)
}

fn describe(error: &Error) -> Described {
    let kind = match error.kind() {
        ErrorKind::Usage => "usage",
        ErrorKind::Input => "input",
        ErrorKind::Io => "io",
        ErrorKind::NoSpace => "no_space",
        ErrorKind::Budget => "budget",
        ErrorKind::Changed => "changed",
        ErrorKind::Locked => "locked",
        ErrorKind::Damaged => "damaged",
        ErrorKind::Stopped => "stopped",
        ErrorKind::Limit => "limit",
        ErrorKind::Task => "task",
        _ => "other",
    };
    let (path, number) = match error {
        Error::Input { path, line, .. } => (Some(path), Some(*line).filter(|line| *line > 0)),
        Error::Io { path, source, .. } => {
            (Some(path), source.raw_os_error().and_then(|number| u64::try_from(number).ok()))
        }
        Error::NoSpace { path, .. } | Error::Damaged { path, .. } | Error::Locked(path) => (Some(path), None),
        Error::Budget { needed, .. } => (None, *needed),
        Error::Task { task, .. } => (None, u64::try_from(*task).ok()),
        _ => (None, None),
    };
    let exit_code = match error {
        Error::Task { exit_code, .. } => *exit_code,
        _ => None,
    };
    (kind, error.to_string(), path.map(|path| path.clone().into_os_string()), number, exit_code)
}

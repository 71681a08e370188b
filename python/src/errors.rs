//! Errors of the library as exceptions of `drystone.errors`.

use std::any::Any;
use std::ffi::OsString;

use drystone::{Error, ErrorKind};
use pyo3::prelude::*;

/// What `drystone.errors.from_native` makes an exception of: kind, message, path, line, error number of the system.
type Described = (&'static str, String, Option<OsString>, u64, Option<i32>);

/// The exception for an error.
pub fn exception(py: Python<'_>, error: &Error) -> PyErr {
    make(py, describe(error))
}

/// The exception for a panic.
pub fn panicked(py: Python<'_>, panic: &(dyn Any + Send)) -> PyErr {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default();
    make(py, ("internal", text, None, 0, None))
}

/// The exception in a process that was forked from the one where the job runs.
pub fn forked(py: Python<'_>) -> PyErr {
    make(py, ("forked", String::new(), None, 0, None))
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
        _ => "other",
    };
    let (path, line, number) = match error {
        Error::Input { path, line, .. } => (Some(path), *line, None),
        Error::Io { path, source, .. } => (Some(path), 0, source.raw_os_error()),
        Error::NoSpace { path, .. } | Error::Damaged { path, .. } | Error::Locked(path) => (Some(path), 0, None),
        _ => (None, 0, None),
    };
    (kind, error.to_string(), path.map(|path| path.clone().into_os_string()), line, number)
}

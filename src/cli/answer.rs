//! What a command found, for a program that calls it instead of reading what it prints.

use std::path::Path;

use serde::Serialize;
use serde_json::Value;

use crate::base::{Error, Result};

/// What a command found.
#[derive(Debug, Clone, PartialEq)]
pub struct CommandAnswer {
    /// Exit code of the command: not 0 also for a target that was missed, a bound that was broken, faults.
    pub code: u8,
    /// What the command prints as JSON.
    pub value: Value,
}

impl CommandAnswer {
    /// An answer with the JSON of what was found.
    ///
    /// # Errors
    /// [`Error::Io`] if a value has no form in JSON.
    pub(super) fn new(code: u8, found: &impl Serialize) -> Result<Self> {
        match serde_json::to_value(found) {
            Ok(value) => Ok(Self { code, value }),
            Err(error) => Err(Error::io(Path::new("the result"), "write", error.into())),
        }
    }
}

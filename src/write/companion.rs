//! Files of a result beside its OBJ.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::job::codec;
use crate::scan::fingerprint;

/// A file of the result beside the OBJ.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Companion {
    /// Where it is.
    #[serde(with = "codec::path")]
    pub path: PathBuf,
    /// Its length in bytes and XXH3; nothing of a link, which only has to lead to a file.
    pub content: Option<(u64, u64)>,
}

impl Companion {
    /// Whether it is there still, as it was written.
    pub fn is_there(&self) -> bool {
        match self.content {
            Some(content) => fingerprint::content(&self.path).is_ok_and(|found| found == content),
            None => self.path.is_file(),
        }
    }
}

/// A texture of the input that was copied: its canonical path, its length and XXH3 as they were then.
pub type CopiedTexture = (PathBuf, (u64, u64));

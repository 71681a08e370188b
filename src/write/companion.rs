//! Files of a result beside its OBJ.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::file::codec;
use crate::os::content::Content;

/// A file of the result other than the OBJ.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Companion {
    /// Its path.
    #[serde(with = "codec::path")]
    pub path: PathBuf,
    /// Its content; `None` for a link, which only has to lead to a file.
    pub content: Option<Content>,
}

impl Companion {
    /// Reports whether it still exists with the content that was written.
    pub fn is_there(&self) -> bool {
        match self.content {
            Some(content) => Content::of(&self.path).is_ok_and(|found| found == content),
            None => self.path.is_file(),
        }
    }
}

/// A texture of the input that was copied: its canonical path, and its content at that time.
pub type CopiedTexture = (PathBuf, Content);

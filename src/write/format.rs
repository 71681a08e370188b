//! Formats of results.

use std::path::Path;

/// A format that is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ResultFormat {
    /// Wavefront OBJ, with an MTL.
    Obj,
    /// Stanford PLY.
    Ply,
    /// glTF 2.0 in one binary file.
    Glb,
    /// Arrays ([`ArrayLayout`](crate::model::array_file::ArrayLayout)).
    Arrays,
}

impl ResultFormat {
    /// Endings of the names of their files.
    const ENDINGS: [(Self, &str); 4] =
        [(Self::Obj, "obj"), (Self::Ply, "ply"), (Self::Glb, "glb"), (Self::Arrays, "drystone")];

    /// Whether images, or an MTL, lie beside such a file.
    pub(super) fn has_companions(self) -> bool {
        self != Self::Glb
    }

    /// Format of the files with the ending of a path; `None` for others.
    pub fn by_ending(path: &Path) -> Option<Self> {
        let ending = path.extension()?;
        Self::ENDINGS.into_iter().find(|(_, known)| ending.eq_ignore_ascii_case(known)).map(|(format, _)| format)
    }
}

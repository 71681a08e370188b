//! Values of finished steps, read back from a work folder that anyone may have changed.

use std::path::Path;

use serde::de::DeserializeOwned;

/// A value of a finished step that can be read back.
///
/// A checksum shows that the value is as it was written, but not that this program wrote it. What indexes memory or
/// files is checked before it is used.
pub trait Recalled: DeserializeOwned {
    /// What the value must fit.
    type Context<'a>;

    /// Looks for its files in `folder`, which may have moved, and nowhere else.
    fn locate(&mut self, _folder: &Path, _context: &Self::Context<'_>) {}

    /// Reports whether the value fits, so that it can be used without further checks. Called once it is located.
    fn is_sound(&self, context: &Self::Context<'_>) -> bool;
}

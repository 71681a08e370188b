//! What the passes know of the texture of the whole mesh.

use serde::{Deserialize, Serialize};

use crate::model::Catalogue;
use crate::partition::TextureScale;

/// Properties of the texture that the passes use.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct TextureTraits {
    /// Scales of texture coordinates.
    pub scale: TextureScale,
    /// Predicted share of the result's vertices that lie on seams; infinite if it was not measured.
    pub seam_density: f64,
}

impl TextureTraits {
    /// Traits for a metric that ignores the texture.
    pub fn none(catalogue: &Catalogue) -> Self {
        Self { scale: TextureScale::none(catalogue), seam_density: f64::INFINITY }
    }
}

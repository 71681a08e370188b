//! Where the tiles lie: the origin of the scene, the length of the texels and the lattice of each level.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::lattice::Lattice;
use crate::geometry::boxtree::Bounds;

/// The origin is a multiple of a power of two that is at least this share of the size.
const ORIGIN_SHARE: f64 = 1.0 / 16.0;

/// The scene.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TileScene {
    /// Positions of tiles are relative to this.
    pub origin: DVec3,
    /// The smallest box around the input.
    pub bounds: Bounds,
    /// Length of a texel's side in level 0.
    pub texel: f64,
    lattice: Lattice,
}

impl TileScene {
    /// The scene of a surface with texels of this length.
    pub fn new(bounds: Bounds, texel: f64) -> Self {
        let middle = 0.5 * (bounds.low + bounds.high);
        let size = (bounds.high - bounds.low).max_element();
        let step = libm::exp2(libm::floor(libm::log2(size * ORIGIN_SHARE)));
        let origin = if step > 0.0 && step.is_finite() { (middle / step).round() * step } else { middle };
        let reach = (bounds.low - origin).abs().max((bounds.high - origin).abs()).max_element();
        Self { origin, bounds, texel, lattice: Lattice::new(texel, reach) }
    }

    /// Reports whether lengths are lengths.
    pub fn is_sound(&self) -> bool {
        [self.texel, self.lattice.step].into_iter().all(|length| length.is_normal() && length > 0.0)
            && self.origin.is_finite()
    }

    /// Length of a texel's side in a level.
    pub fn texel_of(&self, level: u32) -> f64 {
        self.texel * libm::exp2(f64::from(level))
    }

    /// The lattice of a level.
    pub fn lattice(&self, level: u32) -> Lattice {
        Lattice { step: self.lattice.step * libm::exp2(f64::from(level)) }
    }
}

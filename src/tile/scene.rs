//! Where the tiles lie: the origin of the scene, the length of the texels and the lattice of each level.

use std::ops::RangeInclusive;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::lattice::Lattice;
use crate::bake::LengthHistogram;
use crate::base::{Progress, Result};
use crate::geometry::boxtree::Bounds;
use crate::surface::cells::SurfaceCells;

/// The origin is a multiple of a power of two that is at least this share of the size.
const ORIGIN_SHARE: f64 = 1.0 / 16.0;
/// Share of the triangles that may be as small as the lattice.
const FINE_SHARE: f64 = 0.02;

/// Lengths of a scene, from the step of the finest lattice to the size of all, in its unit of length: 2^-120 to 2^120.
/// Viewers hold them in single precision, which ends at 2^±126.
const LENGTHS: RangeInclusive<f64> = 7.6e-37..=1.3e36;

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

/// Lengths of the longest edges of triangles.
#[derive(Debug, Clone, Copy)]
pub struct EdgeLengths {
    /// Half of the triangles have a shorter one.
    pub median: f64,
    /// One triangle in fifty has a shorter one.
    pub fine: f64,
}

impl EdgeLengths {
    /// Those of a surface; infinite if no triangle has an extent.
    ///
    /// # Errors
    /// If the job was stopped, and on failed reads.
    pub fn of(surface: &SurfaceCells, progress: &dyn Progress) -> Result<Self> {
        let mut lengths = LengthHistogram::default();
        for cell in &surface.cells {
            progress.check_stopped()?;
            let view = cell.view()?;
            for number in 0..view.faces.len() as u32 {
                let [a, b, c] = view.triangle(number);
                let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
                if longest.is_normal() {
                    lengths.add(longest, 1.0);
                }
            }
        }
        let quantile = |share| lengths.quantile(share).unwrap_or(f64::INFINITY);
        Ok(Self { median: quantile(0.5), fine: quantile(FINE_SHARE) })
    }
}

impl TileScene {
    /// The scene of a surface with texels of this length. Where texels are longer than edges, as where each triangle shows
    /// one texel of a palette, edges decide: else triangles would vanish between texels.
    pub fn new(bounds: Bounds, texel: f64, edges: EdgeLengths) -> Self {
        let texel = texel.min(edges.median);
        let middle = 0.5 * (bounds.low + bounds.high);
        let size = (bounds.high - bounds.low).max_element();
        let step = libm::exp2(libm::floor(libm::log2(size * ORIGIN_SHARE)));
        let origin = if step > 0.0 && step.is_finite() { (middle / step).round() * step } else { middle };
        let reach = (bounds.low - origin).abs().max((bounds.high - origin).abs()).max_element();
        Self { origin, bounds, texel, lattice: Lattice::new(texel.min(edges.fine), reach) }
    }

    /// Length along an axis and step of the finest lattice, if these are too large or too small for viewers.
    pub fn unfit_lengths(&self) -> Option<[f64; 2]> {
        let lengths = [(self.bounds.high - self.bounds.low).max_element(), self.lattice.step];
        lengths.iter().any(|length| !LENGTHS.contains(length)).then_some(lengths)
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

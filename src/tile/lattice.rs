//! The lattice of a level: the places that vertices of its tiles may have, so that neighbours agree on them to the bit.
//!
//! Positions are relative to the origin of the scene. The step is a power of two, and that of a coarser level a multiple
//! of it, so every place of a coarser level is one of the finer levels, too.

use glam::{DVec3, IVec3};
use serde::{Deserialize, Serialize};

/// Steps of the lattice for each texel, at least.
const STEPS_OF_TEXEL: f64 = 16.0;
/// Places from the origin along an axis at most: the difference of two fits an integer of 32 bits.
const PLACES_MAX: f64 = (1u64 << 29) as f64;

/// Largest distance in places that a float of 32 bits holds exactly, whatever it is.
pub const FLOAT_PLACES_MAX: i32 = 1 << 24;

/// A cubic lattice through the origin of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Lattice {
    /// Distance of neighbouring places, in the mesh's unit of length.
    pub step: f64,
}

impl Lattice {
    /// The lattice of a level whose texels are this long, in a scene that reaches this far from its origin.
    pub fn new(texel: f64, reach: f64) -> Self {
        let wanted = (texel / STEPS_OF_TEXEL).max(reach / PLACES_MAX).max(f64::MIN_POSITIVE);
        let below = libm::exp2(libm::floor(libm::log2(wanted)));
        Self { step: if reach / below > PLACES_MAX { 2.0 * below } else { below } }
    }

    /// The nearest place.
    #[inline]
    pub fn place(self, position: DVec3) -> IVec3 {
        (position / self.step).round().as_ivec3()
    }

    /// Position of a place.
    #[inline]
    pub fn position(self, place: IVec3) -> DVec3 {
        place.as_dvec3() * self.step
    }

    /// The coordinate nearest to one where no place of this lattice or a coarser one lies.
    pub fn between(self, coordinate: f64) -> f64 {
        ((coordinate / self.step).floor() + 0.5) * self.step
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn places_come_back_and_planes_hold_none(at in prop::array::uniform3(-1e4f64..1e4), texel in 1e-3f64..10.0) {
            let lattice = Lattice::new(texel, 1e4);
            prop_assert!(lattice.step <= texel / 8.0);
            let position = lattice.position(lattice.place(at.into()));
            prop_assert!((position - DVec3::from(at)).abs().max_element() <= 0.5 * lattice.step);
            prop_assert_eq!(lattice.place(position), lattice.place(at.into()));
            let plane = lattice.between(at[0]);
            for coarser in [1.0, 2.0, 4.0, 64.0] {
                let step = coarser * lattice.step;
                prop_assert!((plane / step).fract() != 0.0);
            }
        }
    }

    #[test]
    fn a_scene_far_wider_than_its_texels_has_a_coarser_lattice() {
        let lattice = Lattice::new(1e-9, 1e6);
        assert!(lattice.place(DVec3::splat(1e6)).max_element() <= 1 << 29);
    }
}

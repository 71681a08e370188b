//! Weights of the default cost, and how firmly it holds seams.
//!
//! A straightened seam lies outside of one of its two charts by as much as it lies inside the other. Where few vertices of
//! the result will lie on seams, these are so short that it hardly does, however lightly they are held, and the surface may
//! have the vertices; the more there are, the more firmly must they be held. Where they would take nearly all vertices,
//! that costs the surface more than it gives the picture, and they are held lightly again; where they would take more than
//! there are, by the square of that.

use super::knob::{Knob, factor, switch};

/// Crowding with seams between which they are held firmly.
const FIRM: [f64; 2] = [0.52, 0.65];
/// Crowding up to which, and from which on, they are held lightly.
const LOOSE: [f64; 2] = [0.32, 0.85];
/// Weight of seams that are held lightly, relative to that of firm ones; between both it grows by equal factors.
const LIGHT: f64 = 0.08;

/// Crowding beyond which seams are held no more lightly.
const CROWDING_MAX: f64 = 4.0;

/// Weights of the terms, all relative to the area-weighted squared distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// Of the squared slide of the picture; 0 leaves texture out of the cost.
    pub uv: f64,
    /// Of the squared distance to an open border, per squared border length.
    pub border: f64,
    /// Of the squared distance to a seam that is held firmly, per squared seam length and side.
    pub seam: f64,
    /// Share of what a straightened seam or border leaves its chart by that its texture coordinates move inwards instead.
    pub inset: f64,
    /// Share of the result's vertices that seams would take
    /// ([`SeamTally::crowding`](crate::mesh::crowding::SeamTally::crowding)); infinite if it is not known.
    pub crowding: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Self::from(KNOBS.map(|knob| knob.default))
    }
}

/// What may be set besides the weight of the slide.
pub const KNOBS: [Knob; 3] = [
    factor("border", 1.0, "weight of the squared distance to open borders"),
    factor(
        "seam",
        1.5,
        "weight of the squared distance to seams; 8 % of it where they will be few or take nearly all vertices",
    ),
    switch(
        "inset",
        0.0,
        "share of what a straightened seam leaves its chart by that its picture moves inwards instead",
    ),
];

impl From<[f64; 3]> for Weights {
    fn from([border, seam, inset]: [f64; 3]) -> Self {
        Self { uv: 0.7, border, seam, inset, crowding: f64::INFINITY }
    }
}

impl Weights {
    /// Weight of the squared distance to seams, as crowded as they are.
    pub fn of_seams(&self) -> f64 {
        let sparse = (FIRM[0] - self.crowding) / (FIRM[0] - LOOSE[0]);
        let crowded = (self.crowding - FIRM[1]) / (LOOSE[1] - FIRM[1]);
        let lightness = sparse.max(crowded).clamp(0.0, 1.0);
        let overcrowding = (self.crowding.min(CROWDING_MAX) / LOOSE[1]).max(1.0);
        self.seam * libm::pow(LIGHT, lightness) / (overcrowding * overcrowding)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_seams_and_crowded_ones_are_held_lightly() {
        let at = |crowding| Weights { crowding, seam: 1.0, ..Weights::default() }.of_seams();
        assert_eq!([at(0.0), at(0.32), at(0.85)], [LIGHT; 3]);
        assert!((at(1.7) / LIGHT - 0.25).abs() < 1e-12 && at(f64::INFINITY) == at(CROWDING_MAX));
        assert_eq!([at(0.52), at(0.65)], [1.0; 2]);
        assert!(at(0.35) < at(0.45) && at(0.7) > at(0.8));
    }
}

//! Weights of the default cost, and the weight of seams by their predicted density.
//!
//! A straightened seam lies outside one of its two charts by as much as inside the other. The seam weight limits this
//! overhang, at the price of vertices for the surface. It depends on the share of the result's vertices that will lie
//! on seams:
//!
//! * Low: seam edges are short, so a seam hardly leaves its chart, and a light weight is enough.
//! * Medium: the full weight.
//! * High, where seams would take nearly all vertices: the surface loses more than the texture gains, so the weight is
//!   light again. Above that it falls with the inverse square of the density.

use serde::{Deserialize, Serialize};

use super::parameter::{Parameter, factor, switch};

/// NOTE: tuned. Seam densities between which seams have their full weight.
const FIRM: [f64; 2] = [0.52, 0.65];
/// NOTE: tuned. Seam densities up to which, and from which on, seams have the light weight.
const LOOSE: [f64; 2] = [0.32, 0.85];
/// NOTE: tuned. Light weight relative to the full weight; in between the weight is interpolated geometrically.
const LIGHT: f64 = 0.08;

/// Seam density above which the weight falls no further.
const SEAM_DENSITY_MAX: f64 = 4.0;

/// Weights of the terms, all relative to the area-weighted squared distance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Weights {
    /// Of the squared texture drift; 0 leaves texture out of the cost.
    pub uv: f64,
    /// Of the squared distance to an open border, per squared border length.
    pub border: f64,
    /// Of the squared distance to a seam at full weight, per squared seam length and side.
    pub seam: f64,
    /// Share of the overhang of a straightened seam or border beyond its chart by which its texture coordinates move
    /// into the chart, 0 to 1.
    pub inset: f64,
    /// Predicted share of the result's vertices on seams
    /// ([`SeamTally::seam_density`](crate::mesh::seam_density::SeamTally::seam_density)); infinite if unknown.
    pub seam_density: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Self::from(PARAMETERS.map(|parameter| parameter.default))
    }
}

/// Parameters besides the weight of the texture drift.
pub const PARAMETERS: [Parameter; 3] = [
    factor("border", 1.0, "weight of the squared distance to open borders"),
    factor(
        "seam",
        1.5,
        "weight of the squared distance to seams; 8 % of it where they will be few or take nearly all vertices",
    ),
    switch(
        "inset",
        0.0,
        "share of the overhang by which the texture coordinates of a straightened seam move back into its chart",
    ),
];

impl From<[f64; 3]> for Weights {
    fn from([border, seam, inset]: [f64; 3]) -> Self {
        Self { uv: 0.7, border, seam, inset, seam_density: f64::INFINITY }
    }
}

impl Weights {
    /// Weight of the squared distance to seams at their predicted density.
    pub fn of_seams(&self) -> f64 {
        let sparse = (FIRM[0] - self.seam_density) / (FIRM[0] - LOOSE[0]);
        let crowded = (self.seam_density - FIRM[1]) / (LOOSE[1] - FIRM[1]);
        let lightness = sparse.max(crowded).clamp(0.0, 1.0);
        let excess = (self.seam_density.min(SEAM_DENSITY_MAX) / LOOSE[1]).max(1.0);
        self.seam * libm::pow(LIGHT, lightness) / (excess * excess)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_seams_and_crowded_ones_are_held_lightly() {
        let at = |seam_density| Weights { seam_density, seam: 1.0, ..Weights::default() }.of_seams();
        assert_eq!([at(0.0), at(0.32), at(0.85)], [LIGHT; 3]);
        assert!((at(1.7) / LIGHT - 0.25).abs() < 1e-12 && at(f64::INFINITY) == at(SEAM_DENSITY_MAX));
        assert_eq!([at(0.52), at(0.65)], [1.0; 2]);
        assert!(at(0.35) < at(0.45) && at(0.7) > at(0.8));
    }
}

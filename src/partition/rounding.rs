//! Rounds the coordinates of moved vertices, and keeps two of them from coming to one place.

use std::collections::HashMap;

use foldhash::fast::RandomState;
use glam::DVec3;
use xxhash_rust::xxh3::xxh3_64;

use crate::base::id::TiVec;
use crate::file::decimal::POWERS_OF_TEN;
use crate::geometry::position_key;
use crate::model::id::PieceVertex;

/// Largest rounding error of a moved vertex, as a share of its shortest edge.
const ROUNDING_SHARE: f64 = 1e-3;
/// Largest unit of the last decimal of a moved coordinate, as a share of the bound on the error. Rounding and up to
/// [`STEPS_ASIDE_MAX`] units of shift then move a vertex by less than a sixtieth of the bound.
const BOUND_UNIT_SHARE: f64 = 1.0 / 1024.0;
/// Positions tried for a moved vertex whose own is taken.
const STEPS_ASIDE_MAX: u32 = 16;
/// Decimals from which a coordinate is not rounded.
const DECIMALS_MAX: u32 = POWERS_OF_TEN.len() as u32 - 1;

/// Rounding of the coordinates of moved vertices.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rounding {
    /// Largest number of decimals of a position in the input.
    pub input_decimals: u32,
    /// Largest allowed deviation in units of length; `None` if it is unbounded.
    pub max_error: Option<f64>,
}

impl Rounding {
    /// Decimals for a vertex whose shortest edge has length `shortest`.
    pub fn decimals(&self, shortest: f64) -> u32 {
        let bounded = self.max_error.map_or(f64::INFINITY, |most| BOUND_UNIT_SHARE * most);
        let step = (2.0 * ROUNDING_SHARE * shortest).min(bounded);
        let needed = decimals_for(step);
        if self.input_decimals <= needed {
            return needed;
        }
        // The decimals of the input, but no finer than a thousandth of what is needed: some exporters write 1e-05.
        self.input_decimals.min(decimals_for(step * 1e-3)).max(needed)
    }
}

/// Positions in use. Two sheets of the same shape may simplify to the same positions, and would then seem joined.
pub(super) struct TakenPlaces {
    /// Position of each vertex before it moved.
    before: TiVec<PieceVertex, DVec3>,
    /// One vertex at each position; only looked up, never iterated.
    at: HashMap<[u64; 3], PieceVertex, RandomState>,
}

impl TakenPlaces {
    /// Marks the positions of the vertices that stay as taken.
    pub fn new(before: TiVec<PieceVertex, DVec3>, stays: impl Fn(PieceVertex) -> bool) -> Self {
        let staying = before.iter_enumerated().filter(|&(vertex, _)| stays(vertex));
        Self { at: staying.map(|(vertex, &position)| (position_key(position), vertex)).collect(), before }
    }

    /// Returns the position for a moved vertex: `wanted`, or if a vertex is there that was elsewhere before, a position
    /// shifted along x by one or more units of the last decimal. Falls back to `wanted` if all are taken.
    pub fn place(&mut self, vertex: PieceVertex, wanted: DVec3, decimals: u32) -> DVec3 {
        let unit = 1.0 / POWERS_OF_TEN[decimals.min(DECIMALS_MAX) as usize];
        let beside = (0..STEPS_ASIDE_MAX).map(|step| DVec3::new(wanted.x + f64::from(step) * unit, wanted.y, wanted.z));
        let rounded = beside.map(|place| DVec3::new(round_to(place.x, decimals), place.y, place.z));
        let was_together = |other: PieceVertex| self.before[other] == self.before[vertex];
        let mut free =
            rounded.filter(|&place| self.at.get(&position_key(place)).is_none_or(|&other| was_together(other)));
        let place = free.next().unwrap_or(wanted);
        self.at.insert(position_key(place), vertex);
        place
    }
}

/// Reports whether some of the positions may be equal; false is certain.
pub(super) fn may_have_twins(positions: &[DVec3]) -> bool {
    let hash = |position: &DVec3| xxh3_64(bytemuck::bytes_of(&position_key(*position)));
    let mut hashes: Vec<u64> = positions.iter().map(hash).collect();
    hashes.sort_unstable();
    hashes.windows(2).any(|pair| pair[0] == pair[1])
}

/// Smallest number of decimals whose last unit is at most `step`; all of them if nothing may be rounded.
fn decimals_for(step: f64) -> u32 {
    if step <= 0.0 {
        DECIMALS_MAX
    } else if step.is_finite() {
        (-libm::log10(step)).ceil().max(0.0).min(f64::from(DECIMALS_MAX)) as u32
    } else {
        0
    }
}

/// Rounds `x` to a number of decimals; returns `x` itself if doubles are coarser than that.
pub(super) fn round_to(x: f64, decimals: u32) -> f64 {
    let factor = POWERS_OF_TEN[decimals.min(DECIMALS_MAX) as usize];
    let scaled = (x * factor).round();
    if decimals >= DECIMALS_MAX || scaled.abs() > 4e15 { x } else { scaled / factor }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_gives_the_decimals_asked_for() {
        assert_eq!(round_to(4_581_200.123_456_789, 3), 4_581_200.123);
        assert_eq!(round_to(0.1 + 0.2, 4), 0.3);
        assert_eq!(round_to(1e300, 3), 1e300);
        assert_eq!(decimals_for(0.002), 3);
        assert_eq!([0.0, f64::INFINITY].map(decimals_for), [DECIMALS_MAX, 0]);
    }

    #[test]
    fn rounding_leaves_room_below_a_bound() {
        let free = Rounding { input_decimals: 2, max_error: None };
        assert_eq!(free.decimals(50.0), 2);
        for max_error in [1e-6, 0.003, 0.5] {
            let decimals = Rounding { max_error: Some(max_error), ..free }.decimals(50.0);
            let unit = 1.0 / POWERS_OF_TEN[decimals as usize];
            assert!((f64::from(STEPS_ASIDE_MAX) + 0.5 * 3f64.sqrt()) * unit < max_error / 60.0);
        }
    }

    #[test]
    fn two_vertices_do_not_come_to_one_place_unless_they_were_at_one() {
        let before = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Y, DVec3::Z];
        assert!(may_have_twins(&before) && !may_have_twins(&before[..3]));
        let mut taken = TakenPlaces::new(before.to_vec().into(), |vertex| vertex == PieceVertex::new(0));
        let mut place = |vertex, wanted| taken.place(PieceVertex::new(vertex), wanted, 3);
        assert_eq!(place(1, DVec3::ZERO), DVec3::new(0.001, 0.0, 0.0));
        assert_eq!(place(4, DVec3::ZERO), DVec3::new(0.002, 0.0, 0.0));
        let free = DVec3::splat(2.5);
        assert_eq!(place(2, free), free);
        assert_eq!(place(3, free), free);
    }
}

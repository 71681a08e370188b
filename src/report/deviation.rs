//! Deviation that a comparison measured, and whether it keeps the bound of `--max-error`.
//!
//! In: the distances of a [`Comparison`](crate::measure::figures::Comparison). Out: lines for the terminal, and a
//! message if some point is farther away than `--max-error` allows.

use std::fmt::Write as _;

use super::numbers::length;
use super::run::Report;
use crate::measure::figures::{Comparison, Distances, Geometry, ROUNDING_SHARE};
use crate::measure::gauge::Gauged;

/// Units in the last place of a coordinate that rounding alone may add to a distance.
const ROUNDING_UNITS: f64 = 16.0;
/// Why a run has no deviation.
const UNMEASURED: &str = "not measured: the mesh has no area, or its triangles lie across each other by the thousand";
/// Advice for a broken bound above 0.
const CLOSER: &str = "; a smaller --max-error gives a closer result";

impl Report {
    /// Message if the comparison found a point that is farther away than `--max-error` allows; `None` if the bound is
    /// kept, was not asked for or was not measured.
    pub fn broken_bound(&self) -> Option<String> {
        broken_bound(self.options.target.max_error?, &self.comparison.as_ref()?.geometry)
    }

    /// Appends the summary's lines about the deviation.
    pub(super) fn add_deviation(&self, text: &mut String) {
        if let Some(bound) = self.options.target.max_error {
            let _ = writeln!(text, "deviation allowed: {bound}");
        }
        match &self.comparison {
            Some(comparison) => add_measured(text, comparison),
            None => add_gauged(text, self.error.measured.as_ref()),
        }
    }
}

/// The measured figures, in the mesh's unit of length.
fn add_measured(text: &mut String, Comparison { geometry, samples, .. }: &Comparison) {
    let points = samples.map_or("all vertices".into(), |count| format!("{count} points each"));
    let rms = length(geometry.symmetric.rms);
    let _ = writeln!(text, "deviation: {rms} (RMS both ways, measured at {points})");
    let _ = writeln!(text, "largest deviation: {}", length(geometry.symmetric.max));
}

/// The figures that every run measures.
fn add_gauged(text: &mut String, found: Option<&Gauged>) {
    let _ = match found {
        Some(found) => {
            writeln!(text, "deviation: {} (RMS both ways, measured at {} points)", length(found.rms), found.points)
        }
        None => writeln!(text, "deviation: {UNMEASURED}"),
    };
}

/// Message that says where and by how much distances exceed the bound; `None` if they do not.
fn broken_bound(bound: f64, geometry: &Geometry) -> Option<String> {
    let ways =
        [(&geometry.forward, "from the result to the input"), (&geometry.backward, "from the input to the result")];
    let (way, words) = ways.into_iter().max_by(|(a, _), (b, _)| a.max.total_cmp(&b.max))?;
    if way.max <= bound + rounding(way, geometry.diagonal) {
        return None;
    }
    let place = way.worst.first().map_or_else(String::new, |worst| {
        let [x, y, z] = worst.position;
        format!(", at {x} {y} {z}")
    });
    let advice = if bound > 0.0 { CLOSER } else { "" };
    let found = length(way.max);
    Some(format!("--max-error {bound} is broken: the distance {words} is {found}{place}{advice}"))
}

/// Largest distance that rounding alone may cause at the farthest point: rounding of its coordinates as they are
/// written, or rounding in the measurement, which is larger at long and thin triangles.
fn rounding(way: &Distances, diagonal: f64) -> f64 {
    let coordinates = way.worst.first().into_iter().flat_map(|worst| worst.position.into_iter().chain(worst.closest));
    let written = ROUNDING_UNITS * f64::EPSILON * coordinates.fold(0.0f64, |largest, x| largest.max(x.abs()));
    written.max(ROUNDING_SHARE * diagonal)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::measure::figures::FarPoint;

    /// Distances whose largest lies at a corner of a cube around the origin.
    fn up_to(max: f64, corner: f64) -> Distances {
        let worst = FarPoint { distance: max, position: [corner; 3], closest: [corner; 3] };
        Distances { max, worst: vec![worst], ..Distances::default() }
    }

    proptest! {
        #[test]
        fn a_bound_is_broken_by_the_larger_of_both_ways(
            bound in 1e-6f64..1e3,
            shares in [0.0f64..3.0, 0.0f64..3.0],
        ) {
            let [forward, backward] = shares.map(|share| up_to(share * bound, 1.0));
            let geometry = Geometry { forward, backward, ..Geometry::default() };
            let is_broken = shares[0].max(shares[1]) > 1.000_001;
            let is_kept = shares[0].max(shares[1]) <= 1.0;
            prop_assume!(is_broken || is_kept);
            let found = broken_bound(bound, &geometry);
            prop_assert_eq!(found.is_some(), is_broken);
            let way = if shares[0] > shares[1] { "from the result" } else { "from the input" };
            prop_assert!(found.is_none_or(|words| words.contains(way)));
        }
    }

    #[test]
    fn rounding_of_coordinates_breaks_no_bound() {
        let geometry = |max| Geometry { forward: up_to(max, 5e6), ..Geometry::default() };
        assert_eq!(broken_bound(0.0, &geometry(2e-9)), None);
        assert!(broken_bound(0.0, &geometry(1e-7)).unwrap().contains("at 5000000 5000000 5000000"));
        // A city of 5 km: distances measured on a mesh that did not change.
        let city = |max| Geometry { forward: up_to(max, 2e3), diagonal: 5e3, ..Geometry::default() };
        assert_eq!(broken_bound(0.0, &city(1.2e-9)), None);
        assert!(broken_bound(0.0, &city(1e-8)).is_some());
    }

    #[test]
    fn a_smaller_bound_is_advised_where_there_is_one() {
        let found = |bound| broken_bound(bound, &Geometry { forward: up_to(2.0, 1.0), ..Geometry::default() }).unwrap();
        assert!(found(1.0).contains("a smaller --max-error"));
        assert!(found(0.0).ends_with("at 1 1 1"), "{}", found(0.0));
    }
}

//! Statistics of the whole mesh that a metric normalises by. They are summed over all clusters once and then frozen, so
//! that costs in different clusters can be compared.
//!
//! # Memory
//! 12 bytes for each magnitude that occurs, at most 131,072 of them.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::job::Recalled;

/// Low bits of a double that a magnitude drops: 64 magnitudes per power of two remain.
const MAGNITUDE_SHIFT: u32 = 46;

/// Count, sum, histogram and bounding box of the values of a mesh.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MeshStats {
    /// Number of positive values by magnitude.
    magnitudes: BTreeMap<u32, u64>,
    sum: f64,
    count: u64,
    low: DVec3,
    high: DVec3,
}

impl Default for MeshStats {
    fn default() -> Self {
        let none = DVec3::splat(f64::INFINITY);
        Self { magnitudes: BTreeMap::new(), sum: 0.0, count: 0, low: none, high: -none }
    }
}

impl Recalled for MeshStats {
    type Context<'a> = ();

    /// Sums index nothing.
    fn is_sound(&self, (): &()) -> bool {
        true
    }
}

impl MeshStats {
    /// Adds a value; ignores it if it is not finite. Only positive values count for the median.
    pub fn add(&mut self, value: f64) {
        if !value.is_finite() {
            return;
        }
        self.sum += value;
        self.count += 1;
        if value > 0.0 {
            *self.magnitudes.entry((value.to_bits() >> MAGNITUDE_SHIFT) as u32).or_default() += 1;
        }
    }

    /// Extends the box to a position in coordinates of the whole mesh.
    pub fn enclose(&mut self, position: DVec3) {
        self.low = self.low.min(position);
        self.high = self.high.max(position);
    }

    /// Adds the statistics of another cluster. Clusters must come in order, because the sum is rounded.
    pub fn merge(&mut self, other: &Self) {
        for (&magnitude, &count) in &other.magnitudes {
            *self.magnitudes.entry(magnitude).or_default() += count;
        }
        self.sum += other.sum;
        self.count += other.count;
        self.low = self.low.min(other.low);
        self.high = self.high.max(other.high);
    }

    /// Mean of the values; `None` without values.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / self.count as f64)
    }

    /// Median of the positive values, at most 1/64 too low; `None` without positive values.
    pub fn median(&self) -> Option<f64> {
        let half = self.magnitudes.values().sum::<u64>().div_ceil(2);
        let mut seen = 0;
        for (&magnitude, &count) in &self.magnitudes {
            seen += count;
            if seen >= half {
                return Some(f64::from_bits(u64::from(magnitude) << MAGNITUDE_SHIFT));
            }
        }
        None
    }

    /// Diagonal of the box, at least the smallest positive normal number.
    pub fn diagonal(&self) -> f64 {
        let diagonal = (self.high - self.low).length();
        if diagonal.is_normal() { diagonal } else { f64::MIN_POSITIVE }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_that_of_positive_values_and_the_mean_of_all() {
        let mut stats = MeshStats::default();
        for value in [0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 400.0, f64::NAN] {
            stats.add(value);
        }
        assert_eq!(stats.median(), Some(2.0));
        assert_eq!(stats.mean(), Some(403.0 / 7.0));
        assert_eq!(MeshStats::default().median(), None);
    }

    #[test]
    fn parts_add_up_to_the_whole() {
        let (mut whole, mut left, mut right) = (MeshStats::default(), MeshStats::default(), MeshStats::default());
        for i in 0..100u32 {
            let value = f64::from(i * i % 37);
            whole.add(value);
            if i < 40 { &mut left } else { &mut right }.add(value);
        }
        left.merge(&right);
        assert_eq!(left, whole);
    }
}

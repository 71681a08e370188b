//! Random points on triangles.

use glam::DVec3;

use crate::base::chance::{mixed, place_on_triangle, unit};
use crate::geometry::triangle::area;

/// Random points on a sequence of triangles at a fixed density.
#[derive(Debug)]
pub struct RandomPoints {
    /// Area per point.
    spacing: f64,
    owed: f64,
    hash: u64,
    /// Number of points that may still be placed.
    left: u64,
}

impl RandomPoints {
    /// Places one point per `spacing` of area, at most `most`. The same `seed` gives the same points.
    pub fn new(spacing: f64, most: u64, seed: u64) -> Self {
        Self { spacing, owed: unit(mixed(seed)), hash: mixed(seed), left: most }
    }

    /// Visits the points on the next triangle; none if its area is zero or not finite.
    pub fn over(&mut self, triangle: [DVec3; 3], mut visit: impl FnMut(DVec3)) {
        for _ in 0..self.due(triangle) {
            visit(point_on(triangle, &mut self.hash));
        }
    }

    /// Skips the points on the next triangle.
    pub fn pass(&mut self, triangle: [DVec3; 3]) {
        self.due(triangle);
    }

    /// Number of points on the next triangle.
    fn due(&mut self, triangle: [DVec3; 3]) -> u64 {
        let due = area(triangle) / self.spacing;
        self.owed += if due.is_finite() { due } else { 0.0 };
        let whole = (self.owed as u64).min(self.left);
        self.owed -= whole as f64;
        self.left -= whole;
        whole
    }
}

/// A random point on a triangle; `hash` is the state of the generator.
pub(super) fn point_on([a, b, c]: [DVec3; 3], hash: &mut u64) -> DVec3 {
    let [across, along] = [0, 1].map(|_| {
        *hash = mixed(*hash);
        unit(*hash)
    });
    let [of_a, of_b, of_c] = place_on_triangle(across, along);
    a * of_a + b * of_b + c * of_c
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_spread_by_area() {
        let right = |x: f64, size: f64| [[0.0, 0.0], [size, 0.0], [0.0, size]].map(|[u, v]| DVec3::new(x + u, v, 0.0));
        let mut spread = RandomPoints::new(0.001, 10_000, 7);
        let (mut small, mut large) = (0, 0);
        spread.over(right(0.0, 1.0), |_| small += 1);
        spread.over(right(9.0, 2.0), |point| {
            assert!(point.x >= 9.0 && point.y >= 0.0 && point.x - 9.0 + point.y <= 2.0 + 1e-12);
            large += 1;
        });
        assert!((499..=501).contains(&small) && (1999..=2001).contains(&large));
    }
}

//! Convex parts of triangles, and how they are cut by planes or halved.

use glam::DVec3;

/// Largest number of corners of a part; each cut adds at most one.
pub const CORNERS_MAX: usize = 9;

/// A convex planar polygon; its corners are indices of points in [`Parts`].
#[derive(Debug, Clone, Copy, Default)]
pub struct ConvexPolygon {
    corners: [u16; CORNERS_MAX],
    count: usize,
}

impl ConvexPolygon {
    /// A triangle.
    pub fn triangle(corners: [u16; 3]) -> Self {
        let mut part = Self::default();
        corners.into_iter().for_each(|corner| part.push(corner));
        part
    }

    /// Indices of the corners, in order.
    pub fn corners(&self) -> &[u16] {
        &self.corners[..self.count]
    }

    /// Whether it has room for the three corners that cuts along the sides of a triangle may add.
    pub fn can_be_cut(&self) -> bool {
        self.count + 3 <= CORNERS_MAX
    }

    fn push(&mut self, corner: u16) {
        self.corners[self.count] = corner;
        self.count += 1;
    }
}

/// The corner points of parts.
#[derive(Debug, Default)]
pub struct Parts {
    /// Corners of whole triangles, then the points that cuts add.
    pub points: Vec<DVec3>,
}

impl Parts {
    /// Position of a corner.
    pub fn point(&self, corner: u16) -> DVec3 {
        self.points[usize::from(corner)]
    }

    /// Adds a point; returns its index.
    pub fn push(&mut self, point: DVec3) -> u16 {
        self.points.push(point);
        (self.points.len() - 1) as u16
    }

    /// Cuts a part along planes (normal, offset), and passes the resulting parts to `found`, the one inside all planes
    /// last. Returns `false`, and passes none, if no plane cuts the part, or if it has no room for more corners.
    pub fn cut_along(
        &mut self,
        part: &ConvexPolygon,
        planes: [(DVec3, f64); 3],
        mut found: impl FnMut(ConvexPolygon),
    ) -> bool {
        let (mut inside, mut is_cut) = (*part, false);
        if part.can_be_cut() {
            for plane in planes {
                let [within, beyond] = self.cut(&inside, plane);
                if beyond.count >= 3 && within.count >= 3 {
                    found(beyond);
                    inside = within;
                    is_cut = true;
                }
            }
        }
        if is_cut {
            found(inside);
        }
        is_cut
    }

    /// The parts on both sides of a plane, the inner one first; a part without interior has no corners. A part that lies in
    /// the plane, where rounding decides on which side its corners are, stays whole.
    fn cut(&mut self, part: &ConvexPolygon, (normal, offset): (DVec3, f64)) -> [ConvexPolygon; 2] {
        let mut heights = [0.0; CORNERS_MAX];
        let (mut low, mut high) = (0f64, 0f64);
        for (height, &corner) in heights.iter_mut().zip(part.corners()) {
            *height = normal.dot(self.point(corner)) - offset;
            low = low.min(*height);
            high = high.max(*height);
        }
        // Corners within this distance lie on the plane: sides of neighbouring triangles coincide up to rounding.
        let touch = 1e-9 * (high - low);
        if high <= touch {
            return [*part, ConvexPolygon::default()];
        }
        if -low <= touch {
            return [ConvexPolygon::default(), *part];
        }
        if crossings(&heights[..part.count], touch) > 2 {
            return [*part, ConvexPolygon::default()];
        }
        let [mut within, mut beyond] = [ConvexPolygon::default(); 2];
        for i in 0..part.count {
            let next = (i + 1) % part.count;
            let (corner, at, at_next) = (part.corners[i], heights[i], heights[next]);
            if at <= touch {
                within.push(corner);
            }
            if at >= -touch {
                beyond.push(corner);
            }
            if (at < -touch && at_next > touch) || (at > touch && at_next < -touch) {
                let ends = (self.point(corner), self.point(part.corners[next]));
                let crossing = self.push(ends.0.lerp(ends.1, at / (at - at_next)));
                within.push(crossing);
                beyond.push(crossing);
            }
        }
        [within, beyond]
    }

    /// Splits a part from the middle of its longest side to the opposite corner.
    pub fn halves(&mut self, part: &ConvexPolygon) -> [ConvexPolygon; 2] {
        let ends = |i: usize| (self.point(part.corners[i]), self.point(part.corners[(i + 1) % part.count]));
        let length_sq = |i: usize| ends(i).0.distance_squared(ends(i).1);
        let longest = (0..part.count).max_by(|&a, &b| length_sq(a).total_cmp(&length_sq(b))).unwrap_or(0);
        let (a, b) = ends(longest);
        let middle = self.push(a.midpoint(b));
        // The first half ends at the opposite corner, and the second begins there.
        let turn = part.count.div_ceil(2);
        let mut halves = [ConvexPolygon::default(); 2];
        halves.iter_mut().for_each(|half| half.push(middle));
        for step in 1..=part.count {
            let corner = part.corners[(longest + step) % part.count];
            if step <= turn {
                halves[0].push(corner);
            }
            if step >= turn {
                halves[1].push(corner);
            }
        }
        halves
    }
}

/// How often the corners of a polygon change sides of a plane, those within `touch` of it left out: twice at most, if
/// rounding leaves it convex.
fn crossings(heights: &[f64], touch: f64) -> usize {
    let mut sides = heights.iter().filter(|height| height.abs() > touch).map(|height| *height > 0.0);
    let Some(first) = sides.next() else { return 0 };
    let (count, last) = sides.fold((0, first), |(count, last), side| (count + usize::from(side != last), side));
    count + usize::from(last != first)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn point() -> impl Strategy<Value = DVec3> {
        (-1.0..1.0f64, -1.0..1.0f64, -0.2..0.2f64).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    fn area(parts: &Parts, part: &ConvexPolygon) -> f64 {
        let corner = |i: usize| parts.point(part.corners()[i]) - parts.point(part.corners()[0]);
        (1..part.count.saturating_sub(1)).map(|i| 0.5 * corner(i).cross(corner(i + 1)).length()).sum()
    }

    proptest! {
        #[test]
        fn parts_of_a_part_have_its_area_and_lie_on_their_sides_of_the_planes(
            triangle in [point(), point(), point()],
            normals in [point(), point(), point()],
            through in point(),
        ) {
            let mut parts = Parts::default();
            let whole = ConvexPolygon::triangle(triangle.map(|corner| parts.push(corner)));
            let planes = normals.map(|normal| (normal, normal.dot(through)));
            let mut found = Vec::new();
            let is_cut = parts.cut_along(&whole, planes, |part| found.push(part));
            prop_assert_eq!(is_cut, found.len() > 1);
            prop_assert_eq!(found.is_empty(), !is_cut);
            if let Some(inside) = found.last() {
                let sum: f64 = found.iter().map(|part| area(&parts, part)).sum();
                prop_assert!((sum - area(&parts, &whole)).abs() < 1e-9);
                // A plane that does not cut the part has it on one side.
                let is_within = |&(normal, offset): &(DVec3, f64)| {
                    inside.corners().iter().all(|&corner| normal.dot(parts.point(corner)) - offset < 1e-9)
                };
                prop_assert!(planes.iter().filter(|plane| is_within(plane)).count() >= found.len() - 1);
            }
            let halves = parts.halves(&whole);
            let [first, second] = halves.each_ref().map(|half| area(&parts, half));
            prop_assert!((first - second).abs() < 1e-12 && (first + second - area(&parts, &whole)).abs() < 1e-12);
        }
    }

    proptest! {
        // Needles: rounding alone decides on which side of a plane along them their corners lie.
        #[test]
        fn a_needle_in_the_plane_is_cut_or_stays_whole(
            start in point(),
            along in point(),
            shares in prop::collection::vec(0.0..1.0f64, CORNERS_MAX - 3),
            noise in prop::collection::vec(-1.0..1.0f64, CORNERS_MAX - 3),
            width in prop_oneof![Just(0.0), Just(1e-16), Just(1e-14), Just(1e-10)],
            far in prop_oneof![Just(0.0), Just(1e3), Just(4.5e6)],
        ) {
            let mut parts = Parts::default();
            let mut needle = ConvexPolygon::default();
            let across = along.any_orthogonal_vector();
            for (share, noise) in shares.iter().zip(&noise) {
                needle.push(parts.push(DVec3::splat(far) + start + *share * along + width * noise * across));
            }
            let through = |normal: DVec3| (normal, normal.dot(DVec3::splat(far) + start));
            let planes = [across, along, across.cross(along)].map(through);
            let mut found = Vec::new();
            parts.cut_along(&needle, planes, |part| found.push(part));
            prop_assert!(found.iter().all(|part| (3..=CORNERS_MAX).contains(&part.corners().len())));
        }
    }
}

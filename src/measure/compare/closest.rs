//! The closest point of many triangles: a tree of bounding boxes that lies in flat arrays, so that it can be mapped.
//!
//! ```text
//!            pair 0                a pair holds the boxes of its two children; a child is another pair, or
//!          /        \              a few triangles, which lie together
//!      pair 1      triangles 9..12
//!     /      \
//!  triangles  triangles
//!  0..4       4..9                 nearer child first; what lies farther than the best so far is never opened
//! ```
//! Triangles are sorted so that those of a child are neighbours. Boxes are single precision, wide enough that no rounding
//! makes a box farther than a triangle in it; triangles are measured in double precision, so the answer is exact.
//!
//! # Source
//! Boxes are split by the surface area heuristic over bins (Wald 2007, "On fast Construction of SAH-based Bounding Volume
//! Hierarchies"). The closest point of a triangle is Ericson's ("Real-Time Collision Detection", 5.1.5).
//!
//! # Where we differ
//! Other trees were tried with a million points around a city of 0.99 million triangles (one thread, 2026-11-21; seconds
//! to build, to ask): this one 0.4 and 0.6; the crates `bvh` 0.13 0.65 and 0.6, `parry3d-f64` 0.31 0.57 and 0.93, `rstar`
//! 0.14 0.73 and 4.7; [`BoxTree`](super::super::boxtree)'s order along a curve, as a tree of triangles, 0.26 and 1.1.
//! None of the crates lies in a file, which a mesh larger than memory needs.
//!
//! # Memory
//! 64 bytes a pair, about one for every three triangles; 28 bytes a triangle while it is built.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3A, Vec4};

/// Triangles of a leaf, at most, unless they cannot be told apart.
const LEAF_TRIANGLES: usize = 4;
/// Bins of a split.
const BINS: usize = 16;
/// Boxes grow by this share of the largest coordinate; single precision rounds by a sixteenth of it.
const BOX_MARGIN: f64 = 1.0 / (1 << 20) as f64;
/// Single-precision squares of distances are compared with a bound that is larger by this.
const BOUND_MARGIN: f32 = 1.000_002;
/// Depth below which parts are halved whatever their boxes look like, so that the stack of a search is bounded.
const DEPTH_MAX: usize = 40;
/// Entries of that stack: one for each level, and 32 halvings below them.
const STACK_ENTRIES: usize = DEPTH_MAX + 34;

/// The boxes of two children: low corner and index, high corner and count, of each.
///
/// A count of 0 says that the index is a pair's; otherwise it is the first of so many triangles.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Pair {
    corners: [[f32; 4]; 4],
}

/// A box with what is in it.
#[derive(Debug, Clone, Copy)]
struct Child {
    low: Vec3A,
    high: Vec3A,
    index: u32,
    count: u32,
}

#[derive(Debug, Clone, Copy)]
struct Item {
    low: [f32; 3],
    high: [f32; 3],
    triangle: u32,
}

impl Item {
    fn low(&self) -> Vec3A {
        Vec3A::from_array(self.low)
    }

    fn high(&self) -> Vec3A {
        Vec3A::from_array(self.high)
    }
}

impl Pair {
    fn new(children: [Child; 2]) -> Self {
        let corner = |at: Vec3A, number: u32| [at.x, at.y, at.z, f32::from_bits(number)];
        let [a, b] = children;
        Self {
            corners: [corner(a.low, a.index), corner(a.high, a.count), corner(b.low, b.index), corner(b.high, b.count)],
        }
    }

    /// Squared distance, index and count of a child.
    #[inline]
    fn child(&self, which: usize, point: Vec3A) -> (f32, u32, u32) {
        let [low, high] = [self.corners[2 * which], self.corners[2 * which + 1]];
        let outside = (Vec3A::from_vec4(Vec4::from_array(low)) - point)
            .max(point - Vec3A::from_vec4(Vec4::from_array(high)))
            .max(Vec3A::ZERO);
        (outside.length_squared(), low[3].to_bits(), high[3].to_bits())
    }
}

/// Builds the tree of `count` triangles; `triangle` gives their corners by number.
///
/// Returns the pairs, the first of which is the root (there is none for up to `LEAF_TRIANGLES` triangles), and the
/// numbers of the triangles in the order that the pairs refer to. O(n log n).
pub fn build(count: usize, triangle: impl Fn(u32) -> [DVec3; 3]) -> (Vec<Pair>, Vec<u32>) {
    let corners = |number: u32| triangle(number).map(|corner| if corner.is_finite() { corner } else { DVec3::ZERO });
    let mut largest = 0.0f64;
    for number in 0..count as u32 {
        largest = corners(number).iter().fold(largest, |largest, corner| largest.max(corner.abs().max_element()));
    }
    let margin = DVec3::splat(largest * BOX_MARGIN);
    let mut items: Vec<Item> = (0..count as u32)
        .map(|number| {
            let [a, b, c] = corners(number);
            let (low, high) = (a.min(b).min(c) - margin, a.max(b).max(c) + margin);
            Item { low: low.as_vec3().to_array(), high: high.as_vec3().to_array(), triangle: number }
        })
        .collect();
    let mut pairs = Vec::with_capacity(count / 2);
    split(&mut items, 0, 0, &mut pairs);
    (pairs, items.into_iter().map(|item| item.triangle).collect())
}

/// Splits items, the first of which is the `first` of all, and returns their box.
fn split(items: &mut [Item], first: usize, depth: usize, pairs: &mut Vec<Pair>) -> Child {
    let (mut low, mut high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
    let (mut centre_low, mut centre_high) = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
    for item in items.iter() {
        let centre = item.low() + item.high();
        (low, high) = (low.min(item.low()), high.max(item.high()));
        (centre_low, centre_high) = (centre_low.min(centre), centre_high.max(centre));
    }
    if items.len() <= LEAF_TRIANGLES {
        return Child { low, high, index: first as u32, count: items.len() as u32 };
    }
    let extent = (centre_high - centre_low).to_array();
    let axis = (0..3).fold(0, |widest, axis| if extent[axis] > extent[widest] { axis } else { widest });
    let mut cut = 0;
    if depth < DEPTH_MAX && extent[axis] > 0.0 && extent[axis].is_finite() {
        cut = split_by_area(items, axis, centre_low[axis], extent[axis]);
    }
    if cut == 0 || cut == items.len() {
        cut = items.len() / 2;
    }
    let at = pairs.len();
    pairs.push(Pair::default());
    let (near, far) = items.split_at_mut(cut);
    pairs[at] = Pair::new([split(near, first, depth + 1, pairs), split(far, first + cut, depth + 1, pairs)]);
    Child { low, high, index: at as u32, count: 0 }
}

/// Moves the items below the best of [`BINS`] planes to the front and returns how many they are; 0 if no plane parts them.
fn split_by_area(items: &mut [Item], axis: usize, low: f32, extent: f32) -> usize {
    #[derive(Clone, Copy)]
    struct Bin {
        low: Vec3A,
        high: Vec3A,
        count: usize,
    }
    impl Bin {
        const EMPTY: Self = Self { low: Vec3A::INFINITY, high: Vec3A::NEG_INFINITY, count: 0 };

        fn with(self, other: Self) -> Self {
            Self { low: self.low.min(other.low), high: self.high.max(other.high), count: self.count + other.count }
        }

        fn cost(self) -> f32 {
            let size = self.high - self.low;
            (size.x * size.y + size.y * size.z + size.z * size.x) * self.count as f32
        }
    }
    let scale = BINS as f32 / extent;
    let bin_of = |item: &Item| (((item.low[axis] + item.high[axis] - low) * scale) as usize).min(BINS - 1);
    let mut bins = [Bin::EMPTY; BINS];
    for item in items.iter() {
        let bin = &mut bins[bin_of(item)];
        *bin = bin.with(Bin { low: item.low(), high: item.high(), count: 1 });
    }
    let mut above = [Bin::EMPTY; BINS + 1];
    for bin in (0..BINS).rev() {
        above[bin] = above[bin + 1].with(bins[bin]);
    }
    let (mut below, mut best) = (Bin::EMPTY, (f32::INFINITY, 0));
    for plane in 1..BINS {
        below = below.with(bins[plane - 1]);
        if below.count > 0 && above[plane].count > 0 && below.cost() + above[plane].cost() < best.0 {
            best = (below.cost() + above[plane].cost(), plane);
        }
    }
    let mut front = 0;
    for at in 0..items.len() {
        if bin_of(&items[at]) < best.1 {
            items.swap(front, at);
            front += 1;
        }
    }
    front
}

/// Finds the triangle nearest to `point`, if there is one nearer than the square root of `bound_sq`.
///
/// `pairs` and `count` are those of [`build`], `triangle` gives corners by place in its order. The search ends as soon as
/// a triangle is no farther than the square root of `enough_sq`, which then need not be the nearest; a negative number
/// asks for the nearest. Returns the place and the squared distance.
pub fn nearest(
    pairs: &[Pair],
    count: usize,
    point: DVec3,
    bound_sq: f64,
    enough_sq: f64,
    triangle: impl Fn(u32) -> [DVec3; 3],
) -> Option<(u32, f64)> {
    let target = Vec3A::from(point.as_vec3());
    let mut best = (u32::MAX, bound_sq);
    let bound = |sq: f64| sq as f32 * BOUND_MARGIN;
    let mut limit = bound(bound_sq);
    let mut stack = [(0.0f32, 0u32, 0u32); STACK_ENTRIES];
    stack[0] = (0.0, 0, if pairs.is_empty() { count as u32 } else { 0 });
    let mut height = usize::from(count > 0);
    while height > 0 {
        height -= 1;
        let (distance_sq, mut index, mut leaf) = stack[height];
        if distance_sq > limit {
            continue;
        }
        loop {
            if leaf > 0 {
                for place in index..index + leaf {
                    let distance_sq = closest_point(point, triangle(place)).distance_squared(point);
                    if distance_sq < best.1 {
                        best = (place, distance_sq);
                        limit = bound(distance_sq);
                    }
                }
                if best.1 <= enough_sq {
                    return Some(best);
                }
                break;
            }
            let pair = &pairs[index as usize];
            let [a, b] = [pair.child(0, target), pair.child(1, target)];
            let (near, far) = if a.0 <= b.0 { (a, b) } else { (b, a) };
            if far.0 <= limit && height < STACK_ENTRIES {
                stack[height] = far;
                height += 1;
            }
            if near.0 > limit {
                break;
            }
            (_, index, leaf) = near;
        }
    }
    (best.0 != u32::MAX).then_some(best)
}

/// The point of a triangle that is nearest to `point`; of its corners and sides, if it has no area.
pub fn closest_point(point: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = point - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = point - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 && (d4 - d3) + (d5 - d6) > 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    if sum > 0.0 {
        return a + ab * (vb / sum) + ac * (vc / sum);
    }
    [[a, b], [b, c], [c, a]]
        .map(|side| closest_of_side(point, side))
        .into_iter()
        .min_by(|p, q| p.distance_squared(point).total_cmp(&q.distance_squared(point)))
        .unwrap_or(a)
}

fn closest_of_side(point: DVec3, [from, to]: [DVec3; 2]) -> DVec3 {
    let step = to - from;
    let length_sq = step.length_squared();
    let along = if length_sq > 0.0 { ((point - from).dot(step) / length_sq).clamp(0.0, 1.0) } else { 0.0 };
    from + step * along
}

/// Weights of the corners of a triangle at a point of it; the first corner alone if it has no area.
pub fn weights(point: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let normal = ab.cross(ac);
    let area_sq = normal.length_squared();
    if area_sq > 0.0 {
        let at_c = ab.cross(ap).dot(normal) / area_sq;
        let at_b = ap.cross(ac).dot(normal) / area_sq;
        [1.0 - at_b - at_c, at_b, at_c]
    } else {
        [1.0, 0.0, 0.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn by_looking_at_all(point: DVec3, triangles: &[[DVec3; 3]]) -> f64 {
        let distances = triangles.iter().map(|&t| closest_point(point, t).distance_squared(point));
        distances.fold(f64::INFINITY, f64::min)
    }

    fn vectors(raw: [[i16; 3]; 3], scale: f64) -> [DVec3; 3] {
        raw.map(|p| DVec3::from(p.map(f64::from)) * scale)
    }

    proptest! {
        #[test]
        fn the_tree_finds_what_a_plain_search_finds(
            raw in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-300i16..300)), 1..200),
            points in prop::collection::vec(prop::array::uniform3(-900i16..900), 1..30),
            scale in prop_oneof![Just(1.0), Just(1e-5), Just(1e6)],
        ) {
            let triangles: Vec<_> = raw.into_iter().map(|t| vectors(t, scale)).collect();
            let (pairs, order) = build(triangles.len(), |i| triangles[i as usize]);
            let at = |place: u32| triangles[order[place as usize] as usize];
            for point in points {
                let point = DVec3::from(point.map(|x| f64::from(x) + 0.25)) * scale;
                let (place, distance_sq) =
                    nearest(&pairs, triangles.len(), point, f64::INFINITY, -1.0, at).unwrap();
                prop_assert_eq!(distance_sq, by_looking_at_all(point, &triangles));
                prop_assert_eq!(closest_point(point, at(place)).distance_squared(point), distance_sq);
                // nothing is nearer than the nearest, and something is near enough
                prop_assert!(nearest(&pairs, triangles.len(), point, distance_sq, -1.0, at).is_none());
                let enough = nearest(&pairs, triangles.len(), point, f64::INFINITY, distance_sq * 4.0, at).unwrap();
                prop_assert!(enough.1 <= distance_sq * 4.0);
            }
        }

        #[test]
        fn no_point_of_a_triangle_is_nearer_than_the_closest(
            raw in prop::array::uniform3(prop::array::uniform3(-9i16..9)),
            point in prop::array::uniform3(-20i16..20),
        ) {
            let (triangle, point) = (vectors(raw, 1.0), DVec3::from(point.map(f64::from)));
            let closest = closest_point(point, triangle);
            for i in 0..=16 {
                for j in 0..=16 - i {
                    let [u, v] = [i, j].map(|k| f64::from(k) / 16.0);
                    let other = triangle[0] * (1.0 - u - v) + triangle[1] * u + triangle[2] * v;
                    prop_assert!(closest.distance(point) <= other.distance(point) + 1e-9);
                }
            }
        }
    }

    #[test]
    fn a_closest_point_lies_over_the_inside_on_a_side_or_at_a_corner() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        for (point, expected) in [
            ([0.25, 0.25, 3.0], [0.25, 0.25, 0.0]),
            ([0.5, -2.0, 1.0], [0.5, 0.0, 0.0]),
            ([2.0, 2.0, 0.0], [0.5, 0.5, 0.0]),
            ([-1.0, -1.0, 5.0], [0.0, 0.0, 0.0]),
        ] {
            let closest = closest_point(DVec3::from(point), triangle);
            assert!(closest.distance(DVec3::from(expected)) < 1e-12);
        }
    }

    #[test]
    fn weights_give_the_point_back() {
        let triangle = [DVec3::new(3.0, 1.0, 2.0), DVec3::new(-1.0, 4.0, 0.0), DVec3::new(2.0, 2.0, 7.0)];
        let point = triangle[0] * 0.2 + triangle[1] * 0.3 + triangle[2] * 0.5;
        let weights = weights(point, triangle);
        assert!((weights[0] - 0.2).abs() < 1e-12 && (weights[2] - 0.5).abs() < 1e-12);
    }

    #[test]
    fn many_triangles_at_one_place_are_halved() {
        let (pairs, order) = build(10_000, |_| [DVec3::ONE; 3]);
        assert_eq!(order.len(), 10_000);
        let found = nearest(&pairs, 10_000, DVec3::ZERO, f64::INFINITY, -1.0, |_| [DVec3::ONE; 3]);
        assert!((found.unwrap().1 - 3.0).abs() < 1e-12);
    }
}

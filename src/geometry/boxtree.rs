//! A tree of bounding boxes: finds the items near a segment, and the distance to the item nearest to a point.
//!
//! Items are halved across the longest side of the box around their centres, down to leaves of eight; the leaves form a
//! complete binary tree:
//!
//! ```text
//!                 1
//!         2               3            node i has the children 2 i and 2 i + 1;
//!     4       5       6       7        the leaves follow at leaf_base, padded with empty boxes
//!   |....|  |....|  |....|  |..  |
//! ```
//! Unlike a uniform grid it stays efficient where item sizes and densities vary widely.
//!
//! # Memory
//! 4 bytes an item, plus 48 · 2 / 8 to 48 · 4 / 8 for the nodes; 16 more an item during construction.

use glam::{BVec3, DVec3};
use serde::{Deserialize, Serialize};

use crate::base::pool::in_parallel;

/// Number of items of a leaf.
const LEAF_BOXES: usize = 8;
/// Largest depth of the tree: item ids have 32 bits.
const DEPTH_MAX: usize = 32;
/// Halves of at least this many items are sorted on two threads.
const JOIN_ITEMS_MIN: usize = 4096;
/// Items by which the axis to halve along is chosen.
const AXIS_ITEMS: usize = 64;

/// A squared distance below all others: an item that has it ends a search.
pub const END_OF_SEARCH: f64 = f64::NEG_INFINITY;

/// An axis-aligned box; empty if `low` is above `high`.
#[derive(Debug, Clone, Copy, Serialize, Deserialize, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates.
    pub low: DVec3,
    /// Largest coordinates.
    pub high: DVec3,
}

impl Bounds {
    /// The empty box: neutral in [`with`](Bounds::with).
    pub const EMPTY: Self = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };

    /// The smallest box around some points.
    pub fn around(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| Self { low: b.low.min(p), high: b.high.max(p) })
    }

    /// Length of the diagonal; 0 if the box is empty.
    pub fn diagonal(self) -> f64 {
        (self.high - self.low).max(DVec3::ZERO).length()
    }

    /// The smallest box around both.
    pub fn with(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// With `margin` more on all sides.
    pub fn grown(self, margin: f64) -> Self {
        Self { low: self.low - margin, high: self.high + margin }
    }

    /// Squared distance to a point; 0 if it lies inside.
    pub fn distance_sq(self, point: DVec3) -> f64 {
        (self.low - point).max(point - self.high).max(DVec3::ZERO).length_squared()
    }

    /// Squared distance to another box; 0 if they meet.
    pub fn between_sq(self, other: Self) -> f64 {
        (self.low - other.high).max(other.low - self.high).max(DVec3::ZERO).length_squared()
    }

    /// Squared distance from a point to the corner farthest from it.
    pub fn farthest_sq(self, point: DVec3) -> f64 {
        (point - self.low).abs().max((self.high - point).abs()).length_squared()
    }

    /// Whether the segment meets the box grown by the segment's margin on all sides; `false` for an empty box.
    fn meets(self, segment: &Slabs) -> bool {
        let (low, high) = (self.low - segment.margin - segment.from, self.high + segment.margin - segment.from);
        let enter = DVec3::select(segment.backward, high, low) * segment.inverse;
        let leave = DVec3::select(segment.backward, low, high) * segment.inverse;
        enter.max_element().max(0.0) <= leave.min_element().min(1.0)
    }
}

/// A segment, prepared for the slab test against boxes; its parameter runs from 0 to 1.
struct Slabs {
    from: DVec3,
    inverse: DVec3,
    backward: BVec3,
    margin: f64,
}

impl Slabs {
    /// Components of the step below this in size are replaced by it, so that their inverse is finite.
    const STEP_MIN: f64 = 1e-300;

    fn new([from, to]: [DVec3; 2], margin: f64) -> Self {
        let step = to - from;
        let inverse =
            DVec3::select(step.abs().cmplt(DVec3::splat(Self::STEP_MIN)), DVec3::splat(Self::STEP_MIN), step).recip();
        Self { from, inverse, backward: inverse.cmplt(DVec3::ZERO), margin }
    }
}

/// The tree over items 0 .. `count`; the caller keeps the items themselves.
#[derive(Debug)]
pub struct BoxTree {
    items: Vec<u32>,
    nodes: Vec<Bounds>,
    leaf_base: usize,
}

impl BoxTree {
    /// Builds the tree over the items 0 .. `count`, whose boxes `box_of` returns. O(n log n).
    pub fn new(count: usize, box_of: impl Fn(u32) -> Bounds) -> Self {
        let whole = (0..count as u32).fold(Bounds::EMPTY, |all, item| all.with(box_of(item)));
        let scale = f64::from(u32::MAX) / (whole.high - whole.low).max_element().max(f64::MIN_POSITIVE);
        let place = |item| {
            let Bounds { low, high } = box_of(item);
            let centre = ((low + high) * 0.5 - whole.low) * scale;
            ItemPlace([centre.x as u32, centre.y as u32, centre.z as u32, item])
        };
        let mut places: Vec<ItemPlace> = (0..count as u32).map(place).collect();
        let leaf_base = count.div_ceil(LEAF_BOXES).next_power_of_two();
        halve(&mut places, leaf_base * LEAF_BOXES);
        let items: Vec<u32> = places.into_iter().map(|ItemPlace([.., item])| item).collect();
        let mut nodes = vec![Bounds::EMPTY; 2 * leaf_base];
        for (node, leaf) in nodes[leaf_base..].iter_mut().zip(items.chunks(LEAF_BOXES)) {
            *node = leaf.iter().fold(Bounds::EMPTY, |all, &item| all.with(box_of(item)));
        }
        for node in (1..leaf_base).rev() {
            nodes[node] = nodes[2 * node].with(nodes[2 * node + 1]);
        }
        Self { items, nodes, leaf_base }
    }

    /// The box around all items.
    pub fn bounds(&self) -> Bounds {
        self.nodes[1]
    }

    fn leaf(&self, node: usize) -> &[u32] {
        let begin = ((node - self.leaf_base) * LEAF_BOXES).min(self.items.len());
        &self.items[begin..(begin + LEAF_BOXES).min(self.items.len())]
    }

    /// Calls `visit` with every item whose box lies within `margin` of the segment, and with some that lie farther
    /// away.
    pub fn near_segment(&self, ends: [DVec3; 2], margin: f64, mut visit: impl FnMut(u32)) {
        let segment = Slabs::new(ends, margin);
        let mut pending = Vec::with_capacity(64);
        pending.push(1);
        while let Some(node) = pending.pop() {
            if !self.nodes[node].meets(&segment) {
                continue;
            }
            if node >= self.leaf_base {
                self.leaf(node).iter().copied().for_each(&mut visit);
            } else {
                pending.extend([2 * node + 1, 2 * node]);
            }
        }
    }

    /// The lowest `distance_sq` of any item, or `limit` if none is lower. `distance_sq` of an item must not be below
    /// the squared distance from `point` to its box.
    pub fn nearest_sq(&self, point: DVec3, limit: f64, mut distance_sq: impl FnMut(u32) -> f64) -> f64 {
        let mut best = limit;
        // Stack of the farther child of each node on the way down, with its squared distance.
        let mut pending = [(0.0, 0); DEPTH_MAX];
        let mut count = 1;
        pending[0] = (0.0, 1);
        while count > 0 {
            count -= 1;
            let (mut bound, mut node) = pending[count];
            while bound < best && node < self.leaf_base {
                let [a, b] = [2 * node, 2 * node + 1].map(|child| (self.nodes[child].distance_sq(point), child));
                let (near, far) = if a.0 <= b.0 { (a, b) } else { (b, a) };
                if far.0 < best {
                    pending[count] = far;
                    count += 1;
                }
                (bound, node) = near;
            }
            if bound < best {
                best = self.leaf(node).iter().fold(best, |best, &item| best.min(distance_sq(item)));
            }
        }
        best
    }
}

/// The centre of an item's box, as a share of the whole box's longest side, and the item.
#[derive(Debug, Clone, Copy)]
struct ItemPlace([u32; 4]);

impl ItemPlace {
    /// Orders items along an axis.
    fn along(&self, axis: usize) -> u64 {
        u64::from(self.0[axis]) << 32 | u64::from(self.0[3])
    }
}

/// Sorts items so that neighbours share a node, whose leaves have `room` items; `room` is [`LEAF_BOXES`] times a power
/// of two.
fn halve(places: &mut [ItemPlace], room: usize) {
    let middle = room / 2;
    if room <= LEAF_BOXES || places.is_empty() {
        return;
    }
    if places.len() > middle {
        let axis = longest_axis(places);
        places.select_nth_unstable_by_key(middle, |place| place.along(axis));
    }
    let (near, far) = places.split_at_mut(middle.min(places.len()));
    if far.len() >= JOIN_ITEMS_MIN {
        in_parallel(|| rayon::join(|| halve(near, middle), || halve(far, middle)));
    } else {
        halve(near, middle);
        halve(far, middle);
    }
}

/// The axis along which a sample of some items extends farthest.
fn longest_axis(places: &[ItemPlace]) -> usize {
    let (mut low, mut high) = ([u32::MAX; 3], [0; 3]);
    for place in places.iter().step_by(places.len().div_ceil(AXIS_ITEMS)) {
        for axis in 0..3 {
            low[axis] = low[axis].min(place.0[axis]);
            high[axis] = high[axis].max(place.0[axis]);
        }
    }
    (0..3).max_by_key(|&axis| high[axis] - low[axis]).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_empty_tree_has_nothing_near() {
        let tree = BoxTree::new(0, |_| Bounds::EMPTY);
        assert_eq!(tree.nearest_sq(DVec3::ZERO, f64::INFINITY, |_| 0.0), f64::INFINITY);
        tree.near_segment([DVec3::ZERO, DVec3::ONE], 1.0, |_| panic!("nothing to visit"));
    }

    #[test]
    fn an_empty_box_meets_no_segment() {
        for to in [DVec3::ONE, -DVec3::ONE, DVec3::X, DVec3::ZERO] {
            assert!(!Bounds::EMPTY.meets(&Slabs::new([DVec3::ZERO, to], 1.0)));
            assert!(Bounds::around([to]).meets(&Slabs::new([DVec3::ZERO, to], 1e-9)));
        }
    }

    proptest! {
        #[test]
        fn the_nearest_point_is_that_of_a_plain_search(
            points in prop::collection::vec(prop::array::uniform3(-9i8..9), 1..80),
            from in prop::array::uniform3(-9i8..9),
            to in prop::array::uniform3(-9i8..9),
            limit in prop_oneof![Just(f64::INFINITY), 0.5..99.0],
        ) {
            let vector = |p: [i8; 3]| DVec3::from(p.map(f64::from));
            let points: Vec<DVec3> = points.into_iter().map(vector).collect();
            let (from, to) = (vector(from), vector(to));
            let tree = BoxTree::new(points.len(), |item| Bounds::around([points[item as usize]]));
            let nearest = tree.nearest_sq(from, limit, |item| points[item as usize].distance_squared(from));
            let expected = points.iter().map(|p| p.distance_squared(from)).fold(limit, f64::min);
            prop_assert_eq!(nearest, expected);
            let mut seen = vec![false; points.len()];
            tree.near_segment([from, to], 0.5, |item| seen[item as usize] = true);
            for (point, seen) in points.iter().zip(seen) {
                let along = (*point - from).dot(to - from) / (to - from).length_squared().max(1.0);
                let foot = from + (to - from) * along.clamp(0.0, 1.0);
                prop_assert!(seen || point.distance(foot) > 0.49);
            }
        }
    }
}

//! Compares the borders of the tiles of a level.
//!
//! The edges of a tile along its border are those of its skirt. Each of them must be an edge of the skirt of another tile,
//! with the same ends to the bit.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use super::content::ReadTile;

/// Both ends of an edge, the smaller first.
type BorderEnds = [[i64; 3]; 2];

/// The edges along the borders of a level.
#[derive(Debug, Default)]
pub struct BorderEdges {
    /// How often each of them occurs.
    counts: HashMap<BorderEnds, u32, FixedState>,
    /// Edges of all tiles.
    pub edges: u64,
    /// Largest length of a skirt, in steps of the lattice.
    pub longest_skirt: f64,
}

impl BorderEdges {
    /// Adds the edges of a tile.
    pub fn add(&mut self, tile: &ReadTile) {
        let skirt = &tile.triangles[tile.triangles.len() - tile.skirt_triangles..];
        for &strip in skirt.as_chunks::<2>().0 {
            let [start, end, foot, other_foot] = corners_of(strip).map(|vertex| tile.places[vertex as usize]);
            *self.counts.entry([start.min(end), start.max(end)]).or_default() += 1;
            self.edges += 1;
            for (from, to) in [(start, foot), (end, other_foot)] {
                let length_sq: f64 = (0..3).map(|axis| ((to[axis] - from[axis]) as f64).powi(2)).sum();
                self.longest_skirt = self.longest_skirt.max(length_sq.sqrt());
            }
        }
    }

    /// Edges that no other tile has.
    pub fn unequal(&self) -> u64 {
        self.counts.values().filter(|&&count| !count.is_multiple_of(2)).count() as u64
    }
}

/// Start and end of the edge of a strip, and the feet below them. The strip is (end, start, foot) and (end, foot, other
/// foot), each triangle from any of its corners on, since codecs turn them.
fn corners_of([upper, lower]: [[u32; 3]; 2]) -> [u32; 4] {
    let alone = |own: [u32; 3], other: [u32; 3]| own.iter().position(|corner| !other.contains(corner)).unwrap_or(0);
    let (start, other_foot) = (alone(upper, lower), alone(lower, upper));
    [upper[start], upper[(start + 2) % 3], upper[(start + 1) % 3], lower[other_foot]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_corners_of_a_strip_are_found_however_its_triangles_are_turned() {
        // end 1 ── start 0
        //     │  ╲  │
        // foot 3 ── foot 2
        for turns in 0..9 {
            let (mut upper, mut lower) = ([1, 0, 2], [1, 2, 3]);
            upper.rotate_left(turns / 3);
            lower.rotate_left(turns % 3);
            assert_eq!(corners_of([upper, lower]), [0, 1, 2, 3]);
        }
    }
}

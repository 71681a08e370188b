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
        for strip in skirt.chunks_exact(2) {
            let [end, start, foot] = strip[0].map(|vertex| tile.places[vertex as usize]);
            let other_foot = tile.places[strip[1][2] as usize];
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

//! What was built of a pyramid of tiles.

use std::fmt::Write as _;

use serde::Serialize;

use crate::base::{bytes, grouped};
use crate::geo::GeoPlace;
pub use crate::tile::LevelFigures;

/// Report of a pyramid.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TileReport {
    /// Triangles of the input.
    pub triangles: u64,
    /// Where on earth the frame of the tiles lies; `None` for local coordinates.
    pub origin: Option<GeoPlace>,
    /// The levels, the finest first.
    pub levels: Vec<LevelFigures>,
    /// Time in seconds.
    pub seconds: f64,
    /// Peak resident memory of the process, in bytes; `None` if it [is not the job's alone](crate::claim_process).
    pub peak_resident: Option<u64>,
    /// Messages about what was ignored or lost.
    pub warnings: Vec<String>,
}

impl TileReport {
    /// The levels as a table, and sums.
    pub fn table(&self) -> String {
        let mut text = String::from(
            "level   tiles   triangles   most   megatexels  fill  colour     texel  deviation      error       bytes\n",
        );
        for level in self.levels.iter().rev() {
            let _ = writeln!(
                text,
                "{:5} {:>7} {:>11} {:>6} {:>12.2} {:>5.2} {:>7.2} {:>9.4} {:>10.4} {:>10.3} {:>11}",
                level.level,
                grouped(level.tiles),
                grouped(level.faces),
                grouped(level.faces_max),
                level.texels as f64 / 1e6,
                level.fill,
                level.colour_rms,
                level.texel,
                level.to_input_p99.max(level.from_input_p99),
                level.geometric_error,
                bytes::display(level.bytes),
            );
        }
        let sum = |of: fn(&LevelFigures) -> u64| self.levels.iter().map(of).sum::<u64>();
        if let Some(GeoPlace { longitude, latitude, height }) = self.origin {
            let _ = writeln!(text, "on earth at: {longitude:.6}, {latitude:.6}, {height:.1}");
        }
        let _ = writeln!(text, "tiles: {}", sum(|level| level.tiles));
        let exceptions = [
            ("tiles with longer texels, to fit an image", sum(|level| level.reduced)),
            ("tiles with more triangles, since they cannot be divided", sum(|level| level.oversized)),
        ];
        for (what, count) in exceptions.into_iter().filter(|(_, count)| *count > 0) {
            let _ = writeln!(text, "{what}: {count}");
        }
        let _ = writeln!(text, "bytes of tiles: {}", sum(|level| level.bytes));
        let _ = writeln!(text, "seconds: {:.1}", self.seconds);
        if let Some(peak) = self.peak_resident {
            let _ = writeln!(text, "peak memory: {}", bytes::display(peak));
        }
        text
    }
}

//! Unwraps a triangle mesh: cuts it into charts, lays each of them flat, and packs them into images.
//!
//! ```text
//! triangles ── charts: neighbours merge as long as they face alike ── flat: each seen along its own normal, then relaxed
//!                                                                        │
//!            images of bounded size ◀── pack: the largest first, each where it is free uppermost
//! ```
//! In: the triangles of a patch, in memory. Out: an [`Unwrapped`]. Invariant: charts do not overlap, neither themselves
//! nor each other, no triangle is turned over, and [`GUTTER`] texels around each chart belong to no other. The result
//! depends on the triangles and the settings alone.
//!
//! # Memory
//! About 250 bytes a triangle while charts are made.

mod charts;
mod columns;
mod flat;
mod image_size;
mod mask;
mod outline;
mod pack;
mod relax;
mod sheet;
mod types;

pub use self::flat::FlatChart;
pub use self::image_size::{GUTTER, ImageSize};
pub use self::mask::touched_rows;
pub use self::pack::{pack, room};
pub use self::types::{ChartRoom, PlacedChart, TexelRow, Triangles, UnwrapSettings, Unwrapped};

use crate::base::Result;

/// Unwraps a patch.
///
/// # Errors
/// [`Error::Stopped`](crate::base::Error::Stopped).
pub fn unwrap(mesh: Triangles<'_>, settings: &UnwrapSettings<'_>) -> Result<Unwrapped> {
    let charts = charts::charts(mesh, settings.texels, room(settings.side))?;
    Ok(pack(charts, settings.side, None))
}

#[cfg(test)]
mod tests;

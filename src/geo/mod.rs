//! Places on earth: coordinate reference systems, and frames of metres east, north and up.
//!
//! In: positions in the coordinates of a map. Out: the same positions in metres east, north and up of a place.

#[cfg(feature = "images")]
mod crs;
mod earth;

#[cfg(feature = "images")]
pub use self::crs::{Crs, EarthFrame};
pub use self::earth::{GeoPlace, east_north_up};

//! Options of a pyramid of tiles.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::{ImageFormat, JobOptions, Limits, SimplifyOptions, Target, TextureFiles, UpAxis};
use crate::base::{Error, Result};

/// Triangles of a tile at most, unless given, and the range that is accepted.
const TILE_FACES: u64 = 16_000;
const TILE_FACES_RANGE: std::ops::RangeInclusive<u64> = 100..=1_000_000;
/// Side of a tile's image at most, unless given, and the range that is accepted.
const TILE_SIDE: u32 = 1024;
const TILE_SIDE_RANGE: std::ops::RangeInclusive<u32> = 256..=4096;
/// Quality of a tile's image, unless given.
const QUALITY: u8 = 85;
/// Texels, or deviations, that make up the geometric error, unless given: viewers refine at 16 pixels by default.
const ERROR_FACTOR: f64 = 16.0;

/// Options of a pyramid of tiles. As JSON, those that are left out have their defaults.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TileOptions {
    /// Triangles of a tile at most, 100 to 1 million.
    pub tile_faces: u64,
    /// Side of a tile's image at most, in texels: a power of two from 256 to 4096.
    pub tile_side: u32,
    /// Format of the images.
    pub image: ImageFormat,
    /// Geometric error of a tile, by the larger of its texel and its deviation from the input.
    pub error_factor: f64,
    /// Which axis of the input points up.
    pub up: UpAxis,
    /// Where on earth the input's (0, 0, 0) lies; `None` for local coordinates.
    pub origin: Option<GeoOrigin>,
    /// Memory and threads.
    #[serde(flatten)]
    pub limits: Limits,
    /// Intermediate files, and what may be replaced.
    #[serde(flatten)]
    pub job: JobOptions,
}

impl Default for TileOptions {
    fn default() -> Self {
        Self {
            tile_faces: TILE_FACES,
            tile_side: TILE_SIDE,
            image: ImageFormat::Jpeg(QUALITY),
            error_factor: ERROR_FACTOR,
            up: UpAxis::Z,
            origin: None,
            limits: Limits::default(),
            job: JobOptions::default(),
        }
    }
}

/// A place on earth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GeoOrigin {
    /// Degrees east.
    pub longitude: f64,
    /// Degrees north.
    pub latitude: f64,
    /// Metres above the ellipsoid.
    pub height: f64,
}

impl FromStr for GeoOrigin {
    type Err = String;

    /// Reads `longitude,latitude` or `longitude,latitude,height`.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
        let (longitude, latitude, height) = match numbers.as_deref() {
            Some(&[longitude, latitude]) => (longitude, latitude, 0.0),
            Some(&[longitude, latitude, height]) => (longitude, latitude, height),
            _ => return Err("expected LONGITUDE,LATITUDE,HEIGHT in degrees and metres".into()),
        };
        let is_on_earth = longitude.abs() <= 180.0 && latitude.abs() <= 90.0 && f64::abs(height) <= 1e5;
        let place = Self { longitude, latitude, height };
        if is_on_earth { Ok(place) } else { Err("expected degrees within 180 and 90, and metres within 100000".into()) }
    }
}

impl TileOptions {
    /// Checks ranges.
    ///
    /// # Errors
    /// [`Error::Usage`] naming the option, what was found and what is accepted.
    pub fn check(&self) -> Result<()> {
        let Self { tile_faces, tile_side, error_factor, .. } = self;
        let fail = |words: String| Err(Error::Usage(words));
        if !TILE_FACES_RANGE.contains(tile_faces) {
            let (least, most) = TILE_FACES_RANGE.into_inner();
            return fail(format!("`tile_faces: {tile_faces}`: expected {least} to {most}"));
        }
        if !TILE_SIDE_RANGE.contains(tile_side) || !tile_side.is_power_of_two() {
            let (least, most) = TILE_SIDE_RANGE.into_inner();
            return fail(format!("`tile_side: {tile_side}`: expected a power of two from {least} to {most}"));
        }
        if !(error_factor.is_finite() && *error_factor > 0.0) {
            return fail(format!("`error_factor: {error_factor}`: expected a number above 0"));
        }
        Ok(())
    }

    /// How the input is read and simplified.
    pub fn simplify_options(&self) -> SimplifyOptions {
        SimplifyOptions {
            target: Target::ratio(1.0),
            textures: TextureFiles::Bake,
            image: self.image,
            atlas: self.tile_side,
            limits: self.limits,
            job: self.job.clone(),
            ..SimplifyOptions::default()
        }
    }

    /// The options that shape the result, as JSON; memory, threads and folders do not.
    pub fn fingerprint(&self) -> String {
        let shaping = Self { limits: Limits::default(), job: JobOptions::default(), ..self.clone() };
        format!("tile {}", serde_json::to_string(&shaping).unwrap_or_default())
    }
}

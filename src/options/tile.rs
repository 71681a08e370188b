//! Options of a pyramid of tiles.

use serde::{Deserialize, Serialize};

use super::{
    ImageFormat, JobOptions, Limits, SimplifyOptions, Target, TextureFiles, TexturesOutside, TileCompression, UpAxis,
};
use crate::base::{Error, Result};
pub use crate::geo::GeoPlace;

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
    /// How vertices and triangles are stored.
    pub compress: TileCompression,
    /// Geometric error of a tile, as a multiple of the larger of its texel and its deviation from the input.
    pub error_factor: f64,
    /// Which axis of the input points up.
    pub up: UpAxis,
    /// Where on earth the input's (0, 0, 0) lies; `None` for local coordinates.
    pub origin: Option<GeoPlace>,
    /// The coordinate reference system of the input, as an EPSG code or a PROJ string; `None` for local coordinates.
    pub crs: Option<String>,
    /// What is added to the coordinates of the input before the system is applied.
    pub offset: [f64; 3],
    /// What to do with images that an MTL names outside its own folder.
    pub textures_outside: TexturesOutside,
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
            compress: TileCompression::None,
            error_factor: ERROR_FACTOR,
            up: UpAxis::Z,
            origin: None,
            crs: None,
            offset: [0.0; 3],
            textures_outside: TexturesOutside::Refer,
            limits: Limits::default(),
            job: JobOptions::default(),
        }
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
        self.image.check().map_err(|words| Error::Usage(format!("`image: {}`: {words}", self.image)))?;
        if self.crs.is_some() && self.origin.is_some() {
            return fail("`origin` gives local coordinates their place, `crs` those of a map: give one of them".into());
        }
        if self.offset.iter().any(|offset| !offset.is_finite()) {
            return fail("`offset`: expected three numbers".into());
        }
        if self.crs.is_none() && self.offset != [0.0; 3] {
            return fail("`offset` is added to the coordinates of a `crs`".into());
        }
        Ok(())
    }

    /// How the input is read and simplified.
    pub fn simplify_options(&self) -> SimplifyOptions {
        SimplifyOptions {
            target: Target::ratio(1.0),
            textures: TextureFiles::Bake,
            atlas: self.tile_side,
            textures_outside: self.textures_outside,
            limits: self.limits,
            job: self.job.clone(),
            ..SimplifyOptions::default()
        }
    }

    /// The options that shape the result, as JSON; memory, threads and folders do not.
    pub fn fingerprint(&self) -> String {
        let shaping = Self { limits: Limits::default(), job: JobOptions::default(), ..self.clone() };
        let mut fields = serde_json::to_value(&shaping).unwrap_or_default();
        fields["command"] = "tile".into();
        fields.to_string()
    }
}

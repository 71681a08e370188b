//! How far the colours of a tile are from those of the input, as the best texels of its size would show it.
//!
//! ```text
//! points of the tile, by area ──┬─ colour of its image, as a viewer mixes it ──────────┬── difference
//!                               └─ mean of the input over a texel of the tile there ───┘
//! ```

use std::path::Path;
use std::sync::Mutex;

use glam::{DVec2, DVec3, Vec3};

use super::mesh::TileMesh;
use super::paint::PaintedTile;
use crate::bake::{ColourProbe, Original, ProbedSquare};
use crate::base::chance::place_on_triangle;
use crate::base::lock::lock;
use crate::base::{Error, Result};
use crate::geometry::boxtree::Bounds;
use crate::geometry::triangle::{area, unit_normal, weight_growth};
use crate::image::decode::Image;
use crate::mesh::id::FaceId;
use crate::model::image_format::ImageFormat;

/// Points of a level, about: they tell its error within a few per cent; and tiles that they lie on, at most.
const POINTS: usize = 16_384;
const TILES_MAX: usize = 64;
/// Steps of the weights of consecutive points, which fill a triangle evenly.
///
/// # Source
/// Roberts, The Unreasonable Effectiveness of Quasirandom Sequences (2018): powers of the inverse plastic number.
const STEPS: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];

/// Differences of colour of a surface.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ColourError {
    /// Squared difference, summed over the surface by area. A difference is the mean of those of red, green and blue, 0
    /// to 255.
    pub squares: f64,
    /// Area of the surface where both show a colour.
    pub area: f64,
}

impl ColourError {
    /// That of two surfaces.
    pub fn plus(self, other: Self) -> Self {
        Self { squares: self.squares + other.squares, area: self.area + other.area }
    }

    /// Root mean square of the differences; 0 without colours.
    pub fn rms(self) -> f64 {
        if self.area > 0.0 { (self.squares / self.area).sqrt() } else { 0.0 }
    }
}

/// Compares the colours of the tiles of a level with those of the input.
pub struct ColourMeter<'a> {
    input: &'a Original,
    /// Length of a texel.
    texel: f64,
    /// What a surface that faces away counts as farther.
    away: f64,
    /// Of this number of tiles, one is measured.
    step: usize,
    /// At this number of points.
    points: usize,
    idle: Mutex<Vec<ColourProbe<'a>>>,
}

impl<'a> ColourMeter<'a> {
    /// Compares tiles of a level of `tiles`, whose texels are `texel` long.
    pub fn new(input: &'a Original, texel: f64, away: f64, tiles: usize) -> Self {
        let step = tiles.div_ceil(TILES_MAX).max(1);
        let points = POINTS / tiles.div_ceil(step).max(1);
        Self { input, texel, away, step, points, idle: Mutex::default() }
    }

    /// Whether a tile is one of those that are measured.
    pub fn is_measured(&self, tile: usize) -> bool {
        tile.is_multiple_of(self.step)
    }

    /// Measures a tile; positions of its mesh are relative to `origin`.
    ///
    /// # Errors
    /// On failed reads.
    pub fn measure(&self, mesh: &TileMesh, origin: DVec3, tile: &PaintedTile) -> Result<ColourError> {
        let (Some((encoded, format)), Some(own)) = (&tile.content.image, &tile.image) else {
            return Ok(ColourError::default());
        };
        let unread =
            |words: String| Error::Damaged { path: Path::new("an image of a tile").to_owned(), message: words };
        // NOTE: there is no decoder of KTX2 here: what it loses is not measured.
        let image = match format {
            ImageFormat::Ktx2(_) => Image::of_pixels(own.rgb.clone(), own.size),
            _ => Image::of_bytes(encoded).map_err(unread)?,
        };
        let idle = lock(&self.idle).pop();
        let mut probe = idle.unwrap_or_else(|| ColourProbe::new(self.input, self.texel, self.away));
        let error = TextureSurface { mesh, origin, tile, image: &image }.measure(self.points, &mut probe)?;
        lock(&self.idle).push(probe);
        Ok(error)
    }
}

struct TextureSurface<'a> {
    mesh: &'a TileMesh,
    origin: DVec3,
    tile: &'a PaintedTile,
    image: &'a Image,
}

impl TextureSurface<'_> {
    fn measure(&self, points: usize, probe: &mut ColourProbe<'_>) -> Result<ColourError> {
        let faces = &self.tile.texcoords;
        let solid = |face: FaceId| self.mesh.faces[face].map(|vertex| self.origin + self.mesh.positions[vertex]);
        let mut ends: Vec<f64> = Vec::with_capacity(faces.len());
        for &(face, _) in faces {
            ends.push(ends.last().unwrap_or(&0.0) + area(solid(face)));
        }
        let Some(&whole) = ends.last().filter(|&&whole| whole > 0.0) else { return Ok(ColourError::default()) };
        probe.begin(Bounds::around(self.mesh.positions.iter().map(|&position| self.origin + position)));
        let (mut squares, mut count) = (0.0, 0u32);
        for point in 0..points {
            let target = (point as f64 + 0.5) / points as f64 * whole;
            let (face, texcoords) = faces[ends.partition_point(|&end| end < target).min(faces.len() - 1)];
            let weights = weights_of(point);
            let texcoords = texcoords.map(|at| DVec2::new(f64::from(at[0]), f64::from(at[1])));
            let Some(best) = probe.mean_colour(&self.square(solid(face), texcoords, weights))? else { continue };
            let at = texcoords[0] * weights[0] + texcoords[1] * weights[1] + texcoords[2] * weights[2];
            let shown = Vec3::from(self.image.colour(at.as_vec2().to_array()));
            let difference = f64::from((shown - best).abs().element_sum()) / 3.0;
            squares += difference * difference;
            count += 1;
        }
        probe.end();
        let share = f64::from(count) / points as f64 * whole;
        Ok(ColourError { squares: squares / f64::from(count.max(1)) * share, area: share })
    }

    /// What a texel of the image covers around a point of a triangle.
    fn square(&self, solid: [DVec3; 3], texcoords: [DVec2; 3], weights: [f64; 3]) -> ProbedSquare {
        let size = DVec2::from(self.image.size().map(|side| side as f64));
        let growth = weight_growth(texcoords.map(|at| at * size));
        let along = |axis: usize| {
            let side = (solid[1] - solid[0]) * growth[0][axis] + (solid[2] - solid[0]) * growth[1][axis];
            // A face of one colour has no extent in the image.
            if side.is_finite() { side } else { DVec3::ZERO }
        };
        ProbedSquare {
            middle: solid[0] * weights[0] + solid[1] * weights[1] + solid[2] * weights[2],
            sides: [along(0), along(1)],
            normal: unit_normal(solid),
        }
    }
}

/// Weights of the corners for a point: uniform over a triangle.
fn weights_of(point: usize) -> [f64; 3] {
    let [across, along] = STEPS.map(|step| (0.5 + step * point as f64).fract());
    place_on_triangle(across, along)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_fill_a_triangle_evenly() {
        let mut mean = [0.0; 3];
        for point in 0..256 {
            let weights = weights_of(point);
            assert!(weights.iter().all(|weight| (0.0..=1.0).contains(weight)));
            (0..3).for_each(|corner| mean[corner] += weights[corner] / 256.0);
        }
        assert!(mean.iter().all(|share| (share - 1.0 / 3.0).abs() < 0.02), "{mean:?}");
    }

    #[test]
    fn errors_are_weighted_by_area() {
        let (a, b) = (ColourError { squares: 3.0 * 4.0, area: 3.0 }, ColourError { squares: 16.0, area: 1.0 });
        assert_eq!((a.rms(), b.rms(), a.plus(b).rms()), (2.0, 4.0, 7f64.sqrt()));
        assert_eq!(ColourError::default().rms(), 0.0);
    }
}

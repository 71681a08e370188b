//! What the original shows on average in small squares: the colour that a texel there should have.

use glam::{DVec3, Vec3, Vec4};

use super::closest::ClosestPlaces;
use super::original::Original;
use super::paint::colour_of;
use super::points::PointSet;
use crate::base::Result;
use crate::geometry::boxtree::Bounds;
use crate::image::stored::TexelReader;

/// Places along each side of a square at most.
const PLACES_MAX: f64 = 8.0;
/// Cells that stay open between squares: these lie all over a tile, a coarse one on many cells.
const VIEWS: usize = 4;
/// A square may be this much longer than a whole number of texels, through rounding.
const ROUNDING: f64 = 0.01;

/// A square near the original.
#[derive(Debug, Clone, Copy)]
pub struct ProbedSquare {
    /// Its middle.
    pub middle: DVec3,
    /// Its sides.
    pub sides: [DVec3; 2],
    /// The direction that it faces.
    pub normal: DVec3,
}

/// Finds what the original shows in squares.
pub struct ColourProbe<'a> {
    closest: ClosestPlaces<'a>,
    reader: TexelReader<'a>,
    /// Places along each side of a square: as dense as the texels of the original.
    places: usize,
    points: PointSet,
}

impl<'a> ColourProbe<'a> {
    /// Probes squares with sides of about `texel`; a surface that faces away counts as `away` farther.
    pub fn new(original: &'a Original, texel: f64, away: f64) -> Self {
        let places = (texel / original.median_texel - ROUNDING).ceil().clamp(1.0, PLACES_MAX) as usize;
        let (closest, reader) = (ClosestPlaces::new(original, away), TexelReader::new(&original.images));
        Self { closest, reader, places, points: PointSet::default() }
    }

    /// The next squares lie in a box.
    pub fn begin(&mut self, bounds: Bounds) {
        self.closest.begin_patch(bounds);
    }

    /// No more squares follow in that box.
    pub fn end(&mut self) {
        self.closest.close_but(0);
    }

    /// The mean colour of a square, 0 to 255; `None` where the original has none.
    ///
    /// # Errors
    /// On failed reads.
    pub fn mean_colour(&mut self, square: &ProbedSquare) -> Result<Option<Vec3>> {
        let Self { closest, reader, places, points, .. } = self;
        points.clear();
        let share = |place: usize| (place as f64 + 0.5) / *places as f64 - 0.5;
        for place in 0..*places * *places {
            let [across, along] = [place % *places, place / *places].map(share);
            points.push(square.middle + square.sides[0] * across + square.sides[1] * along);
        }
        points.end_run(square.normal);
        points.end_group();
        closest.begin_block(Bounds::around(points.points.iter().copied()));
        let mut sum = Vec4::ZERO;
        closest.of_points(points, &mut |_, count, found| {
            for lane in 0..count {
                let colour = colour_of(reader, &found.triangles[lane].shown, found.weights(lane))?;
                sum += colour.map_or(Vec4::ZERO, |colour| colour.extend(1.0));
            }
            Ok(())
        })?;
        closest.close_but(VIEWS);
        Ok((sum.w > 0.0).then(|| sum.truncate() / sum.w))
    }
}

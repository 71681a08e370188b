//! Paints a chart: each texel the colour that the original shows there.
//!
//! A texel that is coarser than those of the original is painted at several places, and shows their mean.
//!
//! # Memory
//! 4 bytes a texel of the chart's box, and that of [`closest`](super::closest) and of a
//! [`TexelReader`](super::texels::TexelReader).

use glam::{DVec2, DVec3, Vec3};

use super::canvas::Canvas;
use super::closest::{ClosestPlaces, Place};
use super::original::Original;
use super::raster::{NOBODY, Owners};
use super::texels::{Beyond, TexelReader};
use crate::base::Result;
use crate::geometry::boxtree::Bounds;
use crate::geometry::closest_weights;
use crate::geometry::triangle::unit_normal;
use crate::model::id::ImageId;
use crate::surface::cell::texcoord_of;
use crate::unwrap::{ImageSize, PlacedChart, Triangles};

/// Side of a square of texels that are painted together.
const SQUARE: usize = 8;
/// A place beyond its triangle is taken on the triangle's plane if no barycentric weight is below this, else at the
/// triangle's nearest point.
const LEAST_WEIGHT: f64 = -1.0;
/// Colour of what has none in the original.
const NO_COLOUR: Vec3 = Vec3::splat(204.0);

/// Texels that were painted.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Painted {
    /// Texels that charts cover.
    pub covered: u64,
    /// Those of them where the original has no colour.
    pub colourless: u64,
}

/// Paints charts with the colours of the original.
pub(super) struct Painter<'a> {
    closest: ClosestPlaces<'a>,
    reader: TexelReader<'a>,
    original: &'a Original,
    /// Places of a texel along each side.
    samples: usize,
    pub painted: Painted,
}

/// A place of a texel of a triangle: its texel in the chart's box, and the place in space.
struct Sample {
    texel: usize,
    point: DVec3,
}

impl<'a> Painter<'a> {
    /// Paints with `samples` by `samples` places a texel.
    pub fn new(original: &'a Original, reach: f64, samples: usize) -> Self {
        Self {
            closest: ClosestPlaces::new(&original.cells, reach),
            reader: TexelReader::new(&original.images),
            original,
            samples,
            painted: Painted::default(),
        }
    }

    /// Paints a chart of a mesh, whose positions are relative to `origin`.
    ///
    /// # Errors
    /// On failed reads.
    pub fn paint(
        &mut self,
        chart: &PlacedChart,
        mesh: Triangles<'_>,
        origin: DVec3,
        size: ImageSize,
        canvas: &mut Canvas,
    ) -> Result<()> {
        let owners = Owners::of(chart, size);
        let corners = chart.faces.iter().flat_map(|(face, _)| mesh.corners(*face));
        let bounds = Bounds::around(corners.map(|corner| corner + origin));
        self.closest.begin(bounds);
        self.painted.covered += owners.covered;
        let [width, height] = owners.size;
        let mut square: Vec<(u32, usize)> = Vec::new();
        for top in (0..height).step_by(SQUARE) {
            for left in (0..width).step_by(SQUARE) {
                square.clear();
                for y in top..(top + SQUARE).min(height) {
                    let row = left + y * width..(left + SQUARE).min(width) + y * width;
                    square.extend(row.map(|texel| (owners.of[texel], texel)).filter(|(owner, _)| *owner != NOBODY));
                }
                square.sort_unstable();
                for same in square.chunk_by(|a, b| a.0 == b.0) {
                    let (face, flat) = chart.faces[same[0].0 as usize];
                    let solid = mesh.corners(face).map(|corner| corner + origin);
                    self.paint_group(same, &owners, flat, solid, canvas)?;
                }
            }
        }
        Ok(())
    }

    /// Paints texels of one triangle, whose corners lie at `flat` in the image and at `solid` in space.
    fn paint_group(
        &mut self,
        texels: &[(u32, usize)],
        owners: &Owners,
        flat: [DVec2; 3],
        solid: [DVec3; 3],
        canvas: &mut Canvas,
    ) -> Result<()> {
        let samples = self.samples;
        let plane = Plane::new(flat, solid);
        let mut places: Vec<Sample> = Vec::with_capacity(texels.len() * samples * samples);
        for &(_, texel) in texels {
            let corner = [texel % owners.size[0] + owners.first[0], texel / owners.size[0] + owners.first[1]];
            for step in 0..samples * samples {
                let within = [step % samples, step / samples].map(|at| (at as f64 + 0.5) / samples as f64);
                let at = DVec2::new(corner[0] as f64 + within[0], corner[1] as f64 + within[1]);
                places.push(Sample { texel, point: plane.point(at) });
            }
        }
        let points: Vec<DVec3> = places.iter().map(|place| place.point).collect();
        let mut colours = vec![None; points.len()];
        let Self { closest, reader, original, .. } = self;
        closest.of_group(&points, unit_normal(solid), &mut |number, place| {
            colours[number] = colour_of(reader, original, &place)?;
            Ok(())
        })?;
        for (places, colours) in places.chunks(samples * samples).zip(colours.chunks(samples * samples)) {
            let known = colours.iter().flatten();
            let count = known.clone().count();
            self.painted.colourless += u64::from(count == 0);
            let mean = if count > 0 { known.sum::<Vec3>() / count as f32 } else { NO_COLOUR };
            let texel = places[0].texel;
            canvas.set(texel % owners.size[0] + owners.first[0], texel / owners.size[0] + owners.first[1], mean);
        }
        Ok(())
    }
}

/// The colour at a place of the original.
fn colour_of(reader: &mut TexelReader<'_>, original: &Original, place: &Place) -> Result<Option<Vec3>> {
    let Place { face, colours, weights } = place;
    if let Some(plain) = original.plain_colour(face.image) {
        return Ok(Some(plain));
    }
    if face.image != ImageId::NONE {
        let texcoord = texcoord_of(&face.texcoords, *weights);
        let repeats = face.texcoords.iter().flatten().any(|&at| at > 1.0);
        let beyond = if repeats { Beyond::Repeat } else { Beyond::Edge };
        return reader.colour(face.image, texcoord, beyond);
    }
    Ok(colours.and_then(|colours| {
        let known = || colours.iter().zip(weights).filter(|(colour, _)| colour[3] > 0);
        let total: f64 = known().map(|(_, weight)| weight).sum();
        let sum = known().map(|(colour, &weight)| {
            Vec3::new(f32::from(colour[0]), f32::from(colour[1]), f32::from(colour[2])) * weight as f32
        });
        (total > 0.0).then(|| sum.sum::<Vec3>() / total as f32)
    }))
}

/// A triangle of the image and in space.
struct Plane {
    flat: [DVec2; 3],
    solid: [DVec3; 3],
    doubled_area: f64,
}

impl Plane {
    fn new(flat: [DVec2; 3], solid: [DVec3; 3]) -> Self {
        Self { flat, solid, doubled_area: (flat[1] - flat[0]).perp_dot(flat[2] - flat[0]) }
    }

    /// The place in space of one in the image.
    fn point(&self, at: DVec2) -> DVec3 {
        let [a, b, c] = self.flat;
        let at_b = (at - a).perp_dot(c - a) / self.doubled_area;
        let at_c = (b - a).perp_dot(at - a) / self.doubled_area;
        let mut weights = [1.0 - at_b - at_c, at_b, at_c];
        if !weights.into_iter().all(|weight| weight >= LEAST_WEIGHT) {
            weights = closest_weights(at.extend(0.0), self.flat.map(|corner| corner.extend(0.0)));
        }
        self.solid[0] * weights[0] + self.solid[1] * weights[1] + self.solid[2] * weights[2]
    }
}

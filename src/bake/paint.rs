//! Paints a chart: each texel the colour that the original shows there.
//!
//! # Memory
//! 4 bytes a texel of the chart's box, that of the [samples](super::sharpen) of a block, of
//! [`closest`](super::closest) and of a [`TexelReader`](super::texels::TexelReader).

use glam::{DVec2, DVec3, Vec2, Vec3};

use super::canvas::AtlasCanvas;
use super::closest::{ClosestPlaces, OriginalPlace};
use super::original::Original;
use super::raster::{IN_GUTTER, NOBODY, Owners};
use super::sharpen::{NONE, SampleBlock, Samples};
use super::texels::{Beyond, TexelReader};
use crate::base::Result;
use crate::base::id::TiVec;
use crate::geometry::boxtree::Bounds;
use crate::geometry::closest_weights;
use crate::geometry::triangle::unit_normal;
use crate::mesh::id::FaceId;
use crate::model::id::ImageId;
use crate::surface::cell::texcoord_of;
use crate::unwrap::{ImageSize, PlacedChart, Triangles};

/// Side of a square that is painted together, in texels of the original.
const SQUARE: f64 = 8.0;
/// A place beyond its triangle is taken on the triangle's plane if no barycentric weight is below this, else at the
/// triangle's nearest point.
const LEAST_WEIGHT: f64 = -1.0;
/// Largest factor between a texel's length and that where the original has its median.
const DENSITY_RANGE: f64 = 2.0;
/// Places of a texel along each side at most.
const SAMPLES_MAX: f64 = 4.0;

/// Texels that were painted.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Painted {
    /// Texels that charts cover.
    pub covered: u64,
    /// Those of them where the original has no colour.
    pub colourless: u64,
}

/// The triangles of a patch, and where they lie.
pub(super) struct PatchSurface<'a> {
    pub triangles: Triangles<'a>,
    /// Their positions are relative to this.
    pub origin: DVec3,
}

impl PatchSurface<'_> {
    fn corners(&self, face: FaceId) -> [DVec3; 3] {
        self.triangles.corners(face).map(|corner| corner + self.origin)
    }
}

/// Paints charts with the colours of the original.
pub(super) struct ChartPainter<'a> {
    closest: ClosestPlaces<'a>,
    reader: TexelReader<'a>,
    original: &'a Original,
    /// Places of a texel that are sampled, from its middle.
    pattern: Vec<Vec2>,
    /// Side of a square that is painted together, in texels.
    square: usize,
    points: Vec<DVec3>,
    colours: Vec<Vec3>,
    pub painted: Painted,
}

impl<'a> ChartPainter<'a> {
    /// Paints texels that are `texel` long where the original has its median.
    pub fn new(original: &'a Original, reach: f64, texel: f64) -> Self {
        let coarseness = texel / original.median_texel;
        Self {
            closest: ClosestPlaces::new(&original.cells, reach),
            reader: TexelReader::new(&original.images),
            original,
            pattern: pattern(coarseness),
            square: (SQUARE / coarseness).round().clamp(1.0, 16.0) as usize,
            points: Vec::new(),
            colours: Vec::new(),
            painted: Painted::default(),
        }
    }

    /// Length of a texel's side on each triangle of a patch: as the original has it there, within a factor of
    /// [`DENSITY_RANGE`] of `usual`, its length where the original has the median.
    ///
    /// # Errors
    /// On failed reads.
    pub fn texels(&mut self, patch: &PatchSurface<'_>, usual: f64) -> Result<TiVec<FaceId, f64>> {
        let mesh = patch.triangles;
        let bounds = Bounds::around(mesh.positions.iter().map(|&position| position + patch.origin));
        self.closest.begin_patch(bounds);
        let factor = usual / self.original.median_texel;
        let mut lengths = TiVec::with_capacity(mesh.vertices.len());
        for face in mesh.vertices.keys() {
            let corners = patch.corners(face);
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            let mut length = None;
            self.closest.of_group(&[middle], unit_normal(corners), &mut |_, place| {
                length = self.original.texel_of(&place.face, place.area);
                Ok(())
            })?;
            let length = length.map_or(usual, |length| length * factor);
            lengths.push(length.clamp(usual / DENSITY_RANGE, usual * DENSITY_RANGE));
        }
        Ok(lengths)
    }

    /// Paints a chart of a patch.
    ///
    /// # Errors
    /// On failed reads.
    pub fn paint(
        &mut self,
        chart: &PlacedChart,
        patch: &PatchSurface<'_>,
        size: ImageSize,
        canvas: &mut AtlasCanvas,
    ) -> Result<()> {
        let owners = Owners::of(chart, size);
        let bounds = Bounds::around(chart.faces.iter().flat_map(|(face, _)| patch.corners(*face)));
        self.closest.begin_chart(bounds);
        self.painted.covered += owners.covered;
        for block in SampleBlock::of(owners.size) {
            let mut samples = Samples::new(&block, self.pattern.len());
            self.take_samples(chart, patch, &owners, &block, &mut samples)?;
            samples.sharpen(&self.pattern);
            for [column, row] in block.inner() {
                if owners.of[row * owners.size[0] + column] != NOBODY {
                    let texel = samples.value(&block, [column, row]);
                    canvas.set(column + owners.first[0], row + owners.first[1], texel);
                }
            }
        }
        Ok(())
    }

    /// Takes the samples of a block, square by square.
    fn take_samples(
        &mut self,
        chart: &PlacedChart,
        patch: &PatchSurface<'_>,
        owners: &Owners,
        block: &SampleBlock,
        samples: &mut Samples,
    ) -> Result<()> {
        let ([left, top], [right, bottom]) = (block.first, block.end);
        let mut square: Vec<(u32, [usize; 2])> = Vec::new();
        for y in (top..bottom).step_by(self.square) {
            for x in (left..right).step_by(self.square) {
                square.clear();
                for row in y..(y + self.square).min(bottom) {
                    let columns = x..(x + self.square).min(right);
                    let owned = columns.map(|column| (owners.of[row * owners.size[0] + column], [column, row]));
                    square.extend(owned.filter(|(owner, _)| *owner != NOBODY));
                }
                if square.iter().any(|(owner, _)| *owner != square[0].0) {
                    square.sort_unstable();
                }
                for same in square.chunk_by(|a, b| a.0 == b.0) {
                    let (face, flat) = chart.faces[(same[0].0 & !IN_GUTTER) as usize];
                    let plane = Plane::new(flat.map(|corner| corner - owners.corner()), patch.corners(face));
                    self.take_group(same, &plane, block, samples)?;
                }
            }
        }
        Ok(())
    }

    /// Takes the samples of some texels of one triangle.
    fn take_group(
        &mut self,
        texels: &[(u32, [usize; 2])],
        plane: &Plane,
        block: &SampleBlock,
        samples: &mut Samples,
    ) -> Result<()> {
        let is_gutter = texels[0].0 & IN_GUTTER != 0;
        let pattern: &[Vec2] = if is_gutter { &[Vec2::ZERO] } else { &self.pattern };
        let mut points = std::mem::take(&mut self.points);
        points.clear();
        for &(_, [column, row]) in texels {
            let middle = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
            points.extend(pattern.iter().map(|step| plane.point(middle + step.as_dvec2())));
        }
        let mut colours = std::mem::take(&mut self.colours);
        colours.clear();
        colours.resize(points.len(), NONE);
        let Self { closest, reader, original, .. } = self;
        closest.of_group(&points, plane.normal, &mut |number, place| {
            colours[number] = colour_of(reader, original, &place)?.unwrap_or(NONE);
            Ok(())
        })?;
        for (&(_, texel), colours) in texels.iter().zip(colours.chunks(pattern.len())) {
            let has_colour = samples.set(block, texel, colours, is_gutter);
            self.painted.colourless += u64::from(!has_colour && !is_gutter);
        }
        (self.points, self.colours) = (points, colours);
        Ok(())
    }
}

/// The colour at a place of the original.
fn colour_of(reader: &mut TexelReader<'_>, original: &Original, place: &OriginalPlace) -> Result<Option<Vec3>> {
    let OriginalPlace { face, colours, weights, .. } = place;
    let plain = original.plain_colour(face.image);
    if face.image != ImageId::NONE && plain.is_none() {
        let texcoord = texcoord_of(&face.texcoords, *weights);
        let repeats = face.texcoords.iter().flatten().any(|&at| at > 1.0);
        let beyond = if repeats { Beyond::Repeat } else { Beyond::Edge };
        return reader.colour(face.image, texcoord, beyond);
    }
    let of_vertices = colours.and_then(|colours| {
        let known = || colours.iter().zip(weights).filter(|(colour, _)| colour[3] > 0);
        let total: f64 = known().map(|(_, weight)| weight).sum();
        let sum = known().map(|(colour, &weight)| {
            Vec3::new(f32::from(colour[0]), f32::from(colour[1]), f32::from(colour[2])) * weight as f32
        });
        (total > 0.0).then(|| sum.sum::<Vec3>() / total as f32)
    });
    Ok(of_vertices.or(plain))
}

/// Places of a texel that are sampled: two on a diagonal where it is as fine as those of the original, more where it is
/// coarser.
fn pattern(coarseness: f64) -> Vec<Vec2> {
    let side = (coarseness - 0.2).ceil().clamp(1.0, SAMPLES_MAX) as usize;
    if side == 1 {
        return vec![Vec2::splat(-0.25), Vec2::splat(0.25)];
    }
    let at = |step: usize| (step as f32 + 0.5) / side as f32 - 0.5;
    (0..side * side).map(|step| Vec2::new(at(step % side), at(step / side))).collect()
}

/// A triangle of the image and in space.
struct Plane {
    flat: [DVec2; 3],
    solid: [DVec3; 3],
    normal: DVec3,
    doubled_area: f64,
}

impl Plane {
    fn new(flat: [DVec2; 3], solid: [DVec3; 3]) -> Self {
        Self { flat, solid, normal: unit_normal(solid), doubled_area: (flat[1] - flat[0]).perp_dot(flat[2] - flat[0]) }
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

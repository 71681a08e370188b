//! Paints charts: each texel the colour that the original shows there.
//!
//! # Memory
//! 4 bytes a texel of a block, that of its [samples](super::sharpen), of [`closest`](super::closest) and of a
//! [`TexelReader`].

use std::sync::Mutex;

use glam::{DVec2, DVec3, Vec2, Vec3, Vec4};

use super::canvas::AtlasCanvas;
use super::closest::ClosestPlaces;
use super::original::Original;
use super::points::PointSet;
use super::prism::Shown;
use super::raster::{IN_GUTTER, NOBODY, Owners, TexelRect};
use super::sharpen::{SampleBlock, Samples};
use crate::base::Result;
use crate::base::lock::lock;
use crate::geometry::boxtree::Bounds;
use crate::geometry::closest_weights;
use crate::geometry::triangle::{unit_normal, weight_growth};
use crate::image::stored::TexelReader;
use crate::mesh::id::FaceId;
use crate::unwrap::{GUTTER, PlacedChart, Triangles};

/// Side of a square whose points are a group, by that of a square as large as a triangle of the original, and the largest
/// such side in texels.
const SQUARE: f64 = 0.8;
const SQUARE_MAX: f64 = 8.0;
/// Squares along each side of a region, whose triangles are gathered together.
const SQUARES: usize = 6;
/// A place beyond its triangle is taken on the triangle's plane if no barycentric weight is below this, else at the
/// triangle's nearest point.
const LEAST_WEIGHT: f64 = -1.0;
/// Barycentric weights that change by less than this from texel to texel stay above [`LEAST_WEIGHT`] in the gutter.
const PLUMP: f64 = 0.15;
/// Places of a texel along each side at most.
const SAMPLES_MAX: f64 = 4.0;

/// Texels that were painted.
#[derive(Debug, Clone, Copy, Default)]
pub struct Painted {
    /// Texels that charts cover.
    pub covered: u64,
    /// Those of them where the original has no colour.
    pub colourless: u64,
}

impl Painted {
    /// The sum of both.
    pub fn plus(self, other: Self) -> Self {
        Self { covered: self.covered + other.covered, colourless: self.colourless + other.colourless }
    }
}

/// The triangles of a patch, and where they lie.
pub struct PatchSurface<'a> {
    /// The triangles.
    pub triangles: Triangles<'a>,
    /// Their positions are relative to this.
    pub origin: DVec3,
}

impl PatchSurface<'_> {
    /// The smallest box around it.
    pub fn bounds(&self) -> Bounds {
        Bounds::around(self.triangles.positions.iter().map(|&position| position + self.origin))
    }

    /// Corners of a triangle.
    pub fn corners(&self, face: FaceId) -> [DVec3; 3] {
        self.triangles.corners(face).map(|corner| corner + self.origin)
    }
}

/// Paints charts with the colours of the original.
pub(super) struct ChartPainter<'a> {
    closest: ClosestPlaces<'a>,
    reader: TexelReader<'a>,
    /// Places of a texel that are sampled, from its middle.
    pattern: Vec<Vec2>,
    /// Side of a square in texels of the image.
    square: usize,
    /// The texels of a region with their owners, square by square.
    texels: Vec<(u32, [usize; 2])>,
    /// The points of their samples.
    points: PointSet,
    /// The colours of the points; the fourth number is 1, or 0 without colour.
    colours: Vec<Vec4>,
    painted: Painted,
}

impl<'a> ChartPainter<'a> {
    /// Paints with texels that are `texel` long where the original has its median; a surface that faces away counts as
    /// `away` farther.
    pub fn new(original: &'a Original, texel: f64, away: f64) -> Self {
        let coarseness = texel / original.median_texel;
        let of_face = (original.area / original.face_count.max(1) as f64).sqrt() / texel;
        Self {
            closest: ClosestPlaces::new(original, away),
            reader: TexelReader::new(&original.images),
            pattern: pattern(coarseness),
            square: (SQUARE * of_face).round().clamp(1.0, SQUARE_MAX) as usize,
            texels: Vec::new(),
            points: PointSet::default(),
            colours: Vec::new(),
            painted: Painted::default(),
        }
    }

    /// Places of a texel that are sampled.
    pub fn samples_of_texel(&self) -> usize {
        self.pattern.len()
    }

    /// What was painted since the last call.
    pub fn take_painted(&mut self) -> Painted {
        std::mem::take(&mut self.painted)
    }

    /// The next charts are those of a patch.
    pub fn begin(&mut self, patch: &PatchSurface<'_>) {
        self.closest.begin_patch(patch.bounds());
    }

    /// Paints a block of a chart of a patch.
    ///
    /// # Errors
    /// On failed reads.
    pub fn paint(
        &mut self,
        chart: &PlacedChart,
        patch: &PatchSurface<'_>,
        block: &SampleBlock,
        canvas: &Mutex<AtlasCanvas>,
    ) -> Result<()> {
        let limits = TexelRect { first: [0; 2], end: lock(canvas).size };
        let owners = Owners::of(chart, block.outer.grown(GUTTER as usize, limits));
        let owned = || block.outer.texels().map(|texel| owners.owner(texel)).filter(|&owner| owner != NOBODY);
        let mut faces: Vec<u32> = owned().map(|owner| owner & !IN_GUTTER).collect();
        faces.sort_unstable();
        faces.dedup();
        let corners = faces.into_iter().flat_map(|face| patch.corners(chart.faces[face as usize].0));
        self.closest.begin_block(Bounds::around(corners));
        let mut samples = Samples::new(block, self.pattern.len());
        for region in block.outer.squares(self.square * SQUARES) {
            self.find_points(chart, patch, &owners, region);
            self.take_colours()?;
            self.hand_over(block, &mut samples);
        }
        samples.sharpen(&self.pattern);
        let mut canvas = lock(canvas);
        for texel in block.inner.texels() {
            let owner = owners.owner(texel);
            if owner != NOBODY {
                canvas.set(texel, samples.value(block, texel));
            }
        }
        Ok(())
    }

    /// Finds the points of a region, square by square.
    fn find_points(&mut self, chart: &PlacedChart, patch: &PatchSurface<'_>, owners: &Owners, region: TexelRect) {
        let Self { texels, points, pattern, square, .. } = self;
        texels.clear();
        points.clear();
        for square in region.squares(*square) {
            let first = texels.len();
            let owned = square.texels().map(|texel| (owners.owner(texel), texel));
            texels.extend(owned.filter(|(owner, _)| *owner != NOBODY));
            let own = &mut texels[first..];
            if own.iter().any(|(owner, _)| *owner != own[0].0) {
                own.sort_unstable();
            }
            for same in own.chunk_by(|a, b| a.0 == b.0) {
                let (face, flat) = chart.faces[(same[0].0 & !IN_GUTTER) as usize];
                let plane = Plane::new(flat, patch.corners(face));
                let pattern = samples_of(pattern, same[0].0);
                for &(_, [column, row]) in same {
                    let middle = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
                    pattern.iter().for_each(|step| points.push(plane.point(middle + step.as_dvec2())));
                }
                points.end_run(plane.normal);
            }
            points.end_group();
        }
    }

    /// Finds the colours of the points of a region.
    fn take_colours(&mut self) -> Result<()> {
        self.colours.clear();
        self.colours.resize(self.points.len(), Vec4::ZERO);
        let Self { closest, reader, points, colours, .. } = self;
        closest.of_points(points, &mut |first, count, places| {
            for (lane, colour) in colours[first..first + count].iter_mut().enumerate() {
                if let Some(found) = colour_of(reader, &places.triangles[lane].shown, places.weights(lane))? {
                    *colour = found.extend(1.0);
                }
            }
            Ok(())
        })
    }

    /// Hands the colours of a region over to its block.
    fn hand_over(&mut self, block: &SampleBlock, samples: &mut Samples) {
        let mut first = 0;
        for &(owner, texel) in &self.texels {
            let count = samples_of(&self.pattern, owner).len();
            let is_gutter = owner & IN_GUTTER != 0;
            let has_colour = samples.set(block, texel, &self.colours[first..first + count], is_gutter);
            if !is_gutter && block.inner.contains(texel) {
                self.painted.covered += 1;
                self.painted.colourless += u64::from(!has_colour);
            }
            first += count;
        }
    }
}

/// Places that are sampled of a texel with this owner.
fn samples_of(pattern: &[Vec2], owner: u32) -> &[Vec2] {
    if owner & IN_GUTTER != 0 { &[Vec2::ZERO] } else { pattern }
}

/// The colour at a place of a triangle.
#[inline]
pub(super) fn colour_of(reader: &mut TexelReader<'_>, shown: &Shown, weights: [f32; 3]) -> Result<Option<Vec3>> {
    match shown {
        Shown::Image(image, texcoords, beyond) => reader.colour(*image, mixed(texcoords, weights), *beyond),
        Shown::Plain(colour) => Ok(Some(*colour)),
        Shown::Vertices(colours, plain) => Ok(of_vertices(colours, weights).or(*plain)),
        Shown::Nothing => Ok(None),
    }
}

#[inline]
fn mixed(texcoords: &[[f32; 2]; 3], weights: [f32; 3]) -> [f32; 2] {
    let [a, b, c] = texcoords;
    let mix = |axis: usize| a[axis] * weights[0] + b[axis] * weights[1] + c[axis] * weights[2];
    [mix(0), mix(1)]
}

/// The colour between vertices that have one.
fn of_vertices(colours: &[[u8; 4]; 3], weights: [f32; 3]) -> Option<Vec3> {
    let known = || colours.iter().zip(weights).filter(|(colour, _)| colour[3] > 0);
    let total: f32 = known().map(|(_, weight)| weight).sum();
    let [red, green, blue] =
        [0, 1, 2].map(|channel| known().map(|(colour, weight)| f32::from(colour[channel]) * weight).sum::<f32>());
    (total > 0.0).then(|| Vec3::new(red, green, blue) / total)
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
    /// How the barycentric weights of the second and third corner grow along the image.
    growth: [DVec2; 2],
    /// Steps in space of one column and one row.
    steps: [DVec3; 2],
    /// Whether all texels around one of its own lie close to it.
    is_plump: bool,
}

impl Plane {
    fn new(flat: [DVec2; 3], solid: [DVec3; 3]) -> Self {
        let growth = weight_growth(flat);
        let along = |axis: usize| (solid[1] - solid[0]) * growth[0][axis] + (solid[2] - solid[0]) * growth[1][axis];
        let is_plump = growth[0].length() + growth[1].length() < PLUMP;
        Self { flat, solid, normal: unit_normal(solid), growth, steps: [along(0), along(1)], is_plump }
    }

    /// The place in space of one in the image.
    #[inline]
    fn point(&self, at: DVec2) -> DVec3 {
        let from_a = at - self.flat[0];
        if !self.is_plump {
            let [at_b, at_c] = self.growth.map(|growth| growth.dot(from_a));
            let weights = [1.0 - at_b - at_c, at_b, at_c];
            if !weights.into_iter().all(|weight| weight >= LEAST_WEIGHT) {
                let [a, b, c] = closest_weights(at.extend(0.0), self.flat.map(|corner| corner.extend(0.0)));
                return self.solid[0] * a + self.solid[1] * b + self.solid[2] * c;
            }
        }
        self.solid[0] + self.steps[0] * from_a.x + self.steps[1] * from_a.y
    }
}

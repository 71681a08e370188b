//! Paints charts: each texel the colour that the original shows there.
//!
//! # Memory
//! 4 bytes a texel of a block, that of its [samples](super::sharpen), of [`closest`](super::closest) and of a
//! [`TexelReader`].

use std::sync::Mutex;

use glam::{DVec2, Vec2, Vec3, Vec4};

use super::canvas::AtlasCanvas;
use super::closest::ClosestPlaces;
use super::original::Original;
use super::patch_surface::PatchSurface;
use super::plane::Plane;
use super::points::PointSet;
use super::prism::Shown;
use super::project::{ChartPart, Projector};
use super::raster::{IN_GUTTER, NOBODY, Owners, TexelRect};
use super::sharpen::{SampleBlock, Samples};
use crate::base::Result;
use crate::base::lock::lock;
use crate::geometry::boxtree::Bounds;
use crate::image::stored::TexelReader;
use crate::unwrap::{GUTTER, PlacedChart};

/// Side of a square whose points are a group, by that of a square as large as a triangle of the original, and the largest
/// such side in texels.
const SQUARE: f64 = 0.8;
const SQUARE_MAX: f64 = 8.0;
/// Squares along each side of a region, whose triangles are gathered together.
const SQUARES: usize = 6;
/// Colour of a texel of a chart where the original has none.
const NO_COLOUR: Vec3 = Vec3::splat(204.0);
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
    /// Sets the samples of a texel, and counts it.
    fn set(
        &mut self,
        samples: &mut Samples,
        block: &SampleBlock,
        texel: [usize; 2],
        colours: &[Vec4],
        is_gutter: bool,
    ) {
        let has_colour = samples.set(block, texel, colours, is_gutter);
        if !is_gutter && block.inner.contains(texel) {
            self.covered += 1;
            self.colourless += u64::from(!has_colour);
        }
    }

    /// The sum of both.
    pub fn plus(self, other: Self) -> Self {
        Self { covered: self.covered + other.covered, colourless: self.colourless + other.colourless }
    }
}

/// Paints charts with the colours of the original.
pub(super) struct ChartPainter<'a> {
    projector: Projector,
    closest: ClosestPlaces<'a>,
    reader: TexelReader<'a>,
    /// Places of a texel that are sampled, from its middle.
    pattern: Vec<Vec2>,
    /// Side of a square in texels of the image.
    square: usize,
    /// Whether each texel of a block has its colour from the projector.
    are_seen: Vec<bool>,
    /// The other texels of a region with their owners, square by square.
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
        let pattern = pattern(coarseness);
        Self {
            projector: Projector::new(texel, away, of_face * texel, &pattern),
            closest: ClosestPlaces::new(original, away),
            reader: TexelReader::new(&original.images),
            pattern,
            square: (SQUARE * of_face).round().clamp(1.0, SQUARE_MAX) as usize,
            are_seen: Vec::new(),
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
        let part = ChartPart { chart, patch, owners: &owners, rect: block.outer };
        self.project(&part, block, &mut samples)?;
        for region in block.outer.squares(self.square * SQUARES) {
            self.find_points(&part, block, region);
            self.take_colours()?;
            self.hand_over(block, &mut samples);
        }
        let is_bare = |texel: &[usize; 2]| samples.value(block, *texel).is_none();
        let is_gutter = |texel: &[usize; 2]| owners.owner(*texel) != NOBODY && owners.owner(*texel) & IN_GUTTER != 0;
        let mut bare: Vec<[usize; 2]> = block.outer.texels().filter(is_gutter).filter(is_bare).collect();
        samples.extend(block, &mut bare, GUTTER);
        samples.sharpen(&self.pattern);
        let mut canvas = lock(canvas);
        for texel in block.inner.texels() {
            let owner = owners.owner(texel);
            match samples.value(block, texel) {
                Some(colour) => canvas.set(texel, colour),
                None if owner & IN_GUTTER == 0 => canvas.set(texel, NO_COLOUR),
                // What lies around the charts is filled from them.
                None => {}
            }
        }
        Ok(())
    }

    /// Takes the colours that the projector finds.
    fn project(&mut self, part: &ChartPart<'_>, block: &SampleBlock, samples: &mut Samples) -> Result<()> {
        let Self { projector, closest, reader, are_seen, colours, painted, .. } = self;
        let [width, height] = block.outer.size();
        are_seen.clear();
        are_seen.resize(width * height, false);
        projector.project(part, closest, &mut |seen| {
            colours.clear();
            seen.samples(|shown, weights| {
                colours.push(colour_of(reader, shown, weights)?.map_or(Vec4::ZERO, |colour| colour.extend(1.0)));
                Ok(())
            })?;
            are_seen[block.outer.index(seen.texel)] = true;
            painted.set(samples, block, seen.texel, colours, seen.is_gutter());
            Ok(())
        })
    }

    /// Finds the points of the other texels of a region, square by square; in the gutter, these are left to be filled.
    fn find_points(&mut self, part: &ChartPart<'_>, block: &SampleBlock, region: TexelRect) {
        let Self { are_seen, texels, points, pattern, square, .. } = self;
        texels.clear();
        points.clear();
        for square in region.squares(*square) {
            let first = texels.len();
            let unseen = square.texels().filter(|&texel| !are_seen[block.outer.index(texel)]);
            let owned = unseen.map(|texel| (part.owners.owner(texel), texel));
            texels.extend(owned.filter(|(owner, _)| owner & IN_GUTTER == 0));
            let own = &mut texels[first..];
            if own.iter().any(|(owner, _)| *owner != own[0].0) {
                own.sort_unstable();
            }
            for same in own.chunk_by(|a, b| a.0 == b.0) {
                let (face, flat) = part.chart.faces[same[0].0 as usize];
                let plane = Plane::new(flat, part.patch.corners(face));
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
        for (&(_, texel), colours) in self.texels.iter().zip(self.colours.chunks_exact(self.pattern.len())) {
            self.painted.set(samples, block, texel, colours, false);
        }
    }
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

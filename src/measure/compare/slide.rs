//! Texture drift: where texels of a result lie on the original.
//!
//! ```text
//!   result    ----p----        p shows the texel t; t lies at s on the original, and p's closest point is c:
//!                 |            the texture drifted from s to c
//!   original  --s-c-----       the two sides of a seam show texels that lie at two places: the seam gapes from one to
//!                              the other
//! ```
//! In: pairs of points. Out: [`Slides`] and [`Gaps`]. Invariant: pairs are summed in their order.
//!
//! Where the original shows an image more than once, as brick walls do, a texel lies at several positions. Drift on
//! such an image is not measured.
//!
//! Positions on the original are stored for the texels of a grid, [`GRID_SIDE`] along each side of an image, so a
//! texture that did not move has a measured drift of up to one texel of the grid.
//!
//! # Memory
//! 160 bytes for each pair of a window, at most a quarter of the budget; in each thread the texels of one image that
//! are asked for.

use std::ops::Range;

use glam::{DVec2, DVec3};

use super::cells::MeasuredMesh;
use super::distribution::Distribution;
use super::options::Resources;
use super::texture_pair::TexturePair;
use crate::base::id::{TiSlice, TiVec};
use crate::base::ordered::map_in_order;
use crate::base::{Progress, Result};
use crate::file::Column;
use crate::image::textures::TextureImages;
use crate::model::id::ImageId;
use crate::surface::cell::{CellView, ShownImage};

/// The original shows an image more than once if the triangles that show it cover more than this times its area.
const SHOWN_MAX: f64 = 1.1;
/// Texels of the grid along each side of an image, on which drift is measured.
const GRID_SIDE: usize = 2048;
/// The same for more than [`MANY_IMAGES`] texture images.
const GRID_SIDE_OF_MANY: usize = 1024;
/// Number of texture images above which each has a coarser grid.
const MANY_IMAGES: usize = 40;
/// Weight by which a texel's centre may lie outside of a triangle, for the texel to belong to it.
const OUTSIDE_WEIGHT: f64 = 0.3;
/// Distance in texels by which the centre may lie outside of the triangle's box.
const OUTSIDE_TEXELS: f64 = 0.6;
/// Maximum number of repeats of an image across a triangle, along each axis, for the triangle to be searched.
const REPEATS_MAX: usize = 4;
/// Largest drift in texels; longer ones count as this in percentiles.
const TEXELS_MAX: f64 = 1e6;
/// Memory of a pair while its window is in work, in bytes.
const PAIR_BYTES: u64 = 160;
/// Minimum and maximum number of pairs of a window; their indices have 32 bits.
const WINDOW_PAIRS: Range<u64> = 1 << 10..1 << 30;

/// Texture drift at the points of a result.
#[derive(Debug)]
pub struct Slides {
    /// In the mesh's unit of length.
    pub lengths: Distribution,
    /// In texels of the original's images.
    pub texels: Distribution,
    /// Points that show a texture image of the original.
    pub textured: u64,
    /// Of these, points whose image the original shows more than once.
    pub repeated: u64,
    /// Of the others, points that show none of the original's charts.
    pub outside: u64,
    /// All points.
    pub points: u64,
}

/// Gaps of seams: distances on the original between their two sides.
#[derive(Debug)]
pub struct Gaps {
    /// In the mesh's unit of length.
    pub lengths: Distribution,
    /// In texels of the images that are shown.
    pub texels: Distribution,
    /// Points both sides of which show a texture image that the original shows once.
    pub textured: u64,
    /// Of these, points of which a side shows none of the original's charts.
    pub outside: u64,
}

/// The original, on which texels are located.
#[derive(Debug)]
pub struct Atlas<'a> {
    original: &'a MeasuredMesh,
    sources: &'a TiSlice<ImageId, Vec<ImageId>>,
    /// Whether each texture image that is asked for is shown more than once.
    repeated: TiVec<ImageId, bool>,
    limit: f64,
    resources: &'a Resources,
}

/// A point of an image: texture image and texture coordinate.
type Texel = (ImageId, [f32; 2]);

impl<'a> Atlas<'a> {
    /// Prepares to locate texels; `sources` has, for each texture image that is asked for, the images of the original
    /// that it shows, ascending. No drift exceeds `limit` by much.
    pub fn new(
        original: &'a MeasuredMesh,
        sources: &'a TiSlice<ImageId, Vec<ImageId>>,
        limit: f64,
        resources: &'a Resources,
    ) -> Self {
        let mut shown: TiVec<ImageId, f64> = vec![0.0; original.images.files.len()].into();
        for &ShownImage { image, texture_area: area } in original.surface.cells.iter().flat_map(|cell| &cell.images) {
            if let Some(sum) = shown.get_mut(image) {
                *sum += area;
            }
        }
        let area = |sources: &Vec<ImageId>| sources.iter().map(|&source| shown[source]).sum::<f64>();
        let repeated = sources.iter().map(|sources| area(sources) > SHOWN_MAX).collect();
        Self { original, sources, repeated, limit, resources }
    }

    /// Measures the texture drift at points of the result, whose closest points lie on the original.
    ///
    /// # Errors
    /// On failed reads.
    pub fn slides(&self, pairs: &Column<TexturePair>, progress: &dyn Progress) -> Result<Slides> {
        let sizes = sizes(&self.original.images);
        let mut slides = Slides {
            lengths: Distribution::new(self.limit),
            texels: Distribution::new(TEXELS_MAX),
            textured: 0,
            repeated: 0,
            outside: 0,
            points: pairs.len(),
        };
        for range in self.windows(pairs) {
            let window = pairs.window(range)?;
            let texels: Vec<Texel> = window.iter().map(|pair| (pair.image, pair.texcoord)).collect();
            let places = self.places(&texels, progress)?;
            for (pair, place) in window.iter().zip(places).filter(|(pair, _)| self.is_shown(pair.image)) {
                slides.textured += 1;
                if self.is_repeated(pair.image) {
                    slides.repeated += 1;
                    continue;
                }
                let Some(place) = place else {
                    slides.outside += 1;
                    continue;
                };
                let length = DVec3::from(pair.closest).distance(place);
                slides.lengths.add(length);
                if let Some(side) = sizes.get(pair.other_image).copied().flatten() {
                    slides.texels.add(length * f64::from(pair.other_density) * side);
                }
            }
        }
        Ok(slides)
    }

    /// Measures the gaps between the texels that the two sides of seams show; `images` are of the mesh with the
    /// seams.
    ///
    /// # Errors
    /// On failed reads.
    pub fn gaps(&self, pairs: &Column<TexturePair>, images: &TextureImages, progress: &dyn Progress) -> Result<Gaps> {
        let sizes = sizes(images);
        let mut gaps = Gaps {
            lengths: Distribution::new(self.limit),
            texels: Distribution::new(TEXELS_MAX),
            textured: 0,
            outside: 0,
        };
        for range in self.windows(pairs) {
            let window = pairs.window(range)?;
            let sides = |pair: &TexturePair| [(pair.image, pair.texcoord), (pair.other_image, pair.other_texcoord)];
            let texels: Vec<Texel> = window.iter().flat_map(sides).collect();
            let places = self.places(&texels, progress)?;
            let is_shown = |pair: &TexturePair| {
                [pair.image, pair.other_image].iter().all(|&side| self.is_shown(side) && !self.is_repeated(side))
            };
            for (pair, places) in window.iter().zip(places.chunks_exact(2)).filter(|(pair, _)| is_shown(pair)) {
                gaps.textured += 1;
                let &[Some(from), Some(to)] = places else {
                    gaps.outside += 1;
                    continue;
                };
                gaps.lengths.add(from.distance(to));
                if let Some(side) = sizes.get(pair.other_image).copied().flatten() {
                    gaps.texels.add(from.distance(to) * f64::from(pair.other_density) * side);
                }
            }
        }
        Ok(gaps)
    }

    fn windows(&self, pairs: &Column<TexturePair>) -> impl Iterator<Item = Range<u64>> + use<> {
        let fitting = self.resources.work_bytes / 4 / PAIR_BYTES;
        pairs.ranges(fitting.clamp(WINDOW_PAIRS.start, WINDOW_PAIRS.end))
    }

    /// Whether a texture image is one of the original's.
    fn is_shown(&self, image: ImageId) -> bool {
        image != ImageId::NONE && !self.sources[image].is_empty()
    }

    /// Whether the original shows a texture image more than once.
    fn is_repeated(&self, image: ImageId) -> bool {
        self.repeated[image]
    }

    /// Positions of texels on the original; `None` for texels that lie in none of its charts, or in several.
    fn places(&self, texels: &[Texel], progress: &dyn Progress) -> Result<Vec<Option<DVec3>>> {
        let side = if self.original.images.files.len() > MANY_IMAGES { GRID_SIDE_OF_MANY } else { GRID_SIDE };
        let image_of = |texel: usize| texels[texel].0;
        let is_asked = |image: ImageId| self.is_shown(image) && !self.is_repeated(image);
        let mut asked: Vec<usize> = (0..texels.len()).filter(|&texel| is_asked(image_of(texel))).collect();
        asked.sort_unstable_by_key(|&texel| (image_of(texel), texel));
        let groups: Vec<&[usize]> = asked.chunk_by(|&a, &b| image_of(a) == image_of(b)).collect();
        progress.begin("slides", groups.len() as u64, "images");
        let mut found = vec![None; texels.len()];
        let place_in = |texel: usize| texel_of(texels[texel].1, side);
        let threads = self.resources.threads;
        map_in_order(
            groups.iter(),
            threads,
            threads + 1,
            |group| {
                let mut charts = Charts::new(group.iter().map(|&texel| place_in(texel)).collect(), side);
                charts.draw(self.original, &self.sources[image_of(group[0])])?;
                Ok((*group, charts))
            },
            |(group, charts)| {
                progress.advance(1);
                progress.check_stopped()?;
                group.iter().for_each(|&texel| found[texel] = charts.place(place_in(texel)));
                Ok(())
            },
        )?;
        Ok(found)
    }
}

/// Side of a square with as many pixels as each texture image has; `None` if the file is no image.
fn sizes(images: &TextureImages) -> TiVec<ImageId, Option<f64>> {
    let size = |(width, height): (u32, u32)| (f64::from(width) * f64::from(height)).sqrt();
    images.files.iter().map(|file| image::image_dimensions(&file.path).ok().map(size)).collect()
}

/// Number of the grid's texel that contains a texture coordinate between 0 and 1.
fn texel_of(texcoord: [f32; 2], side: usize) -> u32 {
    let [x, y] = texcoord.map(|at| ((f64::from(at) * side as f64) as usize).min(side - 1));
    (y * side + x) as u32
}

/// Positions on a mesh of some texels of a texture image.
struct Charts {
    /// The texels that are asked for, ascending.
    texels: Vec<u32>,
    /// Where the texels of each row begin.
    rows: Vec<u32>,
    places: Vec<Option<DVec3>>,
    side: usize,
}

impl Charts {
    fn new(mut texels: Vec<u32>, side: usize) -> Self {
        texels.sort_unstable();
        texels.dedup();
        let row = |row: usize| texels.partition_point(|&texel| (texel as usize) < row * side) as u32;
        let rows = (0..=side).map(row).collect();
        let places = vec![None; texels.len()];
        Self { texels, rows, places, side }
    }

    /// Position of a texel.
    fn place(&self, texel: u32) -> Option<DVec3> {
        let at = self.texels.binary_search(&texel).ok()?;
        self.places[at]
    }

    /// Draws the triangles of a mesh that show one of some texture images (ascending).
    fn draw(&mut self, mesh: &MeasuredMesh, images: &[ImageId]) -> Result<()> {
        let is_shown = |image: &ImageId| images.binary_search(image).is_ok();
        for cell in mesh.surface.cells.iter().filter(|cell| cell.images.iter().any(|shown| is_shown(&shown.image))) {
            let view = cell.view()?;
            for face in 0..view.faces.len() as u32 {
                if is_shown(&view.faces[face as usize].image) {
                    self.draw_face(&view, face);
                }
            }
        }
        Ok(())
    }

    /// Draws a triangle at every repeat of its texture image.
    fn draw_face(&mut self, view: &CellView, face: u32) {
        let corners = view.triangle(face).map(|corner| corner + view.origin);
        let texcoords = view.faces[face as usize].texcoords.map(|uv| DVec2::new(f64::from(uv[0]), f64::from(uv[1])));
        let highest = texcoords[0].max(texcoords[1]).max(texcoords[2]);
        let repeats = highest.to_array().map(|most| (most.max(0.0) as usize + 1).min(REPEATS_MAX));
        for x in 0..repeats[0] {
            for y in 0..repeats[1] {
                let shift = DVec2::new(x as f64, y as f64);
                let texels = texcoords.map(|uv| (uv - shift) * self.side as f64 - 0.5);
                self.draw_triangle(texels, corners);
            }
        }
    }

    /// Draws a triangle whose corners lie at `[a, b, c]` in texels, counted from the centre of the first one.
    fn draw_triangle(&mut self, [a, b, c]: [DVec2; 3], corners: [DVec3; 3]) {
        let doubled_area = (b - a).perp_dot(c - a);
        if doubled_area.abs() < 1e-12 {
            return;
        }
        let last = self.side as f64 - 1.0;
        let low = (a.min(b).min(c) - OUTSIDE_TEXELS).ceil().max(DVec2::ZERO);
        let high = (a.max(b).max(c) + OUTSIDE_TEXELS).floor().min(DVec2::splat(last));
        if !(low.x <= high.x && low.y <= high.y) {
            return;
        }
        for y in low.y as usize..=high.y as usize {
            let row = self.rows[y] as usize..self.rows[y + 1] as usize;
            let first = (y * self.side + low.x as usize) as u32;
            let end = (y * self.side + high.x as usize) as u32;
            let skipped = self.texels[row.clone()].partition_point(|&texel| texel < first);
            for at in row.start + skipped..row.end {
                let texel = self.texels[at];
                if texel > end {
                    break;
                }
                let point = DVec2::new((texel as usize % self.side) as f64, y as f64);
                let at_b = (point - a).perp_dot(c - a) / doubled_area;
                let at_c = (b - a).perp_dot(point - a) / doubled_area;
                let weights = [1.0 - at_b - at_c, at_b, at_c];
                let least = weights.into_iter().fold(f64::INFINITY, f64::min);
                // The inside of a triangle overwrites the margin of another one; of two insides the later one wins.
                if least >= 0.0 || least >= -OUTSIDE_WEIGHT && self.places[at].is_none() {
                    let place = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
                    self.places[at] = Some(place);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_texel_is_found_on_the_triangle_that_covers_it() {
        // a square of ten by ten units with the left half of the image
        let (side, corner) = (64, |x: f64, y: f64| DVec3::new(x, y, 3.0));
        let texels = (0..64 * 64).collect();
        let mut charts = Charts::new(texels, side);
        let at = |u: f64, v: f64| DVec2::new(u, v) * side as f64 - 0.5;
        charts.draw_triangle(
            [at(0.0, 0.0), at(0.5, 0.0), at(0.5, 1.0)],
            [corner(0.0, 0.0), corner(10.0, 0.0), corner(10.0, 10.0)],
        );
        charts.draw_triangle(
            [at(0.0, 0.0), at(0.5, 1.0), at(0.0, 1.0)],
            [corner(0.0, 0.0), corner(10.0, 10.0), corner(0.0, 10.0)],
        );
        for (texcoord, expected) in
            [([0.26, 0.51], corner(5.15625, 5.078125)), ([0.01, 0.99], corner(0.15625, 9.921875))]
        {
            let place = charts.place(texel_of(texcoord, side)).unwrap();
            assert!(place.distance(expected) < 1e-9, "{place}");
        }
        assert!(charts.place(texel_of([0.75, 0.5], side)).is_none());
    }
}

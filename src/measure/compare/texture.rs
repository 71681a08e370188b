//! How the picture on the surface changed: colours at points and at their closest points, and how far it slid.
//!
//! ```text
//!   result    ----p----        p shows the texel t; t lies at s on the original, and p's closest point is c:
//!                 |            the picture slid from s to c
//!   original  --s-c-----       colours at p and at c are compared as well
//! ```
//! In: pairs of points. Out: [`Texture`]. Invariant: a picture is decoded once for each window of pairs, and pairs are
//! summed in their order, so nothing depends on the budget but images that do not fit it.
//!
//! Slides are measured between texels of a grid, [`GRID_SIDE`] on each side of an image, so that one of up to a texel's
//! size is found on a picture that did not move.
//!
//! # Memory
//! 120 bytes for each pair of a window, at most a quarter of the budget; the images in work.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DVec2, DVec3};

use super::Resources;
use super::cells::{CellView, MeasuredMesh};
use super::colour;
use super::direction::TexturePair;
use super::distribution::Distribution;
use super::pictures::{Content, NO_PICTURE, Pictures};
use crate::base::error::escape_path;
use crate::base::ordered::map_in_order;
use crate::base::{Findings, Permits, Progress, Result};
use crate::store::Column;

/// Texels of the grid along each side of an image, on which slides are measured.
const GRID_SIDE: usize = 2048;
/// The same if there are more than [`MANY_PICTURES`].
const GRID_SIDE_OF_MANY: usize = 1024;
/// Pictures from which on each has a coarser grid.
const MANY_PICTURES: usize = 40;
/// A texel whose middle lies outside of a chart still shows it if it lies this near, in weights of a triangle's corners
const OUTSIDE_WEIGHT: f64 = 0.3;
/// and within this many texels of the triangle's box.
const OUTSIDE_TEXELS: f64 = 0.6;
/// Times that a triangle's picture may repeat across it, along each axis, to be looked for.
const REPEATS_MAX: usize = 4;
/// Largest difference of colours.
const COLOUR_MAX: f64 = 255.0;
/// Memory of a pair while its window is in work, in bytes.
const PAIR_BYTES: u64 = 120;

/// Differences of colour in one direction, and images that were read for them.
#[derive(Debug)]
pub struct Colours {
    /// Differences, mean over the channels.
    pub differences: Distribution,
    /// Images that were read.
    pub images: u64,
    /// Those that were read at a lower resolution.
    pub reduced: u64,
}

/// Slides of the points of a result.
#[derive(Debug)]
pub struct Slides {
    /// In the mesh's unit of length.
    pub lengths: Distribution,
    /// In texels of the original's images.
    pub texels: Distribution,
    /// Points that show a picture of the original.
    pub textured: u64,
    /// Those that show none of its charts.
    pub outside: u64,
    /// All points.
    pub points: u64,
}

/// Ranges of pairs that are in work together.
fn windows(pairs: &Column<TexturePair>, resources: &Resources) -> impl Iterator<Item = std::ops::Range<u64>> + use<> {
    pairs.ranges((resources.work_bytes / 4 / PAIR_BYTES).max(1024))
}

/// Compares colours at pairs of points of two meshes.
///
/// # Errors
/// On failed reads; images that cannot be decoded are noted.
pub fn compare_colours(
    pairs: &Column<TexturePair>,
    own: &Pictures,
    other: &Pictures,
    resources: &Resources,
    findings: &mut Findings,
    progress: &dyn Progress,
) -> Result<Colours> {
    let images = Images::new(own, other);
    let allowed = resources.work_bytes / 4 * 3;
    let permits = Permits::new(allowed);
    let mut found = Colours { differences: Distribution::new(COLOUR_MAX), images: 0, reduced: 0 };
    for range in windows(pairs, resources) {
        let window = pairs.window(range)?;
        // Image, then pair and side, of every colour that is asked for.
        let mut questions: Vec<(u32, u32)> = Vec::with_capacity(2 * window.len());
        for (pair, number) in window.iter().zip(0u32..) {
            if pair.picture != NO_PICTURE && pair.other_picture != NO_PICTURE {
                questions.push((images.of_own[pair.picture as usize], 2 * number));
                questions.push((images.of_other[pair.other_picture as usize], 2 * number + 1));
            }
        }
        questions.sort_unstable();
        let groups: Vec<&[(u32, u32)]> = questions.chunk_by(|a, b| a.0 == b.0).collect();
        progress.begin("colours", groups.len() as u64, "images");
        let mut colours = vec![[f32::NAN; 3]; 2 * window.len()];
        map_in_order(
            groups.iter(),
            resources.threads,
            resources.threads + 1,
            |group| {
                let path = images.paths[group[0].0 as usize];
                let decoded = colour::plan(path, allowed).and_then(|plan| {
                    let _permit = permits.take(plan.bytes);
                    let image = colour::decode(path, &plan)?;
                    let texcoord = |question: u32| {
                        let pair = &window[question as usize / 2];
                        if question.is_multiple_of(2) { pair.texcoord } else { pair.other_texcoord }
                    };
                    Ok((plan.reduction, group.iter().map(|&(_, q)| image.colour(texcoord(q))).collect::<Vec<_>>()))
                });
                Ok((*group, decoded))
            },
            |(group, decoded)| {
                progress.advance(1);
                match decoded {
                    Ok((reduction, found_colours)) => {
                        found.images += 1;
                        if reduction > 1 {
                            found.reduced += 1;
                            let path = escape_path(images.paths[group[0].0 as usize]);
                            findings.note("reduced_picture", || format!("{path}: read at 1/{reduction} of its size"));
                        }
                        group.iter().zip(found_colours).for_each(|(&(_, q), c)| colours[q as usize] = c);
                    }
                    Err(why) => findings.note("unreadable_picture", || {
                        format!("{}: {why}", escape_path(images.paths[group[0].0 as usize]))
                    }),
                }
                Ok(())
            },
        )?;
        for pair in colours.chunks_exact(2) {
            let difference = (0..3).map(|c| f64::from((pair[0][c] - pair[1][c]).abs())).sum::<f64>() / 3.0;
            if difference.is_finite() {
                found.differences.add(difference);
            }
        }
    }
    Ok(found)
}

/// The images of two meshes, those of equal content once.
struct Images<'a> {
    paths: Vec<&'a Path>,
    of_own: Vec<u32>,
    of_other: Vec<u32>,
}

impl<'a> Images<'a> {
    fn new(own: &'a Pictures, other: &'a Pictures) -> Self {
        let mut known: BTreeMap<Content, u32> = BTreeMap::new();
        let mut paths: Vec<&'a Path> = Vec::new();
        let mut numbers = |pictures: &'a Pictures| {
            let mut number = |path: &'a Path| {
                let next = paths.len() as u32;
                let number = Content::of(path).map_or(next, |content| *known.entry(content).or_insert(next));
                if number == next {
                    paths.push(path);
                }
                number
            };
            pictures.files.iter().map(|file| number(&file.path)).collect()
        };
        let (of_own, of_other) = (numbers(own), numbers(other));
        Self { paths, of_own, of_other }
    }
}

/// Measures how far the picture slid at points of the result, whose closest points lie on the original.
///
/// # Errors
/// On failed reads.
pub fn measure_slides(
    pairs: &Column<TexturePair>,
    result: &MeasuredMesh,
    original: &MeasuredMesh,
    limit: f64,
    resources: &Resources,
    progress: &dyn Progress,
) -> Result<Slides> {
    let sources = result.pictures.sources(&original.pictures);
    let sizes: Vec<Option<[u32; 2]>> =
        original.pictures.files.iter().map(|file| image::image_dimensions(&file.path).ok().map(Into::into)).collect();
    let side = if original.pictures.files.len() > MANY_PICTURES { GRID_SIDE_OF_MANY } else { GRID_SIDE };
    let mut slides = Slides {
        lengths: Distribution::new(limit),
        texels: Distribution::new(1e6),
        textured: 0,
        outside: 0,
        points: pairs.len(),
    };
    for range in windows(pairs, resources) {
        let window = pairs.window(range)?;
        let is_asked = |pair: &TexturePair| pair.picture != NO_PICTURE && !sources[pair.picture as usize].is_empty();
        let mut asked: Vec<(u32, u32)> = window
            .iter()
            .zip(0u32..)
            .filter(|(pair, _)| is_asked(pair))
            .map(|(pair, number)| (pair.picture, number))
            .collect();
        asked.sort_unstable();
        slides.textured += asked.len() as u64;
        let groups: Vec<&[(u32, u32)]> = asked.chunk_by(|a, b| a.0 == b.0).collect();
        progress.begin("slides", groups.len() as u64, "images");
        let mut found = vec![None; window.len()];
        map_in_order(
            groups.iter(),
            resources.threads,
            resources.threads + 1,
            |group| {
                let texels =
                    group.iter().map(|&(_, number)| texel_of(window[number as usize].texcoord, side)).collect();
                let mut charts = Charts::new(texels, side);
                charts.draw(original, &sources[group[0].0 as usize])?;
                Ok((*group, charts))
            },
            |(group, charts)| {
                progress.advance(1);
                for &(_, number) in group {
                    found[number as usize] = charts.place(texel_of(window[number as usize].texcoord, side));
                }
                Ok(())
            },
        )?;
        for (pair, place) in window.iter().zip(found).filter(|(pair, _)| is_asked(pair)) {
            let Some(place) = place else {
                slides.outside += 1;
                continue;
            };
            let length = DVec3::from(pair.closest).distance(place);
            slides.lengths.add(length);
            if let Some([width, height]) = sizes.get(pair.other_picture as usize).copied().flatten() {
                let side = (f64::from(width) * f64::from(height)).sqrt();
                slides.texels.add(length * f64::from(pair.other_density) * side);
            }
        }
    }
    Ok(slides)
}

/// Number of the texel of a grid that a texture coordinate between 0 and 1 lies in.
fn texel_of(texcoord: [f32; 2], side: usize) -> u32 {
    let [x, y] = texcoord.map(|at| ((f64::from(at) * side as f64) as usize).min(side - 1));
    (y * side + x) as u32
}

/// Where some texels of a picture lie on a mesh.
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

    /// Where a texel lies.
    fn place(&self, texel: u32) -> Option<DVec3> {
        let at = self.texels.binary_search(&texel).ok()?;
        self.places[at]
    }

    /// Draws the triangles of a mesh that show one of some pictures (ascending).
    fn draw(&mut self, mesh: &MeasuredMesh, pictures: &[u32]) -> Result<()> {
        let is_shown = |picture: &u32| pictures.binary_search(picture).is_ok();
        for cell in mesh.cells.iter().filter(|cell| cell.pictures.iter().any(is_shown)) {
            let view = cell.view()?;
            for face in 0..view.faces.len() as u32 {
                if is_shown(&view.faces[face as usize].picture) {
                    self.draw_face(&view, face);
                }
            }
        }
        Ok(())
    }

    /// Draws a triangle wherever its picture repeats.
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

    /// Draws a triangle whose corners lie at `[a, b, c]` in texels, counted from the middle of the first one.
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
                // The inside of a triangle hides what lies near another one; of two insides the later one is seen.
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
        // a square of ten by ten units with the left half of the picture
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

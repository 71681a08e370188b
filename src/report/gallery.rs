//! Renderings of a mesh from fixed viewpoints, as `data:` addresses for the page.
//!
//! ```text
//! triangles ──▶ canvases, as many as fit ──▶ which image each pixel shows
//!                                                │  images one after the other, each decoded once a round
//!                                                ▼
//!                                             pixels ──▶ JPEG
//! ```
//! In: a mesh, block by block; untrusted images. Out: renderings, and warnings about images that cannot be read.
//! Invariant: the renderings depend on the mesh and its images; they depend on the memory budget only where an image
//! has to be reduced to fit.
//!
//! # Memory
//! A canvas of [`SIZE`] with 2 × 2 samples a pixel takes 59 MiB with its lists; as many as fit three fifths of the
//! memory are drawn in one round, at least one. Images get the rest.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use glam::DVec3;

use super::scene::{DrawResources, Scene};
use crate::base::error::escape_path;
use crate::base::ordered::map_in_order;
use crate::base::{Findings, Permits, Result};
use crate::image::decode::{self, Image};
use crate::image::textures::TextureImage;
use crate::measure::compare::{FarPoint, Onlooker};
use crate::render::canvas::SeenPixel;
use crate::render::encode;
use crate::render::view::ProjectedExtent;
use crate::render::{Canvas, Frame, Paint, View};

/// Width and height of a rendering in pixels.
pub const SIZE: [usize; 2] = [960, 640];
/// Samples of a pixel along each side.
const SAMPLES: usize = 2;
/// Bytes of a sample: the canvas, and an index in the list of samples that show one image.
const SAMPLE_BYTES: u64 = Canvas::PIXEL_BYTES + 4;
/// Bytes of a finished pixel: sums of its samples, its colour, its share of the file.
const PIXEL_BYTES: u64 = 12 + 3 + 3;
/// Bytes of a canvas and of the rendering made from it.
const CANVAS_BYTES: u64 = (SIZE[0] * SIZE[1]) as u64 * ((SAMPLES * SAMPLES) as u64 * SAMPLE_BYTES + PIXEL_BYTES);
/// Bytes of a cell of the mesh, or of a few images.
const CELL_BYTES: u64 = 32 << 20;
/// Maximum number of texels of an image that are averaged for one sample, along each side.
const TAPS_MAX: usize = 4;
/// A neighbouring sample farther away in the image than this lies on another chart.
const CHART_STEP: f32 = 0.1;
/// Light on an image: photographs contain their own light.
const PHOTO_LIGHT: [f32; 2] = [0.72, 0.34];
/// Light on plain colours.
const PLAIN_LIGHT: [f32; 2] = [0.12, 0.92];
const BACKGROUND: [f32; 3] = [226.0, 230.0, 235.0];
const EDGE_COLOUR: [f32; 3] = [22.0, 26.0, 40.0];
const EDGE_SHARE: f32 = 0.62;
/// Colour of a surface whose image cannot be read.
const UNREAD: [f32; 3] = [206.0, 203.0, 196.0];
/// A point is seen in a pixel if it lies within this many pixels' depth of the nearest surface there.
const SURFACE_DEPTH: f32 = 1.5;

/// A viewpoint.
#[derive(Debug, Clone, Copy)]
pub struct Vantage {
    /// Name shown on the page.
    pub name: &'static str,
    turn: f64,
    tilt: f64,
    zoom: f64,
    /// Whether edges of triangles are drawn.
    pub with_edges: bool,
}

/// The viewpoints, in the order of the page.
pub const VANTAGES: [Vantage; 4] = [
    Vantage { name: "from the south-west", turn: -35.0, tilt: 36.0, zoom: 1.0, with_edges: false },
    Vantage { name: "from the north-east", turn: 145.0, tilt: 36.0, zoom: 1.0, with_edges: false },
    Vantage { name: "from above", turn: 0.0, tilt: 90.0, zoom: 1.0, with_edges: false },
    Vantage { name: "the middle, enlarged", turn: -35.0, tilt: 44.0, zoom: 7.0, with_edges: true },
];

/// Views from which a mesh is drawn: the same for an original and its result.
#[derive(Debug, Clone)]
pub struct Viewpoints {
    frame: Frame,
    views: Vec<View>,
}

impl Viewpoints {
    /// Views of a mesh that fill the renderings; `None` if it has no extent.
    ///
    /// # Errors
    /// If the job is to stop; on failed reads.
    pub fn of(scene: &dyn Scene) -> Result<Option<Self>> {
        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (mut sum, mut count) = (DVec3::ZERO, 0.0);
        scene.positions(&mut |positions| {
            (low, high) = positions.iter().fold((low, high), |(low, high), &p| (low.min(p), high.max(p)));
            sum += positions.iter().sum::<DVec3>();
            count += positions.len() as f64;
        })?;
        let Some(frame) = Frame::new(low, high) else { return Ok(None) };
        let size = SIZE.map(|side| side * SAMPLES);
        let mut views: Vec<View> = VANTAGES.iter().map(|place| frame.view(place.turn, place.tilt, size)).collect();
        let middle = sum / count;
        let mut nearest = (f64::INFINITY, middle);
        let mut extents = vec![ProjectedExtent::default(); views.len()];
        scene.positions(&mut |positions| {
            for &position in positions {
                extents.iter_mut().zip(&views).for_each(|(extent, view)| extent.add(view.project(position)));
                let distance_sq = position.distance_squared(middle);
                if distance_sq < nearest.0 {
                    nearest = (distance_sq, position);
                }
            }
        })?;
        for ((view, extent), place) in views.iter_mut().zip(extents).zip(&VANTAGES) {
            view.fit(&extent);
            if place.zoom > 1.0 {
                view.enlarge(nearest.1, place.zoom);
            }
        }
        Ok(Some(Self { frame, views }))
    }

    /// View straight down, for renderings of another size.
    pub fn map(&self, size: [usize; 2]) -> View {
        self.frame.view(0.0, 90.0, size)
    }
}

/// A rendering from one of [`VANTAGES`].
#[derive(Debug)]
pub struct Shot {
    /// `data:` address of the rendering.
    pub address: String,
    /// Data to colour the surface by error, if that was asked for.
    pub relief: Option<Relief>,
}

/// Draws a mesh from all viewpoints.
///
/// # Errors
/// If the job is to stop; on a full disk, failed reads and writes.
pub fn draw(
    scene: &dyn Scene,
    from: &Viewpoints,
    with_relief: bool,
    resources: &DrawResources,
    findings: &mut Findings,
) -> Result<Vec<Shot>> {
    let at_once = canvases_at_once(resources.work_bytes);
    let mut shots = Vec::with_capacity(VANTAGES.len());
    for (places, views) in VANTAGES.chunks(at_once).zip(from.views.chunks(at_once)) {
        let canvas = |(place, view): (&Vantage, &View)| Canvas::new(*view, place.with_edges);
        let mut canvases: Vec<Canvas> = places.iter().zip(views).map(canvas).collect();
        let work_bytes = resources.work_bytes.saturating_sub(CANVAS_BYTES * canvases.len() as u64);
        let left = DrawResources { work_bytes, ..*resources };
        scene.triangles(&left, &mut |triangle| canvases.iter_mut().for_each(|canvas| canvas.draw(triangle)))?;
        let developed = develop(&canvases, &scene.images().files.raw, &left, findings)?;
        shots.extend(
            developed
                .into_iter()
                .zip(&canvases)
                .map(|(address, canvas)| Shot { address, relief: with_relief.then(|| Relief::new(canvas)) }),
        );
    }
    Ok(shots)
}

/// Number of canvases that are drawn in one round.
fn canvases_at_once(work_bytes: u64) -> usize {
    (work_bytes * 3 / 5 / CANVAS_BYTES).clamp(1, VANTAGES.len() as u64) as usize
}

/// Memory that drawing takes, in bytes, if no image is larger than a cell of the mesh.
pub fn peak_bytes(work_bytes: u64) -> u64 {
    (CANVAS_BYTES * canvases_at_once(work_bytes) as u64 + CELL_BYTES).min(work_bytes)
}

/// Computes the colours of canvases.
fn develop(
    canvases: &[Canvas],
    files: &[TextureImage],
    resources: &DrawResources,
    findings: &mut Findings,
) -> Result<Vec<String>> {
    let mut films: Vec<Film> = canvases.iter().map(Film::new).collect();
    let lists: Vec<PixelLists> = canvases.iter().map(|canvas| PixelLists::new(canvas, files.len())).collect();
    let shown = (0..files.len()).filter(|&number| lists.iter().any(|list| !list.of(number).is_empty()));
    let permits = Permits::new(resources.work_bytes);
    let colour_image = |number: usize| {
        let path = &files[number].path;
        let plan = decode::plan(path, resources.work_bytes);
        let _permit = plan.as_ref().ok().map(|plan| permits.take(plan.bytes));
        let image = plan.and_then(|plan| decode::decode(path, &plan));
        let colours = |(canvas, list): (&Canvas, &PixelLists)| -> Vec<[f32; 3]> {
            let pixels = list.of(number).iter().map(|&pixel| pixel as usize);
            let seen = pixels.filter_map(|pixel| Some((pixel, canvas.seen(pixel)?)));
            seen.map(|(pixel, seen)| match &image {
                Ok(image) => lit(image_colour(canvas, pixel, &seen, image), &seen, PHOTO_LIGHT),
                Err(_) => lit(UNREAD, &seen, PLAIN_LIGHT),
            })
            .collect()
        };
        let colours: Vec<_> = canvases.iter().zip(&lists).map(colours).collect();
        Ok((number, colours, image.err()))
    };
    map_in_order(shown, resources.threads, resources.threads, colour_image, |(number, colours, fault)| {
        if let Some(why) = fault {
            findings.note("unreadable_image", || format!("{}: {why}", escape_path(&files[number].path)));
        }
        for ((film, list), colours) in films.iter_mut().zip(&lists).zip(colours) {
            list.of(number).iter().zip(colours).for_each(|(&pixel, colour)| film.add(pixel as usize, colour));
        }
        Ok(())
    })?;
    Ok(films.into_iter().map(Film::finish).collect())
}

/// Which samples of a canvas show which image.
struct PixelLists {
    starts: Vec<usize>,
    pixels: Vec<u32>,
}

impl PixelLists {
    fn new(canvas: &Canvas, images: usize) -> Self {
        let count = canvas.view.size[0] * canvas.view.size[1];
        let shown = |pixel: usize| match canvas.seen(pixel)?.paint {
            Paint::Image(number) if (number as usize) < images => Some(number as usize),
            _ => None,
        };
        let mut starts = vec![0; images + 1];
        (0..count).filter_map(shown).for_each(|number| starts[number + 1] += 1);
        (0..images).for_each(|number| starts[number + 1] += starts[number]);
        let (mut next, mut pixels) = (starts.clone(), vec![0; starts[images]]);
        for pixel in 0..count {
            if let Some(number) = shown(pixel) {
                pixels[next[number]] = pixel as u32;
                next[number] += 1;
            }
        }
        Self { starts, pixels }
    }

    fn of(&self, number: usize) -> &[u32] {
        &self.pixels[self.starts[number]..self.starts[number + 1]]
    }
}

/// Mean colour of the part of an image that a sample covers.
fn image_colour(canvas: &Canvas, pixel: usize, seen: &SeenPixel, image: &Image) -> [f32; 3] {
    let width = canvas.view.size[0];
    let step = |neighbour: Option<usize>| -> Option<[f32; 2]> {
        let other = canvas.seen(neighbour?)?;
        let step = [0, 1].map(|axis| other.texcoord[axis] - seen.texcoord[axis]);
        (other.paint == seen.paint && step.iter().all(|s| s.abs() < CHART_STEP)).then_some(step)
    };
    let (column, count) = (pixel % width, width * canvas.view.size[1]);
    let right = step((column + 1 < width).then_some(pixel + 1)).or_else(|| step((column > 0).then(|| pixel - 1)));
    let below = step((pixel + width < count).then_some(pixel + width)).or_else(|| step(pixel.checked_sub(width)));
    let (right, below) = (right.unwrap_or_default(), below.unwrap_or_default());
    let [texels_wide, texels_high] = image.size();
    let texels = |step: [f32; 2]| (step[0] * texels_wide as f32).abs().max((step[1] * texels_high as f32).abs());
    let taps = (texels(right).max(texels(below)).ceil() as usize).clamp(1, TAPS_MAX);
    if taps == 1 {
        return image.colour(seen.texcoord.map(wrapped));
    }
    let mut sum = [0.0; 3];
    for tap in 0..taps * taps {
        let part = |place: usize| (place as f32 + 0.5) / taps as f32 - 0.5;
        let (along, down) = (part(tap % taps), part(tap / taps));
        let texcoord = [0, 1].map(|axis| wrapped(seen.texcoord[axis] + along * right[axis] + down * below[axis]));
        let pixel = image.pixel(texcoord);
        (0..3).for_each(|channel| sum[channel] += f32::from(pixel[channel]));
    }
    sum.map(|channel| channel / (taps * taps) as f32)
}

/// Wraps a texture coordinate: images repeat.
fn wrapped(coordinate: f32) -> f32 {
    if (0.0..=1.0).contains(&coordinate) { coordinate } else { coordinate.rem_euclid(1.0) }
}

fn lit(colour: [f32; 3], seen: &SeenPixel, [base, slope]: [f32; 2]) -> [f32; 3] {
    let light = base + slope * seen.light;
    let share = if seen.is_edge { EDGE_SHARE } else { 0.0 };
    [0, 1, 2].map(|c| (1.0 - share) * (colour[c] * light).min(255.0) + share * EDGE_COLOUR[c])
}

/// Sums of the samples of each pixel.
struct Film {
    width: usize,
    sums: Vec<[f32; 3]>,
}

impl Film {
    /// Starts with the background and the plain colours of a canvas.
    fn new(canvas: &Canvas) -> Self {
        let [width, height] = canvas.view.size;
        let mut film = Self { width, sums: vec![[0.0; 3]; width * height / (SAMPLES * SAMPLES)] };
        for pixel in 0..width * height {
            match canvas.seen(pixel) {
                None => film.add(pixel, BACKGROUND),
                Some(seen @ SeenPixel { paint: Paint::Colour(colour), .. }) => {
                    film.add(pixel, lit(colour.map(f32::from), &seen, PLAIN_LIGHT));
                }
                Some(_) => {}
            }
        }
        film
    }

    fn add(&mut self, pixel: usize, colour: [f32; 3]) {
        let at = reduced(pixel, self.width);
        (0..3).for_each(|channel| self.sums[at][channel] += colour[channel]);
    }

    fn finish(self) -> String {
        let mean = |sum: [f32; 3]| sum.map(|channel| (channel / (SAMPLES * SAMPLES) as f32).round() as u8);
        let pixels: Vec<u8> = self.sums.into_iter().flat_map(mean).collect();
        jpeg_address(&pixels)
    }
}

/// Pixel of the rendering that a sample belongs to.
fn reduced(sample: usize, width: usize) -> usize {
    let (column, row) = (sample % width / SAMPLES, sample / width / SAMPLES);
    row * (width / SAMPLES) + column
}

fn jpeg_address(pixels: &[u8]) -> String {
    jpeg_file_address(&encode::jpeg(pixels, SIZE).unwrap_or_default())
}

/// `data:` address of a JPEG.
pub fn jpeg_file_address(file: &[u8]) -> String {
    format!("data:image/jpeg;base64,{}", STANDARD.encode(file))
}

/// `data:` address of a PNG.
pub fn png_address(file: &[u8]) -> String {
    format!("data:image/png;base64,{}", STANDARD.encode(file))
}

/// The surface in a rendering, to be coloured by errors.
#[derive(Debug)]
pub struct Relief {
    view: View,
    /// Nearness of each pixel, negative infinity without surface.
    near: Vec<f32>,
    light: Vec<f32>,
    /// Sum and number of errors.
    errors: Vec<(f32, u32)>,
}

/// The surfaces of the renderings collect the errors that a comparison finds.
impl Onlooker for Vec<Shot> {
    fn see_point(&mut self, place: &FarPoint) {
        let reliefs = self.iter_mut().filter_map(|shot| shot.relief.as_mut());
        reliefs.for_each(|relief| relief.add(DVec3::from_array(place.position), place.distance));
    }
}

impl Relief {
    /// Bytes of the surfaces of all renderings.
    pub const BYTES: u64 = (SIZE[0] * SIZE[1] * VANTAGES.len()) as u64 * 16;

    fn new(canvas: &Canvas) -> Self {
        let [width, height] = canvas.view.size;
        let count = width * height / (SAMPLES * SAMPLES);
        let (mut near, mut light) = (vec![f32::NEG_INFINITY; count], vec![0.0; count]);
        for sample in 0..width * height {
            if let Some(seen) = canvas.seen(sample) {
                let at = reduced(sample, width);
                let nearness = canvas.near(sample) / SAMPLES as f32;
                if nearness > near[at] {
                    (near[at], light[at]) = (nearness, seen.light);
                }
            }
        }
        Self { view: canvas.view.reduced(SAMPLES), near, light, errors: vec![(0.0, 0); count] }
    }

    /// Adds the error at a point of the surface, if it is seen.
    pub fn add(&mut self, position: DVec3, error: f64) {
        let [x, y, near] = self.view.project(position);
        let [width, height] = self.view.size;
        if !(x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64) {
            return;
        }
        let at = y as usize * width + x as usize;
        if near as f32 >= self.near[at] - SURFACE_DEPTH {
            self.errors[at].0 += error as f32;
            self.errors[at].1 += 1;
        }
    }

    /// The rendering as an address; the last colour of the scale stands for `most`.
    pub fn colour(&self, most: f64) -> String {
        let filled = fill(&self.errors, self.view.size);
        let mut pixels = Vec::with_capacity(3 * filled.len());
        for (at, error) in filled.into_iter().enumerate() {
            let colour = match error {
                _ if self.near[at] == f32::NEG_INFINITY => BACKGROUND,
                Some(error) => {
                    let light = 0.55 + 0.5 * self.light[at];
                    encode::heat(error / most as f32).map(|channel| (channel * light).min(255.0))
                }
                None => BACKGROUND.map(|channel| channel * 0.8),
            };
            pixels.extend(colour.map(|channel| channel.round() as u8));
        }
        jpeg_address(&pixels)
    }
}

/// Mean error of each pixel that has errors; for other pixels, the mean of the smallest surrounding squares that have
/// some.
fn fill(errors: &[(f32, u32)], size: [usize; 2]) -> Vec<Option<f32>> {
    let mean = |&(sum, count): &(f32, u32)| (count > 0).then(|| sum / count as f32);
    let [width, height] = size;
    if width <= 1 && height <= 1 {
        return errors.iter().map(mean).collect();
    }
    let half = [width.div_ceil(2), height.div_ceil(2)];
    let mut coarse = vec![(0.0, 0); half[0] * half[1]];
    for (at, &(sum, count)) in errors.iter().enumerate() {
        let square = &mut coarse[at / width / 2 * half[0] + at % width / 2];
        *square = (square.0 + sum, square.1 + count);
    }
    let around = fill(&coarse, half);
    let pixel = |(at, error)| mean(error).or_else(|| between(&around, half, [at % width, at / width]));
    errors.iter().enumerate().map(pixel).collect()
}

/// A pixel's mean of the squares of two by two pixels that are nearest to it.
fn between(squares: &[Option<f32>], [wide, high]: [usize; 2], [x, y]: [usize; 2]) -> Option<f32> {
    let neighbour = |place: usize, count: usize| {
        let own = place / 2;
        let other = if place.is_multiple_of(2) { own.saturating_sub(1) } else { (own + 1).min(count - 1) };
        [(own, 3.0), (other, 1.0)]
    };
    let (mut sum, mut weights) = (0.0, 0.0);
    for (column, across) in neighbour(x, wide) {
        for (row, down) in neighbour(y, high) {
            if let Some(error) = squares[row * wide + column] {
                sum += across * down * error;
                weights += across * down;
            }
        }
    }
    (weights > 0.0).then(|| sum / weights)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Triangle;

    #[test]
    fn gaps_are_filled_from_the_nearest_square() {
        // 1 . | . .
        // . 3 | . .
        let errors = [(1.0, 1), (0.0, 0), (0.0, 0), (0.0, 0), (0.0, 0), (6.0, 2), (0.0, 0), (0.0, 0)];
        let filled: Vec<f32> = fill(&errors, [4, 2]).into_iter().flatten().collect();
        let mean = 7.0 / 3.0;
        assert_eq!(filled, [1.0, mean, mean, mean, mean, 3.0, mean, mean]);
        assert_eq!(fill(&[(0.0, 0); 8], [4, 2]), [None; 8]);
    }

    #[test]
    fn images_repeat_and_keep_their_last_row() {
        assert_eq!([0.0, 1.0, 1.25, -0.25].map(wrapped), [0.0, 1.0, 0.25, 0.75]);
    }

    #[test]
    fn samples_of_a_pixel_meet() {
        let width = 4 * SAMPLES;
        assert_eq!([0, 1, width, width + 1].map(|sample| reduced(sample, width)), [0; 4]);
        assert_eq!(reduced(2 * width + 2, width), 4 + 1);
    }

    #[test]
    fn hidden_errors_leave_no_trace() {
        let frame = Frame::new(DVec3::ZERO, DVec3::new(10.0, 10.0, 10.0)).unwrap();
        let mut canvas = Canvas::new(frame.view(0.0, 90.0, [64, 64]), false);
        let corner = |x, z| DVec3::new(x, 10.0, z);
        let corners = [corner(-90.0, -90.0), corner(90.0, -90.0), corner(0.0, 90.0)];
        canvas.draw(&Triangle { corners, texcoords: [[0.0; 2]; 3], paint: Paint::Colour([9; 3]) });
        let mut relief = Relief::new(&canvas);
        relief.add(corner(5.0, 5.0), 1.0);
        relief.add(DVec3::new(5.0, 0.0, 5.0), 100.0);
        assert_eq!(relief.errors.iter().map(|error| error.0).sum::<f32>(), 1.0);
    }
}

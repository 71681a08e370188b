//! Pinholes: pixels of the result that show the background where the original is closed. An eye finds them before any
//! distance shows them.
//!
//! ```text
//!   original          result
//!   ██████████       ██████████
//!   ██████████       ████░█████    ░ background: see-through; or a surface far behind the original's: behind
//!   ██████████       ██████████
//! ```
//! Both meshes are rendered from 16 directions in parallel projection. Only pixels at least 5 pixels inside the
//! original's outline count, so an outline that moved is not a pinhole.
//!
//! # Memory
//! 8 MB for each view that is drawn at once, at least one, up to half of what there is; one cell's pages.

use glam::DVec3;
use rayon::prelude::*;

use super::cells::MeasuredMesh;
use crate::base::pool::{check_stopped, in_parallel};
use crate::base::{Progress, Result};
use crate::measure::figures::{Pinholes, WorstView};
use crate::render::view::View;
use crate::render::{Frame, encode, raster};

/// Number of directions around the vertical, and degrees above the horizon.
const TURNS: usize = 8;
const TILTS: [f64; 2] = [29.0, 63.0];
/// First direction in degrees; no view looks along a wall of a mesh that is aligned with its axes.
const FIRST_TURN: f64 = 11.5;
/// Width and height of a view in pixels.
const SIZE: [usize; 2] = [1000, 800];
/// Pixels count if they lie more than this many steps inside the outline.
const RIM: u16 = 4;
/// A surface lies behind the original's if it is farther away by more than this share of the diagonal.
const BEHIND_SHARE: f64 = 0.01;
/// Largest number of surfaces behind each other, on average over the pixels of a view, that are drawn.
const LAYERS_MAX: f64 = 128.0;
/// Memory of a view in bytes: two depths and a distance from the outline for each pixel.
const VIEW_BYTES: u64 = (SIZE[0] * SIZE[1]) as u64 * 10;
/// Steps around a pinhole that are coloured with it in the rendering.
const MARK: usize = 2;
const SEE_THROUGH_COLOUR: [u8; 3] = [214, 32, 32];
const BEHIND_COLOUR: [u8; 3] = [236, 142, 20];
const BACKGROUND: [u8; 3] = [226, 230, 235];

/// Surfaces behind each other in a view of a mesh, on average over its pixels: from a direction by chance a surface
/// covers half its area (Cauchy).
fn layers(mesh: &MeasuredMesh, frame: &Frame) -> f64 {
    let scale = frame.view(FIRST_TURN, TILTS[0], SIZE).scale;
    0.5 * mesh.area * scale * scale / (SIZE[0] * SIZE[1]) as f64
}

/// Finds the pinholes of a result. `None` where there is nothing to see, or where surfaces of a mesh lie behind each
/// other by the hundred, which `warnings` then tell: drawing them would take far longer than all else.
///
/// # Errors
/// On failed reads.
pub fn find(
    before: &MeasuredMesh,
    after: &MeasuredMesh,
    work_bytes: u64,
    warnings: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Option<Pinholes>> {
    let Some(frame) = Frame::new(before.surface.bounds.low, before.surface.bounds.high) else { return Ok(None) };
    let most = layers(before, &frame).max(layers(after, &frame));
    if !most.is_finite() {
        return Ok(None);
    }
    if most > LAYERS_MAX {
        warnings.push(format!("no pinholes are looked for: on average {most:.0} surfaces lie behind each other"));
        return Ok(None);
    }
    let places: Vec<[f64; 2]> = TILTS
        .into_iter()
        .flat_map(|tilt| (0..TURNS).map(move |turn| [FIRST_TURN + 360.0 / TURNS as f64 * turn as f64, tilt]))
        .collect();
    let at_once = (work_bytes / 2 / VIEW_BYTES).clamp(1, places.len() as u64) as usize;
    let behind = BEHIND_SHARE * before.surface.bounds.diagonal();
    let (mut found, mut sums) = (Pinholes::default(), PixelCounts::default());
    progress.begin(
        "pinholes",
        (places.len().div_ceil(at_once) * (before.surface.cells.len() + after.surface.cells.len())) as u64,
        "cells",
    );
    for places in places.chunks(at_once) {
        let view = |&[turn, tilt]: &[f64; 2]| frame.view(turn, tilt, SIZE);
        let mut depths: [Vec<Depth>; 2] = [before, after].map(|_| places.iter().map(view).map(Depth::new).collect());
        for (mesh, depths) in [before, after].into_iter().zip(&mut depths) {
            draw(mesh, depths, progress)?;
        }
        let [before, after] = &depths;
        let seen: Vec<Seen> =
            in_parallel(|| before.par_iter().zip(after).map(|(old, new)| Seen::of(old, new, behind)).collect());
        for ((seen, depth), &[turn, tilt]) in seen.iter().zip(after).zip(places) {
            let counts = seen.counts();
            sums = sums.with(counts);
            if (counts.through + counts.behind) > 0
                && (counts.ppm(), counts.behind_ppm()) > (found.worst.ppm, found.worst.behind_ppm)
            {
                let rendering = seen.rendering(depth);
                found.worst = WorstView { turn, tilt, ppm: counts.ppm(), behind_ppm: counts.behind_ppm(), rendering };
            }
        }
    }
    (found.ppm, found.behind_ppm, found.pixels) = (sums.ppm(), sums.behind_ppm(), sums.inside);
    Ok(Some(found))
}

/// Nearness of a mesh in each pixel of a view; negative infinity where there is no surface.
struct Depth {
    view: View,
    near: Vec<f32>,
}

impl Depth {
    fn new(view: View) -> Self {
        Self { view, near: vec![f32::NEG_INFINITY; SIZE[0] * SIZE[1]] }
    }

    fn draw(&mut self, triangle: [DVec3; 3]) {
        let corners = triangle.map(|corner| self.view.project(corner));
        raster::each_pixel(&corners, SIZE, |pixel, near, _| self.near[pixel] = self.near[pixel].max(near as f32));
    }
}

fn draw(mesh: &MeasuredMesh, depths: &mut [Depth], progress: &dyn Progress) -> Result<()> {
    for cell in &mesh.surface.cells {
        progress.check_stopped()?;
        let view = cell.view()?;
        let triangles = 0..view.faces.len() as u32;
        let draw_all = |depth: &mut Depth| {
            triangles.clone().try_for_each(|face| {
                depth.draw(view.triangle(face).map(|corner| corner + view.origin));
                check_stopped()
            })
        };
        in_parallel(|| depths.par_iter_mut().try_for_each(draw_all))?;
        progress.advance(1);
    }
    Ok(())
}

/// Pixel counts.
#[derive(Debug, Clone, Copy, Default)]
struct PixelCounts {
    inside: u64,
    through: u64,
    behind: u64,
}

impl PixelCounts {
    fn with(self, other: Self) -> Self {
        Self {
            inside: self.inside + other.inside,
            through: self.through + other.through,
            behind: self.behind + other.behind,
        }
    }

    fn ppm(self) -> f64 {
        1e6 * self.through as f64 / self.inside.max(1) as f64
    }

    fn behind_ppm(self) -> f64 {
        1e6 * self.behind as f64 / self.inside.max(1) as f64
    }
}

/// What a pixel shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sight {
    /// Outside of the original's outline, or near it.
    Outside,
    Closed,
    Through,
    Behind,
}

struct Seen {
    sights: Vec<Sight>,
}

impl Seen {
    /// Compares a view of the original with the same view of the result; `behind` is a length.
    fn of(old: &Depth, new: &Depth, behind: f64) -> Self {
        let behind = (behind * old.view.scale) as f32;
        let sight = |(&steps, (&old, &new)): (&u16, (&f32, &f32))| match new {
            _ if steps <= RIM => Sight::Outside,
            f32::NEG_INFINITY => Sight::Through,
            new if old - new > behind => Sight::Behind,
            _ => Sight::Closed,
        };
        let steps = steps_inside(&old.near);
        Self { sights: steps.iter().zip(old.near.iter().zip(&new.near)).map(sight).collect() }
    }

    fn counts(&self) -> PixelCounts {
        let count = |wanted: Sight| self.sights.iter().filter(|&&sight| sight == wanted).count() as u64;
        let [closed, through, behind] = [Sight::Closed, Sight::Through, Sight::Behind].map(count);
        PixelCounts { inside: closed + through + behind, through, behind }
    }

    /// Rendering of the result, lit by its slopes, with marks.
    fn rendering(&self, depth: &Depth) -> Vec<u8> {
        let [width, height] = SIZE;
        let mut pixels: Vec<[u8; 3]> = (0..width * height).map(|at| shade(&depth.near, at)).collect();
        for (wanted, colour) in [(Sight::Behind, BEHIND_COLOUR), (Sight::Through, SEE_THROUGH_COLOUR)] {
            for at in (0..width * height).filter(|&at| self.sights[at] == wanted) {
                let (column, row) = (at % width, at / width);
                for y in row.saturating_sub(MARK)..(row + MARK + 1).min(height) {
                    let columns = column.saturating_sub(MARK)..(column + MARK + 1).min(width);
                    pixels[y * width..][columns].fill(colour);
                }
            }
        }
        encode::jpeg(pixels.as_flattened(), SIZE).unwrap_or_default()
    }
}

/// Colour of a pixel: brighter the more the surface faces the upper left.
fn shade(near: &[f32], at: usize) -> [u8; 3] {
    let width = SIZE[0];
    if near[at] == f32::NEG_INFINITY {
        return BACKGROUND;
    }
    let slope = |other: Option<&f32>| other.map_or(0.0, |other| near[at] - other).clamp(-4.0, 4.0);
    let right = slope(if at % width + 1 < width { near.get(at + 1) } else { None });
    let below = slope(near.get(at + width));
    // The normal is (right, below, 1), the light comes from (-1, -1, 2).
    let length = (right * right + below * below + 1.0).sqrt() * 6.0f32.sqrt();
    let light = ((2.0 - right - below) / length).clamp(0.0, 1.0);
    [(70.0 + 165.0 * light).round() as u8; 3]
}

/// For each pixel that shows a surface, the steps across pixels to the nearest one that does not, or that lies outside
/// of the rendering; at most [`RIM`] + 1.
fn steps_inside(near: &[f32]) -> Vec<u16> {
    let [width, height] = SIZE;
    let shows = |&near: &f32| if near == f32::NEG_INFINITY { 0 } else { RIM + 1 };
    let mut steps: Vec<u16> = near.iter().map(shows).collect();
    for at in 0..width * height {
        let left = if at % width > 0 { steps[at - 1] } else { 0 };
        let above = if at >= width { steps[at - width] } else { 0 };
        steps[at] = steps[at].min(left.min(above) + 1);
    }
    for at in (0..width * height).rev() {
        let right = if at % width + 1 < width { steps[at + 1] } else { 0 };
        let below = if at + width < width * height { steps[at + width] } else { 0 };
        steps[at] = steps[at].min(right.min(below) + 1);
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of the given size in the middle of a view from above, at a height, in pixels; without the squares in
    /// `holes`.
    fn sheet(half: f64, height: f64, holes: &[[f64; 3]]) -> Depth {
        let frame = Frame::new(DVec3::new(-500.0, -400.0, 0.0), DVec3::new(500.0, 400.0, 100.0)).unwrap();
        let mut view = frame.view(0.0, 90.0, SIZE);
        view.scale = 1.0;
        let mut depth = Depth::new(view);
        let [a, b, c, d] =
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| DVec3::new(half * x, half * y, height));
        depth.draw([a, b, c]);
        depth.draw([a, c, d]);
        for &[x, y, side] in holes {
            let at = |x: f64, y: f64| (400.0 - y) as usize * SIZE[0] + (500.0 + x) as usize;
            for row in 0..side as usize {
                depth.near[at(x, y) + row * SIZE[0]..][..side as usize].fill(f32::NEG_INFINITY);
            }
        }
        depth
    }

    #[test]
    fn pixels_count_from_four_steps_inside_the_outline_on() {
        let whole = sheet(50.0, 10.0, &[]);
        let counts = |result: &Depth| Seen::of(&whole, result, 5.0).counts();
        // 100 × 100 pixels, without four at each side.
        let found = counts(&whole);
        assert_eq!([found.inside, found.through, found.behind], [92 * 92, 0, 0]);
        let holed = counts(&sheet(50.0, 10.0, &[[0.0, 0.0, 3.0]]));
        assert_eq!([holed.inside, holed.through, holed.behind], [92 * 92, 9, 0]);
        // An outline that moved by three pixels is no hole.
        assert_eq!(counts(&sheet(47.0, 10.0, &[])).through, 0);
        assert!(counts(&sheet(45.0, 10.0, &[])).through > 0);
        // A hole of the original is no pinhole of the result.
        let holes = [[10.0, 10.0, 5.0]];
        let both = Seen::of(&sheet(50.0, 10.0, &holes), &sheet(50.0, 10.0, &holes), 5.0).counts();
        assert_eq!(both.through, 0);
        assert!(both.inside < 92 * 92 - 25);
    }

    #[test]
    fn a_surface_far_behind_is_told_apart() {
        let (whole, near, far) = (sheet(50.0, 10.0, &[]), sheet(50.0, 6.0, &[]), sheet(50.0, 4.0, &[]));
        assert_eq!(Seen::of(&whole, &near, 5.0).counts().behind, 0);
        assert_eq!(Seen::of(&whole, &far, 5.0).counts().behind, 92 * 92);
        assert_eq!(Seen::of(&far, &whole, 5.0).counts().behind, 0);
    }
}

//! What each pixel shows: nearness, paint, texture coordinate and light.
//!
//! Colours come later, one texture image at a time: the canvas knows which pixels show an image, so no two images have
//! to be in memory at once.

use glam::DVec3;

use super::raster;
use super::view::View;

/// Half the width of a drawn edge, in pixels.
const EDGE_HALF_WIDTH: f64 = 1.1;
/// Bit of `light` that marks an edge drawn over the pixel; the other bits hold the light.
const EDGE_BIT: u8 = 0x80;
const LIGHT_MAX: f64 = 127.0;

/// What a triangle shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Paint {
    /// A texture image, by its number.
    Image(u32),
    /// A colour: red, green, blue.
    Colour([u8; 3]),
}

/// A triangle to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangle {
    /// Positions of its corners.
    pub corners: [DVec3; 3],
    /// Texture coordinates of its corners; used if it shows an image.
    pub texcoords: [[f32; 2]; 3],
    /// What it shows.
    pub paint: Paint,
}

/// A pixel that shows something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenPixel {
    /// What it shows.
    pub paint: Paint,
    /// Texture coordinate in the image.
    pub texcoord: [f32; 2],
    /// Light, 0 to 1.
    pub light: f32,
    /// Whether an edge is drawn over it.
    pub is_edge: bool,
}

/// Buffers of a rendering in progress.
#[derive(Debug, Clone)]
pub struct Canvas {
    /// The projection.
    pub view: View,
    /// Whether edges of triangles are drawn.
    with_edges: bool,
    /// Nearness, in pixels; negative infinity if the pixel shows nothing.
    near: Vec<f32>,
    /// Number of an image, or a colour with [`COLOUR_BIT`] set.
    paint: Vec<u32>,
    texcoord: Vec<[f32; 2]>,
    light: Vec<u8>,
}

/// Bit of a stored paint that marks a colour.
const COLOUR_BIT: u32 = 1 << 31;

impl Canvas {
    /// Bytes of a pixel.
    pub const PIXEL_BYTES: u64 = 17;

    /// An empty canvas.
    pub fn new(view: View, with_edges: bool) -> Self {
        let count = view.size[0] * view.size[1];
        Self {
            view,
            with_edges,
            near: vec![f32::NEG_INFINITY; count],
            paint: vec![0; count],
            texcoord: vec![[0.0; 2]; count],
            light: vec![0; count],
        }
    }

    /// Draws a triangle where it is nearer than what was drawn before.
    pub fn draw(&mut self, triangle: &Triangle) {
        let corners = triangle.corners.map(|corner| self.view.project(corner));
        let [a, b, c] = triangle.corners;
        let mut light = None;
        let paint = match triangle.paint {
            Paint::Image(number) => number & !COLOUR_BIT,
            Paint::Colour([red, green, blue]) => COLOUR_BIT | u32::from_be_bytes([0, red, green, blue]),
        };
        let heights = if self.with_edges { heights(&corners) } else { [f64::INFINITY; 3] };
        let (view, size) = (&self.view, self.view.size);
        raster::each_pixel(&corners, size, |pixel, near, weights| {
            let near = near as f32;
            if near <= self.near[pixel] {
                return;
            }
            let light = *light.get_or_insert_with(|| (view.light((b - a).cross(c - a)) * LIGHT_MAX).round() as u8);
            let is_edge = (0..3).any(|k| weights[k] * heights[k] < EDGE_HALF_WIDTH);
            let mix = |axis: usize| {
                let sum: f64 = (0..3).map(|k| weights[k] * f64::from(triangle.texcoords[k][axis])).sum();
                sum as f32
            };
            self.near[pixel] = near;
            self.paint[pixel] = paint;
            self.texcoord[pixel] = [mix(0), mix(1)];
            self.light[pixel] = light.min(LIGHT_MAX as u8) | if is_edge { EDGE_BIT } else { 0 };
        });
    }

    /// What a pixel shows; `None` if it shows nothing.
    #[inline]
    pub fn seen(&self, pixel: usize) -> Option<SeenPixel> {
        if self.near[pixel] == f32::NEG_INFINITY {
            return None;
        }
        let paint = match self.paint[pixel] {
            colour if colour & COLOUR_BIT != 0 => {
                let [_, red, green, blue] = colour.to_be_bytes();
                Paint::Colour([red, green, blue])
            }
            number => Paint::Image(number),
        };
        let light = f32::from(self.light[pixel] & !EDGE_BIT) / LIGHT_MAX as f32;
        Some(SeenPixel { paint, texcoord: self.texcoord[pixel], light, is_edge: self.light[pixel] & EDGE_BIT != 0 })
    }

    /// Nearness of the surface in a pixel; negative infinity if there is none.
    #[inline]
    pub fn near(&self, pixel: usize) -> f32 {
        self.near[pixel]
    }
}

/// Heights of a projected triangle over its sides, in pixels; side k lies opposite corner k.
fn heights(corners: &[[f64; 3]; 3]) -> [f64; 3] {
    let [a, b, c] = corners;
    let area = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs();
    [[b, c], [c, a], [a, b]].map(|[p, q]| area / libm::hypot(p[0] - q[0], p[1] - q[1]).max(f64::MIN_POSITIVE))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Frame;

    fn canvas(with_edges: bool) -> Canvas {
        let frame = Frame::new(DVec3::ZERO, DVec3::new(8.0, 8.0, 1.0)).unwrap();
        let mut view = frame.view(0.0, 90.0, [16, 16]);
        view.scale = 2.0;
        Canvas::new(view, with_edges)
    }

    fn triangle(height: f64, paint: Paint) -> Triangle {
        let corners = [[-9.0, -9.0], [30.0, -9.0], [-9.0, 30.0]].map(|[x, y]| DVec3::new(x, y, height));
        Triangle { corners, texcoords: [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], paint }
    }

    #[test]
    fn the_nearer_triangle_is_seen_in_any_order() {
        let (low, high) = (triangle(0.2, Paint::Image(3)), triangle(0.8, Paint::Colour([1, 2, 3])));
        for order in [[low, high], [high, low]] {
            let mut canvas = canvas(false);
            order.iter().for_each(|triangle| canvas.draw(triangle));
            assert_eq!(canvas.seen(100).unwrap().paint, high.paint);
        }
    }

    #[test]
    fn texture_coordinates_run_over_the_triangle() {
        let mut canvas = canvas(false);
        canvas.draw(&triangle(0.0, Paint::Image(0)));
        // The centre of the lowest pixel on the left is at (0.25, 0.25): 9.25 of 39 along each side.
        let seen = canvas.seen(15 * 16).unwrap();
        assert!(seen.texcoord.iter().all(|t| (t - 9.25 / 39.0).abs() < 1e-6), "{seen:?}");
        assert!((0.0..=1.0).contains(&seen.light) && seen.light > 0.3);
    }

    #[test]
    fn edges_are_drawn_where_asked_for() {
        let corners = [[1.0, 1.0], [7.0, 1.0], [1.0, 7.0]].map(|[x, y]| DVec3::new(x, y, 0.0));
        let triangle = Triangle { corners, ..triangle(0.0, Paint::Image(0)) };
        let count = |with_edges| {
            let mut canvas = canvas(with_edges);
            canvas.draw(&triangle);
            (0..256).filter(|&pixel| canvas.seen(pixel).is_some_and(|seen| seen.is_edge)).count()
        };
        assert_eq!(count(false), 0);
        assert!(count(true) > 20);
    }

    #[test]
    fn nothing_is_seen_on_an_empty_canvas() {
        assert!((0..256).all(|pixel| canvas(true).seen(pixel).is_none()));
    }
}

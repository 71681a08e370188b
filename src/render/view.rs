//! Views of a mesh: parallel projections that are fitted to its bounding box.
//!
//! ```text
//!        up │  / north          turn: about the vertical, from the south, counter-clockwise seen from above
//!           │ /                 tilt: above the horizon; 90° looks straight down
//!           └───── east
//! ```

use glam::DVec3;

/// An axis counts as the vertical if the mesh is this much flatter along it than along the other two.
const FLATNESS: f64 = 0.6;
/// Share of the rendering's width or height that the mesh fills.
const FILLED: f64 = 0.96;

/// The bounding box in view, and its vertical axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Smallest coordinates.
    pub low: DVec3,
    /// Largest coordinates.
    pub high: DVec3,
    /// The vertical axis: 0, 1 or 2.
    pub up: usize,
}

impl Frame {
    /// The frame of a mesh; `None` if the box is empty.
    ///
    /// A mesh does not record which axis is up. The flattest axis is, if the mesh is flat; otherwise y, as for most
    /// scanned objects.
    pub fn new(low: DVec3, high: DVec3) -> Option<Self> {
        let size = high - low;
        if !(size.is_finite() && size.max_element() > 0.0) {
            return None;
        }
        let mut order = [2, 1, 0];
        order.sort_by(|&a, &b| size[a].total_cmp(&size[b]));
        let up = if size[order[0]] < FLATNESS * size[order[1]] { order[0] } else { 1 };
        Some(Self { low, high, up })
    }

    /// Name of the vertical axis.
    pub fn up_name(&self) -> &'static str {
        ["x", "y", "z"][self.up]
    }

    /// Unit vectors to the east, to the north and up.
    fn compass(&self) -> [DVec3; 3] {
        match self.up {
            0 => [DVec3::Y, DVec3::Z, DVec3::X],
            1 => [DVec3::X, DVec3::NEG_Z, DVec3::Y],
            _ => [DVec3::X, DVec3::Y, DVec3::Z],
        }
    }

    /// A view of the whole box; angles in degrees, size in pixels.
    pub fn view(&self, turn: f64, tilt: f64, size: [usize; 2]) -> View {
        let [east, north, up] = self.compass();
        let (turn, tilt) = (turn.to_radians(), tilt.to_radians());
        let (turn_sin, turn_cos) = (libm::sin(turn), libm::cos(turn));
        let (tilt_sin, tilt_cos) = (libm::sin(tilt), libm::cos(tilt));
        let right = turn_cos * east + turn_sin * north;
        let ahead = -turn_sin * east + turn_cos * north;
        let down = -(tilt_sin * ahead + tilt_cos * up);
        let towards = tilt_sin * up - tilt_cos * ahead;
        let axes = [right, down, towards];
        let origin = (self.low + self.high) / 2.0;
        let half = (self.high - self.low) / 2.0;
        // Half the extent of the box along an axis of the view.
        let reach = |axis: DVec3| axis.abs().dot(half).max(f64::MIN_POSITIVE);
        let [width, height] = size.map(|side| side as f64);
        let fitting = (width / (2.0 * reach(right))).min(height / (2.0 * reach(down)));
        let sun = (0.35 * right - 0.75 * down + 0.55 * towards).normalize();
        View { axes, origin, scale: FILLED * fitting, size, sun }
    }
}

/// A parallel projection to pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Unit vectors to the right, down, and towards the eye.
    axes: [DVec3; 3],
    origin: DVec3,
    /// Pixels per unit of length.
    pub scale: f64,
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Unit vector to the light.
    sun: DVec3,
}

impl View {
    /// Column, row and nearness of a position, all in pixels; the first pixel covers 0 to 1.
    #[inline]
    pub fn project(&self, position: DVec3) -> [f64; 3] {
        let from_middle = (position - self.origin) * self.scale;
        [
            from_middle.dot(self.axes[0]) + 0.5 * self.size[0] as f64,
            from_middle.dot(self.axes[1]) + 0.5 * self.size[1] as f64,
            from_middle.dot(self.axes[2]),
        ]
    }

    /// Light on a surface with this normal, 0 to 1; both sides are lit alike.
    pub fn light(&self, normal: DVec3) -> f64 {
        let normal = normal.normalize_or_zero();
        let facing = if normal.dot(self.axes[2]) < 0.0 { -normal } else { normal };
        0.32 + 0.68 * (0.5 + 0.5 * facing.dot(self.sun))
    }

    /// Fits the view to the extent of positions that it projected.
    pub fn fit(&mut self, extent: &ProjectedExtent) {
        let [x, y] = extent.0;
        let size = self.size.map(|side| side as f64);
        let [wide, high] = [x[1] - x[0], y[1] - y[0]].map(|length| length.max(f64::MIN_POSITIVE));
        let factor = FILLED * (size[0] / wide).min(size[1] / high);
        if factor.is_finite() {
            let aside = (0.5 * (x[0] + x[1] - size[0])) / self.scale * self.axes[0];
            let below = (0.5 * (y[0] + y[1] - size[1])) / self.scale * self.axes[1];
            self.origin += aside + below;
            self.scale *= factor;
        }
    }

    /// Centres the view on a position and enlarges it `zoom` times.
    pub fn enlarge(&mut self, position: DVec3, zoom: f64) {
        self.origin = position;
        self.scale *= zoom;
    }

    /// The same view with width, height and scale divided by `factor`.
    pub fn reduced(&self, factor: usize) -> Self {
        Self { scale: self.scale / factor as f64, size: self.size.map(|side| side / factor), ..*self }
    }
}

/// Range of columns and of rows of projected positions: least and largest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProjectedExtent([[f64; 2]; 2]);

impl Default for ProjectedExtent {
    fn default() -> Self {
        Self([[f64::INFINITY, f64::NEG_INFINITY]; 2])
    }
}

impl ProjectedExtent {
    /// Extends the ranges to a projected position.
    #[inline]
    pub fn add(&mut self, projected: [f64; 3]) {
        for (range, place) in self.0.iter_mut().zip(projected) {
            *range = [range[0].min(place), range[1].max(place)];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_mesh_lies_and_others_stand_along_y() {
        let up = |size: [f64; 3]| Frame::new(DVec3::ZERO, DVec3::from_array(size)).unwrap().up;
        assert_eq!([up([9.0, 7.0, 2.0]), up([9.0, 2.0, 7.0]), up([1.0, 1.0, 1.0]), up([1.0, 3.0, 1.0])], [2, 1, 1, 1]);
        assert!(Frame::new(DVec3::ONE, DVec3::ONE).is_none());
        assert!(Frame::new(DVec3::INFINITY, DVec3::NEG_INFINITY).is_none());
    }

    #[test]
    fn straight_down_north_is_at_the_top() {
        let frame = Frame::new(DVec3::ZERO, DVec3::new(10.0, 10.0, 1.0)).unwrap();
        let view = frame.view(0.0, 90.0, [100, 100]);
        let [x, y, near] = view.project(DVec3::new(10.0, 10.0, 1.0));
        assert!((x - 98.0).abs() < 1e-9 && (y - 2.0).abs() < 1e-9 && near > 0.0, "{x} {y} {near}");
    }

    #[test]
    fn a_fitted_view_is_filled() {
        let frame = Frame::new(DVec3::splat(-5.0), DVec3::new(50.0, 20.0, 9.0)).unwrap();
        let mut view = frame.view(30.0, 40.0, [300, 200]);
        let corners = [DVec3::new(40.0, 3.0, 1.0), DVec3::new(45.0, 4.0, 1.0), DVec3::new(42.0, 9.0, 2.0)];
        let extent = |view: &View| {
            let mut extent = ProjectedExtent::default();
            corners.iter().for_each(|&corner| extent.add(view.project(corner)));
            extent.0
        };
        let mut before = ProjectedExtent::default();
        corners.iter().for_each(|&corner| before.add(view.project(corner)));
        view.fit(&before);
        let [x, y] = extent(&view);
        assert!((x[0] + x[1] - 300.0).abs() < 1e-6 && (y[0] + y[1] - 200.0).abs() < 1e-6, "{x:?} {y:?}");
        assert!((x[1] - x[0] - 288.0).abs() < 1e-6 || (y[1] - y[0] - 192.0).abs() < 1e-6, "{x:?} {y:?}");
        view.enlarge(corners[1], 3.0);
        assert_eq!(view.project(corners[1]), [150.0, 100.0, 0.0]);
    }

    #[test]
    fn every_corner_of_the_box_is_in_the_image() {
        let frame = Frame::new(DVec3::new(5e5, 4e6, 10.0), DVec3::new(5e5 + 300.0, 4e6 + 200.0, 60.0)).unwrap();
        for (turn, tilt) in [(30.0, 38.0), (210.0, 38.0), (0.0, 90.0)] {
            let view = frame.view(turn, tilt, [960, 640]);
            for corner in 0..8 {
                let pick = |axis: usize| if corner >> axis & 1 == 0 { frame.low[axis] } else { frame.high[axis] };
                let [x, y, _] = view.project(DVec3::new(pick(0), pick(1), pick(2)));
                assert!((0.0..=960.0).contains(&x) && (0.0..=640.0).contains(&y));
            }
        }
    }
}

//! Rasterises triangles and lines.

use std::ops::Range;

/// A weight above minus this counts as 0 or more, so that rounding leaves out no pixel between two triangles with a
/// common side.
const SLACK: f64 = 1e-9;

/// Calls `plot` with index, nearness and corner weights for each pixel whose centre lies in a triangle, its outline
/// included. Corners are column, row and nearness in pixels.
#[inline]
pub fn each_pixel(corners: &[[f64; 3]; 3], size: [usize; 2], mut plot: impl FnMut(usize, f64, [f64; 3])) {
    let [a, b, c] = corners;
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let Some([columns, rows]) = covered(corners, size) else { return };
    if area == 0.0 || !area.is_finite() {
        return;
    }
    for row in rows {
        let y = row as f64 + 0.5;
        for column in columns_near(corners, y, &columns) {
            let x = column as f64 + 0.5;
            let of_b = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area;
            let of_c = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area;
            let of_a = 1.0 - of_b - of_c;
            if of_a >= -SLACK && of_b >= -SLACK && of_c >= -SLACK {
                let near = of_a * a[2] + of_b * b[2] + of_c * c[2];
                plot(row * size[0] + column, near, [of_a, of_b, of_c].map(|weight| weight.max(0.0)));
            }
        }
    }
}

/// Those of some columns that a triangle meets in a row, and one or two more on each side; `y` is the middle of the row.
#[inline]
fn columns_near(corners: &[[f64; 3]; 3], y: f64, columns: &Range<usize>) -> Range<usize> {
    let ys = corners.map(|corner| corner[1]);
    let y = y.clamp(ys[0].min(ys[1]).min(ys[2]), ys[0].max(ys[1]).max(ys[2]));
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for k in 0..3 {
        let (from, to) = (corners[k], corners[(k + 1) % 3]);
        if (from[1] <= y && y <= to[1]) || (to[1] <= y && y <= from[1]) {
            let share = if from[1] == to[1] { 0.0 } else { (y - from[1]) / (to[1] - from[1]) };
            let x = from[0] + share * (to[0] - from[0]);
            (low, high) = (low.min(x), high.max(x));
        }
    }
    // A cast saturates.
    let first = (low - 1.5).max(0.0) as usize;
    let end = (high + 2.5).max(0.0) as usize;
    first.max(columns.start)..end.min(columns.end)
}

/// Calls `plot` with index and nearness for pixels along a line between two projected points.
pub fn each_pixel_of_line(from: [f64; 3], to: [f64; 3], size: [usize; 2], mut plot: impl FnMut(usize, f64)) {
    let length = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
    // Most of a long line may lie outside; a line inside is not longer than both sides together.
    if !(length.is_finite() && length <= 4.0 * (size[0] + size[1]) as f64) {
        return;
    }
    let steps = length.ceil().max(1.0) as usize;
    for step in 0..=steps {
        let share = step as f64 / steps as f64;
        let [x, y, near] = [0, 1, 2].map(|k| from[k] + share * (to[k] - from[k]));
        if x >= 0.0 && y >= 0.0 && x < size[0] as f64 && y < size[1] as f64 {
            plot(y as usize * size[0] + x as usize, near);
        }
    }
}

/// Columns and rows whose centres lie in the box around a triangle; `None` if there are none.
fn covered(corners: &[[f64; 3]; 3], size: [usize; 2]) -> Option<[Range<usize>; 2]> {
    let range = |axis: usize| {
        let low = corners[0][axis].min(corners[1][axis]).min(corners[2][axis]);
        let high = corners[0][axis].max(corners[1][axis]).max(corners[2][axis]);
        // A cast saturates, and turns NaN into 0.
        let first = (low - 0.5).ceil().max(0.0) as usize;
        let end = ((high - 0.5).floor() + 1.0).clamp(0.0, size[axis] as f64) as usize;
        (first < end).then_some(first..end)
    };
    Some([range(0)?, range(1)?])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Pixels whose centres lie in a triangle, of all in the image.
    fn pixels_by_trial(corners: [[f64; 3]; 3], size: [usize; 2]) -> Vec<usize> {
        let side = |[from, to]: [[f64; 3]; 2], x: f64, y: f64| {
            (to[0] - from[0]) * (y - from[1]) - (to[1] - from[1]) * (x - from[0])
        };
        let [a, b, c] = corners;
        let area = side([a, b], c[0], c[1]);
        let is_inside = |pixel: &usize| {
            let (x, y) = ((pixel % size[0]) as f64 + 0.5, (pixel / size[0]) as f64 + 0.5);
            [[b, c], [c, a], [a, b]].into_iter().all(|edge| side(edge, x, y) / area >= 0.0)
        };
        (0..size[0] * size[1]).filter(|pixel| area != 0.0 && is_inside(pixel)).collect()
    }

    proptest! {
        // Coordinates are multiples of a quarter: no rounding, and many sides through centres.
        #[test]
        fn all_pixels_of_a_triangle_are_found(corners in prop::array::uniform3(prop::array::uniform2(-40i8..80))) {
            let corners = corners.map(|[x, y]| [f64::from(x) / 4.0, f64::from(y) / 4.0, 0.0]);
            prop_assert_eq!(pixels(corners, [13, 9]), pixels_by_trial(corners, [13, 9]));
        }
    }

    fn pixels(corners: [[f64; 3]; 3], size: [usize; 2]) -> Vec<usize> {
        let mut found = Vec::new();
        each_pixel(&corners, size, |pixel, _, _| found.push(pixel));
        found
    }

    #[test]
    fn two_triangles_of_a_square_cover_it() {
        let square = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 4.0, 0.0], [0.0, 4.0, 0.0]];
        let mut both = pixels([square[0], square[1], square[2]], [4, 4]);
        both.extend(pixels([square[0], square[2], square[3]], [4, 4]));
        both.sort_unstable();
        both.dedup();
        assert_eq!(both, (0..16).collect::<Vec<_>>());
    }

    #[test]
    fn what_lies_outside_or_is_no_number_is_left_out() {
        let far = [[-1e30, -1e30, 0.0], [1e30, -1e30, 0.0], [0.0, 1e30, 0.0]];
        assert!(pixels(far, [3, 3]).len() <= 9);
        assert!(pixels([[f64::NAN; 3], [1.0, 0.0, 0.0], [0.0, 9.0, 0.0]], [3, 3]).is_empty());
        assert!(pixels([[5.0, 5.0, 0.0], [9.0, 5.0, 0.0], [5.0, 9.0, 0.0]], [3, 3]).is_empty());
        each_pixel_of_line([-1e300, 0.0, 0.0], [1e300, 0.0, 0.0], [3, 3], |_, _| panic!("too long to draw"));
    }

    #[test]
    fn nearness_is_that_of_the_plane() {
        let mut seen = Vec::new();
        each_pixel(&[[0.0, 0.0, 0.0], [4.0, 0.0, 4.0], [0.0, 4.0, 0.0]], [4, 4], |_, near, _| seen.push(near));
        assert_eq!(&seen[..4], [0.5, 1.5, 2.5, 3.5]);
    }
}

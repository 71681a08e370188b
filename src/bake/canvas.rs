//! An image that is being baked: colours of the texels, and which of them are set.
//!
//! # Memory
//! 3.2 bytes a texel, and a third more while it is filled.

use glam::Vec3;

/// An image under way.
pub struct AtlasCanvas {
    /// Width and height.
    pub size: [usize; 2],
    /// Red, green, blue, row by row from the top.
    pub rgb: Vec<u8>,
    /// A bit for each texel.
    are_set: Vec<u64>,
}

impl AtlasCanvas {
    /// An image without any texel set.
    pub fn new(size: [usize; 2]) -> Self {
        let texels = size[0] * size[1];
        Self { size, rgb: vec![0; 3 * texels], are_set: vec![0; texels.div_ceil(64)] }
    }

    /// Sets a texel.
    #[inline]
    pub fn set(&mut self, [column, row]: [usize; 2], colour: Vec3) {
        let at = row * self.size[0] + column;
        let bytes = colour.clamp(Vec3::ZERO, Vec3::splat(255.0)).to_array().map(|channel| (channel + 0.5) as u8);
        self.set_bytes(at, bytes);
    }

    /// Red, green and blue of neighbouring texels of a row, to be set.
    pub fn set_row(&mut self, [column, row]: [usize; 2], count: usize) -> &mut [[u8; 3]] {
        let first = row * self.size[0] + column;
        let end = first + count;
        for word in first / 64..end.div_ceil(64) {
            let [from, to] = [first, end].map(|at| at.saturating_sub(64 * word).min(64));
            // A row is not empty.
            self.are_set[word] |= u64::MAX >> (64 - (to - from)) << from;
        }
        &mut self.rgb.as_chunks_mut().0[first..end]
    }

    #[inline]
    fn set_bytes(&mut self, at: usize, bytes: [u8; 3]) {
        self.are_set[at / 64] |= 1 << (at % 64);
        self.rgb[3 * at..3 * at + 3].copy_from_slice(&bytes);
    }

    #[inline]
    fn is_set(&self, at: usize) -> bool {
        self.are_set[at / 64] >> (at % 64) & 1 != 0
    }

    /// Number of texels that are set.
    fn set_count(&self) -> usize {
        self.are_set.iter().map(|bits| bits.count_ones() as usize).sum()
    }

    /// Fills the texels that are not set from those that are, in ever larger squares.
    ///
    /// # Source
    /// Gortler, Grzeszczuk, Szeliski & Cohen 1996, "The lumigraph", section 3.4.3 (pull-push).
    pub fn fill(&mut self) {
        let [width, height] = self.size;
        let count = self.set_count();
        if count == 0 || count == width * height {
            return;
        }
        let mut half = self.pulled();
        half.fill();
        for y in 0..height {
            let (first, mut x) = (y * width, 0);
            while x < width {
                let at = first + x;
                let are_unset = !self.are_set[at / 64] >> (at % 64);
                if are_unset & 1 != 0 {
                    let from = 3 * (y / 2 * half.size[0] + x / 2);
                    self.set_bytes(at, [half.rgb[from], half.rgb[from + 1], half.rgb[from + 2]]);
                    x += 1;
                } else {
                    // To the next one that may be unset: in this word, or the first of the next.
                    x += (are_unset.trailing_zeros() as usize).min(64 - at % 64);
                }
            }
        }
    }

    /// The image at half of its size: means of the texels that are set.
    fn pulled(&self) -> Self {
        let [width, height] = self.size;
        let mut half = Self::new(self.size.map(|side| side.div_ceil(2)));
        for y in 0..half.size[1] {
            for x in 0..half.size[0] {
                let first = 2 * y * width + 2 * x;
                let has_four = 2 * x + 1 < width && 2 * y + 1 < height;
                if has_four
                    && [first, first + 1, first + width, first + width + 1].into_iter().all(|at| self.is_set(at))
                {
                    let [a, b] = [first, first + width].map(|at| &self.rgb[3 * at..3 * at + 6]);
                    let mean = |c: usize| {
                        (u32::from(a[c]) + u32::from(a[c + 3]) + u32::from(b[c]) + u32::from(b[c + 3]) + 2) / 4
                    };
                    half.set_bytes(y * half.size[0] + x, [mean(0) as u8, mean(1) as u8, mean(2) as u8]);
                    continue;
                }
                let (mut sum, mut count) = ([0u32; 3], 0);
                for (column, row) in [(2 * x, 2 * y), (2 * x + 1, 2 * y), (2 * x, 2 * y + 1), (2 * x + 1, 2 * y + 1)] {
                    if column < width && row < height && self.is_set(row * width + column) {
                        let at = 3 * (row * width + column);
                        (0..3).for_each(|channel| sum[channel] += u32::from(self.rgb[at + channel]));
                        count += 1;
                    }
                }
                if count > 0 {
                    half.set_bytes(y * half.size[0] + x, sum.map(|sum| ((sum + count / 2) / count) as u8));
                }
            }
        }
        half
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_set_takes_the_colour_of_what_is_near() {
        let mut canvas = AtlasCanvas::new([37, 21]);
        canvas.set([3, 4], Vec3::new(200.0, 10.0, 30.0));
        canvas.set([33, 18], Vec3::new(0.0, 100.0, 0.0));
        canvas.fill();
        let pixel = |x: usize, y: usize| &canvas.rgb[3 * (y * 37 + x)..][..3];
        assert_eq!(pixel(3, 4), [200, 10, 30]);
        assert_eq!(pixel(2, 5), [200, 10, 30]);
        assert_eq!(pixel(34, 19), [0, 100, 0]);
        assert_eq!(canvas.set_count(), 37 * 21);
    }

    #[test]
    fn an_empty_image_stays_black() {
        let mut canvas = AtlasCanvas::new([5, 3]);
        canvas.fill();
        assert!(canvas.rgb.iter().all(|&byte| byte == 0));
    }
}

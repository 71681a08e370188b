//! Colours of vertices, whose channels go from 0 to 1 or from 0 to 255: a file does not say which, so the largest
//! channel of a mesh decides. Shares may be a little above 1, as rounding and exposure leave them.

use crate::base::Result;
use crate::file::Segment;

/// Channels from here on are none of shares.
const BYTES_FROM: f32 = 2.0;
/// Colours read at once.
const SWEEP_RECORDS: u64 = 128 << 10;

/// How far the channels of a mesh's colours go.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ColourRange {
    /// The largest channel.
    brightest: f32,
}

impl ColourRange {
    /// That of all colours of a column.
    ///
    /// # Errors
    /// On failed reads.
    pub fn of(colours: &Segment<[f32; 3]>) -> Result<Self> {
        let mut all = Self::default();
        for range in colours.ranges(SWEEP_RECORDS) {
            all = all.with(&colours.window(range)?);
        }
        Ok(all)
    }

    /// With further colours; one that is NaN is none.
    pub fn with(self, colours: &[[f32; 3]]) -> Self {
        Self { brightest: colours.as_flattened().iter().fold(self.brightest, |most, &channel| most.max(channel)) }
    }

    /// That of the colours of both.
    pub fn joined(self, other: Self) -> Self {
        Self { brightest: self.brightest.max(other.brightest) }
    }

    /// The channel of white.
    pub fn white(self) -> f32 {
        if self.brightest >= BYTES_FROM { 255.0 } else { 1.0 }
    }

    /// A colour, each channel as a byte.
    #[inline]
    pub fn bytes(self, colour: [f32; 3]) -> [u8; 3] {
        let scale = 255.0 / self.white();
        colour.map(|channel| (channel * scale).round().clamp(0.0, 255.0) as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_channel_decides_what_white_is() {
        let none = [f32::NAN; 3];
        let shares = ColourRange::default().with(&[none, [0.5, 0.0, 1.0]]);
        assert_eq!(shares.bytes([0.5, -1.0, 1.0]), [128, 0, 255]);
        let exposed = shares.joined(ColourRange::default().with(&[[1.0001, 0.9, 1.9]]));
        assert_eq!(exposed.bytes([0.5, 1.0001, 1.9]), [128, 255, 255]);
        let bytes = shares.joined(ColourRange::default().with(&[[200.0, 40.0, 30.0], none]));
        assert_eq!(bytes.bytes([200.0, 1.0, 300.0]), [200, 1, 255]);
        assert_eq!(bytes, bytes.joined(shares));
    }
}

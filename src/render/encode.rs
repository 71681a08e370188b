//! Encodes pixels as image files in memory, and maps numbers to colours.

#[cfg(feature = "images")]
use image::codecs::jpeg::JpegEncoder;
#[cfg(feature = "images")]
use image::codecs::png::PngEncoder;
#[cfg(feature = "images")]
use image::{ExtendedColorType, ImageEncoder};

/// Quality of a JPEG, 1 to 100.
#[cfg(feature = "images")]
const JPEG_QUALITY: u8 = 86;
/// Colours of an error from 0 to the largest: pale stone to dark red. `style.css` draws the scale with the same ones.
const HEAT: [[f32; 3]; 6] = [
    [236.0, 235.0, 230.0],
    [250.0, 214.0, 137.0],
    [241.0, 150.0, 73.0],
    [210.0, 74.0, 61.0],
    [139.0, 27.0, 73.0],
    [64.0, 10.0, 52.0],
];

/// A JPEG of red, green and blue bytes; `None` if the rendering is too large for the format.
#[cfg(feature = "images")]
pub fn jpeg(rgb: &[u8], size: [usize; 2]) -> Option<Vec<u8>> {
    let mut file = Vec::new();
    let [width, height] = [u32::try_from(size[0]).ok()?, u32::try_from(size[1]).ok()?];
    JpegEncoder::new_with_quality(&mut file, JPEG_QUALITY).encode(rgb, width, height, ExtendedColorType::Rgb8).ok()?;
    Some(file)
}

/// A PNG of red, green, blue and opacity bytes; `None` if the rendering is too large for the format.
#[cfg(feature = "images")]
pub fn png(rgba: &[u8], size: [usize; 2]) -> Option<Vec<u8>> {
    let mut file = Vec::new();
    let [width, height] = [u32::try_from(size[0]).ok()?, u32::try_from(size[1]).ok()?];
    PngEncoder::new(&mut file).write_image(rgba, width, height, ExtendedColorType::Rgba8).ok()?;
    Some(file)
}

/// No PNG: the crate is built without images.
#[cfg(not(feature = "images"))]
pub fn png(_rgba: &[u8], _size: [usize; 2]) -> Option<Vec<u8>> {
    None
}

/// Colour of an error relative to the largest one shown, 0 to 1.
pub fn heat(share: f32) -> [f32; 3] {
    let place = share.clamp(0.0, 1.0) * (HEAT.len() - 1) as f32;
    let low = (place as usize).min(HEAT.len() - 2);
    let part = place - low as f32;
    [0, 1, 2].map(|channel| HEAT[low][channel] + part * (HEAT[low + 1][channel] - HEAT[low][channel]))
}

/// A colour for a number, different from those of nearby numbers.
pub fn distinct(number: u32) -> [u8; 3] {
    // The golden angle, in turns: consecutive numbers are far apart in hue.
    let turns = f64::from(number) * 0.381_966_011_25;
    let tone = [0.80, 0.68, 0.74][number as usize % 3];
    [0.0, 1.0 / 3.0, 2.0 / 3.0].map(|shift| {
        let wave = libm::cos(std::f64::consts::TAU * (turns + shift));
        (255.0 * (tone + 0.16 * wave)).clamp(0.0, 255.0) as u8
    })
}

#[cfg(all(test, feature = "images"))]
mod tests {
    use super::*;

    #[test]
    fn heat_runs_from_pale_to_dark() {
        let luma = |share| heat(share).iter().sum::<f32>();
        assert!((0..10).all(|step| luma(step as f32 / 10.0) > luma((step + 1) as f32 / 10.0)));
        assert_eq!(heat(-1.0), heat(0.0));
        assert_eq!(heat(f32::NAN.max(7.0)), heat(1.0));
    }

    #[test]
    fn files_can_be_read_again() {
        let rgb: Vec<u8> = (0..4 * 3 * 3).map(|i| i as u8 * 5).collect();
        let read = image::load_from_memory(&jpeg(&rgb, [4, 3]).unwrap()).unwrap();
        assert_eq!((read.width(), read.height()), (4, 3));
        let rgba: Vec<u8> = (0..4 * 3 * 4).map(|i| i as u8 * 5).collect();
        assert_eq!(image::load_from_memory(&png(&rgba, [4, 3]).unwrap()).unwrap().into_rgba8().into_raw(), rgba);
    }

    #[test]
    fn neighbouring_numbers_have_different_colours() {
        let far = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).map(|(&a, b)| u32::from(a.abs_diff(b))).sum::<u32>() > 40;
        assert!((0..200).all(|number| far(distinct(number), distinct(number + 1))));
    }
}

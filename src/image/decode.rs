//! Decodes image files and returns colours at texture coordinates, one image at a time or as many as the budget holds.
//!
//! In: untrusted image files. Out: [`Image`]. Invariant: memory is allocated only after the size that a file claims is
//! known to fit; a file that cannot be decoded gives an error message and never ends the program.
//!
//! # Memory
//! 3 bytes a pixel, the file itself, and the decoder's working memory: [`DecodePlan::bytes`].

use std::fs::File;
use std::io::{BufReader, Read};
use std::ops::Range;
use std::path::Path;

use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use crate::base::pool::in_parallel;

/// Bytes of a decoded pixel.
const PIXEL_BYTES: u64 = 3;
/// Bytes of a pixel's coefficients, which the decoder of a progressive JPEG keeps for the whole image.
const COEFFICIENT_BYTES: u64 = 6;
/// Bytes that a decoder takes beside the image.
const DECODER_BYTES: u64 = 2 << 20;
/// Factors by which the sides of an image that does not fit may be reduced.
const REDUCTIONS: [u32; 3] = [2, 4, 8];

/// Plan for decoding an image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DecodePlan {
    /// Width and height in the file.
    pub size: [u32; 2],
    /// Memory while it is decoded, in bytes.
    pub bytes: u64,
    /// Number of pixels of the file for each one that is kept, along a side.
    pub reduction: u32,
    format: ImageFormat,
}

/// A decoded image.
#[derive(Debug)]
pub struct Image {
    width: usize,
    height: usize,
    /// Red, green, blue, row by row from the top.
    pixels: Vec<u8>,
}

impl Image {
    /// Decodes an image of this program's own making.
    ///
    /// # Errors
    /// A message, if the bytes are damaged.
    pub fn of_bytes(bytes: &[u8]) -> Result<Self, String> {
        let image = image::load_from_memory(bytes).map_err(|e| e.to_string())?.into_rgb8();
        Ok(Self { width: image.width() as usize, height: image.height() as usize, pixels: image.into_raw() })
    }

    /// An image of pixels: red, green, blue, row by row from the top.
    pub fn of_pixels(pixels: Vec<u8>, [width, height]: [usize; 2]) -> Self {
        Self { width, height, pixels }
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// All pixels, red, green, blue, row by row from the top.
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// Pixels of a row, red, green, blue, one after the other; rows are counted from the top.
    pub fn row(&self, row: usize, columns: Range<usize>) -> &[u8] {
        let pixel = PIXEL_BYTES as usize;
        &self.pixels[(row * self.width + columns.start) * pixel..(row * self.width + columns.end) * pixel]
    }

    /// The pixel (red, green, blue) at a texture coordinate between 0 and 1, with (0, 0) at the lower left.
    pub fn pixel(&self, texcoord: [f32; 2]) -> [u8; 3] {
        let column = ((texcoord[0] * self.width as f32) as usize).min(self.width - 1);
        let row = (((1.0 - texcoord[1]) * self.height as f32) as usize).min(self.height - 1);
        let at = (row * self.width + column) * PIXEL_BYTES as usize;
        [self.pixels[at], self.pixels[at + 1], self.pixels[at + 2]]
    }

    /// Colour (red, green, blue; 0 to 255) at a texture coordinate between 0 and 1, with (0, 0) at the lower left.
    pub fn colour(&self, texcoord: [f32; 2]) -> [f32; 3] {
        let x = f64::from(texcoord[0]) * self.width as f64 - 0.5;
        let y = (1.0 - f64::from(texcoord[1])) * self.height as f64 - 0.5;
        let (left, top) = (x.floor(), y.floor());
        let (right_share, lower_share) = ((x - left) as f32, (y - top) as f32);
        let pixel = |x: f64, y: f64| {
            let column = x.clamp(0.0, (self.width - 1) as f64) as usize;
            let row = y.clamp(0.0, (self.height - 1) as f64) as usize;
            let at = (row * self.width + column) * PIXEL_BYTES as usize;
            [0, 1, 2].map(|channel| f32::from(self.pixels[at + channel]))
        };
        let mix = |a: [f32; 3], b: [f32; 3], share: f32| [0, 1, 2].map(|c| a[c] * (1.0 - share) + b[c] * share);
        let upper = mix(pixel(left, top), pixel(left + 1.0, top), right_share);
        let lower = mix(pixel(left, top + 1.0), pixel(left + 1.0, top + 1.0), right_share);
        mix(upper, lower, lower_share)
    }
}

/// Plan for decoding an image file within `allowed_bytes`, from its header.
///
/// # Errors
/// A message, if it is no image, or cannot be decoded within `allowed_bytes`.
pub fn plan(path: &Path, allowed_bytes: u64) -> Result<DecodePlan, String> {
    let file_bytes = path.metadata().map_err(|e| e.to_string())?.len();
    let reader = ImageReader::open(path).and_then(ImageReader::with_guessed_format).map_err(|e| e.to_string())?;
    let format = reader.format().ok_or("of no known format")?;
    // The decoder of a JPEG keeps the file, also to read its header alone.
    if format == ImageFormat::Jpeg && file_bytes.saturating_add(DECODER_BYTES) > allowed_bytes {
        return Err("larger than the memory budget".into());
    }
    let of_jpeg = if format == ImageFormat::Jpeg { jpeg_header(path) } else { None };
    let header = match of_jpeg {
        Some(header) => header,
        None => ImageHeader::of(reader, allowed_bytes)?,
    };
    let [width, height] = header.size;
    if width == 0 || height == 0 {
        return Err("without pixels".into());
    }
    let pixels = u64::from(width) * u64::from(height);
    let raw = if header.is_rgb { 0 } else { header.pixel_bytes * pixels };
    let coefficients = if header.is_progressive { COEFFICIENT_BYTES * pixels } else { 0 };
    // A PNG is decoded while it is read, so the file is not kept.
    let file_bytes = if format == ImageFormat::Png { 0 } else { file_bytes };
    let whole = PIXEL_BYTES * pixels + raw + coefficients + file_bytes + DECODER_BYTES;
    let plan = |reduction: u32, bytes| DecodePlan { size: [width, height], bytes, reduction, format };
    if whole <= allowed_bytes {
        return Ok(plan(1, whole));
    }
    for reduction in REDUCTIONS {
        let kept = PIXEL_BYTES * u64::from(width.div_ceil(reduction)) * u64::from(height.div_ceil(reduction));
        let row = 8 * u64::from(width) * 16;
        // The decoder of a JPEG holds the colour channels, each as large as the image, until it has mixed them.
        let channels = if format == ImageFormat::Jpeg { kept } else { 0 };
        let bytes = kept + channels + coefficients + file_bytes + row + DECODER_BYTES;
        if matches!(format, ImageFormat::Jpeg | ImageFormat::Png) && bytes <= allowed_bytes {
            return Ok(plan(reduction, bytes));
        }
    }
    Err(format!("{width} x {height} pixels, too many for the memory budget"))
}

/// What the header of an image file says.
struct ImageHeader {
    size: [u32; 2],
    /// Whether its pixels are red, green and blue, a byte each.
    is_rgb: bool,
    /// Bytes of a pixel as the decoder gives it.
    pixel_bytes: u64,
    /// Whether it is a JPEG that is coded in several scans.
    is_progressive: bool,
}

impl ImageHeader {
    fn of(mut reader: ImageReader<BufReader<File>>, allowed_bytes: u64) -> Result<Self, String> {
        // A header is small; one that needs more memory than this claims a false size.
        let mut limits = Limits::default();
        limits.max_alloc = Some(allowed_bytes);
        reader.limits(limits);
        let decoder = reader.into_decoder().map_err(|e| e.to_string())?;
        let colour = decoder.color_type();
        let (is_rgb, pixel_bytes) = (colour == ColorType::Rgb8, u64::from(colour.bytes_per_pixel()));
        Ok(Self { size: decoder.dimensions().into(), is_rgb, pixel_bytes, is_progressive: false })
    }
}

/// The header of a JPEG file, without the rest of the file in memory; `None` if it is not as usual.
fn jpeg_header(path: &Path) -> Option<ImageHeader> {
    let mut file = BufReader::new(File::open(path).ok()?);
    let mut two = [0; 2];
    file.read_exact(&mut two).ok()?;
    loop {
        file.read_exact(&mut two).ok()?;
        let marker = two[1];
        if two[0] != 0xff || matches!(marker, 0xda | 0xd9) {
            return None;
        }
        file.read_exact(&mut two).ok()?;
        let length = u16::from_be_bytes(two).checked_sub(2)?;
        if matches!(marker, 0xc0..=0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf) {
            // Bits of a sample, height, width, number of channels.
            let mut frame = [0; 6];
            file.read_exact(&mut frame).ok()?;
            let [_, height @ .., channels] = frame;
            let side = |at: usize| u32::from(u16::from_be_bytes([height[at], height[at + 1]]));
            return Some(ImageHeader {
                size: [side(2), side(0)],
                is_rgb: channels == 3,
                pixel_bytes: channels.into(),
                is_progressive: matches!(marker, 0xc2 | 0xc6 | 0xca | 0xce),
            });
        }
        file.seek_relative(length.into()).ok()?;
    }
}

/// Decodes an image as planned.
///
/// # Errors
/// A message, if the file is damaged.
pub fn decode(path: &Path, plan: &DecodePlan) -> Result<Image, String> {
    let image = match (plan.reduction, plan.format) {
        (1, _) => decode_whole(path, plan)?,
        (_, ImageFormat::Jpeg) => decode_small_jpeg(path, plan)?,
        _ => decode_small_png(path, plan)?,
    };
    let is_whole = image.pixels.len() as u64 == image.width as u64 * image.height as u64 * PIXEL_BYTES;
    if is_whole && !image.pixels.is_empty() { Ok(image) } else { Err("the image ends early".into()) }
}

fn decode_whole(path: &Path, plan: &DecodePlan) -> Result<Image, String> {
    let mut reader = ImageReader::open(path).and_then(ImageReader::with_guessed_format).map_err(|e| e.to_string())?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(plan.bytes);
    limits.max_image_width = Some(plan.size[0]);
    limits.max_image_height = Some(plan.size[1]);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| e.to_string())?;
    let image = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?.into_rgb8();
    Ok(Image { width: image.width() as usize, height: image.height() as usize, pixels: image.into_raw() })
}

/// Decodes a JPEG at a half, a quarter or an eighth of its size.
fn decode_small_jpeg(path: &Path, plan: &DecodePlan) -> Result<Image, String> {
    let file = File::open(path).map_err(|e| e.to_string())?;
    let mut decoder = jpeg_decoder::Decoder::new(BufReader::new(file));
    let [width, height] = plan.size.map(|side| u16::try_from(side.div_ceil(plan.reduction)).unwrap_or(u16::MAX));
    let (width, height) = decoder.scale(width, height).map_err(|e| e.to_string())?;
    let pixels = in_parallel(|| decoder.decode()).map_err(|e| e.to_string())?;
    let format = decoder.info().ok_or("without header")?.pixel_format;
    let pixels = match format {
        jpeg_decoder::PixelFormat::RGB24 => pixels,
        jpeg_decoder::PixelFormat::L8 => pixels.iter().flat_map(|&grey| [grey; 3]).collect(),
        _ => return Err("of a colour space that cannot be reduced".into()),
    };
    Ok(Image { width: width.into(), height: height.into(), pixels })
}

/// Decodes a PNG row by row and keeps means over squares of pixels.
fn decode_small_png(path: &Path, plan: &DecodePlan) -> Result<Image, String> {
    let file = File::open(path).map_err(|e| e.to_string())?;
    let mut decoder = png::Decoder::new(BufReader::new(file));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(|e| e.to_string())?;
    if reader.info().interlaced {
        return Err("interlaced, and too large for the memory budget".into());
    }
    let channels = reader.output_color_type().0.samples();
    let reduction = plan.reduction as usize;
    let (width, height) = (reader.info().width as usize, reader.info().height as usize);
    let kept = width.div_ceil(reduction);
    let mut pixels = Vec::with_capacity(kept * height.div_ceil(reduction) * PIXEL_BYTES as usize);
    let (mut sums, mut rows) = (vec![[0u32; 4]; kept], 0);
    for row in 0..height {
        let line = reader.next_row().map_err(|e| e.to_string())?.ok_or("the image ends early")?;
        for (column, pixel) in line.data().chunks_exact(channels).enumerate() {
            let sum = &mut sums[column / reduction];
            let grey = channels < 3;
            (0..3).for_each(|channel| sum[channel] += u32::from(pixel[if grey { 0 } else { channel }]));
            sum[3] += 1;
        }
        rows += 1;
        if rows == reduction || row + 1 == height {
            for sum in &mut sums {
                pixels.extend([0, 1, 2].map(|channel| (sum[channel] / sum[3].max(1)) as u8));
                *sum = [0; 4];
            }
            rows = 0;
        }
    }
    Ok(Image { width: kept, height: height.div_ceil(reduction), pixels })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checkers(folder: &Path, name: &str, side: u32) -> std::path::PathBuf {
        let path = folder.join(name);
        let pixel =
            |x: u32, y: u32| image::Rgb(if (x / 32 + y / 32).is_multiple_of(2) { [250, 30, 10] } else { [0, 90, 200] });
        image::RgbImage::from_fn(side, side, pixel).save(&path).unwrap();
        path
    }

    #[test]
    fn colours_are_mixed_between_the_middles_of_pixels() {
        // 0    100      v = 1
        // 200  40       v = 0
        let grey = |value: u8| [value; 3];
        let image = Image { width: 2, height: 2, pixels: [grey(0), grey(100), grey(200), grey(40)].concat() };
        assert_eq!(image.colour([0.25, 0.75]), [0.0; 3]);
        assert_eq!(image.colour([0.5, 0.75]), [50.0; 3]);
        assert_eq!(image.colour([0.5, 0.5]), [85.0; 3]);
        assert_eq!(image.colour([0.0, 0.0]), [200.0; 3]);
    }

    #[test]
    fn an_image_that_does_not_fit_is_read_at_a_lower_resolution() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.png", "a.jpg"] {
            let path = checkers(folder.path(), name, 2048);
            let whole = decode(&path, &plan(&path, 1 << 30).unwrap()).unwrap();
            let small_plan = plan(&path, 7 << 20).unwrap();
            assert!(small_plan.reduction > 1 && small_plan.bytes <= 7 << 20, "{small_plan:?}");
            let small = decode(&path, &small_plan).unwrap();
            assert_eq!(small.width * small_plan.reduction as usize, 2048);
            // inside a field both decodings show the same colour
            for at in [[15.5, 15.5], [47.5, 15.5], [1999.5, 1041.5]] {
                let texcoord = [at[0] / 2048.0, 1.0 - at[1] / 2048.0];
                let (a, b) = (whole.colour(texcoord), small.colour(texcoord));
                assert!((0..3).all(|c| (a[c] - b[c]).abs() < 6.0), "{name} {at:?}: {a:?} {b:?}");
            }
            assert!(plan(&path, 100 << 10).is_err());
        }
    }

    #[test]
    fn the_header_of_a_jpeg_is_read_without_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = checkers(folder.path(), "a.jpg", 320);
        let plain = plan(&path, 64 << 20).unwrap();
        assert_eq!(plain.size, [320; 2]);
        // A hole of the disk follows the image: nothing that the memory could hold.
        let file = File::options().write(true).open(&path).unwrap();
        file.set_len(1 << 40).unwrap();
        assert_eq!(plan(&path, 64 << 20), Err("larger than the memory budget".into()));
        assert_eq!(jpeg_header(&path).unwrap().size, [320; 2]);
        let grey = folder.path().join("grey.jpg");
        image::GrayImage::new(40, 30).save(&grey).unwrap();
        let grey = plan(&grey, 64 << 20).unwrap();
        assert_eq!((grey.size, grey.bytes > 4 * 1200 + DECODER_BYTES), ([40, 30], true));
    }

    #[test]
    fn files_that_are_no_images_are_refused_in_words() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        for content in [&b""[..], b"no image", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", b"\xff\xd8\xff\xe0\0\x10JFIF"] {
            std::fs::write(&path, content).unwrap();
            assert!(plan(&path, 1 << 30).is_err());
        }
        // truncated: the header is whole, the pixels are not
        let whole = std::fs::read(checkers(folder.path(), "b.png", 64)).unwrap();
        std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        assert!(plan(&path, 1 << 30).and_then(|plan| decode(&path, &plan)).is_err());
    }
}

//! Encodes images.

use std::io::Write;
use std::path::Path;

use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

#[cfg(feature = "ktx2")]
use super::ktx2::ktx2;
use crate::base::{Error, Result};
use crate::model::image_format::ImageFormat;
use crate::os::durable::DurableFile;

/// Bytes that are written at once.
const BUFFER_BYTES: usize = 1 << 16;

/// Writes an image to a file in the work folder, durably: red, green and blue of each pixel, row by row.
///
/// # Errors
/// On a full disk or a failed write.
pub fn encode(pixels: &[u8], size: [usize; 2], format: ImageFormat, path: &Path) -> Result<()> {
    let mut sink = Sink { file: DurableFile::create_shared(path, BUFFER_BYTES)?, failure: None };
    let encoded = encode_into(pixels, size, format, &mut sink);
    if let Some(failure) = sink.failure {
        return Err(failure);
    }
    encoded.map_err(|error| Error::io(path, "write", error))?;
    sink.file.commit()?;
    Ok(())
}

/// Passes the bytes of an image file to `out`: red, green and blue of each pixel, row by row.
///
/// # Errors
/// Those of `out`.
fn encode_into(
    pixels: &[u8],
    [width, height]: [usize; 2],
    format: ImageFormat,
    mut out: impl Write,
) -> std::io::Result<()> {
    match format {
        ImageFormat::Png => {
            let mut encoder = png::Encoder::new(&mut out, width as u32, height as u32);
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_depth(png::BitDepth::Eight);
            encoder.set_compression(png::Compression::Fast);
            let mut writer = encoder.write_header()?;
            // Row by row: compressed as a whole, the image would be in memory twice.
            let mut rows = writer.stream_writer()?;
            rows.write_all(pixels)?;
            rows.finish()?;
            Ok(())
        }
        ImageFormat::Jpeg(quality) => {
            let mut encoder = JpegEncoder::new_with_quality(&mut out, quality);
            let written = encoder.encode(pixels, width as u32, height as u32, ExtendedColorType::Rgb8);
            written.map_err(std::io::Error::other)
        }
        ImageFormat::WebP(quality) => out.write_all(&webp(pixels, [width, height], quality)?),
        ImageFormat::Ktx2(quality) => out.write_all(&ktx2(pixels, [width, height], quality)?),
    }
}

/// The bytes of an image file: red, green and blue of each pixel, row by row; `what` names it in errors.
///
/// # Errors
/// If the format cannot hold the image.
pub fn encode_in_memory(pixels: &[u8], size: [usize; 2], format: ImageFormat, what: &str) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    encode_into(pixels, size, format, &mut bytes).map_err(|error| Error::io(Path::new(what), "encode", error))?;
    Ok(bytes)
}

/// The bytes of a WebP with loss.
#[cfg(feature = "webp")]
fn webp(
    pixels: &[u8],
    [width, height]: [usize; 2],
    quality: u8,
) -> std::io::Result<impl std::ops::Deref<Target = [u8]>> {
    let encoder = webp::Encoder::from_rgb(pixels, width as u32, height as u32);
    let encoded = encoder.encode_simple(false, f32::from(quality));
    encoded.map_err(|error| std::io::Error::other(format!("WebP: {error:?}")))
}

/// Fails: the program is built without this encoder.
#[cfg(not(feature = "webp"))]
fn webp(_: &[u8], _: [usize; 2], quality: u8) -> std::io::Result<Vec<u8>> {
    Err(std::io::Error::other(ImageFormat::WebP(quality).check().err().unwrap_or_default()))
}

/// Fails: the program is built without this encoder.
#[cfg(not(feature = "ktx2"))]
fn ktx2(_: &[u8], _: [usize; 2], quality: u8) -> std::io::Result<Vec<u8>> {
    Err(std::io::Error::other(ImageFormat::Ktx2(quality).check().err().unwrap_or_default()))
}

/// A durable file that encoders write to.
struct Sink {
    file: DurableFile,
    /// Why a write failed: encoders pass on less.
    failure: Option<Error>,
}

impl Write for &mut Sink {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if let Err(failure) = self.file.write(bytes) {
            self.failure = Some(failure);
            return Err(std::io::Error::other("a write failed"));
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pixels of a smooth image.
    fn smooth([width, height]: [usize; 2]) -> Vec<u8> {
        let pixel = |at: usize| {
            let [x, y] = [at % width, at / width];
            [(3 * x) as u8, (4 * y) as u8, (x + y) as u8]
        };
        (0..width * height).flat_map(pixel).collect()
    }

    #[test]
    fn an_image_is_read_as_it_was_written() {
        let size = [60, 44];
        let pixels = smooth(size);
        for (format, most) in [(ImageFormat::Png, 0.0), (ImageFormat::Jpeg(90), 3.0), (ImageFormat::WebP(90), 3.0)] {
            let file = match encode_in_memory(&pixels, size, format, "pixels") {
                Err(error) if format.check().is_err() => {
                    assert!(error.to_string().contains("--features"), "{format}");
                    continue;
                }
                written => written.unwrap(),
            };
            let read = image::load_from_memory(&file).unwrap().into_rgb8();
            assert_eq!([read.width(), read.height()], size.map(|side| side as u32));
            let difference: f64 = read.iter().zip(&pixels).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
            assert!(difference <= most * pixels.len() as f64, "{format}: {difference}");
            assert!(file == encode_in_memory(&pixels, size, format, "pixels").unwrap(), "{format}");
        }
    }
}

//! Finds damage in image files of tiles.
//!
//! ```text
//! JPEG    markers and codes, to the last bit             see jpeg_scan
//! PNG     decoded, with its checksums
//! WebP    length, decoded
//! KTX2    header, and where its parts lie; its blocks are not decoded
//! ```
//! In: untrusted bytes. Out: width and height, or what is wrong. Damage that a decoder takes for other colours is not
//! found.
//!
//! # Memory
//! That of an image of `PIXELS_MAX` pixels, 8 bytes each, and its decoder.
//!
//! # Source
//! Khronos, KTX file format 2.0; Google, WebP container specification; W3C, PNG.

use std::io::Cursor;
use std::ops::Range;

use image::{ImageDecoder, ImageFormat, ImageReader, Limits};

use super::jpeg_scan::scan_jpeg;

/// Pixels of an image that is decoded, at most: more than a tile has.
const PIXELS_MAX: u64 = 1 << 24;
/// Memory of a pixel at most, in bytes, and of a decoder.
const PIXEL_BYTES_MAX: u64 = 8;
const DECODER_BYTES: u64 = 64 << 20;
/// The chunk that a PNG ends with.
const PNG_END: [u8; 12] = *b"\0\0\0\0IEND\xae\x42\x60\x82";
/// Bytes in front of the levels of a KTX2, and of an entry in their list.
const KTX2_HEADER: usize = 80;
const KTX2_LEVEL: usize = 24;
const KTX2_IDENTIFIER: &[u8] = b"\xabKTX 20\xbb\r\n\x1a\n";
/// Levels of a KTX2 at most.
const KTX2_LEVELS_MAX: usize = 32;

/// Reads an image file of a type; returns its width and height.
///
/// # Errors
/// What is wrong with it.
pub fn sound_size(bytes: &[u8], media_type: &str) -> Result<[u32; 2], String> {
    let size = match media_type {
        "image/jpeg" => scan_jpeg(bytes)?,
        "image/png" if !bytes.ends_with(&PNG_END) => return Err("the PNG ends early".into()),
        "image/png" => decoded_size(bytes, ImageFormat::Png)?,
        "image/webp" if !is_riff(bytes) => return Err("the WebP has another length than it says".into()),
        "image/webp" => decoded_size(bytes, ImageFormat::WebP)?,
        "image/ktx2" => ktx2_size(bytes).ok_or("the parts of the KTX2 do not fit it")?,
        other => return Err(format!("an image of type '{other}'")),
    };
    let [width, height] = size;
    let is_plausible = (1..=PIXELS_MAX).contains(&(u64::from(width) * u64::from(height)));
    if is_plausible { Ok(size) } else { Err(format!("an image of {width} x {height} pixels")) }
}

/// Decodes an image.
fn decoded_size(bytes: &[u8], format: ImageFormat) -> Result<[u32; 2], String> {
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = Limits::default();
    limits.max_alloc = Some(PIXELS_MAX * PIXEL_BYTES_MAX + DECODER_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|error| error.to_string())?;
    let (width, height) = decoder.dimensions();
    if u64::from(width) * u64::from(height) > PIXELS_MAX {
        return Err(format!("an image of {width} x {height} pixels"));
    }
    let mut pixels = vec![0; decoder.total_bytes() as usize];
    decoder.read_image(&mut pixels).map_err(|error| error.to_string())?;
    Ok([width, height])
}

/// Whether a file is as long as its header says.
fn is_riff(bytes: &[u8]) -> bool {
    bytes.starts_with(b"RIFF") && number(bytes, 4, 4).and_then(|length| length.checked_add(8)) == Some(bytes.len())
}

/// A little-endian number of `bytes` bytes.
fn number(file: &[u8], at: usize, bytes: usize) -> Option<usize> {
    let number =
        file.get(at..at.checked_add(bytes)?)?.iter().rev().fold(0_u64, |all, &byte| all << 8 | u64::from(byte));
    usize::try_from(number).ok()
}

/// A part of a file, whose place and length stand at `at` in `bytes` bytes each.
fn part(file: &[u8], at: usize, bytes: usize) -> Option<Range<usize>> {
    let (start, length) = (number(file, at, bytes)?, number(file, at + bytes, bytes)?);
    let part = start..start.checked_add(length)?;
    (part.end <= file.len()).then_some(part)
}

/// Width and height of a KTX2 of one image; `None` if it is none, or its parts do not fit it.
fn ktx2_size(file: &[u8]) -> Option<[u32; 2]> {
    let word = |at: usize| number(file, at, 4);
    let size = [word(20)? as u32, word(24)? as u32];
    let (flat, levels) = ([word(28)?, word(32)?, word(36)?], word(40)?);
    if !file.starts_with(KTX2_IDENTIFIER) || flat != [0, 0, 1] || !(1..=KTX2_LEVELS_MAX).contains(&levels) {
        return None;
    }
    let entries = (0..levels).map(|level| part(file, KTX2_HEADER + level * KTX2_LEVEL, 8));
    let entries: Vec<Range<usize>> = entries.collect::<Option<_>>()?;
    let (descriptor, _, global) = (part(file, 48, 4)?, part(file, 56, 4)?, part(file, 64, 8)?);
    let last = entries.iter().chain([&global]).map(|part| part.end).max()?;
    let first = KTX2_HEADER + levels * KTX2_LEVEL;
    let is_whole = entries.iter().all(|level| level.start >= first && !level.is_empty()) && last == file.len();
    let has_descriptor = descriptor.start >= first && word(descriptor.start)? == descriptor.len();
    let has_slices = word(44)? != 1 || has_slices(&file[global], &entries)?;
    (is_whole && has_descriptor && has_slices).then_some(size)
}

/// Whether the tables of a KTX2 with BasisLZ are as long as they say, and each level holds its slice.
fn has_slices(global: &[u8], levels: &[Range<usize>]) -> Option<bool> {
    let lengths = [4, 8, 12, 16].map(|at| number(global, at, 4));
    let tables = lengths.into_iter().try_fold(20 + 20 * levels.len(), |all, length| all.checked_add(length?))?;
    let holds = |(entry, level): (usize, &Range<usize>)| {
        let [start, length] = [4, 8].map(|at| number(global, entry + at, 4));
        start.zip(length).and_then(|(start, length)| start.checked_add(length)).is_some_and(|end| end <= level.len())
    };
    let are_held = (20..).step_by(20).zip(levels).all(holds);
    Some(tables == global.len() && are_held)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::encode::encode_in_memory;
    use proptest::prelude::*;

    const PIXELS: usize = 3 * 40 * 24;

    fn pixels() -> Vec<u8> {
        (0..PIXELS).map(|at| (at * at / 50) as u8).collect()
    }

    fn png() -> Vec<u8> {
        encode_in_memory(&pixels(), [40, 24], crate::model::image_format::ImageFormat::Png, "pixels").unwrap()
    }

    fn webp() -> Vec<u8> {
        let mut file = Vec::new();
        let encoder = image::codecs::webp::WebPEncoder::new_lossless(&mut file);
        encoder.encode(&pixels(), 40, 24, image::ExtendedColorType::Rgb8).unwrap();
        file
    }

    /// A KTX2 with BasisLZ of two levels, with 4 bytes each and 5 of tables.
    fn ktx2() -> Vec<u8> {
        let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
        let longs = |longs: &[u64]| longs.iter().flat_map(|long| long.to_le_bytes()).collect::<Vec<u8>>();
        let global = [words(&[1 << 16 | 1, 2, 2, 1, 0]), words(&[0, 0, 4, 0, 0, 0, 0, 4, 0, 0]), vec![7; 5]].concat();
        let (descriptor, start) = (128_u32, 172_u32);
        let last = u64::from(start) + global.len() as u64;
        [
            KTX2_IDENTIFIER.to_vec(),
            words(&[0, 1, 40, 24, 0, 0, 1, 2, 1, descriptor, 44, 0, 0]),
            longs(&[start.into(), global.len() as u64, last + 4, 4, 0, last, 4, 0]),
            words(&[44, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]),
            global,
            vec![9; 8],
        ]
        .concat()
    }

    #[test]
    fn whole_files_have_a_size_and_no_part_of_one_has() {
        for (file, media_type) in [(png(), "image/png"), (webp(), "image/webp"), (ktx2(), "image/ktx2")] {
            assert_eq!(sound_size(&file, media_type), Ok([40, 24]), "{media_type}");
            for length in 0..file.len() {
                assert!(sound_size(&file[..length], media_type).is_err(), "{media_type}: {length} bytes");
            }
            let headless = [&[0; 8], &file[8..]].concat();
            assert!(sound_size(&headless, media_type).is_err(), "{media_type}");
            assert!(sound_size(&file, "image/jpeg").is_err() && sound_size(&file, "").is_err());
        }
    }

    #[test]
    fn any_byte_of_a_png_counts() {
        let file = png();
        for at in 0..file.len() {
            let mut damaged = file.clone();
            damaged[at] ^= 0x55;
            assert!(sound_size(&damaged, "image/png").is_err(), "byte {at} of {}", file.len());
        }
    }

    #[test]
    fn a_size_that_no_tile_has_is_refused() {
        let mut large = ktx2();
        large[20..24].copy_from_slice(&40_000_u32.to_le_bytes());
        assert_eq!(sound_size(&large, "image/ktx2"), Ok([40_000, 24]));
        large[24..28].copy_from_slice(&40_000_u32.to_le_bytes());
        assert!(sound_size(&large, "image/ktx2").unwrap_err().contains("40000 x 40000"));
        large[24..28].fill(0);
        assert!(sound_size(&large, "image/ktx2").is_err());
    }

    #[cfg(feature = "ktx2")]
    #[test]
    fn a_ktx2_of_this_program_is_whole() {
        let file = crate::image::ktx2::ktx2(&pixels(), [40, 24], 80).unwrap();
        assert_eq!(sound_size(&file, "image/ktx2"), Ok([40, 24]));
        assert!(sound_size(&file[..file.len() - 1], "image/ktx2").is_err());
    }

    proptest! {
        #[test]
        fn damaged_images_are_refused_or_read(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
            for (mut file, media_type) in [(png(), "image/png"), (webp(), "image/webp"), (ktx2(), "image/ktx2")] {
                for (at, byte) in &changes {
                    let at = at.index(file.len());
                    file[at] = *byte;
                }
                let _ = sound_size(&file, media_type);
            }
        }
    }
}

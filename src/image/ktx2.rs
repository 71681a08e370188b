//! KTX2 images for textures of glTF (`KHR_texture_basisu`): ETC1S with BasisLZ, and all levels down to one pixel.
//!
//! ```text
//! pixels ── encoder of Basis Universal ──▶ .basis: palettes, tables, a slice for each level
//!                                            ╰─ the same parts in the order of KTX2
//! ```
//! The encoder's crate writes `.basis` files only; a KTX2 with BasisLZ holds the same parts, byte by byte.
//!
//! # Memory
//! 96 bytes a pixel while an image is encoded.
//!
//! # Source
//! Khronos, KTX file format 2.0, sections 3 to 5; Binomial, `.basis` file format.

use std::io::{Error, Result};

use basis_universal::{BasisTextureFormat, ColorSpace, Compressor, CompressorParams};

/// The encoder's best quality.
const ENCODER_QUALITY_MAX: u32 = 255;
const IDENTIFIER: [u8; 12] = *b"\xabKTX 20\xbb\r\n\x1a\n";
const WRITER: &[u8] = concat!("KTXwriter\0drystone ", env!("CARGO_PKG_VERSION"), "\0").as_bytes();
const BASIS_LZ: u32 = 1;
/// Bytes in front of the list of levels, and of an entry in it.
const HEADER_BYTES: usize = 80;
const LEVEL_BYTES: usize = 24;
/// Of a slice's entry in a `.basis` file.
const SLICE_BYTES: usize = 23;
/// The data format descriptor: color model ETC1S, primaries of BT.709, sRGB, blocks of 4 x 4, one channel RGB.
const DESCRIPTOR: [u32; 11] = [44, 0, 40 << 16 | 2, 2 << 16 | 1 << 8 | 163, 3 << 8 | 3, 0, 0, 63 << 16, 0, 0, u32::MAX];

/// The bytes of a KTX2: red, green and blue of each pixel, row by row; a quality from 1 to 100.
///
/// # Errors
/// If a side is no multiple of 4, and if the encoder fails.
pub fn ktx2(pixels: &[u8], [width, height]: [usize; 2], quality: u8) -> Result<Vec<u8>> {
    if !width.is_multiple_of(4) || !height.is_multiple_of(4) || pixels.len() != 3 * width * height {
        return Err(Error::other(format!("KTX2: expected sides that are multiples of 4, found {width} x {height}")));
    }
    let size = [width as u32, height as u32];
    let mut parameters = CompressorParams::new();
    parameters.set_basis_format(BasisTextureFormat::ETC1S);
    parameters.set_etc1s_quality_level((u32::from(quality) * ENCODER_QUALITY_MAX / 100).max(1));
    parameters.set_color_space(ColorSpace::Srgb);
    parameters.set_generate_mipmaps(true);
    parameters.source_image_mut(0).init(pixels, size[0], size[1], 3);
    let mut encoder = Compressor::new(1);
    // SAFETY: the parameters are the encoder's own defaults besides those above, each in its range, and the image has as
    // many bytes as its size says. What stays possible is a fault of the encoder itself.
    #[allow(unsafe_code)]
    let encoded = unsafe { encoder.init(&parameters) && encoder.process().is_ok() };
    let packed = encoded.then(|| repack(encoder.basis_file(), size)).flatten();
    packed.ok_or_else(|| Error::other("KTX2: the encoder failed"))
}

/// A little-endian number of `bytes` bytes.
fn number(file: &[u8], at: usize, bytes: usize) -> Option<usize> {
    Some(file.get(at..at + bytes)?.iter().rev().fold(0, |number, &byte| number << 8 | usize::from(byte)))
}

/// A part of a file, whose place and size stand at `at`, in 4 and `size_bytes` bytes.
fn part(file: &[u8], at: usize, size_bytes: usize) -> Option<&[u8]> {
    let (start, size) = (number(file, at, 4)?, number(file, at + 4, size_bytes)?);
    file.get(start..start.checked_add(size)?)
}

/// The parts of a `.basis` file of one image as a KTX2; `None` if it is none.
fn repack(basis: &[u8], size: [u32; 2]) -> Option<Vec<u8>> {
    let [endpoint_count, selector_count] = [number(basis, 39, 2)?, number(basis, 48, 2)?];
    let [endpoints, selectors, tables] = [part(basis, 41, 3)?, part(basis, 50, 3)?, part(basis, 57, 4)?];
    let (slice_count, first) = (number(basis, 14, 3)?, number(basis, 65, 4)?);
    let slice = |level: usize| part(basis, first + level * SLICE_BYTES + 13, 4);
    let levels: Vec<&[u8]> = (0..slice_count).map(slice).collect::<Option<_>>()?;

    let mut global = Vec::new();
    [endpoint_count, selector_count].iter().for_each(|&count| global.extend((count as u16).to_le_bytes()));
    put(&[endpoints.len() as u32, selectors.len() as u32, tables.len() as u32, 0], &mut global);
    levels.iter().for_each(|level| put(&[0, 0, level.len() as u32, 0, 0], &mut global));
    [endpoints, selectors, tables].iter().for_each(|part| global.extend_from_slice(part));

    let descriptor_at = HEADER_BYTES + levels.len() * LEVEL_BYTES;
    let writer_at = descriptor_at + 4 * DESCRIPTOR.len();
    let writer_bytes = (4 + WRITER.len()).next_multiple_of(4);
    let global_at = (writer_at + writer_bytes).next_multiple_of(8);
    let mut out = IDENTIFIER.to_vec();
    // No format of Vulkan; one byte; no depth, no layers, one face.
    put(&[0, 1, size[0], size[1], 0, 0, 1, levels.len() as u32, BASIS_LZ], &mut out);
    put(&[descriptor_at as u32, 4 * DESCRIPTOR.len() as u32, writer_at as u32, writer_bytes as u32], &mut out);
    [global_at, global.len()].iter().for_each(|&number| out.extend((number as u64).to_le_bytes()));
    // The smallest level lies first, the largest one is listed first.
    let bytes_above = |number: usize| levels[number + 1..].iter().map(|level| level.len()).sum::<usize>();
    for (number, level) in levels.iter().enumerate() {
        let place = [global_at + global.len() + bytes_above(number), level.len(), 0];
        place.iter().for_each(|&number| out.extend((number as u64).to_le_bytes()));
    }
    put(&DESCRIPTOR, &mut out);
    put(&[WRITER.len() as u32], &mut out);
    out.extend_from_slice(WRITER);
    out.resize(global_at, 0);
    out.append(&mut global);
    levels.iter().rev().for_each(|level| out.extend_from_slice(level));
    Some(out)
}

fn put(words: &[u32], out: &mut Vec<u8>) {
    words.iter().for_each(|word| out.extend(word.to_le_bytes()));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_holds_all_levels_one_after_another() {
        let pixels: Vec<u8> = (0..3 * 64 * 20).map(|at| (at * at / 50) as u8).collect();
        let file = ktx2(&pixels, [64, 20], 80).unwrap();
        assert_eq!(&file[..12], IDENTIFIER);
        let word = |at| number(&file, at, 4).unwrap();
        let [size, levels] = [[word(20), word(24)], [word(40), word(44)]];
        assert_eq!((size, levels), ([64, 20], [7, BASIS_LZ as usize]));
        let long = |at| number(&file, at, 8).unwrap();
        let mut end = long(64) + long(72);
        for level in (0..7).rev().map(|level| HEADER_BYTES + level * LEVEL_BYTES) {
            assert_eq!((long(level), long(level + 16)), (end, 0));
            end += long(level + 8);
        }
        assert_eq!(end, file.len());
        assert!(file == ktx2(&pixels, [64, 20], 80).unwrap());
    }

    #[test]
    fn other_sides_and_files_are_refused() {
        assert!(ktx2(&[0; 3 * 4 * 6], [4, 6], 80).is_err());
        assert!(ktx2(&[0; 3], [4, 4], 80).is_err());
        assert!(repack(&[], [4, 4]).is_none() && repack(&[255; 100], [4, 4]).is_none());
    }
}

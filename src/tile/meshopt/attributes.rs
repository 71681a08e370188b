//! Vertices: the bytes of each as differences from the vertex before, 16 vertices a group.
//!
//! ```text
//! 0xa0 │ block of up to 256 vertices │ block │ … │ zeros │ first vertex
//!        ╰─ for each byte of a vertex: 2 bits a group │ its 16 differences in 0, 2, 4 or 8 bits each
//! ```
//! A difference that 2 or 4 bits do not hold has all of them set; its byte follows those of the group.

use super::{DECODED_BYTES_MAX, StreamFault};

/// First byte of a stream.
const HEADER: u8 = 0xa0;
/// Vertices of a group.
const GROUP: usize = 16;
/// Vertices of a block at most, and bytes.
const BLOCK_VERTICES: usize = 256;
const BLOCK_BYTES: usize = 8192;
/// Least bytes behind the last block.
const TAIL_BYTES: usize = 32;
/// Bits of a difference, by the two bits of its group.
const BITS: [u32; 4] = [0, 2, 4, 8];
/// A stream is at least this many times smaller than what it holds: 2 bits stand for 16 bytes.
const RATIO_MAX: usize = 64;

/// Vertices of a block.
fn block_size(stride: usize) -> usize {
    (BLOCK_BYTES / stride / GROUP * GROUP).min(BLOCK_VERTICES)
}

/// Compresses vertices of `stride` bytes each, a multiple of 4 up to 256.
///
/// # Panics
/// If `vertices` holds no whole number of them.
pub fn encode_attributes(vertices: &[u8], stride: usize) -> Vec<u8> {
    assert!(vertices.len().is_multiple_of(stride), "{} bytes of vertices of {stride}", vertices.len());
    let mut out = vec![HEADER];
    let first = vertices.get(..stride).map_or_else(|| vec![0; stride], <[u8]>::to_vec);
    let mut last = first.clone();
    for block in vertices.chunks(block_size(stride) * stride) {
        for (at, last) in last.iter_mut().enumerate() {
            let mut differences: Vec<u8> = Vec::with_capacity(BLOCK_VERTICES);
            for vertex in block.chunks_exact(stride) {
                differences.push(zigzag(vertex[at].wrapping_sub(*last)));
                *last = vertex[at];
            }
            differences.resize(differences.len().next_multiple_of(GROUP), 0);
            put_groups(&differences, &mut out);
        }
    }
    out.resize(out.len() + TAIL_BYTES.saturating_sub(stride), 0);
    out.extend(first);
    out
}

/// Adds the groups of one byte of the vertices of a block.
fn put_groups(differences: &[u8], out: &mut Vec<u8>) {
    let (groups, _) = differences.as_chunks::<GROUP>();
    let modes: Vec<u8> = groups.iter().map(smallest).collect();
    for four in modes.chunks(4) {
        out.push(four.iter().zip([0, 2, 4, 6]).fold(0, |byte, (mode, shift)| byte | mode << shift));
    }
    for (group, mode) in groups.iter().zip(modes) {
        let bits = BITS[usize::from(mode)];
        match mode {
            0 => {}
            3 => out.extend(group),
            _ => {
                let most = (1 << bits) - 1;
                for part in group.chunks(8 / bits as usize) {
                    out.push(part.iter().fold(0, |byte, &difference| byte << bits | difference.min(most)));
                }
                out.extend(group.iter().filter(|&&difference| difference >= most));
            }
        }
    }
}

/// The mode that needs the fewest bytes for a group.
fn smallest(group: &[u8; GROUP]) -> u8 {
    let bytes = |&mode: &u8| {
        let beyond = |most: u8| group.iter().filter(|&&difference| difference >= most).count();
        match mode {
            0 if beyond(1) > 0 => usize::MAX,
            0 => 0,
            1 => 4 + beyond(3),
            2 => 8 + beyond(15),
            _ => GROUP,
        }
    };
    (0..4).min_by_key(bytes).unwrap_or(3)
}

/// Decodes `count` vertices of `stride` bytes each. Nothing larger than 64 times the stream is allocated.
///
/// # Errors
/// What is wrong with the stream.
pub fn decode_attributes(stream: &[u8], count: usize, stride: usize) -> Result<Vec<u8>, StreamFault> {
    if stride == 0 || stride > 256 || !stride.is_multiple_of(4) {
        return Err("the length of its vertices is no multiple of 4 up to 256");
    }
    let bytes = count.checked_mul(stride).filter(|&bytes| bytes <= DECODED_BYTES_MAX);
    let bytes =
        bytes.filter(|bytes| bytes / RATIO_MAX <= stream.len()).ok_or("it names more vertices than it holds")?;
    let tail = stride.max(TAIL_BYTES);
    if stream.first() != Some(&HEADER) || stream.len() <= tail {
        return Err("its vertices have another header");
    }
    let mut blocks = &stream[1..stream.len() - tail];
    let mut last = stream[stream.len() - stride..].to_vec();
    let mut out = vec![0; bytes];
    for block in out.chunks_mut(block_size(stride) * stride) {
        for (at, last) in last.iter_mut().enumerate() {
            let groups = (block.len() / stride).div_ceil(GROUP);
            let modes = take(&mut blocks, groups.div_ceil(4))?;
            for (group, vertices) in block.chunks_mut(GROUP * stride).enumerate() {
                let mode = modes[group / 4] >> (2 * (group % 4)) & 3;
                let differences = take_group(&mut blocks, mode)?;
                for (vertex, difference) in vertices.chunks_exact_mut(stride).zip(differences) {
                    *last = last.wrapping_add(unzigzag(difference));
                    vertex[at] = *last;
                }
            }
        }
    }
    if blocks.is_empty() { Ok(out) } else { Err("bytes follow its vertices") }
}

/// The 16 differences of a group.
fn take_group(blocks: &mut &[u8], mode: u8) -> Result<[u8; GROUP], StreamFault> {
    let bits = BITS[usize::from(mode)];
    let mut group = [0; GROUP];
    match mode {
        0 => {}
        3 => group.copy_from_slice(take(blocks, GROUP)?),
        _ => {
            let most = (1 << bits) - 1;
            let packed = take(blocks, GROUP * bits as usize / 8)?;
            for (part, byte) in group.chunks_mut(8 / bits as usize).zip(packed) {
                for (place, difference) in part.iter_mut().rev().enumerate() {
                    *difference = byte >> (bits * place as u32) & most;
                }
            }
            for difference in group.iter_mut().filter(|difference| **difference == most) {
                *difference = take(blocks, 1)?[0];
            }
        }
    }
    Ok(group)
}

/// Takes the first bytes of a stream.
fn take<'a>(stream: &mut &'a [u8], count: usize) -> Result<&'a [u8], StreamFault> {
    let (taken, rest) = stream.split_at_checked(count).ok_or("its vertices end too early")?;
    *stream = rest;
    Ok(taken)
}

/// Small numbers of either sign as small numbers.
fn zigzag(difference: u8) -> u8 {
    if difference < 0x80 { difference << 1 } else { !(difference << 1) }
}

fn unzigzag(code: u8) -> u8 {
    if code & 1 == 0 { code >> 1 } else { !(code >> 1) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_example_of_the_standard_is_read() {
        let stream = [0x17, 0x5f, 0xf0, 0xbc, 0x77, 0xa9, 0x21, 0x00, 0x34, 0xb5];
        let group = take_group(&mut &stream[..], 2).unwrap();
        let found = group.map(|code| unzigzag(code) as i8);
        assert_eq!(found, [-1, -4, -3, 26, -91, 0, -6, 6, -4, -4, 5, -5, 1, -1, 0, 0]);
    }

    #[test]
    fn equal_vertices_take_almost_no_bytes() {
        let vertices = [7, 0, 3, 200].repeat(256);
        let stream = encode_attributes(&vertices, 4);
        // The header, four bytes of modes for each byte of a vertex, and the tail.
        assert_eq!(stream.len(), 1 + 4 * 4 + 32);
        assert_eq!(decode_attributes(&stream, 256, 4), Ok(vertices));
    }

    #[test]
    fn a_number_that_the_stream_does_not_hold_is_refused_before_anything_is_allocated() {
        let stream = encode_attributes(&[1; 12], 12);
        for (count, stride) in [(usize::MAX, 12), (1 << 40, 12), (1, 0), (1, 6), (1, 512), (65, 12), (0, 12), (1, 8)] {
            assert!(decode_attributes(&stream, count, stride).is_err(), "{count} of {stride}");
        }
        assert!(decode_attributes(&[], 0, 12).is_err());
    }

    proptest! {
        #[test]
        fn vertices_are_read_as_they_were_written(
            stride in (1_usize..=64).prop_map(|words| 4 * words),
            count in 0_usize..600,
            seeds in prop::collection::vec(any::<u8>(), 1..40),
            spread in 1_u8..,
        ) {
            let byte = |at: usize| seeds[at % seeds.len()] % spread;
            let vertices: Vec<u8> = (0..count * stride).map(byte).collect();
            let stream = encode_attributes(&vertices, stride);
            prop_assert_eq!(decode_attributes(&stream, count, stride), Ok(vertices));
        }

        #[test]
        fn damaged_streams_are_refused_or_read(
            changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
            cut in any::<prop::sample::Index>(),
            count in 0_usize..2000,
        ) {
            let vertices: Vec<u8> = (0..300 * 12).map(|at| (at * at / 7) as u8).collect();
            let mut stream = encode_attributes(&vertices, 12);
            for (at, byte) in changes {
                let at = at.index(stream.len());
                stream[at] = byte;
            }
            let _ = decode_attributes(&stream, 300, 12);
            let _ = decode_attributes(&stream, count, 12);
            stream.truncate(cut.index(stream.len()));
            let _ = decode_attributes(&stream, 300, 12);
        }
    }
}

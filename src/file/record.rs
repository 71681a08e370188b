//! Records by cell, as bytes: how those of one extent are encoded together.

use bytemuck::Pod;
use glam::DVec2;

use crate::file::packed::{self, Coordinates};
use crate::file::varint::{self, VARINT_BYTES_MAX, unzigzag, zigzag};

/// A record that is encoded together with others of its cell.
pub trait Record: Copy + Send + Sync {
    /// Appends the encoded records to `out`.
    fn encode(records: &[Self], out: &mut Vec<u8>);

    /// Decodes `count` records and appends them to `out`.
    ///
    /// # Errors
    /// A description of the fault if the bytes are invalid.
    fn decode(bytes: &[u8], count: usize, out: &mut Vec<Self>) -> Result<(), String>;
}

/// Appends pairs of numbers to `out`, each number as the difference from that of the pair before.
pub fn encode_pairs(pairs: impl ExactSizeIterator<Item = [u32; 2]>, out: &mut Vec<u8>) {
    let mut at = out.len();
    out.resize(at + pairs.len() * 2 * VARINT_BYTES_MAX, 0);
    let mut last = [0; 2];
    for pair in pairs {
        for (number, last) in pair.into_iter().zip(&mut last) {
            at = varint::put(out, at, zigzag(i64::from(number) - *last));
            *last = i64::from(number);
        }
    }
    out.truncate(at);
}

/// Decodes `count` pairs of numbers.
///
/// # Errors
/// A description of the fault if the bytes are invalid.
pub fn decode_pairs(bytes: &[u8], count: usize, mut take: impl FnMut([u32; 2])) -> Result<(), String> {
    let (mut at, mut last) = (0, [0i64; 2]);
    for _ in 0..count {
        for last in &mut last {
            let difference = varint::take(bytes, &mut at).ok_or("an extent ends inside a number")?;
            *last = last.wrapping_add(unzigzag(difference));
        }
        take(last.map(|number| number as u32));
    }
    if at == bytes.len() { Ok(()) } else { Err(format!("{} bytes are left after an extent", bytes.len() - at)) }
}

impl Record for DVec2 {
    fn encode(records: &[Self], out: &mut Vec<u8>) {
        encode_coordinates(records, out);
    }

    fn decode(bytes: &[u8], count: usize, out: &mut Vec<Self>) -> Result<(), String> {
        let rest = decode_coordinates(bytes, count, out)?;
        if rest.is_empty() { Ok(()) } else { Err(format!("{} bytes are left after an extent", rest.len())) }
    }
}

/// A record that is stored as it lies in memory.
pub trait Verbatim: Pod + Send + Sync {}

impl<T: Verbatim> Record for T {
    fn encode(records: &[Self], out: &mut Vec<u8>) {
        out.extend_from_slice(bytemuck::cast_slice(records));
    }

    fn decode(bytes: &[u8], count: usize, out: &mut Vec<Self>) -> Result<(), String> {
        if bytes.len() != count * size_of::<Self>() {
            return Err(format!("{} bytes for {count} records", bytes.len()));
        }
        out.extend(bytes.chunks_exact(size_of::<Self>()).map(bytemuck::pod_read_unaligned::<Self>));
        Ok(())
    }
}

/// Encodes coordinates in blocks, each preceded by its length.
pub fn encode_coordinates<T: Coordinates>(records: &[T], out: &mut Vec<u8>) {
    let mut decimals = 0;
    for records in records.chunks(packed::BLOCK_RECORDS) {
        let start = out.len();
        out.extend([0; 4]);
        packed::encode_block(records, &mut decimals, out);
        let bytes = (out.len() - start - 4) as u32;
        out[start..start + 4].copy_from_slice(&bytes.to_le_bytes());
    }
}

/// Decodes `count` coordinates from the front of `bytes`; returns the remaining bytes.
pub fn decode_coordinates<'a, T: Coordinates>(
    mut bytes: &'a [u8],
    count: usize,
    out: &mut Vec<T>,
) -> Result<&'a [u8], String> {
    let mut left = count;
    while left > 0 {
        let (length, rest) = bytes.split_first_chunk::<4>().ok_or("an extent ends before a block")?;
        let (block, rest) =
            rest.split_at_checked(u32::from_le_bytes(*length) as usize).ok_or("an extent ends inside a block")?;
        packed::decode_block(block, left.min(packed::BLOCK_RECORDS), out)?;
        left = left.saturating_sub(packed::BLOCK_RECORDS);
        bytes = rest;
    }
    Ok(bytes)
}

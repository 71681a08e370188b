//! Encodes integers in few bytes: seven bits per byte, the low ones first; the top bit marks that more follow.
//!
//! # Source
//! LEB128 as in DWARF; signed numbers by zigzag as in Protocol Buffers.

/// Largest size of a 64-bit number in bytes.
pub const VARINT_BYTES_MAX: usize = 10;

/// Folds a signed number to an unsigned one: 0, -1, 1, -2, 2, … become 0, 1, 2, 3, 4, …
#[inline]
pub fn zigzag(number: i64) -> u64 {
    (number << 1 ^ number >> 63) as u64
}

/// Inverse of [`zigzag`].
#[inline]
pub fn unzigzag(number: u64) -> i64 {
    (number >> 1) as i64 ^ -((number & 1) as i64)
}

/// Writes a number at `at`, where [`VARINT_BYTES_MAX`] bytes must be available; returns the offset after it.
#[inline]
pub fn put(out: &mut [u8], mut at: usize, mut number: u64) -> usize {
    while number >= 0x80 {
        out[at] = number as u8 | 0x80;
        number >>= 7;
        at += 1;
    }
    out[at] = number as u8;
    at + 1
}

/// Reads the number at `at` and advances `at` past it; `None` if it is truncated or exceeds 64 bits.
///
/// Nearly all numbers have up to four bytes, which are read together: how many there are is hard to foresee, so a
/// branch for each would cost more.
#[inline(always)]
pub fn take(bytes: &[u8], at: &mut usize) -> Option<u64> {
    let rest = bytes.get(*at..)?;
    let word = rest.first_chunk().map_or(u32::MAX, |word| u32::from_le_bytes(*word));
    let ends = !word & 0x8080_8080;
    if ends == 0 {
        let (number, length) = take_slowly(rest);
        *at += length;
        return (length > 0).then_some(number);
    }
    *at += ends.trailing_zeros() as usize / 8 + 1;
    let word = word & (ends ^ (ends - 1));
    let pairs = word & 0x007f_007f | (word & 0x7f00_7f00) >> 1;
    Some(u64::from(pairs & 0x3fff | pairs >> 2 & 0x0fff_c000))
}

/// The number that `rest` begins with and its length, byte by byte; a length of 0 if it is truncated or too large.
#[cold]
fn take_slowly(rest: &[u8]) -> (u64, usize) {
    let mut number = 0;
    for (place, &byte) in rest.iter().enumerate().take(VARINT_BYTES_MAX) {
        let shift = 7 * place as u32;
        number |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return (number, if shift < 63 || byte < 2 { place + 1 } else { 0 });
        }
    }
    (0, 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn numbers_come_back_as_they_were(numbers in prop::collection::vec((any::<u64>(), 0u32..64), 0..50)) {
            let numbers: Vec<u64> = numbers.into_iter().map(|(number, shift)| number >> shift).collect();
            let mut out = vec![0; numbers.len() * VARINT_BYTES_MAX];
            let end = numbers.iter().fold(0, |at, &number| put(&mut out, at, number));
            let mut at = 0;
            for &number in &numbers {
                prop_assert_eq!(take(&out[..end], &mut at), Some(number));
            }
            prop_assert_eq!(at, end);
        }

        #[test]
        fn zigzag_keeps_every_number(number in any::<i64>()) {
            prop_assert_eq!(unzigzag(zigzag(number)), number);
        }
    }

    #[test]
    fn what_is_cut_off_or_too_long_is_refused() {
        assert_eq!(take(&[0x80, 0x80], &mut 0), None);
        assert_eq!(take(&[], &mut 0), None);
        assert_eq!(take(&[0; 3], &mut 4), None);
        assert_eq!(take(&[0xff; 12], &mut 0), None);
    }
}

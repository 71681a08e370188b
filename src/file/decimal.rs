//! Converts doubles that come from decimal text to integer counts of their last decimal place.
//!
//! Most coordinates come from text with few decimals, or were rounded to few: 4581200.1234 is 45812001234 · 10⁻⁴. The
//! quotient of two doubles is the double nearest to the true quotient, which is also how a parser reads a text with
//! that many decimals. So count and decimals restore the coordinate bit for bit.

/// Largest number of decimals tried.
pub const DECIMALS_MAX: u32 = 15;

/// Powers of ten.
pub const POWERS_OF_TEN: [f64; 18] =
    [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17];
/// Numbers of this size have no fraction, so adding and subtracting it rounds to an integer.
const ROUNDER: f64 = 1.5 * (1u64 << 52) as f64;
/// Limit of the magnitude of counts, so that they are exact and `ROUNDER` rounds them.
const COUNT_LIMIT: f64 = (1u64 << 51) as f64;
/// Numbers converted at once, without a branch, so that the compiler converts several with one instruction.
const AT_ONCE: usize = 64;

/// Returns `x` in units of the last of `decimals` places; `None` if that is not an integer.
#[inline]
pub fn count(x: f64, decimals: u32) -> Option<i64> {
    let (count, is_exact) = rounded_count(x, POWERS_OF_TEN[decimals as usize]);
    is_exact.then_some(count)
}

/// Returns `x` in units of 1 / `power`, rounded, and whether that is exact.
#[inline(always)]
fn rounded_count(x: f64, power: f64) -> (i64, bool) {
    let scaled = x * power;
    let sum = scaled + ROUNDER;
    // NOTE: negative zero and non-finite numbers fail this comparison of bits.
    let is_exact = (scaled.abs() < COUNT_LIMIT) & (((sum - ROUNDER) / power).to_bits() == x.to_bits());
    // Neighbours of `ROUNDER` are 1 apart, so their bits count up like integers.
    (sum.to_bits().wrapping_sub(ROUNDER.to_bits()) as i64, is_exact)
}

/// Returns the number that is `count` units of the last of `decimals` places.
#[inline]
pub fn value(count: i64, decimals: u32) -> f64 {
    count as f64 / POWERS_OF_TEN[decimals as usize]
}

/// Converts all numbers to counts with the fewest common decimals, at least `at_least`. Returns those decimals; `None`
/// if no number of decimals fits all.
pub fn counts(numbers: &[f64], at_least: u32, out: &mut Vec<i64>) -> Option<u32> {
    let mut decimals = at_least;
    while decimals <= DECIMALS_MAX {
        let Some(x) = misfit(numbers, decimals, out) else { return Some(decimals) };
        // Usually the next place suffices. A number that fits no number of decimals fails at once.
        count(x, DECIMALS_MAX).or_else(|| (decimals..DECIMALS_MAX).find_map(|more| count(x, more)))?;
        decimals += 1;
    }
    None
}

/// Replaces `out` with the counts of numbers, up to one without a count, which is returned.
fn misfit(numbers: &[f64], decimals: u32, out: &mut Vec<i64>) -> Option<f64> {
    let power = POWERS_OF_TEN[decimals as usize];
    out.clear();
    out.reserve(numbers.len());
    for numbers in numbers.chunks(AT_ONCE) {
        let (mut counts, mut are_exact) = ([0; AT_ONCE], true);
        for (count, &x) in counts.iter_mut().zip(numbers) {
            let (rounded, is_exact) = rounded_count(x, power);
            *count = rounded;
            are_exact &= is_exact;
        }
        if !are_exact {
            return numbers.iter().copied().find(|&x| count(x, decimals).is_none());
        }
        out.extend_from_slice(&counts[..numbers.len()]);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn decimal_texts_come_back_bit_for_bit(count_given in -(1i64 << 50)..1i64 << 50, decimals in 0u32..12) {
            let text = format!("{count_given}e-{decimals}");
            let x: f64 = text.parse().unwrap();
            prop_assert_eq!(count(x, decimals), Some(count_given));
            prop_assert_eq!(value(count_given, decimals).to_bits(), x.to_bits());
        }

        #[test]
        fn what_is_counted_is_exact(x in any::<f64>(), decimals in 0u32..=DECIMALS_MAX) {
            if let Some(count) = count(x, decimals) {
                prop_assert_eq!(value(count, decimals).to_bits(), x.to_bits());
            }
        }
    }

    #[test]
    fn decimals_are_as_few_as_do() {
        let mut out = Vec::new();
        assert_eq!(counts(&[1.5, 4_581_200.123_4, -7.0], 0, &mut out), Some(4));
        assert_eq!(out, [15_000, 45_812_001_234, -70_000]);
        assert_eq!(counts(&[1.0, 1.0 / 3.0], 0, &mut out), None);
        assert_eq!(counts(&[-0.0], 0, &mut out), None);
        assert_eq!(counts(&[f64::NAN], 0, &mut out), None);
    }
}

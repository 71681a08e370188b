//! Converts 32-bit floats to the shortest decimals that they stand for.
//!
//! A program that has 12.345 and writes a float writes 12.3450002670288…, whose nearest short decimal is 12.345 again.
//! Read as that decimal, coordinates stay as short as they were: they are stored in few bytes, an OBJ shows them as they
//! were meant, and writing them as floats again gives the same bits.

use super::decimal::POWERS_OF_TEN;

/// Most decimals tried by arithmetic. The product of 24 bits and 5¹² has 52 bits, so it is exact.
const DECIMALS_TRIED: u32 = 12;
/// Numbers of this size have no fraction, so adding and subtracting it rounds to an integer.
const ROUNDER: f64 = 1.5 * (1u64 << 52) as f64;
/// Limit of the magnitude of counts, so that they are exact and `ROUNDER` rounds them.
const COUNT_LIMIT: f64 = (1u64 << 51) as f64;
const MANTISSA: u32 = 0x7f_ffff;

/// Returns the decimal with the fewest digits after the point among those that round to `x`, the nearest of them.
/// `decimals` are those of the number before, and are replaced with those of this one. Not a number and infinity stay
/// as they are.
#[inline]
pub fn shortest(x: f32, decimals: &mut u32) -> f64 {
    if x == 0.0 || !x.is_finite() {
        return f64::from(x);
    }
    let mut best = rounded(x, *decimals);
    // NOTE: what fits with some decimals fits with more, but for powers of two: what rounds to them from below is
    // nearer than what does so from above.
    if best.is_some() && x.to_bits() & MANTISSA != 0 {
        while *decimals > 0
            && let Some(shorter) = rounded(x, *decimals - 1)
        {
            *decimals -= 1;
            best = Some(shorter);
        }
    } else {
        // Too many decimals for the size of the number tell nothing about fewer.
        let is_judged =
            x.to_bits() & MANTISSA != 0 && f64::from(x.abs()) * POWERS_OF_TEN[*decimals as usize] < COUNT_LIMIT;
        let from = if is_judged { *decimals + 1 } else { 0 };
        best = None;
        for more in from..=DECIMALS_TRIED {
            best = rounded(x, more);
            if best.is_some() {
                *decimals = more;
                break;
            }
        }
    }
    best.unwrap_or_else(|| printed(x, decimals))
}

/// Returns `x` rounded to a number of decimals if it is nearest to that; `None` otherwise.
#[inline]
fn rounded(x: f32, decimals: u32) -> Option<f64> {
    let power = POWERS_OF_TEN[decimals as usize];
    let scaled = f64::from(x) * power;
    let count = (scaled + ROUNDER) - ROUNDER;
    let value = count / power;
    (scaled.abs() < COUNT_LIMIT && value as f32 == x).then_some(value)
}

#[cold]
fn printed(x: f32, decimals: &mut u32) -> f64 {
    *decimals = DECIMALS_TRIED;
    fast_float2::parse(ryu::Buffer::new().format_finite(x)).unwrap_or(f64::from(x))
}

/// Reports whether a number comes back as it is if it is written as a 32-bit float and read as a decimal.
pub fn fits_float(x: f64) -> bool {
    shortest(x as f32, &mut 0) == x
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn any_float_reads_back_and_its_neighbours_do_not_matter(bits in any::<u32>(), before in 0u32..=DECIMALS_TRIED) {
            let x = f32::from_bits(bits);
            prop_assume!(x.is_finite());
            let (mut decimals, mut fresh) = (before, 0);
            let value = shortest(x, &mut decimals);
            prop_assert_eq!((value as f32).to_bits(), x.to_bits());
            prop_assert_eq!(value.to_bits(), shortest(x, &mut fresh).to_bits());
        }

        #[test]
        fn short_decimals_come_back(count in -9_999_999i32..9_999_999, places in 0i32..7, before in 0u32..=DECIMALS_TRIED) {
            let value = f64::from(count) / 10f64.powi(places);
            let mut decimals = before;
            prop_assert_eq!(shortest(value as f32, &mut decimals), value);
            prop_assert!(decimals <= places as u32 || value == 0.0);
        }
    }

    #[test]
    fn short_numbers_fit_a_float_and_long_ones_do_not() {
        assert!([0.0, -0.0, 12.345, -0.1, 1e6, 123_456.5].into_iter().all(fits_float));
        assert!(![452_123.256, 1.0 / 3.0, 16_777_217.0, 1e300].into_iter().any(fits_float));
    }

    #[test]
    fn floats_read_as_people_write_them() {
        for value in [12.345, 0.1, -1e-20, 16_777_216.0, 3.25e30, 0.5, 1e-7] {
            let found = shortest(value as f32, &mut 3);
            assert!((found - value).abs() <= 1e-9 * value.abs(), "{value} {found}");
        }
        assert!(shortest(f32::NAN, &mut 3).is_nan());
    }
}

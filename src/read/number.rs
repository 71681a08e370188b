//! Parses the numbers and indices of OBJ text.
//!
//! In: bytes and an offset. Out: the number at that offset and the offset after it. A number is `[+-] digits [. digits]
//! [e [+-] digits]` with a digit before or after the point; hexadecimal, `nan`, `inf` and decimal commas are not
//! numbers.
//!
//! # Source
//! W. D. Clinger, "How to read floating point numbers accurately", PLDI 1990: a mantissa below 2⁵³ divided by a power
//! of ten up to 10²² is one exact operation away from the text, so the division alone rounds correctly. Everything
//! else goes through `fast-float2`. D. Lemire, "Number parsing at a gigabyte per second", 2021: eight digits are read
//! as one word.

use crate::file::decimal;

/// Largest magnitude of positions and texture coordinates: clusters store them as 32-bit floats.
pub const COORDINATE_MAX: f64 = f32::MAX as f64;
/// Largest number of decimals that is reported; more count as this many.
pub const DECIMALS_MAX: u32 = 40;

const EXACT_MANTISSA: u64 = 1 << 53;
/// Largest number of digits that cannot overflow a `u64`.
const EXACT_DIGITS: usize = 19;
const POWERS_OF_TEN: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];
const TENS: [u64; 9] = [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];

/// A number in a text.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Number {
    /// Its value, correctly rounded; infinite if it exceeds the range of an `f64`.
    pub value: f64,
    /// Digits after the point once the exponent is applied, 0 to [`DECIMALS_MAX`].
    pub decimals: u32,
    /// Offset of the first byte after it.
    pub end: usize,
}

/// Returns whether a minus sign stands at `start`, and the offset after a sign; `None` at the end of the text.
#[inline(always)]
fn sign_at(text: &[u8], start: usize) -> Option<(bool, usize)> {
    match text.get(start)? {
        b'-' => Some((true, start + 1)),
        b'+' => Some((false, start + 1)),
        _ => Some((false, start)),
    }
}

/// Returns the longest number that begins at `start`, or `None`.
#[inline(always)]
pub fn number_at(text: &[u8], start: usize) -> Option<Number> {
    let (negative, first_digit) = sign_at(text, start)?;
    let (mut mantissa, mut at) = digits_at(text, first_digit, 0);
    let mut digits = at - first_digit;
    let mut decimals = 0;
    if text.get(at) == Some(&b'.') {
        let first_decimal = at + 1;
        (mantissa, at) = digits_at(text, first_decimal, mantissa);
        decimals = at - first_decimal;
        digits += decimals;
    }
    if digits == 0 {
        return None;
    }
    let exponent = matches!(text.get(at), Some(b'e' | b'E'));
    if exponent || digits > EXACT_DIGITS || mantissa >= EXACT_MANTISSA {
        return Some(any_number(text, start, at, decimals));
    }
    let magnitude = mantissa as f64 / POWERS_OF_TEN[decimals];
    Some(Number { value: if negative { -magnitude } else { magnitude }, decimals: decimals as u32, end: at })
}

/// Returns the number of the form `[-] digits . digits` that begins at `start`, with one to seven digits before the
/// point and at most seven after it; `None` for any other form.
#[inline(always)]
pub fn short_number_at(text: &[u8], start: usize) -> Option<Number> {
    let negative = text.get(start) == Some(&b'-');
    let first_digit = start + usize::from(negative);
    let (whole, count) = leading_digits(eight_at(text, first_digit)?);
    let point = first_digit + count;
    let (part, decimals) = leading_digits(eight_at(text, point + 1)?);
    let is_short = (1..8).contains(&count) && decimals < 8 && text.get(point) == Some(&b'.');
    // Signed integers convert to floats in one instruction. The sign is set as a bit, since a branch on it is
    // unpredictable.
    let mantissa = (whole * TENS[decimals] + part) as i64;
    let magnitude = mantissa as f64 / POWERS_OF_TEN[decimals];
    let value = f64::from_bits(magnitude.to_bits() | u64::from(negative) << 63);
    is_short.then_some(Number { value, decimals: decimals as u32, end: point + 1 + decimals })
}

/// Parses a token that is one number from end to end.
pub fn number(token: &[u8]) -> Option<Number> {
    number_at(token, 0).filter(|number| number.end == token.len())
}

/// Reports whether a token is a non-finite number as programs print it: `nan`, `-inf`, `nan(0x1)`.
pub fn is_non_finite_word(token: &[u8]) -> bool {
    let word = token.strip_prefix(b"-").or_else(|| token.strip_prefix(b"+")).unwrap_or(token).to_ascii_lowercase();
    matches!(word.as_slice(), b"nan" | b"inf" | b"infinity") || word.starts_with(b"nan(") && word.ends_with(b")")
}

#[cold]
fn any_number(text: &[u8], start: usize, mantissa_end: usize, decimals: usize) -> Number {
    let (mut end, mut exponent) = (mantissa_end, 0i64);
    if matches!(text.get(end), Some(b'e' | b'E')) {
        let mut at = end + 1;
        let negative = text.get(at) == Some(&b'-');
        at += usize::from(matches!(text.get(at), Some(b'+' | b'-')));
        let first_digit = at;
        while let Some(digit) = digit_at(text, at) {
            exponent = exponent.saturating_mul(10).saturating_add(digit as i64);
            at += 1;
        }
        if at > first_digit {
            end = at;
        }
        if negative {
            exponent = -exponent;
        }
    }
    let unsigned = start + usize::from(text[start] == b'+');
    // NOTE: the grammar was checked above, so parsing cannot fail; a NaN would be refused as not finite.
    let value = fast_float2::parse(&text[unsigned..end]).unwrap_or(f64::NAN);
    let decimals = (decimals as i64).saturating_sub(exponent).clamp(0, i64::from(DECIMALS_MAX));
    Number { value, decimals: decimals as u32, end }
}

/// Appends the digits from `start` on to `value`, modulo 2⁶⁴; returns the sum and the offset after them.
#[inline(always)]
fn digits_at(text: &[u8], start: usize, mut value: u64) -> (u64, usize) {
    let mut at = start;
    while let Some(eight) = eight_at(text, at) {
        let (run, count) = leading_digits(eight);
        value = value.wrapping_mul(TENS[count]).wrapping_add(run);
        at += count;
        if count < 8 {
            return (value, at);
        }
    }
    while let Some(digit) = digit_at(text, at) {
        value = value.wrapping_mul(10).wrapping_add(digit);
        at += 1;
    }
    (value, at)
}

/// Returns eight bytes as one word, the first byte lowest, or `None` near the end of the text.
#[inline(always)]
fn eight_at(text: &[u8], at: usize) -> Option<u64> {
    text.get(at..)?.first_chunk().map(|eight| u64::from_le_bytes(*eight))
}

/// Returns the value of the leading digits of eight bytes, the lowest byte first, and their number.
#[inline(always)]
fn leading_digits(eight: u64) -> (u64, usize) {
    const ONES: u64 = u64::MAX / 0xff;
    // Subtract '0' from each byte, then set the high bit of the first byte that is no digit, and no bit below it.
    let values = eight ^ (ONES * 0x30);
    let others = (values.wrapping_add(ONES * 0x76) | values) & (ONES * 0x80);
    let count = (others.trailing_zeros() / 8) as usize;
    if count == 0 {
        return (0, 0);
    }
    // Shift in zeros for missing digits, then combine pairs of digits, pairs of pairs, and both halves.
    let digits = values << (64 - 8 * count);
    let pairs = digits.wrapping_mul(10).wrapping_add(digits >> 8);
    let halves = |pairs: u64, powers: u64| (pairs & 0x0000_00ff_0000_00ff).wrapping_mul(powers);
    let sum = halves(pairs, 100 + (1_000_000 << 32)).wrapping_add(halves(pairs >> 16, 1 + (10_000 << 32)));
    (sum >> 32, count)
}

#[inline]
fn digit_at(text: &[u8], at: usize) -> Option<u64> {
    let digit = text.get(at)?.wrapping_sub(b'0');
    (digit < 10).then_some(u64::from(digit))
}

/// An index as written: positive ones count from 1, negative ones count back from the last statement read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Index {
    /// Absolute value; `u64::MAX` also stands for all larger ones.
    pub magnitude: u64,
    /// Whether it counts back.
    pub negative: bool,
}

/// Returns the integer that begins at `start` and the offset after it, or `None`.
#[inline(always)]
pub fn index_at(text: &[u8], start: usize) -> Option<(Index, usize)> {
    let (negative, first_digit) = sign_at(text, start)?;
    let (mut magnitude, at) = digits_at(text, first_digit, 0);
    if at - first_digit > EXACT_DIGITS {
        magnitude = saturated(&text[first_digit..at]);
    }
    (at > first_digit).then_some((Index { magnitude, negative }, at))
}

/// Returns the unsigned integer of one to seven digits that begins at `start`, and the offset after it; `None` if it is
/// 0.
#[inline(always)]
pub fn short_index_at(text: &[u8], start: usize) -> Option<(u32, usize)> {
    let (value, count) = leading_digits(eight_at(text, start)?);
    (value > 0 && count < 8).then_some((value as u32, start + count))
}

/// Value of a long run of digits, at most `u64::MAX`.
#[cold]
fn saturated(digits: &[u8]) -> u64 {
    digits.iter().fold(0, |sum: u64, digit| sum.saturating_mul(10).saturating_add(u64::from(digit - b'0')))
}

/// Raises `decimals` to those of a double, or to the most that there are.
#[inline]
pub fn raise_decimals(value: f64, decimals: &mut u32) {
    if decimal::count(value, (*decimals).min(decimal::DECIMALS_MAX)).is_none() {
        raise_to(value, decimals);
    }
}

#[cold]
fn raise_to(value: f64, decimals: &mut u32) {
    if *decimals < decimal::DECIMALS_MAX && value.is_finite() && value != 0.0 {
        let found = (*decimals + 1..decimal::DECIMALS_MAX).find(|&more| decimal::count(value, more).is_some());
        *decimals = found.unwrap_or(decimal::DECIMALS_MAX).min(DECIMALS_MAX);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn bits_agree(text: &str) {
        let ours = number(text.as_bytes()).unwrap_or_else(|| panic!("{text} is a number"));
        let theirs: f64 = text.parse().unwrap();
        assert_eq!(ours.value.to_bits(), theirs.to_bits(), "{text}");
    }

    proptest! {
        #[test]
        fn decimal_text_reads_as_the_standard_library_reads_it(text in "[+-]?[0-9]{1,9}(\\.[0-9]{0,12})?") {
            bits_agree(&text);
        }

        #[test]
        fn any_text_of_the_grammar_reads_as_the_standard_library_reads_it(
            text in "[+-]?([0-9]{1,25}(\\.[0-9]{0,30})?|\\.[0-9]{1,30})([eE][+-]?[0-9]{1,3})?"
        ) {
            bits_agree(&text);
        }

        #[test]
        fn printed_numbers_come_back(value in any::<f64>().prop_filter("finite", |v| v.is_finite())) {
            bits_agree(&format!("{value}"));
            bits_agree(&format!("{value:e}"));
        }

        #[test]
        fn digits_end_where_they_end_whatever_follows(
            digits in "[0-9]{0,19}", after in prop::collection::vec(any::<u8>().prop_filter("none", |b| !b.is_ascii_digit()), 0..12)
        ) {
            let text = [digits.as_bytes(), &after].concat();
            let expected: u64 = if digits.is_empty() { 0 } else { digits.parse().unwrap_or(0) };
            prop_assert_eq!(digits_at(&text, 0, 0), (expected, digits.len()));
        }

        #[test]
        fn bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..40)) {
            let _ = (number(&bytes), index_at(&bytes, 0), is_non_finite_word(&bytes));
        }
    }

    #[test]
    fn text_that_is_no_number_is_refused() {
        for text in ["", "-", ".", "1,5", "0x8", "1.#IND", "3.0e", "3e+", "nan", "inf", "1e5x", "--1", "1-"] {
            assert!(number(text.as_bytes()).is_none(), "{text}");
        }
    }

    #[test]
    fn decimals_count_what_the_exponent_leaves() {
        let decimals = |text: &str| number(text.as_bytes()).unwrap().decimals;
        assert_eq!(["1", "1.", "1.250", "1.5e1", "1e-3", "12.5e-2", "1e9"].map(decimals), [0, 0, 3, 0, 3, 3, 0]);
        assert_eq!(decimals("1e-99999999999999999999"), DECIMALS_MAX);
    }

    #[test]
    fn an_index_never_wraps() {
        let magnitude = |text: &str| index_at(text.as_bytes(), 0).unwrap().0.magnitude;
        assert_eq!(magnitude("4294967297"), 4_294_967_297);
        assert_eq!(magnitude("18446744073709551617"), u64::MAX);
        assert_eq!(magnitude("-9223372036854775808"), 9_223_372_036_854_775_808);
        assert_eq!(magnitude(&"9".repeat(50)), u64::MAX);
        assert_eq!(index_at(b"7/8", 0), Some((Index { magnitude: 7, negative: false }, 1)));
        assert_eq!(index_at(b"/8", 0), None);
    }
}

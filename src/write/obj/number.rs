//! Formats numbers as the shortest decimal that reads back bit for bit, without an exponent in the usual range.

/// Smallest power of ten written without an exponent.
///
/// NOTE: texture coordinates such as 0.000001 are common, and some readers do not accept exponents.
const PLAIN_EXPONENT_MIN: i32 = -15;
/// Below this, the shortest form has an exponent.
const SHORT_MIN: f64 = 1e-4;
/// From this on, the shortest form has an exponent.
const SHORT_MAX: f64 = 1e16;

/// Appends a number: `5` for 5.0, `0` for -0.0 and non-finite numbers.
pub(super) fn put_f64(out: &mut Vec<u8>, value: f64) {
    let size = value.abs();
    let mut buffer = ryu::Buffer::new();
    if (SHORT_MIN..SHORT_MAX).contains(&size) {
        let text = buffer.format_finite(value).as_bytes();
        out.extend_from_slice(text.strip_suffix(b".0").unwrap_or(text));
    } else if size == 0.0 || !size.is_finite() {
        out.push(b'0');
    } else {
        put_short(out, buffer.format_finite(value).as_bytes());
    }
}

/// Appends a single-precision number in the same way.
pub(super) fn put_f32(out: &mut Vec<u8>, value: f32) {
    if value == 0.0 || !value.is_finite() {
        out.push(b'0');
    } else {
        put_short(out, ryu::Buffer::new().format_finite(value).as_bytes());
    }
}

/// Appends an integer.
pub(super) fn put_u32(out: &mut Vec<u8>, value: u32) {
    out.extend_from_slice(itoa::Buffer::new().format(value).as_bytes());
}

/// Appends `value` / 10 000 with four decimals.
pub(super) fn put_four_decimals(out: &mut Vec<u8>, value: i16) {
    if value < 0 {
        out.push(b'-');
    }
    let size = value.unsigned_abs();
    let digit = |unit: u16| b'0' + (size / unit % 10) as u8;
    out.extend_from_slice(&[digit(10_000), b'.', digit(1000), digit(100), digit(10), digit(1)]);
}

/// Appends `[-]d[.d…][e[-]n]`, without the exponent if it is -15 to -1.
fn put_short(out: &mut Vec<u8>, text: &[u8]) {
    let Some(e) = text.iter().position(|&c| c == b'e') else {
        out.extend_from_slice(text.strip_suffix(b".0").unwrap_or(text));
        return;
    };
    let exponent = std::str::from_utf8(&text[e + 1..]).ok().and_then(|digits| digits.parse::<i32>().ok());
    let Some(exponent) = exponent.filter(|n| (PLAIN_EXPONENT_MIN..0).contains(n)) else {
        out.extend_from_slice(text);
        return;
    };
    let (sign, mantissa) = if text[0] == b'-' { text[..e].split_at(1) } else { text[..e].split_at(0) };
    out.extend_from_slice(sign);
    out.extend_from_slice(b"0.");
    out.extend((exponent + 1..0).map(|_| b'0'));
    out.extend(mantissa.iter().filter(|&&c| c != b'.'));
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn text(value: f64) -> String {
        let mut out = Vec::new();
        put_f64(&mut out, value);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn numbers_read_as_people_write_them() {
        for (value, expected) in [
            (5.0, "5"),
            (-0.0, "0"),
            (0.1, "0.1"),
            (-12.25, "-12.25"),
            (452_123.456, "452123.456"),
            (0.00012, "0.00012"),
            (0.000001, "0.000001"),
            (-1.25e-9, "-0.00000000125"),
            (1e-30, "1e-30"),
            (1e15, "1000000000000000"),
            (1e16, "1e16"),
            (f64::NAN, "0"),
        ] {
            assert_eq!(text(value), expected);
        }
    }

    #[test]
    fn normals_have_four_decimals() {
        for (value, expected) in [(10_000, "1.0000"), (-7071, "-0.7071"), (0, "0.0000"), (3, "0.0003")] {
            let mut out = Vec::new();
            put_four_decimals(&mut out, value);
            assert_eq!(out, expected.as_bytes());
        }
    }

    proptest! {
        #[test]
        fn any_number_reads_back_bit_for_bit(bits in any::<u64>()) {
            let value = f64::from_bits(bits);
            prop_assume!(value.is_finite() && value != 0.0);
            prop_assert_eq!(text(value).parse::<f64>().unwrap().to_bits(), bits);
        }

        #[test]
        fn common_numbers_have_no_exponent(value in -1e7f64..1e7, scale in 0i32..9) {
            let value = value * 10f64.powi(-scale);
            prop_assume!(value.abs() > 1e-14);
            let text = text(value);
            prop_assert!(!text.contains('e'));
            prop_assert_eq!(text.parse::<f64>().unwrap(), value);
        }

        #[test]
        fn any_single_reads_back_bit_for_bit(bits in any::<u32>()) {
            let value = f32::from_bits(bits);
            prop_assume!(value.is_finite() && value != 0.0);
            let mut out = Vec::new();
            put_f32(&mut out, value);
            prop_assert_eq!(std::str::from_utf8(&out).unwrap().parse::<f32>().unwrap().to_bits(), bits);
        }
    }
}

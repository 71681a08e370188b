//! Parses and formats sizes in bytes.

/// One KiB, in bytes.
pub const KIB: u64 = 1 << 10;
/// One MiB, in bytes.
pub const MIB: u64 = 1 << 20;
/// One GiB, in bytes.
pub const GIB: u64 = 1 << 30;

/// Parses a size such as `512MiB`, `1.5GiB`, `2G`, `800M`, `1000000`; returns bytes.
///
/// `K`, `M`, `G`, `T` alone and with `iB` are powers of 1024; `kB`, `MB`, `GB`, `TB` are powers of 1000.
///
/// # Errors
/// A description of the fault.
pub fn parse(text: &str) -> Result<u64, String> {
    let text = text.trim();
    let split = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let number: f64 =
        number.parse().map_err(|_| format!("'{text}' is not a size; write for example 512MiB or 4GiB"))?;
    let factor = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 1.0,
        "k" | "kib" => KIB as f64,
        "m" | "mib" => MIB as f64,
        "g" | "gib" => GIB as f64,
        "t" | "tib" => (GIB << 10) as f64,
        "kb" => 1e3,
        "mb" => 1e6,
        "gb" => 1e9,
        "tb" => 1e12,
        other => return Err(format!("'{other}' is not a unit of size; use KiB, MiB, GiB or TiB")),
    };
    let bytes = number * factor;
    if bytes >= 1e18 {
        return Err(format!("'{text}' is beyond any machine"));
    }
    Ok(bytes as u64)
}

/// Formats bytes for a reader: `384 MiB`, `1.20 GiB`.
pub fn display(bytes: u64) -> String {
    match bytes {
        0..KIB => format!("{bytes} B"),
        KIB..MIB => format!("{:.0} KiB", bytes as f64 / KIB as f64),
        MIB..GIB => format!("{:.0} MiB", bytes as f64 / MIB as f64),
        _ => format!("{:.2} GiB", bytes as f64 / GIB as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_read_as_people_write_them() {
        assert_eq!(parse("512MiB"), Ok(512 * MIB));
        assert_eq!(parse("1.5g"), Ok(3 * GIB / 2));
        assert_eq!(parse("2 GB"), Ok(2_000_000_000));
        assert_eq!(parse("42"), Ok(42));
        assert!(parse("lots").is_err());
        assert!(parse("1e99").is_err());
    }

    #[test]
    fn sizes_print_with_a_unit() {
        assert_eq!(display(384 * MIB), "384 MiB");
        assert_eq!(display(10), "10 B");
    }
}

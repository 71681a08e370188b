//! Formats counts for a reader.

/// Formats a number with digits in groups of three: `16 609 988`.
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

/// Formats a count with its noun: `1 cluster`, `16 609 988 clusters`; appends an s to `thing` in the plural.
pub fn counted(number: u64, thing: &str) -> String {
    format!("{} {thing}{}", grouped(number), if number == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_numbers_are_grouped() {
        assert_eq!(grouped(16_609_988), "16 609 988");
        assert_eq!(grouped(999), "999");
    }

    #[test]
    fn one_thing_is_no_plural() {
        assert_eq!([0, 1, 1234].map(|number| counted(number, "file")), ["0 files", "1 file", "1 234 files"]);
    }
}

//! Formats times for a reader.

/// A time that is foretold: `under 0.1 s`, `0.4 s`, `12 s`, `3 min`, `2.5 h`.
pub fn rough(seconds: f64) -> String {
    match seconds {
        s if s < 0.1 => "under 0.1 s".to_owned(),
        s if s < 9.95 => format!("{s:.1} s"),
        s if s < 119.5 => format!("{s:.0} s"),
        s if s < 7170.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// A time that is foretold, in a sentence: `under 0.1 s`, `about 12 s`.
pub fn about(seconds: f64) -> String {
    let time = rough(seconds);
    if time.starts_with("under") { time } else { format!("about {time}") }
}

/// A time that has passed: `42 s`, `3 min 20 s`, `2 h 5 min`, `3 d 4 h`; what is smaller is cut off.
pub fn whole(seconds: u64) -> String {
    match seconds {
        s if s < 90 => format!("{s} s"),
        s if s < 3600 => format!("{} min {} s", s / 60, s % 60),
        s if s < 48 * 3600 => format!("{} h {} min", s / 3600, s / 60 % 60),
        s => format!("{} d {} h", s / 86_400, s / 3600 % 24),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_told_in_words() {
        assert_eq!([0.01, 0.42, 12.3, 180.0, 9000.0].map(rough), ["under 0.1 s", "0.4 s", "12 s", "3 min", "2.5 h"]);
        assert_eq!([0.01, 12.3].map(about), ["under 0.1 s", "about 12 s"]);
    }

    #[test]
    fn each_unit_begins_where_the_one_before_ends() {
        let cases = [0.04, 0.1, 9.94, 9.96, 119.4, 119.6, 7169.0, 7171.0].map(rough);
        assert_eq!(cases, ["under 0.1 s", "0.1 s", "9.9 s", "10 s", "119 s", "2 min", "119 min", "2.0 h"]);
        let cases = [0, 89, 90, 3599, 3600, 172_799, 172_800].map(whole);
        assert_eq!(cases, ["0 s", "89 s", "1 min 30 s", "59 min 59 s", "1 h 0 min", "47 h 59 min", "2 d 0 h"]);
    }
}

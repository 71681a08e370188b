//! Splits OBJ and MTL text into lines.
//!
//! In: bytes. Out: logical lines, and the number of physical lines in each. A line ends in LF, CR LF or a lone CR; a
//! backslash right before the line end joins it with the next line, except on a line that is a comment.

use std::borrow::Cow;

use memchr::memchr2;

use crate::base::error::escape;

/// One logical line.
#[derive(Debug)]
pub struct LogicalLine<'a> {
    /// Its bytes without line end. The parts of a continued line are joined by a blank.
    pub text: Cow<'a, [u8]>,
    /// Offset of the next line.
    pub next: usize,
    /// Number of physical lines in it.
    pub line_count: u64,
}

/// Returns the logical line that begins at `at`.
pub fn logical_line(text: &[u8], at: usize) -> LogicalLine<'_> {
    let (end, mut next) = line_end(text, at);
    let first = &text[at..end];
    let is_comment = first.iter().find(|byte| !is_blank(**byte)) == Some(&b'#');
    let Some(kept) = first.strip_suffix(b"\\").filter(|_| !is_comment) else {
        return LogicalLine { text: Cow::Borrowed(first), next, line_count: 1 };
    };
    let mut joined = kept.to_vec();
    let mut line_count = 1;
    while next < text.len() {
        let (end, after) = line_end(text, next);
        let part = &text[next..end];
        next = after;
        line_count += 1;
        joined.push(b' ');
        match part.strip_suffix(b"\\") {
            Some(kept) => joined.extend_from_slice(kept),
            None => {
                joined.extend_from_slice(part);
                break;
            }
        }
    }
    LogicalLine { text: Cow::Owned(joined), next, line_count }
}

/// Returns the end of the physical line that contains `at`, and the offset after its line end.
pub fn line_end(text: &[u8], at: usize) -> (usize, usize) {
    match memchr2(b'\n', b'\r', &text[at..]) {
        None => (text.len(), text.len()),
        Some(length) => {
            let end = at + length;
            let is_pair = text[end] == b'\r' && text.get(end + 1) == Some(&b'\n');
            (end, end + 1 + usize::from(is_pair))
        }
    }
}

/// Counts the line ends in a text.
pub fn count_line_ends(text: &[u8]) -> u64 {
    let (mut at, mut count) = (0, 0);
    while at < text.len() {
        let (end, next) = line_end(text, at);
        count += u64::from(next > end);
        at = next;
    }
    count
}

/// Bytes of a word that a message shows.
const QUOTED_MAX: usize = 40;

/// Formats a word of the input for a message: escaped and shortened.
pub fn quote(word: &[u8]) -> String {
    let cut = &word[..word.len().min(QUOTED_MAX)];
    escape(cut) + if cut.len() < word.len() { "…" } else { "" }
}

/// Reports whether a byte separates words: blank, tab, vertical tab or form feed.
#[inline]
pub fn is_blank(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | 0x0b | 0x0c)
}

/// Strips blanks from both ends.
pub fn trim(text: &[u8]) -> &[u8] {
    let Some(start) = text.iter().position(|byte| !is_blank(*byte)) else { return &[] };
    let end = text.iter().rposition(|byte| !is_blank(*byte)).map_or(start, |last| last + 1);
    &text[start..end]
}

/// Splits trimmed text into its first word and the trimmed rest.
pub fn split_keyword(text: &[u8]) -> (&[u8], &[u8]) {
    let end = text.iter().position(|byte| is_blank(*byte)).unwrap_or(text.len());
    (&text[..end], trim(&text[end..]))
}

/// Splits text into words.
pub fn words(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    text.split(|byte| is_blank(*byte)).filter(|word| !word.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str) -> Vec<(String, u64)> {
        let (mut at, mut out) = (0, Vec::new());
        while at < text.len() {
            let line = logical_line(text.as_bytes(), at);
            out.push((String::from_utf8_lossy(&line.text).into_owned(), line.line_count));
            at = line.next;
        }
        out
    }

    fn owned(lines: &[(&str, u64)]) -> Vec<(String, u64)> {
        lines.iter().map(|(text, count)| (text.to_string(), *count)).collect()
    }

    #[test]
    fn lines_end_in_lf_crlf_or_cr() {
        assert_eq!(lines("a\nb\r\nc\rd"), owned(&[("a", 1), ("b", 1), ("c", 1), ("d", 1)]));
        assert_eq!(count_line_ends(b"a\nb\r\nc\rd"), 3);
    }

    #[test]
    fn a_backslash_joins_lines() {
        assert_eq!(lines("f 1 2\\\r\n3 \\\n4\nf"), owned(&[("f 1 2 3  4", 3), ("f", 1)]));
    }

    #[test]
    fn a_comment_swallows_no_line() {
        assert_eq!(lines(" # C:\\scans\\\nv"), owned(&[(" # C:\\scans\\", 1), ("v", 1)]));
    }

    #[test]
    fn a_file_may_end_in_a_backslash() {
        assert_eq!(lines("f 1 2 3 \\"), owned(&[("f 1 2 3 ", 1)]));
    }

    #[test]
    fn words_are_split_at_every_kind_of_blank() {
        assert_eq!(words(b" a\tb\x0bc\x0c").collect::<Vec<_>>(), [b"a", b"b", b"c"]);
        assert_eq!(split_keyword(b"usemtl \t a b"), (&b"usemtl"[..], &b"a b"[..]));
    }
}

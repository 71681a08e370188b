//! Counts the statements of OBJ text without parsing them. Faults inside statements are not noticed here.

use std::path::Path;

use super::chunk::{ObjChunk, too_long};
use super::statements::BYTE_ORDER_MARK;
use crate::base::{Error, Result};
use crate::file::packed::RecordBounds;
use crate::read::line::{logical_line, split_keyword, trim, words};
use crate::read::number::number;
use crate::read::source::Counts;

/// Counts the statements of a chunk, and merges the box of its vertices into `bounds`.
///
/// # Errors
/// If the chunk cannot be read, is of another format, or ends in a line that is too long.
pub(super) fn count_chunk(
    path: &Path,
    chunk: &ObjChunk,
    mut bounds: Option<&mut RecordBounds>,
    text: &mut Vec<u8>,
) -> Result<Counts> {
    chunk.read(path, text)?;
    chunk.refuse_foreign(path, text)?;
    if chunk.line_is_too_long {
        return Err(Error::input(path, 0, too_long()));
    }
    let mut counts = Counts { bytes: chunk.end - chunk.start, ..Counts::default() };
    let mut at = 0;
    while at < text.len() {
        let line = logical_line(text, at);
        see(&mut counts, trim(&line.text), bounds.as_deref_mut());
        at = line.next;
    }
    Ok(counts)
}

fn see(counts: &mut Counts, statement: &[u8], bounds: Option<&mut RecordBounds>) {
    let statement = match statement.strip_prefix(BYTE_ORDER_MARK) {
        Some(rest) => trim(rest),
        None => statement,
    };
    let (keyword, rest) = split_keyword(statement);
    match keyword {
        b"v" => {
            if counts.vertices == 0 {
                counts.has_colours = words(rest).take_while(|word| word[0] != b'#').count() >= 6;
                counts.decimals = words(rest).take(3).map(decimals).max().unwrap_or(0);
            }
            counts.vertices += 1;
            if let Some(bounds) = bounds
                && let Some(position) = position(rest)
            {
                bounds.merge(&RecordBounds { low: position, high: position });
            }
        }
        b"vt" => counts.texcoords += 1,
        b"vn" => counts.normals += 1,
        b"f" | b"fo" => {
            let corners = words(rest).take_while(|word| word[0] != b'#').count() as u64;
            if corners >= 3 {
                counts.polygons += 1;
                counts.triangles += corners - 2;
            }
        }
        _ => {}
    }
}

/// Returns the first three numbers of a `v` statement; `None` if one is missing or not finite.
fn position(text: &[u8]) -> Option<[f64; 3]> {
    let mut numbers = words(text).map(|word| number(word).map(|number| number.value).filter(|x| x.is_finite()));
    Some([numbers.next()??, numbers.next()??, numbers.next()??])
}

/// Number of decimals of a number as written; `u32::MAX` if it has an exponent.
fn decimals(word: &[u8]) -> u32 {
    if word.iter().any(|byte| matches!(byte, b'e' | b'E')) {
        return u32::MAX;
    }
    let point = word.iter().position(|&byte| byte == b'.');
    point.map_or(0, |point| (word.len() - point - 1) as u32)
}

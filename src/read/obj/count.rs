//! Counts the statements of OBJ text without parsing them. Faults inside statements are not noticed here.

use std::path::Path;

use memchr::memchr;

use super::chunk::{ObjChunk, too_long};
use super::statements::BYTE_ORDER_MARK;
use crate::base::{Error, Result};
use crate::file::packed::RecordBounds;
use crate::read::line::{logical_line, split_keyword, trim, words};
use crate::read::number::{Index, index_at, number};
use crate::read::source::Counts;
use crate::read::texture_sample::{ChunkTexture, TexcoordIndex};

/// Counts the statements of a chunk, merges the box of its vertices into `bounds`, and adds to `texture`.
///
/// # Errors
/// If the chunk cannot be read, is of another format, or ends in a line that is too long.
pub(super) fn count_chunk(
    path: &Path,
    chunk: &ObjChunk,
    mut bounds: Option<&mut RecordBounds>,
    mut texture: Option<&mut ChunkTexture>,
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
        let statement = trim(&line.text);
        let statement = statement.strip_prefix(BYTE_ORDER_MARK).map_or(statement, trim);
        see(&mut counts, statement, bounds.as_deref_mut());
        if let Some(texture) = texture.as_deref_mut() {
            see_texture(texture, statement);
        }
        at = line.next;
    }
    Ok(counts)
}

fn see(counts: &mut Counts, statement: &[u8], bounds: Option<&mut RecordBounds>) {
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

/// Adds what a statement says of the texture.
fn see_texture(texture: &mut ChunkTexture, statement: &[u8]) {
    let (keyword, rest) = split_keyword(statement);
    match keyword {
        b"vt" => {
            let mut numbers = words(rest).map(|word| number(word).map_or(0.0, |number| number.value as f32));
            texture.texcoords.push([numbers.next().unwrap_or(0.0), numbers.next().unwrap_or(0.0)]);
        }
        b"usemtl" => texture.use_material(rest),
        b"mtllib" => texture.name_library(rest),
        b"f" | b"fo" => {
            let known = texture.texcoords.len();
            let mut corners = words(rest).take_while(|word| word[0] != b'#').map(|word| texcoord_index(word, known));
            let (Some(first), Some(mut last)) = (corners.next(), corners.next()) else { return };
            for corner in corners {
                texture.add_triangle([first, last, corner]);
                last = corner;
            }
        }
        _ => {}
    }
}

/// The texture coordinate of a corner such as `7/3/1`; `known` were read in the chunk before.
fn texcoord_index(corner: &[u8], known: usize) -> Option<TexcoordIndex> {
    let start = memchr(b'/', corner)? + 1;
    let (Index { magnitude, negative }, _) = index_at(corner, start)?;
    if negative {
        Some(TexcoordIndex::OfChunk(i64::try_from(known).ok()?.checked_sub_unsigned(magnitude)?))
    } else {
        Some(TexcoordIndex::OfFile(magnitude.checked_sub(1)?))
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

//! Parses the statements of a chunk of OBJ text.
//!
//! In: bytes that begin and end between statements. Out: a [`ParsedChunk`], or the first faulty line. Invariant: a
//! chunk is parsed without knowing what precedes it. Negative indices stay relative to its start; whether positive ones
//! exist is checked at the end of the file.
//!
//! Each statement has two readers. The one in `fast.rs` knows only the form that exporters write (`v 1.5 2 3`, `f 1/2/3
//! 4/5/6 7/8/9`) and leaves everything else to the one here, which splits the line into words, knows every form and
//! reports what is wrong.

use glam::{DVec2, DVec3};
use memchr::memchr;

use super::parsed::{Library, LineError, Numbered, ParsedChunk};
use crate::model::face::POLYGON_CORNERS_MAX;
use crate::model::id::{PieceTexcoord, PieceVertex};
use crate::model::stored_mesh::ID_LIMIT;
use crate::read::line::{LogicalLine, logical_line, quote, split_keyword, trim, words};
use crate::read::number::{COORDINATE_MAX, Index, Number, index_at, is_non_finite_word, number};
use crate::read::records::{ChunkCorner, LabelKind};

pub(super) const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

type LineResult<T> = Result<T, String>;

/// Reads the statements of `text` into `chunk`, which must be empty.
///
/// # Errors
/// The first damaged line.
pub fn parse(text: &[u8], chunk: &mut ParsedChunk) -> Result<(), LineError> {
    let mut parser = Parser { text, at: 0, line: 1, chunk };
    parser.run()
}

/// A position in a chunk, and the records parsed before it.
pub(super) struct Parser<'a> {
    pub(super) text: &'a [u8],
    pub(super) at: usize,
    pub(super) line: u64,
    pub(super) chunk: &'a mut ParsedChunk,
}

impl Parser<'_> {
    fn run(&mut self) -> Result<(), LineError> {
        while self.at < self.text.len() {
            if !self.read_plain_statement() {
                let LogicalLine { text, next, line_count } = logical_line(self.text, self.at);
                self.read_statement(trim(&text)).map_err(|message| LineError { line: self.line, message })?;
                self.at = next;
                self.line += line_count;
            }
        }
        self.chunk.line_count = self.line - 1;
        Ok(())
    }

    fn read_statement(&mut self, text: &[u8]) -> LineResult<()> {
        if text.starts_with(BYTE_ORDER_MARK) {
            return Err(
                "expected a statement, found a byte order mark; files joined end to end, whose indices do not \
                        fit each other? Give their folder as input instead"
                    .into(),
            );
        }
        if text.is_empty() || text[0] == b'#' {
            return Ok(());
        }
        if memchr(0, text).is_some() {
            return Err("expected text, found NUL bytes; the file is damaged, or binary".into());
        }
        let (keyword, rest) = split_keyword(text);
        match keyword {
            b"v" => self.read_vertex(rest)?,
            b"vt" => self.read_texcoord(rest)?,
            b"vn" => self.chunk.normal_count += 1,
            b"f" | b"fo" => self.read_face(rest)?,
            b"usemtl" => self.chunk.records.push_change(LabelKind::Material, rest),
            b"o" => self.chunk.records.push_change(LabelKind::Object, rest),
            b"g" => self.chunk.records.push_change(LabelKind::Group, rest),
            b"mtllib" => {
                let library = Library { line: self.line, name: self.chunk.records.push_name(rest) };
                self.chunk.libraries.push(library);
            }
            b"p" => self.chunk.records.count("ignored_points"),
            b"l" => self.chunk.records.count("ignored_lines"),
            _ if is_free_form(keyword) => {
                self.note("free_form_statements", || format!("free-form statement '{}' is ignored", quote(keyword)));
            }
            _ if is_display_attribute(keyword) => {}
            _ => self.note("unknown_statements", || format!("unknown statement '{}' is ignored", quote(keyword))),
        }
        Ok(())
    }

    fn read_vertex(&mut self, rest: &[u8]) -> LineResult<()> {
        let mut values = [0.0; 7];
        let mut count = 0;
        for word in words_before_comment(rest) {
            let value = match number(word) {
                Some(Number { value, decimals, .. }) => {
                    if count < 3 {
                        self.chunk.records.position_decimals = self.chunk.records.position_decimals.max(decimals);
                    }
                    value
                }
                None if is_non_finite_word(word) => f64::NAN,
                None => return Err(format!("expected a number, found '{}'", quote(word))),
            };
            if count < 3 && (value.is_nan() || value.abs() > COORDINATE_MAX) {
                return Err(format!("expected a number between -3.4e38 and 3.4e38, found '{}'", quote(word)));
            }
            if let Some(place) = values.get_mut(count) {
                *place = value;
            }
            count += 1;
        }
        let [x, y, z, r, g, b, _] = values;
        let mut colour = None;
        match count {
            0..3 => return Err(format!("a vertex has 3 numbers, found {count}")),
            3 => {}
            4 if r == 1.0 => {}
            4 => self.note("vertex_weights", || format!("the weight {r} of a vertex is ignored")),
            6 | 7 => {
                let rgb = [r as f32, g as f32, b as f32];
                if rgb.iter().all(|c| c.is_finite()) {
                    colour = Some(rgb);
                } else {
                    self.note("bad_colours", || "a colour that is not finite is ignored".into());
                }
            }
            _ => self.note("extra_numbers", || format!("a vertex with {count} numbers; the first 3 are used")),
        }
        self.chunk.records.push_vertex(DVec3::new(x, y, z), colour);
        Ok(())
    }

    fn read_texcoord(&mut self, rest: &[u8]) -> LineResult<()> {
        let mut values = [0.0; 2];
        let mut count = 0;
        let mut is_bad = false;
        for word in words_before_comment(rest) {
            let value = match number(word) {
                Some(Number { value, decimals, .. }) => {
                    if count < 2 {
                        self.chunk.records.texcoord_decimals = self.chunk.records.texcoord_decimals.max(decimals);
                    }
                    value
                }
                None if is_non_finite_word(word) => f64::NAN,
                None => return Err(format!("expected a number, found '{}'", quote(word))),
            };
            if let Some(place) = values.get_mut(count) {
                is_bad |= value.is_nan() || value.abs() > COORDINATE_MAX;
                *place = value;
            }
            count += 1;
        }
        if count == 0 {
            return Err("a texture coordinate has 1 to 3 numbers, found none".into());
        }
        if is_bad {
            self.note("bad_texcoords", || "a texture coordinate that is not finite is read as 0 0".into());
            values = [0.0; 2];
        }
        self.chunk.records.texcoords.push(DVec2::from_array(values));
        Ok(())
    }

    fn read_face(&mut self, rest: &[u8]) -> LineResult<()> {
        let start = self.chunk.records.corner_vertices.len();
        let texcoords_start = self.chunk.records.corner_texcoords.len();
        let relative_texcoords_start = self.chunk.relative_texcoords.len();
        let mut texcoord_count = 0;
        for word in words_before_comment(rest) {
            let corner = split_corner(word)?;
            let Some(vertex) = self.resolve(Numbered::Vertex, corner[0])? else {
                return Err("expected a vertex index, found 0; OBJ counts from 1".into());
            };
            let texcoord = match corner[1] {
                Some(_) => self.resolve(Numbered::Texcoord, corner[1])?,
                None => None,
            };
            if corner[2].is_some() {
                self.resolve(Numbered::Normal, corner[2])?;
                self.chunk.records.uses_normals = true;
            }
            self.chunk.push_corner_vertex(vertex);
            if let Some(texcoord) = texcoord {
                self.chunk.push_corner_texcoord(texcoord);
                texcoord_count += 1;
            } else if corner[1].is_some() || !self.chunk.records.corner_texcoords.is_empty() {
                self.chunk.push_corner_texcoord(Reference::Absolute(PieceTexcoord::NONE.number()));
            }
        }
        let size = self.chunk.records.corner_vertices.len() - start;
        if size < 3 {
            self.chunk.drop_corners(start, texcoords_start);
            self.note("short_faces", || format!("a face with {size} corners is ignored"));
            return Ok(());
        }
        if size > POLYGON_CORNERS_MAX {
            self.note("fanned_polygons", || format!("a face with {size} corners is read as a fan of triangles"));
        }
        if texcoord_count < size && !self.chunk.records.corner_texcoords.is_empty() {
            if texcoord_count > 0 {
                self.note("partial_texcoords", || {
                    format!("{texcoord_count} of {size} corners have a texture coordinate; the face is read without")
                });
            }
            self.chunk.relative_texcoords.truncate(relative_texcoords_start);
            self.chunk.records.corner_texcoords.truncate(start);
            self.chunk.records.corner_texcoords.resize(start + size, PieceTexcoord::NONE);
        }
        self.chunk.records.polygon_sizes.push(size as u32);
        Ok(())
    }

    /// Returns what an index refers to; `None` for texture coordinate or normal 0, which some exporters write for
    /// "none".
    fn resolve(&mut self, kind: Numbered, index: Option<Index>) -> LineResult<Option<Reference>> {
        let Some(index) = index else { return Ok(None) };
        if index.magnitude == 0 {
            if kind != Numbered::Vertex {
                self.note("zero_indices", || format!("{} 0 is read as none; OBJ counts from 1", kind.word()));
            }
            return Ok(None);
        }
        match self.chunk.refer(kind, index) {
            Some(reference) => Ok(Some(reference)),
            None => Err(format!(
                "face refers to {} {}{}; at most {ID_LIMIT} are supported",
                kind.word(),
                if index.negative { "-" } else { "" },
                index.magnitude
            )),
        }
    }

    fn note(&mut self, kind: &'static str, words: impl FnOnce() -> String) {
        self.chunk.records.note(kind, self.line, words);
    }
}

/// An index counted from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reference {
    /// Counted from the first of the file.
    Absolute(u32),
    /// Counted from the first of the chunk, modulo 2³².
    Relative(u32),
}

impl Reference {
    #[inline]
    fn number(self) -> u32 {
        let (Self::Absolute(number) | Self::Relative(number)) = self;
        number
    }
}

impl ParsedChunk {
    /// Converts a nonzero index to a reference and records how far it reaches; `None` if its magnitude exceeds
    /// [`ID_LIMIT`].
    #[inline]
    pub(super) fn refer(&mut self, kind: Numbered, index: Index) -> Option<Reference> {
        if index.magnitude > ID_LIMIT {
            return None;
        }
        let place = kind as usize;
        if index.negative {
            let from_chunk = self.counts()[place] as i64 - index.magnitude as i64;
            self.lowest[place] = self.lowest[place].min(from_chunk);
            return Some(Reference::Relative(from_chunk as u32));
        }
        self.highest[place] = self.highest[place].max(index.magnitude);
        Some(Reference::Absolute(index.magnitude as u32 - 1))
    }

    #[inline]
    pub(super) fn push_corner_vertex(&mut self, vertex: Reference) {
        if let Reference::Relative(_) = vertex {
            self.relative_vertices.push(self.records.corner_vertices.next_key());
        }
        self.records.corner_vertices.push(PieceVertex::new(vertex.number()));
    }

    /// Assigns a texture coordinate to the last corner.
    #[inline]
    pub(super) fn push_corner_texcoord(&mut self, texcoord: Reference) {
        let corner = self.records.corner_vertices.len() - 1;
        self.records.corner_texcoords.resize(corner, PieceTexcoord::NONE);
        if let Reference::Relative(_) = texcoord {
            self.relative_texcoords.push(ChunkCorner::from(corner));
        }
        self.records.corner_texcoords.push(PieceTexcoord::new(texcoord.number()));
    }

    /// Appends a triangle by its vertex and texture coordinate indices, counted from 1. Returns false without appending
    /// if some corner before it has no texture coordinate.
    #[inline(always)]
    pub(super) fn push_textured_triangle(&mut self, corners: [[u32; 3]; 2]) -> bool {
        let is_textured = self.records.corner_texcoords.len() == self.records.corner_vertices.len();
        if is_textured {
            for (kind, indices) in [Numbered::Vertex, Numbered::Texcoord].into_iter().zip(corners) {
                let highest = &mut self.highest[kind as usize];
                *highest = indices.into_iter().map(u64::from).fold(*highest, u64::max);
            }
            let [vertices, texcoords] = corners.map(|indices| indices.map(|index| index - 1));
            self.records.corner_vertices.raw.extend_from_slice(&vertices.map(PieceVertex::new));
            self.records.corner_texcoords.raw.extend_from_slice(&texcoords.map(PieceTexcoord::new));
            self.records.polygon_sizes.push(3);
        }
        is_textured
    }

    /// Removes the corners of an unfinished face.
    pub(super) fn drop_corners(&mut self, start: usize, texcoords_start: usize) {
        self.records.corner_vertices.truncate(start);
        self.records.corner_texcoords.truncate(texcoords_start);
        for relative in [&mut self.relative_vertices, &mut self.relative_texcoords] {
            while relative.last().is_some_and(|corner| corner.index() >= start) {
                relative.pop();
            }
        }
    }
}

/// Returns the first line with a dangling index of one of `kinds`: a positive one above `totals`, or a negative one
/// that points before the first. `bases` are the counts of v, vt and vn before the chunk.
pub fn find_dangling_index(text: &[u8], bases: [u64; 3], totals: [u64; 3], kinds: &[Numbered]) -> Option<LineError> {
    let (mut at, mut line, mut counts) = (0, 1, bases);
    while at < text.len() {
        let LogicalLine { text: whole, next, line_count } = logical_line(text, at);
        let whole = trim(&whole);
        let (keyword, rest) = split_keyword(trim(whole.strip_prefix(BYTE_ORDER_MARK).unwrap_or(whole)));
        match keyword {
            b"v" => counts[0] += 1,
            b"vt" => counts[1] += 1,
            b"vn" => counts[2] += 1,
            b"f" | b"fo" => {
                for corner in words_before_comment(rest).filter_map(|word| split_corner(word).ok()) {
                    for &kind in kinds {
                        let place = kind as usize;
                        let Some(index) = corner[place] else { continue };
                        let magnitude = index.magnitude;
                        if index.negative && magnitude > counts[place] {
                            let found = format!(
                                "face refers to {} -{magnitude}, the file has {} so far",
                                kind.word(),
                                counts[place]
                            );
                            return Some(LineError { line, message: found });
                        }
                        if !index.negative && magnitude > totals[place] {
                            let found =
                                format!("face refers to {} {magnitude}, the file has {}", kind.word(), totals[place]);
                            return Some(LineError { line, message: found });
                        }
                    }
                }
            }
            _ => {}
        }
        at = next;
        line += line_count;
    }
    None
}

/// Splits `v`, `v/t`, `v//n` or `v/t/n`; trailing slashes are accepted.
fn split_corner(word: &[u8]) -> LineResult<[Option<Index>; 3]> {
    let mut corner = [None; 3];
    let mut parts = word.split(|byte| *byte == b'/');
    for (place, slot) in corner.iter_mut().enumerate() {
        let Some(part) = parts.next() else { break };
        *slot = match index_at(part, 0) {
            Some((index, end)) if end == part.len() => Some(index),
            None if part.is_empty() && place > 0 => None,
            _ => return Err(format!("expected a corner such as 1/2/3, found '{}'", quote(word))),
        };
    }
    match parts.next() {
        Some(_) => Err(format!("a corner has at most two slashes, found '{}'", quote(word))),
        None => Ok(corner),
    }
}

fn words_before_comment(text: &[u8]) -> impl Iterator<Item = &[u8]> {
    words(text).take_while(|word| word[0] != b'#')
}

fn is_free_form(keyword: &[u8]) -> bool {
    const FREE_FORM: &[&str] = &[
        "vp", "deg", "bmat", "step", "cstype", "curv", "curv2", "surf", "parm", "trim", "hole", "scrv", "sp", "end",
        "con", "bsp", "bzp", "cdc", "cdp", "res",
    ];
    FREE_FORM.iter().any(|word| word.as_bytes() == keyword)
}

fn is_display_attribute(keyword: &[u8]) -> bool {
    const ATTRIBUTES: &[&str] = &[
        "s",
        "mg",
        "bevel",
        "c_interp",
        "d_interp",
        "lod",
        "shadow_obj",
        "trace_obj",
        "ctech",
        "stech",
        "maplib",
        "usemap",
    ];
    ATTRIBUTES.iter().any(|word| word.as_bytes() == keyword)
}

//! Fast reader for statements in the form that exporters write, in one pass over the bytes.
//!
//! In: a parser at the start of a line. Out: the statement appended to the chunk, or no change if the line has another
//! form; the general reader in `statements.rs` then reads it. Invariant: both readers agree on every line that this one
//! accepts; a test checks it.

use glam::{DVec2, DVec3};
use memchr::memchr3;

use super::parsed::Numbered;
use super::statements::Parser;
use crate::model::face::POLYGON_CORNERS_MAX;
use crate::model::id::PieceTexcoord;
use crate::read::number::{COORDINATE_MAX, index_at, number_at, short_index_at, short_number_at};

impl Parser<'_> {
    /// Reads the statement at the parser's position if it is a plain `v`, `vt`, `vn` or `f` on one line; returns
    /// whether it did.
    #[inline]
    pub(super) fn read_plain_statement(&mut self) -> bool {
        let Some(&[first, second]) = self.text[self.at..].first_chunk::<2>() else { return false };
        match (first, second) {
            (b'v', b' ') => self.read_plain_vertex(),
            (b'f', b' ') => self.read_textured_triangle() || self.read_plain_face(),
            (b'v', b't') => self.read_plain_texcoord(),
            (b'v', b'n') => self.skip_plain_normal(),
            _ => false,
        }
    }

    #[inline]
    fn read_plain_vertex(&mut self) -> bool {
        if let Some(Row { values: [x, y, z], decimals: [dx, dy, dz], next, .. }) = self.short_numbers(self.at + 1) {
            self.chunk.records.position_decimals = self.chunk.records.position_decimals.max(dx).max(dy).max(dz);
            self.chunk.records.push_vertex(DVec3::new(x, y, z), None);
            return self.finish_line(next);
        }
        let Some(row) = self.plain_numbers::<6>(self.at + 1) else { return false };
        let [x, y, z, r, g, b] = row.values;
        if [x, y, z].iter().any(|v| v.abs() > COORDINATE_MAX) {
            return false;
        }
        let colour = match row.count {
            3 => None,
            6 => Some([r as f32, g as f32, b as f32]),
            _ => return false,
        };
        if colour.is_some_and(|rgb| rgb.iter().any(|c| !c.is_finite())) {
            return false;
        }
        let [dx, dy, dz, ..] = row.decimals;
        self.chunk.records.position_decimals = self.chunk.records.position_decimals.max(dx).max(dy).max(dz);
        self.chunk.records.push_vertex(DVec3::new(x, y, z), colour);
        self.finish_line(row.next)
    }

    #[inline]
    fn read_plain_texcoord(&mut self) -> bool {
        if let Some(Row { values: [u, v], decimals: [du, dv], next, .. }) = self.short_numbers(self.at + 2) {
            self.chunk.records.texcoord_decimals = self.chunk.records.texcoord_decimals.max(du).max(dv);
            self.chunk.records.texcoords.push(DVec2::new(u, v));
            return self.finish_line(next);
        }
        let Some(row) = self.plain_numbers::<3>(self.at + 2) else { return false };
        let [u, v, _] = row.values;
        if row.count < 2 || u.abs() > COORDINATE_MAX || v.abs() > COORDINATE_MAX {
            return false;
        }
        self.chunk.records.texcoord_decimals =
            self.chunk.records.texcoord_decimals.max(row.decimals[0]).max(row.decimals[1]);
        self.chunk.records.texcoords.push(DVec2::new(u, v));
        self.finish_line(row.next)
    }

    /// Counts normals without reading them: they are recomputed for the result.
    #[inline]
    fn skip_plain_normal(&mut self) -> bool {
        if !matches!(self.text.get(self.at + 2), Some(b' ' | b'\t')) {
            return false;
        }
        let Some(length) = memchr3(b'\n', b'\r', 0, &self.text[self.at..]) else { return false };
        let end = self.at + length;
        let Some(next) = plain_line_end(self.text, end).filter(|_| self.text[end - 1] != b'\\') else { return false };
        self.chunk.normal_count += 1;
        self.finish_line(next)
    }

    /// Reads `f v/vt v/vt v/vt` with short positive indices and single blanks, the form of most lines in a textured
    /// mesh.
    #[inline(always)]
    fn read_textured_triangle(&mut self) -> bool {
        let (text, mut at) = (self.text, self.at + 1);
        let mut corners = [[0; 3]; 2];
        for k in 0..3 {
            for (indices, before) in corners.iter_mut().zip([b' ', b'/']) {
                if text.get(at) != Some(&before) {
                    return false;
                }
                let Some((index, end)) = short_index_at(text, at + 1) else { return false };
                (indices[k], at) = (index, end);
            }
        }
        match plain_line_end(text, at) {
            Some(next) => self.chunk.push_textured_triangle(corners) && self.finish_line(next),
            None => false,
        }
    }

    #[inline]
    fn read_plain_face(&mut self) -> bool {
        let start = self.chunk.records.corner_vertices.len();
        let texcoords_start = self.chunk.records.corner_texcoords.len();
        match self.plain_corners(self.at + 1) {
            Some(next) => self.finish_line(next),
            None => {
                self.chunk.drop_corners(start, texcoords_start);
                false
            }
        }
    }

    /// Appends the corners of a face and returns the offset of the next line. If it returns `None`, some corners may
    /// have been appended.
    #[inline]
    fn plain_corners(&mut self, mut at: usize) -> Option<usize> {
        let text = self.text;
        let start = self.chunk.records.corner_vertices.len();
        let (mut texcoord_count, mut uses_normals) = (0, false);
        let next = loop {
            let from = at;
            at = skip_blanks(text, at);
            if let Some(next) = plain_line_end(text, at) {
                break next;
            }
            if at == from {
                return None;
            }
            at = self.plain_index(Numbered::Vertex, at)?;
            if text.get(at) == Some(&b'/') {
                at += 1;
                if text.get(at) != Some(&b'/') {
                    at = self.plain_index(Numbered::Texcoord, at)?;
                    texcoord_count += 1;
                }
                if text.get(at) == Some(&b'/') {
                    at = self.plain_index(Numbered::Normal, at + 1)?;
                    uses_normals = true;
                }
            }
        };
        let size = self.chunk.records.corner_vertices.len() - start;
        if !(3..=POLYGON_CORNERS_MAX).contains(&size) || texcoord_count != 0 && texcoord_count != size {
            return None;
        }
        if texcoord_count == 0 && !self.chunk.records.corner_texcoords.is_empty() {
            self.chunk.records.corner_texcoords.resize(start + size, PieceTexcoord::NONE);
        }
        self.chunk.records.uses_normals |= uses_normals;
        self.chunk.records.polygon_sizes.push(size as u32);
        Some(next)
    }

    #[inline(always)]
    fn plain_index(&mut self, kind: Numbered, at: usize) -> Option<usize> {
        let (index, end) = index_at(self.text, at)?;
        if index.magnitude == 0 {
            return None;
        }
        let reference = self.chunk.refer(kind, index)?;
        match kind {
            Numbered::Vertex => self.chunk.push_corner_vertex(reference),
            Numbered::Texcoord => self.chunk.push_corner_texcoord(reference),
            Numbered::Normal => {}
        }
        Some(end)
    }

    /// Reads `N` short numbers, each after a single blank, that fill the rest of a line; most lines have this form.
    #[inline(always)]
    fn short_numbers<const N: usize>(&self, mut at: usize) -> Option<Row<N>> {
        let mut row = Row { values: [0.0; N], decimals: [0; N], count: N, next: 0 };
        for (value, decimals) in row.values.iter_mut().zip(&mut row.decimals) {
            if self.text.get(at) != Some(&b' ') {
                return None;
            }
            let number = short_number_at(self.text, at + 1)?;
            (*value, *decimals, at) = (number.value, number.decimals, number.end);
        }
        row.next = plain_line_end(self.text, at)?;
        Some(row)
    }

    /// Reads up to `N` numbers that fill the rest of a line.
    #[inline]
    fn plain_numbers<const N: usize>(&self, mut at: usize) -> Option<Row<N>> {
        let mut row = Row { values: [0.0; N], decimals: [0; N], count: 0, next: 0 };
        loop {
            let from = at;
            at = skip_blanks(self.text, at);
            if let Some(next) = plain_line_end(self.text, at) {
                row.next = next;
                return Some(row);
            }
            if at == from || row.count == N {
                return None;
            }
            let number = number_at(self.text, at)?;
            row.values[row.count] = number.value;
            row.decimals[row.count] = number.decimals;
            row.count += 1;
            at = number.end;
        }
    }

    #[inline]
    fn finish_line(&mut self, next: usize) -> bool {
        self.at = next;
        self.line += 1;
        true
    }
}

struct Row<const N: usize> {
    values: [f64; N],
    decimals: [u32; N],
    count: usize,
    next: usize,
}

#[inline]
fn skip_blanks(text: &[u8], mut at: usize) -> usize {
    while matches!(text.get(at), Some(b' ' | b'\t')) {
        at += 1;
    }
    at
}

/// Returns the offset after the LF or CR LF at `at`, or `None`; a lone CR is left to the general reader.
#[inline]
fn plain_line_end(text: &[u8], at: usize) -> Option<usize> {
    match text.get(at)? {
        b'\n' => Some(at + 1),
        b'\r' if text.get(at + 1) == Some(&b'\n') => Some(at + 2),
        _ => None,
    }
}

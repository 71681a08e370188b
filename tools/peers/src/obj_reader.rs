//! OBJ in, [`Mesh`] out: one pass over the file in blocks of 4 MiB, numbers parsed by hand, wedges found while reading.
//!
//! A wedge is looked up in a chain that hangs on its `v` index, as long as the place has wedges (two or three, seldom
//! more): no hash, and neighbours in the file are neighbours in memory.
//!
//! ```text
//!   first_wedge[v] ──► { texcoord, material, next } ──► { texcoord, material, next } ──► NONE
//! ```
//!
//! Reads `v`, `vt`, `f` (polygons become fans, indices may count backwards), `usemtl` and `mtllib`; other lines pass.
//!
//! # Memory
//! 12 bytes a `v`, 8 a `vt`, 16 a wedge and 12 a triangle; the first two go when the wedges have their own.

use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::mesh::Mesh;

const NONE: u32 = u32::MAX;
const BLOCK_BYTES: usize = 4 << 20;

/// Reads the whole file.
///
/// # Errors
/// A sentence that begins with `file:line:`.
pub fn read_obj(path: &Path) -> Result<Mesh, String> {
    let mut file = File::open(path).map_err(|error| format!("{}: {error}", path.display()))?;
    let mut reader = Reader::default();
    reader.materials.push(String::new());
    let mut block = vec![0u8; BLOCK_BYTES];
    let mut filled = 0;
    loop {
        if filled == block.len() {
            block.resize(block.len() * 2, 0);
        }
        let count = file.read(&mut block[filled..]).map_err(|error| format!("{}: {error}", path.display()))?;
        filled += count;
        if count == 0 {
            if filled > 0 && block[filled - 1] != b'\n' {
                if filled == block.len() {
                    block.push(0);
                }
                block[filled] = b'\n';
                filled += 1;
            }
            reader.lines(&block[..filled]).map_err(|what| format!("{}:{what}", path.display()))?;
            break;
        }
        let Some(last) = block[..filled].iter().rposition(|&byte| byte == b'\n') else { continue };
        reader.lines(&block[..=last]).map_err(|what| format!("{}:{what}", path.display()))?;
        block.copy_within(last + 1..filled, 0);
        filled -= last + 1;
    }
    reader.finish().map_err(|what| format!("{}: {what}", path.display()))
}

#[derive(Clone, Copy)]
struct Wedge {
    place: u32,
    texcoord: u32,
    material: u32,
    next: u32,
}

#[derive(Default)]
struct Reader {
    line: usize,
    origin: Option<[f64; 3]>,
    places: Vec<[f32; 3]>,
    texcoords: Vec<[f32; 2]>,
    first_wedge: Vec<u32>,
    wedges: Vec<Wedge>,
    indices: Vec<u32>,
    polygon: Vec<u32>,
    material: u32,
    materials: Vec<String>,
    material_ids: HashMap<String, u32>,
    mtllibs: Vec<String>,
}

impl Reader {
    /// Reads whole lines: `text` ends with a line feed, so a scan that stops at one needs no other bound.
    fn lines(&mut self, text: &[u8]) -> Result<(), String> {
        let mut cursor = Cursor { text, at: 0 };
        while cursor.at < text.len() {
            self.line += 1;
            cursor.blanks();
            let (first, second) = (cursor.peek(), *text.get(cursor.at + 1).unwrap_or(&b'\n'));
            let read = match (first, second) {
                (b'v', b' ' | b'\t') => self.place(cursor.skip(1)),
                (b'v', b't') => self.texcoord(cursor.skip(2)),
                (b'f', b' ' | b'\t') => self.face(cursor.skip(1)),
                (b'u', b's') => self.usemtl(cursor.rest("usemtl")),
                (b'm', b't') => {
                    self.mtllibs.extend(cursor.rest("mtllib").map(str::to_owned));
                    Some(())
                }
                _ => Some(()),
            };
            if read.is_none() {
                return Err(format!("{}: expected numbers or indices that exist", self.line));
            }
            cursor.next_line();
        }
        Ok(())
    }

    fn place(&mut self, cursor: &mut Cursor) -> Option<()> {
        let place = [cursor.float()?, cursor.float()?, cursor.float()?];
        let origin = self.origin.get_or_insert(place.map(f64::floor));
        self.places.push(std::array::from_fn(|axis| (place[axis] - origin[axis]) as f32));
        Some(())
    }

    fn texcoord(&mut self, cursor: &mut Cursor) -> Option<()> {
        self.texcoords.push([cursor.float()? as f32, cursor.float()? as f32]);
        Some(())
    }

    fn face(&mut self, cursor: &mut Cursor) -> Option<()> {
        self.polygon.clear();
        while let Some((place, texcoord)) = cursor.corner(self.places.len(), self.texcoords.len())? {
            let wedge = self.wedge(place, texcoord);
            self.polygon.push(wedge);
        }
        if self.polygon.len() < 3 {
            return None;
        }
        for corner in 2..self.polygon.len() {
            self.indices.extend([self.polygon[0], self.polygon[corner - 1], self.polygon[corner]]);
        }
        Some(())
    }

    #[inline]
    fn wedge(&mut self, place: u32, texcoord: u32) -> u32 {
        if self.first_wedge.len() < self.places.len() {
            self.first_wedge.resize(self.places.len(), NONE);
        }
        let first = self.first_wedge[place as usize];
        let mut at = first;
        while at != NONE {
            let wedge = self.wedges[at as usize];
            if wedge.texcoord == texcoord && wedge.material == self.material {
                return at;
            }
            at = wedge.next;
        }
        let new = self.wedges.len() as u32;
        self.wedges.push(Wedge { place, texcoord, material: self.material, next: first });
        self.first_wedge[place as usize] = new;
        new
    }

    fn usemtl(&mut self, name: Option<&str>) -> Option<()> {
        let name = name?;
        self.material = *self.material_ids.entry(name.to_owned()).or_insert_with(|| {
            self.materials.push(name.to_owned());
            self.materials.len() as u32 - 1
        });
        Some(())
    }

    fn finish(mut self) -> Result<Mesh, String> {
        if self.indices.is_empty() {
            return Err("expected at least one face, found none".to_owned());
        }
        self.first_wedge = Vec::new();
        let positions = self.wedges.iter().map(|wedge| self.places[wedge.place as usize]).collect();
        let place_count = self.places.len();
        self.places = Vec::new();
        let texcoords = if self.texcoords.is_empty() {
            Vec::new()
        } else {
            let texcoord = |wedge: &Wedge| self.texcoords.get(wedge.texcoord as usize).copied().unwrap_or_default();
            self.wedges.iter().map(texcoord).collect()
        };
        Ok(Mesh {
            origin: self.origin.unwrap_or_default(),
            positions,
            texcoords,
            place_of: self.wedges.iter().map(|wedge| wedge.place).collect(),
            place_count,
            material_of: self.wedges.iter().map(|wedge| wedge.material).collect(),
            materials: self.materials,
            mtllibs: self.mtllibs,
            indices: self.indices,
        })
    }
}

/// Powers of ten that an `f64` holds exactly.
const TENS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];

struct Cursor<'a> {
    text: &'a [u8],
    at: usize,
}

impl Cursor<'_> {
    #[inline]
    fn peek(&self) -> u8 {
        self.text[self.at]
    }

    fn skip(&mut self, count: usize) -> &mut Self {
        self.at += count;
        self
    }

    #[inline]
    fn blanks(&mut self) {
        while matches!(self.peek(), b' ' | b'\t' | b'\r') {
            self.at += 1;
        }
    }

    fn next_line(&mut self) {
        while self.peek() != b'\n' {
            self.at += 1;
        }
        self.at += 1;
    }

    /// The rest of the line behind a keyword, trimmed, if the line begins with it.
    fn rest(&mut self, keyword: &str) -> Option<&str> {
        let end = self.at + self.text[self.at..].iter().position(|&byte| byte == b'\n')?;
        let line = std::str::from_utf8(&self.text[self.at..end]).ok()?;
        self.at = end;
        Some(line.strip_prefix(keyword)?.trim())
    }

    /// A decimal number, rounded as the standard library rounds: up to 15 digits and 22 places in one division of
    /// exact numbers, anything else through the standard library.
    #[inline]
    fn float(&mut self) -> Option<f64> {
        self.blanks();
        let start = self.at;
        let negative = self.peek() == b'-';
        self.at += usize::from(negative || self.peek() == b'+');
        let mut mantissa = 0u64;
        let digits_start = self.at;
        self.digits(&mut mantissa);
        let mut digit_count = self.at - digits_start;
        let mut places = 0;
        if self.peek() == b'.' {
            self.at += 1;
            let fraction_start = self.at;
            self.digits(&mut mantissa);
            places = self.at - fraction_start;
            digit_count += places;
        }
        if !matches!(self.peek(), b' ' | b'\t' | b'\r' | b'\n') || digit_count == 0 || digit_count > 15 {
            while !matches!(self.peek(), b' ' | b'\t' | b'\r' | b'\n') {
                self.at += 1;
            }
            let number: f64 = std::str::from_utf8(&self.text[start..self.at]).ok()?.parse().ok()?;
            return number.is_finite().then_some(number);
        }
        let magnitude = mantissa as f64 / TENS[places];
        Some(if negative { -magnitude } else { magnitude })
    }

    #[inline]
    fn digits(&mut self, number: &mut u64) {
        loop {
            let digit = self.peek().wrapping_sub(b'0');
            if digit > 9 {
                return;
            }
            *number = number.wrapping_mul(10).wrapping_add(u64::from(digit));
            self.at += 1;
        }
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn` as indices from 0; the inner `None` is the end of the line.
    #[inline]
    fn corner(&mut self, place_count: usize, texcoord_count: usize) -> Option<Option<(u32, u32)>> {
        self.blanks();
        if matches!(self.peek(), b'\n' | b'#') {
            return Some(None);
        }
        let place = self.index(place_count)?;
        let mut texcoord = NONE;
        if self.peek() == b'/' {
            self.at += 1;
            if self.peek() != b'/' {
                texcoord = self.index(texcoord_count)?;
            }
            while !matches!(self.peek(), b' ' | b'\t' | b'\r' | b'\n') {
                self.at += 1;
            }
        }
        Some(Some((place, texcoord)))
    }

    #[inline]
    fn index(&mut self, count: usize) -> Option<u32> {
        let negative = self.peek() == b'-';
        self.at += usize::from(negative);
        let mut number = 0;
        self.digits(&mut number);
        let index = if negative { (count as u64).wrapping_sub(number) } else { number.wrapping_sub(1) };
        (index < count as u64).then_some(index as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Mesh, String> {
        let mut reader = Reader { materials: vec![String::new()], ..Reader::default() };
        reader.lines(text.as_bytes())?;
        reader.finish()
    }

    #[test]
    fn corners_with_the_same_place_and_texcoord_are_one_wedge() {
        // 4 ── 3     both triangles in one material: four wedges;
        // │  ╱ │     in two materials the diagonal is split: six
        // 1 ── 2
        let head = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n";
        let one = read(&format!("{head}usemtl a\nf 1/1 2/2 3/3\nf -4/-4 -2/-2 -1/-1\n")).unwrap();
        assert_eq!((one.positions.len(), one.indices), (4, vec![0, 1, 2, 0, 2, 3]));
        let two = read(&format!("{head}usemtl a\nf 1/1 2/2 3/3\nusemtl b\nf 1/1 3/3 4/4\n")).unwrap();
        assert_eq!((two.positions.len(), two.material_of), (6, vec![1, 1, 1, 2, 2, 2]));
    }

    #[test]
    fn numbers_are_read_as_the_standard_library_reads_them() {
        for text in ["0.185", "-7.374", "432100.123", "1e-3", ".5", "4.", "-0", "0.1234567890123456789", "+2.5E2"] {
            let line = format!("{text}\n");
            let read = Cursor { text: line.as_bytes(), at: 0 }.float().unwrap();
            assert_eq!(read.to_bits(), text.parse::<f64>().unwrap().to_bits(), "{text}");
        }
    }

    #[test]
    fn an_index_that_does_not_exist_is_refused_with_its_line() {
        assert!(read("v 0 0 0\nf 1 1 2\n").err().unwrap().starts_with("2:"));
        assert!(read("v 0 x 0\n").err().unwrap().starts_with("1:"));
    }
}

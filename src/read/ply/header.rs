//! Parses the header of a PLY file.
//!
//! ```text
//! ply
//! format binary_little_endian 1.0
//! comment TextureFile wall.png
//! element vertex 8
//! property float x
//! …
//! element face 6
//! property list uchar int vertex_indices
//! end_header
//! ```
//! In: the first bytes of a file. Out: a [`PlyHeader`]. Lines end in LF, CR LF or CR, as the first one does. Nothing is
//! allocated by a number in it, and it has at most [`HEADER_BYTES_MAX`].
//!
//! # Source
//! G. Turk, "The PLY Polygon File Format", 1994.

use std::path::Path;

use crate::base::error::escape;
use crate::base::{Error, Result};
use crate::read::line::{quote, split_keyword, trim, words};

/// Longest accepted header in bytes.
pub(super) const HEADER_BYTES_MAX: usize = 256 << 10;
/// Most elements of a file, and most properties of an element.
const ELEMENTS_MAX: usize = 64;
const PROPERTIES_MAX: usize = 256;

/// How the records are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    /// A line of words per record.
    Ascii,
    /// Little-endian numbers.
    Little,
    /// Big-endian numbers.
    Big,
}

/// Type of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn of(word: &[u8]) -> Option<Self> {
        Some(match word {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    /// Size in bytes.
    pub(super) fn bytes(self) -> u64 {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Whether it is an integer.
    pub(super) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// Largest value of an unsigned integer, which colours are a share of; 1 for other types.
    pub(super) fn whole(self) -> f64 {
        match self {
            Self::U8 => 255.0,
            Self::U16 => 65535.0,
            _ => 1.0,
        }
    }
}

/// A property of an element.
#[derive(Debug, Clone)]
pub(super) struct Property {
    /// Its name.
    pub(super) name: Vec<u8>,
    /// Type of the number of items of a list; `None` for a single number.
    pub(super) list: Option<Scalar>,
    /// Type of a number.
    pub(super) scalar: Scalar,
    /// Line of the header, from 1.
    pub(super) line: u64,
}

/// An element: consecutive records with the same properties.
#[derive(Debug, Clone)]
pub(super) struct Element {
    /// Its name.
    pub(super) name: Vec<u8>,
    /// Number of records.
    pub(super) count: u64,
    /// What a record holds, in order.
    pub(super) properties: Vec<Property>,
    /// Line of the header, from 1.
    pub(super) line: u64,
}

impl Element {
    /// Fewest bytes that a record takes.
    pub(super) fn least_bytes(&self, encoding: Encoding) -> u64 {
        match encoding {
            // A digit and what ends a word.
            Encoding::Ascii => 2 * self.properties.len() as u64,
            _ => self.properties.iter().map(|property| property.list.unwrap_or(property.scalar).bytes()).sum(),
        }
    }
}

/// The header of a file.
#[derive(Debug, Clone)]
pub(super) struct PlyHeader {
    /// How the records are written.
    pub(super) encoding: Encoding,
    /// The elements in order.
    pub(super) elements: Vec<Element>,
    /// Names of the texture images: the rest of lines `comment TextureFile`.
    pub(super) textures: Vec<Vec<u8>>,
    /// Length in bytes, the last line end included.
    pub(super) bytes: u64,
    /// Number of lines.
    pub(super) lines: u64,
}

impl PlyHeader {
    /// Parses the header at the start of `text`, which ends with it or holds more than [`HEADER_BYTES_MAX`].
    ///
    /// # Errors
    /// [`Error::Input`] at the first faulty line.
    pub(super) fn parse(path: &Path, text: &[u8]) -> Result<Self> {
        let mut parser = HeaderParser { format: None, elements: Vec::new(), textures: Vec::new() };
        let end: &[u8] = match text.strip_prefix(b"ply") {
            Some([b'\r', b'\n', ..]) => b"\r\n",
            Some([b'\r', ..]) => b"\r",
            Some([b'\n', ..]) => b"\n",
            _ => return Err(Error::input(path, 1, "expected 'ply' on the first line; the file is no PLY")),
        };
        let (mut at, mut line) = (3 + end.len(), 1);
        loop {
            line += 1;
            let fault = |message: String| Error::input(path, line, message);
            let room = &text[at..text.len().min(HEADER_BYTES_MAX)];
            let Some(length) = room.windows(end.len()).position(|window| window == end) else {
                return Err(fault(if text.len() < HEADER_BYTES_MAX {
                    "the file ends inside its header; expected 'end_header'".into()
                } else {
                    format!("expected 'end_header' within {} KiB", HEADER_BYTES_MAX >> 10)
                }));
            };
            // Some writers mix line ends.
            let whole = &room[..length];
            let statement = trim(whole.strip_suffix(b"\r").unwrap_or(whole));
            at += length + end.len();
            if statement == b"end_header" {
                let Some(encoding) = parser.format else {
                    return Err(fault("expected a 'format' line before 'end_header'".into()));
                };
                let HeaderParser { elements, textures, .. } = parser;
                return Ok(Self { encoding, elements, textures, bytes: at as u64, lines: line });
            }
            parser.read(statement, line).map_err(fault)?;
        }
    }

    /// Refuses counts of records that the rest of the file cannot hold.
    ///
    /// # Errors
    /// [`Error::Input`] that names the element, the bytes that it needs at least and where they begin.
    pub(super) fn check_size(&self, path: &Path, file_bytes: u64) -> Result<()> {
        let (mut at, rest) = (self.bytes, file_bytes.saturating_sub(self.bytes));
        for element in &self.elements {
            let least = element.least_bytes(self.encoding);
            let needed = least.saturating_mul(element.count);
            // The last word of a text needs nothing after it.
            let spare = u64::from(self.encoding == Encoding::Ascii);
            if (at - self.bytes).saturating_add(needed) > rest + spare {
                let message = format!(
                    "element '{}' needs at least {needed} bytes ({} records of at least {least}); the file has {} left \
                     at byte {at}",
                    escape(&element.name),
                    element.count,
                    file_bytes.saturating_sub(at),
                );
                return Err(Error::input(path, element.line, message));
            }
            at += needed;
        }
        Ok(())
    }
}

struct HeaderParser {
    format: Option<Encoding>,
    elements: Vec<Element>,
    textures: Vec<Vec<u8>>,
}

impl HeaderParser {
    fn read(&mut self, statement: &[u8], line: u64) -> std::result::Result<(), String> {
        let (keyword, rest) = split_keyword(statement);
        match keyword {
            b"format" => self.read_format(rest),
            b"comment" => {
                let (key, name) = split_keyword(rest);
                if key.eq_ignore_ascii_case(b"TextureFile") && !name.is_empty() {
                    self.textures.push(name.to_vec());
                }
                Ok(())
            }
            b"element" => self.read_element(rest, line),
            b"property" => self.read_property(rest, line),
            b"obj_info" | b"" => Ok(()),
            _ => Err(format!("expected format, comment, element, property or end_header, found '{}'", quote(keyword))),
        }
    }

    fn read_format(&mut self, rest: &[u8]) -> std::result::Result<(), String> {
        if self.format.is_some() {
            return Err("a second 'format' line".into());
        }
        let (name, version) = split_keyword(rest);
        self.format = Some(match name {
            b"ascii" => Encoding::Ascii,
            b"binary_little_endian" => Encoding::Little,
            b"binary_big_endian" => Encoding::Big,
            _ => {
                let found = quote(name);
                return Err(format!("expected ascii, binary_little_endian or binary_big_endian, found '{found}'"));
            }
        });
        match version {
            b"1.0" => Ok(()),
            _ => Err(format!("expected version 1.0, found '{}'", quote(version))),
        }
    }

    fn read_element(&mut self, rest: &[u8], line: u64) -> std::result::Result<(), String> {
        let (name, count) = split_keyword(rest);
        let digits = std::str::from_utf8(count).ok().filter(|text| text.bytes().all(|byte| byte.is_ascii_digit()));
        let Some(count) = digits.and_then(|text| text.parse::<u64>().ok()) else {
            return Err(format!("expected a name and a number of records, found '{}'", quote(rest)));
        };
        if self.elements.iter().any(|element| element.name == name) {
            return Err(format!("a second element '{}'", quote(name)));
        }
        if self.elements.len() == ELEMENTS_MAX {
            return Err(format!("more than {ELEMENTS_MAX} elements"));
        }
        self.elements.push(Element { name: name.to_vec(), count, properties: Vec::new(), line });
        Ok(())
    }

    fn read_property(&mut self, rest: &[u8], line: u64) -> std::result::Result<(), String> {
        let Some(element) = self.elements.last_mut() else {
            return Err("a property before the first element".into());
        };
        let all: Vec<&[u8]> = words(rest).take(5).collect();
        let parsed = match all[..] {
            [b"list", count, scalar, name] => Scalar::of(count)
                .filter(|count| count.is_integer())
                .zip(Scalar::of(scalar))
                .map(|(count, scalar)| Property { name: name.to_vec(), list: Some(count), scalar, line }),
            [scalar, name] => {
                Scalar::of(scalar).map(|scalar| Property { name: name.to_vec(), list: None, scalar, line })
            }
            _ => None,
        };
        let Some(property) = parsed else {
            return Err(format!(
                "expected a property such as 'float x' or 'list uchar int vertex_indices', found '{}'",
                quote(rest)
            ));
        };
        if element.properties.iter().any(|other| other.name == property.name) {
            return Err(format!("a second property '{}' of element '{}'", quote(&property.name), quote(&element.name)));
        }
        if element.properties.len() == PROPERTIES_MAX {
            return Err(format!("more than {PROPERTIES_MAX} properties of element '{}'", quote(&element.name)));
        }
        element.properties.push(property);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> std::result::Result<PlyHeader, String> {
        PlyHeader::parse(Path::new("a.ply"), text.as_bytes()).map_err(|error| error.to_string())
    }

    #[test]
    fn a_header_is_read_with_any_line_end() {
        let text = "ply\nformat ascii 1.0\ncomment by hand\ncomment TextureFile my wall.png\nobj_info x\nelement vertex 3\n\
                    property float x\nelement face 1\nproperty list uchar int32 vertex_index\nend_header\n";
        for end in ["\n", "\r\n", "\r"] {
            let text = text.replace('\n', end);
            let header = parse(&(text.clone() + "\n1")).unwrap();
            assert_eq!((header.bytes, header.lines), (text.len() as u64, 10));
            assert_eq!((header.encoding, header.elements.len(), header.elements[0].count), (Encoding::Ascii, 2, 3));
            assert_eq!(header.textures, [b"my wall.png"]);
            let list = &header.elements[1].properties[0];
            assert_eq!((list.list, list.scalar, list.line), (Some(Scalar::U8), Scalar::I32, 9));
        }
    }

    #[test]
    fn faulty_headers_are_named_by_line() {
        let start = "ply\nformat ascii 1.0\n";
        for (text, expected) in [
            ("plx\n", "a.ply:1: expected 'ply'"),
            ("ply", "a.ply:1: expected 'ply'"),
            ("ply\n", "a.ply:2: the file ends inside its header"),
            ("ply\nformat ascii 2.0\n", "a.ply:2: expected version 1.0, found '2.0'"),
            ("ply\nformat text 1.0\n", "a.ply:2: expected ascii, binary_little_endian"),
            ("ply\nend_header\n", "a.ply:2: expected a 'format' line"),
            (&format!("{start}format ascii 1.0\n"), "a.ply:3: a second 'format' line"),
            (&format!("{start}element vertex -1\n"), "a.ply:3: expected a name and a number of records"),
            (&format!("{start}element vertex 99999999999999999999\n"), "a.ply:3: expected a name and a number"),
            (&format!("{start}property float x\n"), "a.ply:3: a property before the first element"),
            (&format!("{start}element v 1\nproperty real x\n"), "a.ply:4: expected a property such as"),
            (&format!("{start}element v 1\nproperty list float int x\n"), "a.ply:4: expected a property such as"),
            (&format!("{start}element v 1\nproperty int x\nproperty int x\n"), "a.ply:5: a second property 'x'"),
            (&format!("{start}element v 1\nelement v 1\n"), "a.ply:4: a second element 'v'"),
            (&format!("{start}vertices 9\n"), "a.ply:3: expected format, comment, element"),
            (&format!("{start}comment {}", "x".repeat(HEADER_BYTES_MAX)), "a.ply:3: expected 'end_header' within"),
        ] {
            let found = parse(text).unwrap_err();
            assert!(found.starts_with(expected), "{found}");
        }
    }

    #[test]
    fn counts_that_the_file_cannot_hold_are_refused_at_once() {
        let text = "ply\nformat binary_little_endian 1.0\nelement vertex 18446744073709551615\nproperty float x\n\
                    element face 2\nproperty list uchar int vertex_index\nend_header\n";
        let header = parse(text).unwrap();
        let error = header.check_size(Path::new("a.ply"), header.bytes + 9).unwrap_err().to_string();
        assert!(
            error.contains("a.ply:3: ")
                && error.contains("records of at least 4)")
                && error.contains("has 9 left at byte"),
            "{error}"
        );
        let header = parse(&text.replace("18446744073709551615", "2")).unwrap();
        assert!(header.check_size(Path::new("a.ply"), header.bytes + 10).is_ok());
        assert!(header.check_size(Path::new("a.ply"), header.bytes + 9).is_err());
    }
}

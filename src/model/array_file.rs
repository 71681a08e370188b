//! The layout of an array file: a mesh as arrays of fixed records, as a program hands it over and gets it back.
//!
//! ```text
//!  0  "drystone"                              8 bytes
//!  8  1, the version                          u64 each
//! 16  vertices, texture coordinates, faces
//! 40  1 colours + 2 texture coordinates of faces + 4 labels
//! 48  corners of a face, images, bytes of their text
//! 72  "LABEL NAME\n" for each image, in bytes; then zeros up to a multiple of 8
//!     x y z f64 [red green blue f32]          each vertex
//!     u v f64                                 each texture coordinate
//!     a b c … u32 [A B C … u32] [label u32]   each face: vertices, texture coordinates, label
//! ```
//! All numbers are little-endian; indices count from 0, and 2³² - 1 stands for none: behind the corners of a polygon that
//! has fewer than others, for a corner without texture coordinate, for a face without label. An image is the texture of
//! the faces with its label; its name is relative to the folder of the file.

use super::face::POLYGON_CORNERS_MAX;

/// First bytes of an array file.
pub const MAGIC: [u8; 8] = *b"drystone";
/// Version of the layout.
const VERSION: u64 = 1;
/// Bytes before the text of the images.
pub const FIXED_BYTES: u64 = 72;
/// Longest accepted header, in bytes.
const HEADER_BYTES_MAX: u64 = 16 << 20;
/// Stands for no corner, a corner without texture coordinate, and a face without label.
pub const NONE: u32 = u32::MAX;

/// What an array file holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ArrayLayout {
    /// Number of vertices.
    pub vertices: u64,
    /// Number of texture coordinates.
    pub texcoords: u64,
    /// Number of faces.
    pub faces: u64,
    /// Largest number of corners of a face, 3 to [`POLYGON_CORNERS_MAX`].
    pub corners: usize,
    /// Whether vertices have colours.
    pub has_colours: bool,
    /// Whether faces have texture coordinates.
    pub has_texcoords: bool,
    /// Whether faces have labels.
    pub has_labels: bool,
    /// Label and name of each image.
    pub images: Vec<(u32, Vec<u8>)>,
}

impl ArrayLayout {
    /// Bytes of a vertex.
    pub fn vertex_bytes(&self) -> u64 {
        if self.has_colours { 36 } else { 24 }
    }

    /// Bytes of a texture coordinate.
    pub const TEXCOORD_BYTES: u64 = 16;

    /// Bytes of a face.
    pub fn face_bytes(&self) -> u64 {
        4 * self.face_words() as u64
    }

    /// 32-bit words of a face.
    pub fn face_words(&self) -> usize {
        self.corners * (1 + usize::from(self.has_texcoords)) + usize::from(self.has_labels)
    }

    /// The header of a file.
    pub fn encode(&self) -> Vec<u8> {
        let mut text = Vec::new();
        for (label, name) in &self.images {
            text.extend_from_slice(label.to_string().as_bytes());
            text.push(b' ');
            text.extend_from_slice(name);
            text.push(b'\n');
        }
        let flags = u64::from(self.has_colours) + 2 * u64::from(self.has_texcoords) + 4 * u64::from(self.has_labels);
        let (corners, images, text_bytes) = (self.corners as u64, self.images.len() as u64, text.len() as u64);
        let words = [VERSION, self.vertices, self.texcoords, self.faces, flags, corners, images, text_bytes];
        let mut header = MAGIC.to_vec();
        words.iter().for_each(|word| header.extend_from_slice(&word.to_le_bytes()));
        header.extend_from_slice(&text);
        header.resize(header.len().next_multiple_of(8), 0);
        header
    }

    /// Length of the header that begins with [`FIXED_BYTES`] bytes, in a file of `file_bytes` bytes.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn header_bytes(start: &[u8], file_bytes: u64) -> Result<u64, String> {
        let words = words_of(start)?;
        let header_bytes = FIXED_BYTES.saturating_add(words[7]).checked_next_multiple_of(8).unwrap_or(u64::MAX);
        if header_bytes > HEADER_BYTES_MAX.min(file_bytes) {
            return Err(format!("a header of {header_bytes} bytes; the file has {file_bytes}"));
        }
        Ok(header_bytes)
    }

    /// Reads a whole header of a file of `file_bytes` bytes.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(header: &[u8], file_bytes: u64) -> Result<Self, String> {
        let [version, vertices, texcoords, faces, flags, corners, images, text_bytes] = words_of(header)?;
        if version != VERSION {
            return Err(format!("expected version {VERSION} of an array file, found {version}"));
        }
        if flags > 7 {
            return Err(format!("unknown flags {flags}"));
        }
        if !(3..=POLYGON_CORNERS_MAX as u64).contains(&corners) {
            return Err(format!("expected 3 to {POLYGON_CORNERS_MAX} corners of a face, found {corners}"));
        }
        let corners = corners as usize;
        let header_bytes = Self::header_bytes(header, file_bytes)?;
        let text = header.get(FIXED_BYTES as usize..(FIXED_BYTES + text_bytes) as usize);
        let images = parse_images(text.ok_or("the file ends inside its header")?, images)?;
        let [has_colours, has_texcoords, has_labels] = [1, 2, 4].map(|bit| flags & bit != 0);
        let layout = Self { vertices, texcoords, faces, corners, has_colours, has_texcoords, has_labels, images };
        let expected = layout.records_bytes().and_then(|bytes| bytes.checked_add(header_bytes));
        if expected != Some(file_bytes) {
            let expected = expected.map_or("more".to_owned(), |bytes| bytes.to_string());
            return Err(format!("the header describes {expected} bytes; the file has {file_bytes}"));
        }
        Ok(layout)
    }

    /// Bytes of all records; `None` if they are more than can be counted.
    fn records_bytes(&self) -> Option<u64> {
        let of = |count: u64, bytes: u64| count.checked_mul(bytes);
        of(self.vertices, self.vertex_bytes())?
            .checked_add(of(self.texcoords, Self::TEXCOORD_BYTES)?)?
            .checked_add(of(self.faces, self.face_bytes())?)
    }
}

/// The numbers at the beginning of a header.
fn words_of(start: &[u8]) -> Result<[u64; 8], String> {
    let Some(rest) = start.strip_prefix(&MAGIC) else {
        return Err("expected an array file, which begins with 'drystone'".to_owned());
    };
    let (chunks, _) = rest.as_chunks::<8>();
    let words = chunks.first_chunk::<8>().ok_or("the file ends inside its header")?;
    Ok(words.map(u64::from_le_bytes))
}

fn parse_images(text: &[u8], count: u64) -> Result<Vec<(u32, Vec<u8>)>, String> {
    let lines = text.split_inclusive(|byte| *byte == b'\n');
    let image = |line: &[u8]| {
        let line = line.strip_suffix(b"\n")?;
        let space = line.iter().position(|byte| *byte == b' ')?;
        let label = std::str::from_utf8(&line[..space]).ok()?.parse().ok()?;
        Some((label, line[space + 1..].to_vec()))
    };
    let images: Vec<_> = lines.map(image).collect::<Option<_>>().ok_or("expected 'LABEL NAME' for each image")?;
    if images.len() as u64 != count {
        return Err(format!("expected {count} images, found {}", images.len()));
    }
    Ok(images)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout() -> ArrayLayout {
        ArrayLayout {
            vertices: 4,
            texcoords: 3,
            faces: 2,
            corners: 4,
            has_colours: true,
            has_texcoords: true,
            has_labels: true,
            images: vec![(0, b"a wall.png".to_vec()), (7, b"b.jpg".to_vec())],
        }
    }

    #[test]
    fn a_header_comes_back_as_it_was() {
        for flags in 0..8 {
            let bit = |bit: u32| flags & bit != 0;
            let images = if flags == 0 { Vec::new() } else { layout().images };
            let layout =
                ArrayLayout { has_colours: bit(1), has_texcoords: bit(2), has_labels: bit(4), images, ..layout() };
            let header = layout.encode();
            let whole = header.len() as u64 + layout.records_bytes().unwrap();
            assert_eq!(ArrayLayout::header_bytes(&header[..FIXED_BYTES as usize], whole), Ok(header.len() as u64));
            assert_eq!(ArrayLayout::parse(&header, whole), Ok(layout));
            assert!(ArrayLayout::parse(&header, whole - 1).is_err() && ArrayLayout::parse(&header, whole + 1).is_err());
        }
    }

    #[test]
    fn a_damaged_header_is_refused() {
        let header = layout().encode();
        let whole = header.len() as u64 + layout().records_bytes().unwrap();
        for length in 0..header.len() {
            assert!(ArrayLayout::parse(&header[..length], whole).is_err() || length >= header.len() - 7, "{length}");
        }
        for (place, byte) in
            [(0, b'x'), (8, 2), (23, 255), (40, 8), (48, 2), (50, 1), (56, 3), (64, 255), (71, 255), (72, b'x')]
        {
            let mut damaged = header.clone();
            damaged[place] = byte;
            assert!(ArrayLayout::parse(&damaged, whole).is_err(), "{place}");
        }
    }
}

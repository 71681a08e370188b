//! What the properties of a PLY mean: which numbers of a record are kept, and which are passed over.
//!
//! In: a header. Out: the steps in which a record of each element is read, and what the file holds. Properties go by
//! the names that programs use: `x y z`, `nx ny nz`, `red green blue`, `u v`, `s t` or `texture_u texture_v` of a
//! vertex; `vertex_indices`, `texcoord` and `texnumber` of a face.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use super::header::{Element, Encoding, PlyHeader, Property, Scalar};
use crate::base::{Error, Result};
use crate::model::texture_file::base_name;
use crate::read::line::quote;

/// A step in reading a record.
#[derive(Debug, Clone, Copy)]
pub(super) enum FieldStep {
    /// Numbers that are passed over: how many, and their bytes.
    Skip { words: usize, bytes: usize },
    /// A number of a vertex.
    Number { role: usize, scalar: Scalar },
    /// Index of the texture image of a face.
    TextureNumber(Scalar),
    /// A list: type of its length, type of its items.
    List { role: ListRole, length: Scalar, scalar: Scalar },
}

impl FieldStep {
    /// Largest memory of what is kept of a list by its length in the file.
    fn growth(&self) -> u64 {
        match *self {
            Self::List { role: ListRole::Vertices, scalar, .. } => CORNER_BYTES.div_ceil(scalar.bytes()),
            Self::List { role: ListRole::Texcoords, scalar, .. } => TEXCOORD_BYTES.div_ceil(scalar.bytes()),
            _ => VERTEX_BYTES / CORNER_BYTES,
        }
    }
}

/// What a list is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ListRole {
    /// Vertices of the corners of a face.
    Vertices,
    /// Two texture coordinates for each corner.
    Texcoords,
    /// Nothing.
    Skipped,
}

/// Numbers of a vertex by role: x y z, red green blue, u v.
pub(super) const ROLES: usize = 8;
/// Role of the first channel of a colour, and of the first texture coordinate.
pub(super) const RED: usize = 3;
pub(super) const U: usize = 6;
/// Names by role; the last two have several.
const NAMES: [&[u8]; 6] = [b"x", b"y", b"z", b"red", b"green", b"blue"];
const TEXCOORD_NAMES: [[&[u8]; 2]; 3] = [[b"texture_u", b"texture_v"], [b"u", b"v"], [b"s", b"t"]];
const NORMAL_NAMES: [&[u8]; 3] = [b"nx", b"ny", b"nz"];

/// Element that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ElementKind {
    Vertex,
    Face,
    Other,
}

/// How the records of an element are read.
#[derive(Debug)]
pub(super) struct ElementLayout {
    /// What the records are.
    pub(super) kind: ElementKind,
    /// The steps in which a record is read.
    pub(super) steps: Vec<FieldStep>,
    /// Size of every record in bytes in a binary file; `None` if it has lists.
    pub(super) record_bytes: Option<u64>,
}

/// Where texture coordinates are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Texcoords {
    Nowhere,
    OfVertices,
    OfFaces,
}

/// How a file is read.
#[derive(Debug)]
pub(super) struct Layout {
    /// Its header.
    pub(super) header: PlyHeader,
    /// Layout of each element.
    pub(super) elements: Vec<ElementLayout>,
    /// Number of vertices.
    pub(super) vertex_count: u64,
    /// Whether vertices have colours.
    pub(super) has_colours: bool,
    /// Whether vertices have normals.
    pub(super) has_normals: bool,
    /// Where texture coordinates are.
    pub(super) texcoords: Texcoords,
    /// Whether positions are 32-bit floats, whose digits are limited.
    pub(super) has_float_positions: bool,
    /// Name of the material of each texture image.
    pub(super) materials: Vec<Vec<u8>>,
    /// Findings in the header: kind, line and words.
    pub(super) notes: Vec<(&'static str, u64, String)>,
    /// Number of alpha channels that are ignored.
    pub(super) ignored_alphas: u64,
}

/// Memory of parsed records in bytes: a position with its packed form, a colour and a texture coordinate of a vertex;
/// each corner of a face; each of its two texture coordinates.
const VERTEX_BYTES: u64 = 92;
const CORNER_BYTES: u64 = 8;
const TEXCOORD_BYTES: u64 = 18;
/// Largest memory of records of text by its length: texture coordinates of one digit.
const TEXT_GROWTH: u64 = TEXCOORD_BYTES / 2;

impl Layout {
    /// Largest memory of the parsed records of an element by their length in the file.
    pub(super) fn growth(&self, element: usize) -> u64 {
        let Some(own) = self.elements.get(element) else { return 0 };
        match (self.header.encoding, own.record_bytes) {
            (Encoding::Ascii, _) => TEXT_GROWTH,
            (_, Some(bytes)) => VERTEX_BYTES.div_ceil(bytes.max(1)),
            (_, None) => own.steps.iter().map(FieldStep::growth).max().unwrap_or(0),
        }
    }

    /// Finds out how to read a file.
    ///
    /// # Errors
    /// [`Error::Input`] if the file has no vertices with positions or no faces with indices.
    pub(super) fn new(path: &Path, header: PlyHeader) -> Result<Self> {
        let find = |name: &[u8]| header.elements.iter().find(|element| element.name == name);
        let missing = |words: &str| Error::input(path, 0, words);
        let vertex =
            find(b"vertex").ok_or_else(|| missing("expected an element 'vertex' in the header, found none"))?;
        let face = find(b"face")
            .ok_or_else(|| missing("no faces: the header has no element 'face'; a point cloud cannot be simplified"))?;
        let has = |element: &Element, name: &[u8]| {
            element.properties.iter().any(|property| property.name == name && property.list.is_none())
        };
        if let Some(name) = NAMES[..3].iter().find(|name| !has(vertex, name)) {
            return Err(missing(&format!("expected a property '{}' of element 'vertex', found none", quote(name))));
        }
        match vertex_list(face) {
            None => return Err(missing("expected a list 'vertex_indices' of element 'face', found none")),
            Some(list) if !list.scalar.is_integer() => {
                return Err(Error::input(path, list.line, "expected vertex indices that are integers"));
            }
            Some(_) => {}
        }
        let has_lists = face.properties.iter().any(|property| property.name == b"texcoord" && property.list.is_some());
        let pair = TEXCOORD_NAMES.iter().find(|pair| pair.iter().all(|name| has(vertex, name)));
        let texcoords = match (has_lists, pair) {
            (true, _) => Texcoords::OfFaces,
            (false, Some(_)) => Texcoords::OfVertices,
            (false, None) => Texcoords::Nowhere,
        };
        let mut layout = Self {
            vertex_count: vertex.count,
            has_colours: NAMES[RED..].iter().all(|name| has(vertex, name)),
            has_normals: NORMAL_NAMES.iter().all(|name| has(vertex, name)),
            texcoords,
            has_float_positions: has_float_positions(vertex),
            materials: Vec::new(),
            elements: Vec::new(),
            notes: Vec::new(),
            ignored_alphas: 0,
            header,
        };
        layout.name_materials();
        layout.lay_out(pair.filter(|_| texcoords == Texcoords::OfVertices));
        Ok(layout)
    }

    /// Names a material after each texture image: its file name without folders and ending.
    fn name_materials(&mut self) {
        let textures = &self.header.textures;
        if self.texcoords == Texcoords::Nowhere {
            if let Some(first) = textures.first() {
                let words = format!("texture '{}' is ignored: there are no texture coordinates", quote(first));
                self.notes.push(("unused_textures", 0, words));
            }
            return;
        }
        let (mut first_places, mut taken): (HashMap<&[u8], usize>, HashSet<Vec<u8>>) = Default::default();
        for (place, texture) in textures.iter().enumerate() {
            let first = *first_places.entry(texture).or_insert(place);
            if first < place {
                self.materials.push(self.materials[first].clone());
                continue;
            }
            let file = base_name(texture);
            let stem = match file.iter().rposition(|&byte| byte == b'.') {
                Some(dot) if dot > 0 => &file[..dot],
                _ => file,
            };
            let mut name = if stem.is_empty() { b"texture".to_vec() } else { stem.to_vec() };
            while !taken.insert(name.clone()) {
                name.extend_from_slice(format!("_{place}").as_bytes());
            }
            self.materials.push(name);
        }
    }

    fn lay_out(&mut self, texcoord_names: Option<&[&[u8]; 2]>) {
        let elements = std::mem::take(&mut self.header.elements);
        for element in &elements {
            let kind = match &element.name[..] {
                b"vertex" => ElementKind::Vertex,
                b"face" => ElementKind::Face,
                _ => ElementKind::Other,
            };
            if kind == ElementKind::Other && element.count > 0 {
                let words = format!("{} records of element '{}' are ignored", element.count, quote(&element.name));
                self.notes.push(("unknown_elements", element.line, words));
            }
            let mut steps: Vec<FieldStep> = Vec::new();
            for property in &element.properties {
                match (self.step(kind, element, property, texcoord_names), steps.last_mut()) {
                    (
                        FieldStep::Skip { words, bytes },
                        Some(FieldStep::Skip { words: all_words, bytes: all_bytes }),
                    ) => {
                        *all_words += words;
                        *all_bytes += bytes;
                    }
                    (step, _) => steps.push(step),
                }
            }
            let is_fixed = element.properties.iter().all(|property| property.list.is_none());
            let record_bytes = element.properties.iter().map(|property| property.scalar.bytes()).sum();
            self.elements.push(ElementLayout { kind, steps, record_bytes: is_fixed.then_some(record_bytes) });
        }
        self.header.elements = elements;
    }

    /// How a property is read; notes one that is ignored.
    fn step(
        &mut self,
        kind: ElementKind,
        element: &Element,
        property: &Property,
        texcoord_names: Option<&[&[u8]; 2]>,
    ) -> FieldStep {
        let Property { name, list, scalar, line } = property;
        let skip = FieldStep::Skip { words: 1, bytes: scalar.bytes() as usize };
        let role = match (kind, list) {
            (ElementKind::Face, Some(_)) if vertex_list(element).is_some_and(|list| std::ptr::eq(list, property)) => {
                ListRole::Vertices
            }
            (ElementKind::Face, Some(_)) if name == b"texcoord" => ListRole::Texcoords,
            _ => ListRole::Skipped,
        };
        let step = match list {
            Some(length) => FieldStep::List { role, length: *length, scalar: *scalar },
            None => match kind {
                ElementKind::Face if name == b"texnumber" => return FieldStep::TextureNumber(*scalar),
                ElementKind::Vertex => {
                    let colour_or_position = if self.has_colours { &NAMES[..] } else { &NAMES[..RED] };
                    let own = colour_or_position.iter().position(|other| other == name);
                    let of_texture = || texcoord_names?.iter().position(|other| other == name).map(|place| U + place);
                    match own.or_else(of_texture) {
                        Some(role) => return FieldStep::Number { role, scalar: *scalar },
                        None => skip,
                    }
                }
                _ => skip,
            },
        };
        if kind == ElementKind::Vertex && list.is_none() && name == b"alpha" {
            self.ignored_alphas += element.count;
        } else if kind != ElementKind::Other
            && role == ListRole::Skipped
            && !(kind == ElementKind::Vertex && NORMAL_NAMES.iter().any(|other| other == name))
        {
            let words = format!("property '{}' of element '{}' is ignored", quote(name), quote(&element.name));
            self.notes.push(("unknown_properties", *line, words));
        }
        step
    }
}

/// The list with the corners of a face: the first one of either name.
fn vertex_list(face: &Element) -> Option<&Property> {
    let is_list = |property: &&Property| matches!(&*property.name, b"vertex_indices" | b"vertex_index");
    face.properties.iter().find(|property| property.list.is_some() && is_list(property))
}

fn has_float_positions(vertex: &Element) -> bool {
    let is_float = |name: &&[u8]| {
        vertex.properties.iter().any(|property| property.name == **name && property.scalar == Scalar::F32)
    };
    NAMES[..3].iter().all(is_float)
}

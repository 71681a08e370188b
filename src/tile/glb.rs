//! Writes a tile as a GLB: one mesh, one image, positions on the lattice of the level.
//!
//! ```text
//! vertices   i16 x y z, 0, u16 u v      12 bytes; f32 x y z, u16 u v (16 bytes) where a tile is too large
//! indices    u16, or u32
//! image      the file
//! ```
//! Vertices and triangles may be compressed; triangles are then in another order, those of the skirt last all the same.
//!
//! A node scales the places of the lattice to the mesh's unit, turns z up to y up, and moves them to the tile's middle,
//! which is a place of the lattice itself: equal places of two tiles are equal numbers.
//!
//! # Source
//! Khronos, glTF 2.0; `KHR_mesh_quantization`; `KHR_materials_unlit`; `EXT_meshopt_compression`.

use glam::{DVec2, DVec3, IVec3};
use serde_json::{Value, json};

use super::lattice::FLOAT_PLACES_MAX;
use super::meshopt::{encode_attributes, encode_triangles, for_reuse, strips_in_rows, vertices_by_use};
use crate::geometry::boxtree::Bounds;
use crate::model::image_format::ImageFormat;
use crate::write::glb_format::{
    ARRAY_BUFFER, CLAMP_TO_EDGE, ELEMENT_ARRAY_BUFFER, FLOAT, LINEAR, LINEAR_MIPMAP_LINEAR, MESHOPT, NO_COLOUR, SHORT,
    UNLIT, UNSIGNED_INT, UNSIGNED_SHORT, Z_TO_Y, linear, padded,
};

const QUANTIZATION: &str = "KHR_mesh_quantization";

/// A vertex of a tile.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TileVertex {
    /// Place on the lattice, from the middle of the tile.
    pub place: IVec3,
    /// Texture coordinate, with (0, 0) at the upper left of the image.
    pub texcoord: DVec2,
}

/// What a file holds.
#[derive(Debug, Default)]
pub struct TileContent {
    /// Vertices.
    pub vertices: Vec<TileVertex>,
    /// Vertices of each triangle; those of the skirt come last.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles of the skirt, two for each edge of the border: (end, start, foot) and (end, foot, other foot), each
    /// from any of its corners on.
    pub skirt_triangles: usize,
    /// The image file and its format; `None` for a tile without texture.
    pub image: Option<(Vec<u8>, ImageFormat)>,
    /// Length of a step of the lattice.
    pub step: f64,
    /// Position of the middle of the tile, relative to the origin of the scene.
    pub middle: DVec3,
}

impl TileContent {
    /// The bytes of the file, with compressed vertices and triangles or without.
    pub fn to_glb(&self, is_compressed: bool) -> Vec<u8> {
        let layout = if is_compressed { self.compressed() } else { self.plain() };
        let mut chunk = Vec::new();
        let offsets = layout.parts.each_ref().map(|part| {
            chunk.extend_from_slice(part.stored());
            pad(&mut chunk, 0);
            chunk.len() - padded(part.stored().len() as u64) as usize
        });
        let geometry_bytes = chunk.len();
        if let Some((image, _)) = &self.image {
            chunk.extend_from_slice(image);
            pad(&mut chunk, 0);
        }
        let mut buffers = vec![json!({ "byteLength": chunk.len() })];
        let mut views = if is_compressed {
            buffers.push(layout.fallback());
            layout.compressed_views(offsets)
        } else {
            layout.plain_views(offsets)
        };
        if let Some((image, _)) = &self.image {
            views.push(json!({ "buffer": 0, "byteOffset": geometry_bytes, "byteLength": image.len() }));
        }
        let mut document = self.document(&layout, is_compressed);
        document["buffers"] = json!(buffers);
        document["bufferViews"] = json!(views);
        assemble(&document, chunk)
    }

    /// Vertices and triangles as they are.
    fn plain(&self) -> TileLayout {
        TileLayout::new(&self.vertices, &self.triangles)
    }

    /// Vertices and triangles in an order that compresses well, and compressed.
    fn compressed(&self) -> TileLayout {
        let surface = self.triangles.len() - self.skirt_triangles;
        let mut triangles = for_reuse(&self.triangles[..surface], self.vertices.len());
        triangles.extend(strips_in_rows(&self.triangles[surface..]));
        let ordered = vertices_by_use(&triangles, self.vertices.len());
        let vertices: Vec<TileVertex> = ordered.vertices.iter().map(|&old| self.vertices[old as usize]).collect();
        let mut layout = TileLayout::new(&vertices, &ordered.triangles);
        let [vertices, triangles] = &mut layout.parts;
        vertices.compressed = Some(encode_attributes(&vertices.plain, vertices.stride));
        triangles.compressed = Some(encode_triangles(&ordered.triangles));
        layout
    }

    /// The document without buffers and their views.
    fn document(&self, layout: &TileLayout, is_compressed: bool) -> Value {
        let (low, high) = self.extent();
        let positions = json!({
            "bufferView": 0, "byteOffset": 0, "componentType": if layout.is_short { SHORT } else { FLOAT },
            "count": self.vertices.len(), "type": "VEC3", "min": low.to_array(), "max": high.to_array(),
        });
        let texcoords = json!({
            "bufferView": 0, "byteOffset": layout.parts[0].stride - 4, "componentType": UNSIGNED_SHORT,
            "normalized": true, "count": self.vertices.len(), "type": "VEC2",
        });
        let corners = json!({
            "bufferView": 1, "byteOffset": 0, "componentType": if layout.is_wide { UNSIGNED_INT } else { UNSIGNED_SHORT },
            "count": 3 * self.triangles.len(), "type": "SCALAR",
        });
        let mut attributes = json!({ "POSITION": 0 });
        let mut material = json!({ "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 1 } });
        material["doubleSided"] = json!(true);
        let mut required = Vec::from_iter((layout.is_short || self.image.is_some()).then_some(QUANTIZATION));
        required.extend(is_compressed.then_some(MESHOPT));
        required.extend(self.image.as_ref().and_then(|(_, format)| format.extension()));
        let mut used = required.clone();
        let mut document = json!({
            "asset": { "version": "2.0", "generator": concat!("drystone ", env!("CARGO_PKG_VERSION")) },
            "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [self.node()],
        });
        if let Some((_, format)) = &self.image {
            attributes["TEXCOORD_0"] = json!(2);
            material["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
            material["extensions"] = json!({ UNLIT: {} });
            used.insert(0, UNLIT);
            document["images"] = json!([{ "bufferView": 2, "mimeType": format.media_type() }]);
            document["textures"] = match format.extension() {
                None => json!([{ "source": 0, "sampler": 0 }]),
                Some(extension) => json!([{ "sampler": 0, "extensions": { extension: { "source": 0 } } }]),
            };
            document["samplers"] = json!([{
                "magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR, "wrapS": CLAMP_TO_EDGE, "wrapT": CLAMP_TO_EDGE,
            }]);
            document["accessors"] = json!([positions, corners, texcoords]);
        } else {
            let [red, green, blue] = NO_COLOUR.map(|channel| linear(f64::from(channel) / 255.0));
            material["pbrMetallicRoughness"]["baseColorFactor"] = json!([red, green, blue, 1]);
            document["accessors"] = json!([positions, corners]);
        }
        document["meshes"] = json!([{
            "primitives": [{ "attributes": attributes, "indices": 1, "material": 0 }],
            "extras": { "skirtTriangles": self.skirt_triangles },
        }]);
        document["materials"] = json!([material]);
        for (key, names) in [("extensionsUsed", used), ("extensionsRequired", required)] {
            if !names.is_empty() {
                document[key] = json!(names);
            }
        }
        document
    }

    fn node(&self) -> Value {
        let DVec3 { x, y, z } = self.middle;
        let scale = [self.step; 3];
        json!({ "mesh": 0, "translation": [x, z, -y], "rotation": Z_TO_Y, "scale": scale })
    }

    /// Moves the vertices of a tile that is wider than floats can count to the nearest places that they hold exactly.
    pub fn settle(&mut self) {
        let farthest = self.vertices.iter().map(|vertex| vertex.place.abs().max_element()).max().unwrap_or(0);
        if farthest <= FLOAT_PLACES_MAX {
            return;
        }
        let unit = (farthest as u32).div_ceil(FLOAT_PLACES_MAX as u32).next_power_of_two() as i32;
        for vertex in &mut self.vertices {
            vertex.place = (vertex.place + unit / 2).div_euclid(IVec3::splat(unit)) * unit;
        }
    }

    /// The smallest box around it, relative to the origin of the scene.
    pub fn bounds(&self) -> Bounds {
        let (low, high) = self.extent();
        let position = |place: IVec3| self.middle + place.as_dvec3() * self.step;
        Bounds { low: position(low), high: position(high) }
    }

    fn extent(&self) -> (IVec3, IVec3) {
        let places = || self.vertices.iter().map(|vertex| vertex.place);
        let low = places().reduce(IVec3::min).unwrap_or_default();
        (low, places().reduce(IVec3::max).unwrap_or_default())
    }
}

/// Vertices or triangles as bytes.
struct GeometryPart {
    plain: Vec<u8>,
    /// `None` if they are stored as they are.
    compressed: Option<Vec<u8>>,
    /// Bytes of a vertex, or of an index.
    stride: usize,
    /// How they are compressed.
    mode: &'static str,
    /// The use of their buffer.
    target: u32,
}

impl GeometryPart {
    fn stored(&self) -> &[u8] {
        self.compressed.as_ref().unwrap_or(&self.plain)
    }
}

/// What the binary chunk holds besides the image.
struct TileLayout {
    is_short: bool,
    is_wide: bool,
    /// Vertices, and triangles.
    parts: [GeometryPart; 2],
}

impl TileLayout {
    fn new(vertices: &[TileVertex], triangles: &[[u32; 3]]) -> Self {
        let is_short = vertices.iter().all(|vertex| fits_short(vertex.place));
        let is_wide = vertices.len() > usize::from(u16::MAX);
        let part = |stride, mode, target| GeometryPart { plain: Vec::new(), compressed: None, stride, mode, target };
        let mut own = part(if is_short { 12 } else { 16 }, "ATTRIBUTES", ARRAY_BUFFER);
        vertices.iter().for_each(|vertex| put_vertex(vertex, is_short, &mut own.plain));
        let mut corners = part(if is_wide { 4 } else { 2 }, "TRIANGLES", ELEMENT_ARRAY_BUFFER);
        for &index in triangles.iter().flatten() {
            corners.plain.extend_from_slice(&index.to_le_bytes()[..corners.stride]);
        }
        Self { is_short, is_wide, parts: [own, corners] }
    }

    fn plain_views(&self, offsets: [usize; 2]) -> Vec<Value> {
        let view = |(part, offset): (&GeometryPart, usize)| {
            let bytes = padded(part.plain.len() as u64);
            json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes, "target": part.target })
        };
        self.with_stride(self.parts.iter().zip(offsets).map(view).collect())
    }

    /// Views of the fallback, each with the place of its compressed bytes.
    fn compressed_views(&self, offsets: [usize; 2]) -> Vec<Value> {
        let decoded = [0, self.parts[0].plain.len()];
        let view = |((part, offset), decoded): ((&GeometryPart, usize), usize)| {
            let (bytes, stride) = (part.plain.len(), part.stride);
            let compressed = json!({
                "buffer": 0, "byteOffset": offset, "byteLength": part.stored().len(), "byteStride": stride,
                "mode": part.mode, "count": bytes / stride,
            });
            json!({
                "buffer": 1, "byteOffset": decoded, "byteLength": bytes, "target": part.target,
                "extensions": { MESHOPT: compressed },
            })
        };
        self.with_stride(self.parts.iter().zip(offsets).zip(decoded).map(view).collect())
    }

    fn with_stride(&self, mut views: Vec<Value>) -> Vec<Value> {
        views[0]["byteStride"] = json!(self.parts[0].stride);
        views
    }

    /// The buffer that the decoded bytes are taken to lie in: it has no file.
    fn fallback(&self) -> Value {
        let bytes: usize = self.parts.iter().map(|part| part.plain.len()).sum();
        json!({ "byteLength": padded(bytes as u64), "extensions": { MESHOPT: { "fallback": true } } })
    }
}

/// A GLB of a document and its binary chunk.
fn assemble(document: &Value, mut chunk: Vec<u8>) -> Vec<u8> {
    let mut json = document.to_string().into_bytes();
    pad(&mut json, b' ');
    let total = 12 + 8 + json.len() + 8 + chunk.len();
    let mut glb = Vec::with_capacity(total);
    glb.extend_from_slice(b"glTF");
    [2, total as u32, json.len() as u32].iter().for_each(|word: &u32| glb.extend(word.to_le_bytes()));
    glb.extend_from_slice(b"JSON");
    glb.append(&mut json);
    glb.extend((chunk.len() as u32).to_le_bytes());
    glb.extend_from_slice(b"BIN\0");
    glb.append(&mut chunk);
    glb
}

fn fits_short(place: IVec3) -> bool {
    place.to_array().iter().all(|&at| i16::try_from(at).is_ok())
}

fn put_vertex(vertex: &TileVertex, is_short: bool, out: &mut Vec<u8>) {
    for at in vertex.place.to_array() {
        if is_short {
            out.extend((at as i16).to_le_bytes());
        } else {
            out.extend((at as f32).to_le_bytes());
        }
    }
    if is_short {
        out.extend([0; 2]);
    }
    for at in vertex.texcoord.to_array() {
        out.extend(((at.clamp(0.0, 1.0) * f64::from(u16::MAX)).round() as u16).to_le_bytes());
    }
}

fn pad(bytes: &mut Vec<u8>, with: u8) {
    bytes.resize(padded(bytes.len() as u64) as usize, with);
}

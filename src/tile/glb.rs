//! Writes a tile as a GLB: one mesh, one image, positions on the lattice of the level.
//!
//! ```text
//! vertices   i16 x y z, 0, u16 u v      12 bytes; f32 x y z, u16 u v (16 bytes) where a tile is too large
//! indices    u16, or u32
//! image      the file
//! ```
//! A node scales the places of the lattice to the mesh's unit, turns z up to y up, and moves them to the tile's middle,
//! which is a place of the lattice itself: equal places of two tiles are equal numbers.
//!
//! # Source
//! Khronos, glTF 2.0; `KHR_mesh_quantization`; `KHR_materials_unlit`.

use glam::{DVec2, DVec3, IVec3};
use serde_json::{Value, json};

use crate::geometry::boxtree::Bounds;
use crate::write::glb_format::{
    ARRAY_BUFFER, CLAMP_TO_EDGE, ELEMENT_ARRAY_BUFFER, FLOAT, LINEAR, LINEAR_MIPMAP_LINEAR, NO_COLOUR, SHORT, UNLIT,
    UNSIGNED_INT, UNSIGNED_SHORT, Z_TO_Y, linear, padded,
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
    /// Triangles of the skirt, two for each edge of the border: (end, start, foot) and (end, foot, other foot).
    pub skirt_triangles: usize,
    /// The image file and its type; `None` for a tile without texture.
    pub image: Option<(Vec<u8>, &'static str)>,
    /// Length of a step of the lattice.
    pub step: f64,
    /// Position of the middle of the tile, relative to the origin of the scene.
    pub middle: DVec3,
}

impl TileContent {
    /// The bytes of the file.
    pub fn to_glb(&self) -> Vec<u8> {
        let mut chunk = Vec::new();
        let is_short = self.vertices.iter().all(|vertex| fits_short(vertex.place));
        self.vertices.iter().for_each(|vertex| put_vertex(vertex, is_short, &mut chunk));
        let vertex_bytes = chunk.len();
        let is_wide = self.vertices.len() > usize::from(u16::MAX);
        for &index in self.triangles.iter().flatten() {
            if is_wide {
                chunk.extend(index.to_le_bytes());
            } else {
                chunk.extend((index as u16).to_le_bytes());
            }
        }
        pad(&mut chunk, 0);
        let index_bytes = chunk.len() - vertex_bytes;
        if let Some((image, _)) = &self.image {
            chunk.extend_from_slice(image);
            pad(&mut chunk, 0);
        }
        let layout = TileLayout { is_short, is_wide, vertex_bytes, index_bytes, bytes: chunk.len() };
        let mut json = self.document(&layout).to_string().into_bytes();
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

    fn document(&self, layout: &TileLayout) -> Value {
        let stride = if layout.is_short { 12 } else { 16 };
        let (low, high) = self.extent();
        let view = |offset: usize, bytes: usize| json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes });
        let mut vertices = view(0, layout.vertex_bytes);
        (vertices["byteStride"], vertices["target"]) = (json!(stride), json!(ARRAY_BUFFER));
        let mut indices = view(layout.vertex_bytes, layout.index_bytes);
        indices["target"] = json!(ELEMENT_ARRAY_BUFFER);
        let mut views = vec![vertices, indices];
        let positions = json!({
            "bufferView": 0, "byteOffset": 0, "componentType": if layout.is_short { SHORT } else { FLOAT },
            "count": self.vertices.len(), "type": "VEC3", "min": low.to_array(), "max": high.to_array(),
        });
        let texcoords = json!({
            "bufferView": 0, "byteOffset": stride - 4, "componentType": UNSIGNED_SHORT, "normalized": true,
            "count": self.vertices.len(), "type": "VEC2",
        });
        let corners = json!({
            "bufferView": 1, "byteOffset": 0, "componentType": if layout.is_wide { UNSIGNED_INT } else { UNSIGNED_SHORT },
            "count": 3 * self.triangles.len(), "type": "SCALAR",
        });
        let mut attributes = json!({ "POSITION": 0 });
        let mut material = json!({ "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 1 } });
        material["doubleSided"] = json!(true);
        let mut used = Vec::from_iter(layout.is_short.then_some(QUANTIZATION));
        let mut document = json!({
            "asset": { "version": "2.0", "generator": concat!("drystone ", env!("CARGO_PKG_VERSION")) },
            "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [self.node()],
            "buffers": [{ "byteLength": layout.bytes }],
        });
        if let Some((image, kind)) = &self.image {
            views.push(view(layout.vertex_bytes + layout.index_bytes, image.len()));
            attributes["TEXCOORD_0"] = json!(2);
            material["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
            material["extensions"] = json!({ UNLIT: {} });
            used = vec![UNLIT, QUANTIZATION];
            document["images"] = json!([{ "bufferView": 2, "mimeType": kind }]);
            document["textures"] = json!([{ "source": 0, "sampler": 0 }]);
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
        document["bufferViews"] = json!(views);
        if !used.is_empty() {
            document["extensionsUsed"] = json!(used);
        }
        if used.contains(&QUANTIZATION) {
            document["extensionsRequired"] = json!([QUANTIZATION]);
        }
        document
    }

    fn node(&self) -> Value {
        let DVec3 { x, y, z } = self.middle;
        let scale = [self.step; 3];
        json!({ "mesh": 0, "translation": [x, z, -y], "rotation": Z_TO_Y, "scale": scale })
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

/// What the binary chunk holds.
struct TileLayout {
    is_short: bool,
    is_wide: bool,
    vertex_bytes: usize,
    index_bytes: usize,
    bytes: usize,
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

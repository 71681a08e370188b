//! The JSON of a GLB: scene, materials, and where everything lies in the binary chunk.
//!
//! # Source
//! Khronos, glTF 2.0; `KHR_materials_unlit`.

use std::f64::consts::FRAC_1_SQRT_2;

use glam::{DVec3, Vec3};
use serde_json::{Value, json};

use super::images::GlbImages;
use super::layout::{ChunkLayout, PrimitiveSize, padded};
use super::primitives::{Primitive, Primitives};
use crate::model::Catalogue;
use crate::model::diffuse::diffuse_colour;

/// Types of components and uses of buffers, as OpenGL numbers them.
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;
const LINEAR: u32 = 9729;
const LINEAR_MIPMAP_LINEAR: u32 = 9987;
const REPEAT: u32 = 10497;
/// The buffer views of vertices and indices; those of images follow.
const VERTICES: usize = 0;
const INDICES: usize = 1;
const FIRST_IMAGE: usize = 2;
/// Colour of a material that has none.
const NO_COLOUR: [u8; 3] = [204; 3];
/// The turn by a quarter about x that makes (x, y, z) to (x, z, -y), as a quaternion.
const Z_TO_Y: [f64; 4] = [-FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2];
const UNLIT: &str = "KHR_materials_unlit";

/// What the document describes.
pub(super) struct GlbDocument<'a> {
    pub catalogue: &'a Catalogue,
    pub primitives: &'a Primitives,
    pub images: &'a GlbImages,
    pub layout: &'a ChunkLayout,
    /// Positions are relative to this.
    pub origin: DVec3,
    /// Whether what was z points up along y.
    pub turns_z_up: bool,
}

impl GlbDocument<'_> {
    /// The document, filled with blanks to whole words.
    pub fn text(&self) -> Vec<u8> {
        let mut text = self.json().to_string().into_bytes();
        text.resize(padded(text.len() as u64) as usize, b' ');
        text
    }

    fn json(&self) -> Value {
        let mut root = json!({
            "asset": { "version": "2.0", "generator": concat!("drystone ", env!("CARGO_PKG_VERSION")) },
            "scene": 0,
        });
        let filled: Vec<_> =
            self.primitives.list.iter().zip(&self.layout.primitives).filter(|(_, size)| size.faces > 0).collect();
        if filled.is_empty() {
            root["scenes"] = json!([{}]);
            return root;
        }
        let mut accessors = Vec::new();
        let (mut first_vertex, mut first_index) = (0, 0);
        let mut primitives = Vec::new();
        for (number, (primitive, size)) in filled.iter().enumerate() {
            let attributes = self.attributes(primitive, size, first_vertex, &mut accessors);
            primitives.push(json!({ "attributes": attributes, "indices": accessors.len(), "material": number }));
            let kind = if size.index_bytes() == 2 { UNSIGNED_SHORT } else { UNSIGNED_INT };
            accessors.push(accessor(INDICES, first_index, kind, 3 * size.faces, "SCALAR"));
            first_vertex += size.vertices;
            first_index += size.indices_bytes();
        }
        let mut node = json!({ "mesh": 0 });
        let mut shift = self.origin;
        if self.turns_z_up {
            node["rotation"] = json!(Z_TO_Y);
            shift = DVec3::new(shift.x, shift.z, -shift.y);
        }
        if self.origin != DVec3::ZERO {
            node["translation"] = json!(shift.to_array());
        }
        root["scenes"] = json!([{ "nodes": [0] }]);
        root["nodes"] = json!([node]);
        root["meshes"] = json!([{ "primitives": primitives }]);
        root["materials"] = filled.iter().map(|(primitive, _)| self.material(primitive)).collect();
        root["accessors"] = json!(accessors);
        root["bufferViews"] = json!(self.buffer_views());
        root["buffers"] = json!([{ "byteLength": self.layout.bytes() }]);
        if !self.layout.form.normals {
            root["extensionsUsed"] = json!([UNLIT]);
        }
        if !self.images.files.is_empty() {
            let numbered = || self.images.files.iter().enumerate();
            let image = |(number, image): (usize, &super::images::EmbeddedImage)| json!({ "bufferView": FIRST_IMAGE + number, "mimeType": image.media_type, "name": image.name });
            root["images"] = numbered().map(image).collect();
            root["textures"] = numbered().map(|(number, _)| json!({ "source": number, "sampler": 0 })).collect();
            root["samplers"] = json!([{
                "magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR, "wrapS": REPEAT, "wrapT": REPEAT,
            }]);
        }
        root
    }

    /// Adds the accessors of a primitive's vertices; returns them by attribute.
    fn attributes(&self, primitive: &Primitive, size: &PrimitiveSize, first: u64, accessors: &mut Vec<Value>) -> Value {
        let form = self.layout.form;
        let mut attributes = json!({});
        let mut add = |name: &str, word: usize, kind: u32, shape: &str| {
            attributes[name] = json!(accessors.len());
            let offset = 4 * (first * form.words() as u64 + word as u64);
            accessors.push(accessor(VERTICES, offset, kind, size.vertices, shape));
            accessors.len() - 1
        };
        let position = add("POSITION", 0, FLOAT, "VEC3");
        if form.normals {
            add("NORMAL", 3, FLOAT, "VEC3");
        }
        if primitive.image.is_some() {
            add("TEXCOORD_0", form.before_texcoord(), FLOAT, "VEC2");
        } else if form.colours {
            let colour = add("COLOR_0", form.before_colour(), UNSIGNED_SHORT, "VEC4");
            accessors[colour]["normalized"] = json!(true);
        }
        let numbers = |corner: Vec3| json!(corner.to_array().map(f64::from));
        accessors[position]["min"] = numbers(size.low);
        accessors[position]["max"] = numbers(size.high);
        attributes
    }

    fn material(&self, primitive: &Primitive) -> Value {
        let material = primitive.material.map(|material| &self.catalogue.materials[material]);
        let mut surface = json!({ "metallicFactor": 0, "roughnessFactor": 1 });
        if let Some(image) = primitive.image {
            surface["baseColorTexture"] = json!({ "index": image });
        } else if !self.layout.form.colours {
            let colour = material.and_then(|material| material.definition.as_ref()).and_then(diffuse_colour);
            let [red, green, blue] = colour.unwrap_or(NO_COLOUR).map(|channel| linear(f64::from(channel) / 255.0));
            surface["baseColorFactor"] = json!([red, green, blue, 1]);
        }
        let mut described = json!({ "pbrMetallicRoughness": surface, "doubleSided": true });
        if let Some(material) = material {
            described["name"] = json!(String::from_utf8_lossy(&material.output_name));
        }
        if !self.layout.form.normals {
            described["extensions"] = json!({ UNLIT: {} });
        }
        described
    }

    fn buffer_views(&self) -> Vec<Value> {
        let layout = self.layout;
        let view = |offset: u64, bytes: u64| json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes });
        let mut vertices = view(0, layout.vertex_bytes);
        vertices["byteStride"] = json!(4 * layout.form.words());
        vertices["target"] = json!(ARRAY_BUFFER);
        let mut indices = view(layout.vertex_bytes, layout.index_bytes);
        indices["target"] = json!(ELEMENT_ARRAY_BUFFER);
        let mut views = vec![vertices, indices];
        let mut offset = layout.vertex_bytes + layout.index_bytes;
        for &bytes in &layout.image_bytes {
            views.push(view(offset, bytes));
            offset += padded(bytes);
        }
        views
    }
}

fn accessor(view: usize, offset: u64, kind: u32, count: u64, shape: &str) -> Value {
    json!({ "bufferView": view, "byteOffset": offset, "componentType": kind, "count": count, "type": shape })
}

/// A channel of sRGB, from 0 to 1, as an amount of light.
pub(super) fn linear(channel: f64) -> f64 {
    if channel <= 0.040_45 { channel / 12.92 } else { libm::pow((channel + 0.055) / 1.055, 2.4) }
}

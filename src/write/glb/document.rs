//! The JSON of a GLB: scene, materials, and where everything lies in the binary chunk.
//!
//! # Source
//! Khronos, glTF 2.0; `KHR_materials_unlit`.

use glam::{DVec3, Vec3};
use serde_json::{Value, json};

use super::images::{EmbeddedImage, GlbImages};
use super::layout::{ChunkLayout, PrimitiveSize};
use super::primitives::{Primitive, Primitives};
use crate::base::Result;
use crate::model::Catalogue;
use crate::model::diffuse::diffuse_colour;
use crate::write::glb_format::{
    ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, FLOAT, LINEAR, LINEAR_MIPMAP_LINEAR, NO_COLOUR, REPEAT, UNLIT, UNSIGNED_INT,
    UNSIGNED_SHORT, Z_TO_Y, linear, padded,
};

/// The buffer views of vertices and indices; those of images follow.
const VERTICES: usize = 0;
const INDICES: usize = 1;
const FIRST_IMAGE: usize = 2;
/// What receives the text.
type Put<'p> = &'p mut dyn FnMut(&[u8]) -> Result<()>;

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

/// A primitive that has faces, and where it begins.
#[derive(Clone, Copy)]
struct PlacedPrimitive<'a> {
    primitive: &'a Primitive,
    size: &'a PrimitiveSize,
    number: usize,
    /// Number of its first accessor; that of its indices is the last.
    accessor: usize,
    /// Vertices and bytes of indices before it.
    vertices_before: u64,
    index_bytes_before: u64,
}

impl GlbDocument<'_> {
    /// Length of the text in bytes.
    ///
    /// # Errors
    /// As [`write`](Self::write), where nothing is put anywhere.
    pub fn bytes(&self) -> Result<u64> {
        let mut bytes = 0;
        self.write(&mut |text| {
            bytes += text.len() as u64;
            Ok(())
        })?;
        Ok(bytes)
    }

    /// Passes the text on in small parts, since there may be many materials.
    ///
    /// # Errors
    /// Those of `put`.
    pub fn write(&self, put: Put<'_>) -> Result<()> {
        let asset = json!({ "version": "2.0", "generator": concat!("drystone ", env!("CARGO_PKG_VERSION")) });
        put(format!("{{\"asset\":{asset},\"scene\":0").as_bytes())?;
        if self.placed().next().is_none() {
            put_list(put, "scenes", [json!({})].into_iter())?;
            return put(b"}");
        }
        put_list(put, "scenes", [json!({ "nodes": [0] })].into_iter())?;
        put_list(put, "nodes", [self.node()].into_iter())?;
        put(b",\"meshes\":[{\"primitives\":")?;
        put_values(put, self.placed().map(|placed| self.primitive(placed)))?;
        put(b"}]")?;
        put_list(put, "materials", self.placed().map(|placed| self.material(placed.primitive)))?;
        put_list(put, "accessors", self.placed().flat_map(|placed| self.accessors(placed)))?;
        put_list(put, "bufferViews", self.buffer_views())?;
        put_list(put, "buffers", [json!({ "byteLength": self.layout.bytes() })].into_iter())?;
        if !self.layout.form.normals {
            put_list(put, "extensionsUsed", [json!(UNLIT)].into_iter())?;
        }
        let images = || self.images.files.iter().enumerate();
        if images().next().is_some() {
            let described = |(number, image): (usize, &EmbeddedImage)| {
                let view = FIRST_IMAGE + number;
                json!({ "bufferView": view, "mimeType": image.media_type, "name": image.name })
            };
            put_list(put, "images", images().map(described))?;
            put_list(put, "textures", images().map(|(number, _)| json!({ "source": number, "sampler": 0 })))?;
            let sampler = json!({
                "magFilter": LINEAR, "minFilter": LINEAR_MIPMAP_LINEAR, "wrapS": REPEAT, "wrapT": REPEAT,
            });
            put_list(put, "samplers", [sampler].into_iter())?;
        }
        put(b"}")
    }

    /// The primitives that have faces.
    fn placed(&self) -> impl Iterator<Item = PlacedPrimitive<'_>> {
        let all = self.primitives.list.iter().zip(&self.layout.primitives).filter(|(_, size)| size.faces > 0);
        let mut before = (0, 0, 0);
        all.enumerate().map(move |(number, (primitive, size))| {
            let (accessor, vertices_before, index_bytes_before) = before;
            before.0 += self.attributes(primitive).count() + 1;
            before.1 += size.vertices;
            before.2 += size.indices_bytes();
            PlacedPrimitive { primitive, size, number, accessor, vertices_before, index_bytes_before }
        })
    }

    fn node(&self) -> Value {
        let mut node = json!({ "mesh": 0 });
        let mut shift = self.origin;
        if self.turns_z_up {
            node["rotation"] = json!(Z_TO_Y);
            shift = DVec3::new(shift.x, shift.z, -shift.y);
        }
        if self.origin != DVec3::ZERO {
            node["translation"] = json!(shift.to_array());
        }
        node
    }

    /// Attributes of a primitive's vertices: name, first word in the record, type of the components, shape.
    fn attributes(
        &self,
        primitive: &Primitive,
    ) -> impl Iterator<Item = (&'static str, usize, u32, &'static str)> + use<> {
        let form = self.layout.form;
        let normal = form.normals.then_some(("NORMAL", 3, FLOAT, "VEC3"));
        let shown = if primitive.image.is_some() {
            Some(("TEXCOORD_0", form.before_texcoord(), FLOAT, "VEC2"))
        } else {
            form.colours.then_some(("COLOR_0", form.before_colour(), UNSIGNED_SHORT, "VEC4"))
        };
        std::iter::once(("POSITION", 0, FLOAT, "VEC3")).chain(normal).chain(shown)
    }

    fn primitive(&self, placed: PlacedPrimitive<'_>) -> Value {
        let names = self.attributes(placed.primitive).map(|(name, ..)| name.to_owned());
        let attributes: serde_json::Map<String, Value> = names.zip((placed.accessor..).map(Value::from)).collect();
        let indices = placed.accessor + attributes.len();
        json!({ "attributes": attributes, "indices": indices, "material": placed.number })
    }

    /// The accessors of a primitive: those of its vertices, then that of its indices.
    fn accessors(&self, placed: PlacedPrimitive<'_>) -> impl Iterator<Item = Value> {
        let record_bytes = 4 * self.layout.form.words() as u64;
        let PlacedPrimitive { primitive, size, vertices_before, index_bytes_before, .. } = placed;
        let of_vertices = self.attributes(primitive).map(move |(name, word, kind, shape)| {
            let offset = vertices_before * record_bytes + 4 * word as u64;
            let mut accessor = accessor(VERTICES, offset, kind, size.vertices, shape);
            let numbers = |corner: Vec3| json!(corner.to_array().map(f64::from));
            match name {
                "POSITION" => (accessor["min"], accessor["max"]) = (numbers(size.low), numbers(size.high)),
                "COLOR_0" => accessor["normalized"] = json!(true),
                _ => {}
            }
            accessor
        });
        let kind = if size.index_bytes() == 2 { UNSIGNED_SHORT } else { UNSIGNED_INT };
        of_vertices.chain([accessor(INDICES, index_bytes_before, kind, 3 * size.faces, "SCALAR")])
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

    fn buffer_views(&self) -> impl Iterator<Item = Value> {
        let layout = self.layout;
        let view = |offset: u64, bytes: u64| json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes });
        let mut vertices = view(0, layout.vertex_bytes);
        vertices["byteStride"] = json!(4 * layout.form.words());
        vertices["target"] = json!(ARRAY_BUFFER);
        let mut indices = view(layout.vertex_bytes, layout.index_bytes);
        indices["target"] = json!(ELEMENT_ARRAY_BUFFER);
        let mut offset = layout.vertex_bytes + layout.index_bytes;
        let images = layout.image_bytes.iter().map(move |&bytes| {
            offset += padded(bytes);
            view(offset - padded(bytes), bytes)
        });
        [vertices, indices].into_iter().chain(images)
    }
}

/// Puts a member with a list.
fn put_list(put: Put<'_>, key: &str, values: impl Iterator<Item = Value>) -> Result<()> {
    put(format!(",\"{key}\":").as_bytes())?;
    put_values(put, values)
}

fn put_values(put: Put<'_>, values: impl Iterator<Item = Value>) -> Result<()> {
    put(b"[")?;
    for (number, value) in values.enumerate() {
        let comma = if number == 0 { "" } else { "," };
        put(format!("{comma}{value}").as_bytes())?;
    }
    put(b"]")
}

fn accessor(view: usize, offset: u64, kind: u32, count: u64, shape: &str) -> Value {
    json!({ "bufferView": view, "byteOffset": offset, "componentType": kind, "count": count, "type": shape })
}

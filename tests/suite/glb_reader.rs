//! Reads a GLB, strictly: whatever the format forbids fails the test.
//!
//! Source: Khronos, glTF 2.0, `EXT_meshopt_compression`.

use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;

use glam::{DQuat, DVec2, DVec3};
use serde_json::Value;

/// A triangle of a GLB.
#[derive(Debug, Clone, Copy)]
pub struct GlbTriangle {
    /// Positions of the corners in the scene, turned back if it was turned.
    pub positions: [DVec3; 3],
    /// Texture coordinates of the corners, with (0, 0) at the lower left as in an OBJ.
    pub texcoords: Option<[DVec2; 3]>,
    /// Amounts of light of the corners: red, green, blue, opacity.
    pub colours: Option<[[f64; 4]; 3]>,
    /// Normals of the corners.
    pub normals: Option<[DVec3; 3]>,
    /// Number of the material.
    pub material: usize,
}

/// The contents of a GLB.
pub struct Glb {
    /// The JSON.
    pub document: Value,
    /// The binary chunk.
    bytes: Vec<u8>,
}

/// The extension for compressed buffers.
const MESHOPT: &str = "EXT_meshopt_compression";

/// Decodes vertices of `STRIDE` bytes each.
fn vertices<const STRIDE: usize>(stream: &[u8], count: usize) -> Vec<u8> {
    let mut vertices = vec![[0_u8; STRIDE]; count];
    meshopt_rs::vertex::buffer::decode_vertex_buffer(&mut vertices, stream).unwrap();
    vertices.concat()
}

fn word(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

impl Glb {
    /// Reads a file, and checks its chunks and the ranges of all views and accessors.
    pub fn read(path: &Path) -> Self {
        let file = std::fs::read(path).unwrap();
        assert_eq!((&file[..4], word(&file, 4), word(&file, 8)), (&b"glTF"[..], 2, file.len()));
        let json_bytes = word(&file, 12);
        assert_eq!((&file[16..20], json_bytes % 4), (&b"JSON"[..], 0));
        let document: Value = serde_json::from_slice(&file[20..20 + json_bytes]).unwrap();
        let rest = &file[20 + json_bytes..];
        let bytes = if rest.is_empty() {
            Vec::new()
        } else {
            assert_eq!((&rest[4..8], word(rest, 0), rest.len() % 4), (&b"BIN\0"[..], rest.len() - 8, 0));
            rest[8..].to_vec()
        };
        let glb = Self { document, bytes };
        assert_eq!(glb.document["asset"]["version"], "2.0");
        let views = glb.list("bufferViews").len();
        (0..views).for_each(|view| _ = glb.view(view));
        let mut ends: Vec<Range<usize>> = (0..views).map(|view| glb.stored(view)).collect();
        ends.sort_by_key(|range| range.start);
        assert!(ends.windows(2).all(|pair| pair[0].end <= pair[1].start), "views overlap");
        glb
    }

    fn list(&self, name: &str) -> &[Value] {
        self.document[name].as_array().map_or(&[], Vec::as_slice)
    }

    /// Where the bytes of a view, or its compressed ones, lie in the binary chunk.
    fn stored(&self, number: usize) -> Range<usize> {
        let view = &self.list("bufferViews")[number];
        let extension = &view["extensions"][MESHOPT];
        let place = if extension.is_null() { view } else { extension };
        let number = |key: &str| place[key].as_u64().unwrap() as usize;
        assert_eq!(place["buffer"], 0);
        let range = number("byteOffset")..number("byteOffset") + number("byteLength");
        assert!(number("byteLength") > 0 && range.end <= self.bytes.len() && range.start.is_multiple_of(4), "{view}");
        range
    }

    /// The bytes of a view, decoded by a library that the program does not have.
    fn view(&self, number: usize) -> Cow<'_, [u8]> {
        let view = &self.list("bufferViews")[number];
        let stored = &self.bytes[self.stored(number)];
        let extension = &view["extensions"][MESHOPT];
        if extension.is_null() {
            return stored.into();
        }
        assert!(self.list("extensionsRequired").contains(&Value::from(MESHOPT)));
        let fallback = &self.list("buffers")[view["buffer"].as_u64().unwrap() as usize];
        assert!(fallback["extensions"][MESHOPT]["fallback"] == true && fallback.get("uri").is_none());
        let number = |place: &Value, key: &str| place[key].as_u64().unwrap() as usize;
        let (count, stride) = (number(extension, "count"), number(extension, "byteStride"));
        assert_eq!(count * stride, number(view, "byteLength"));
        assert!(number(view, "byteOffset") + count * stride <= number(fallback, "byteLength"));
        match (extension["mode"].as_str().unwrap(), stride) {
            ("ATTRIBUTES", 12) => vertices::<12>(stored, count).into(),
            ("ATTRIBUTES", 16) => vertices::<16>(stored, count).into(),
            ("TRIANGLES", 2 | 4) => {
                let mut corners = vec![0_u32; count];
                meshopt_rs::index::buffer::decode_index_buffer(&mut corners, stored).unwrap();
                corners.iter().flat_map(|corner| corner.to_le_bytes().into_iter().take(stride)).collect()
            }
            _ => panic!("{extension}"),
        }
    }

    /// Bytes of an image, and its type.
    pub fn image(&self, number: usize) -> (&[u8], &str) {
        let image = &self.list("images")[number];
        let view = image["bufferView"].as_u64().unwrap() as usize;
        (&self.bytes[self.stored(view)], image["mimeType"].as_str().unwrap())
    }

    /// The numbers of an accessor, `shape` of them for each element.
    fn accessor(&self, number: &Value, kind: u64, shape: &str) -> Vec<Vec<f64>> {
        let accessor = &self.list("accessors")[number.as_u64().unwrap() as usize];
        assert_eq!((accessor["componentType"].as_u64(), accessor["type"].as_str()), (Some(kind), Some(shape)));
        let (bytes, count) =
            ([0, 0, 2, 2, 0, 4, 4][kind as usize - 5120], accessor["count"].as_u64().unwrap() as usize);
        let width = match shape {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            _ => 4,
        };
        let view_number = accessor["bufferView"].as_u64().unwrap() as usize;
        let view = self.view(view_number);
        let stride = self.list("bufferViews")[view_number]["byteStride"].as_u64().map(|stride| stride as usize);
        let stride = stride.unwrap_or(bytes * width);
        let offset = accessor["byteOffset"].as_u64().unwrap() as usize;
        assert!(
            count > 0
                && stride.is_multiple_of(bytes)
                && stride >= bytes * width
                && offset.is_multiple_of(bytes)
                && stride < 253
        );
        assert!(offset + stride * (count - 1) + bytes * width <= view.len(), "{accessor}");
        let component = |at: usize| match kind {
            5122 => f64::from(i16::from_le_bytes(view[at..at + 2].try_into().unwrap())),
            5123 => f64::from(u16::from_le_bytes(view[at..at + 2].try_into().unwrap())),
            5125 => word(&view, at) as f64,
            _ => f64::from(f32::from_le_bytes(view[at..at + 4].try_into().unwrap())),
        };
        let scale = if accessor["normalized"] == true { 1.0 / 65535.0 } else { 1.0 };
        let element = |i: usize| (0..width).map(|axis| scale * component(offset + i * stride + axis * bytes)).collect();
        let elements: Vec<Vec<f64>> = (0..count).map(element).collect();
        assert!(elements.iter().flatten().all(|number| number.is_finite()));
        for (bound, fold) in [("min", f64::min as fn(f64, f64) -> f64), ("max", f64::max)] {
            if let Some(given) = accessor[bound].as_array() {
                // The accessor's components are floats.
                let given = given.iter().map(|number| f64::from(number.as_f64().unwrap() as f32)).collect::<Vec<_>>();
                let found = elements.iter().cloned().reduce(|a, b| a.iter().zip(b).map(|(a, b)| fold(*a, b)).collect());
                assert_eq!(Some(given), found, "{bound}");
            }
        }
        elements
    }

    /// All triangles; each vertex is used, and there once with the same attributes.
    pub fn triangles(&self) -> Vec<GlbTriangle> {
        let mut triangles = Vec::new();
        for node in self.list("scenes")[0]["nodes"].as_array().unwrap_or(&Vec::new()) {
            let node = &self.list("nodes")[node.as_u64().unwrap() as usize];
            let numbers = |key: &str| -> Option<Vec<f64>> {
                node[key].as_array().map(|list| list.iter().map(|x| x.as_f64().unwrap()).collect())
            };
            let mut shift = numbers("translation").map_or(DVec3::ZERO, |shift| DVec3::from_slice(&shift));
            if let Some(turn) = numbers("rotation") {
                let turn = DQuat::from_slice(&turn);
                assert!((turn * DVec3::Z).distance(DVec3::Y) < 1e-12 && (turn * DVec3::X).distance(DVec3::X) < 1e-12);
                shift = DVec3::new(shift.x, -shift.z, shift.y);
            }
            let scale = numbers("scale").map_or(DVec3::ONE, |scale| DVec3::from_slice(&scale));
            let mesh = &self.list("meshes")[node["mesh"].as_u64().unwrap() as usize];
            for primitive in mesh["primitives"].as_array().unwrap() {
                self.add_triangles(primitive, [scale, shift], &mut triangles);
            }
        }
        triangles
    }

    fn add_triangles(&self, primitive: &Value, [scale, shift]: [DVec3; 2], triangles: &mut Vec<GlbTriangle>) {
        let attributes = &primitive["attributes"];
        // Positions on a lattice, and texture coordinates with them, are numbers of 16 bits.
        let is_on_lattice = self.list("extensionsUsed").contains(&Value::from("KHR_mesh_quantization"));
        let kind_of = |number: &Value| {
            let kind = self.list("accessors")[number.as_u64().unwrap() as usize]["componentType"].as_u64().unwrap();
            assert!(kind == 5126 || is_on_lattice && (kind == 5122 || kind == 5123));
            kind
        };
        let positions = self.accessor(&attributes["POSITION"], kind_of(&attributes["POSITION"]), "VEC3");
        let accessor = |name: &str, kind: u64, shape: &str| {
            let kind = |number: &Value| if kind == 5126 { kind_of(number) } else { kind };
            let given = attributes.get(name).map(|number| self.accessor(number, kind(number), shape));
            assert!(given.as_ref().is_none_or(|given| given.len() == positions.len()));
            given
        };
        let texcoords = accessor("TEXCOORD_0", 5126, "VEC2");
        let normals = accessor("NORMAL", 5126, "VEC3");
        let colours = accessor("COLOR_0", 5123, "VEC4");
        let index = &self.list("accessors")[primitive["indices"].as_u64().unwrap() as usize];
        let kind = index["componentType"].as_u64().unwrap();
        let indices: Vec<usize> =
            self.accessor(&primitive["indices"], kind, "SCALAR").iter().map(|index| index[0] as usize).collect();
        let mut is_used = vec![false; positions.len()];
        indices.iter().for_each(|&index| is_used[index] = true);
        assert!(is_used.iter().all(|used| *used), "a vertex of no face");
        assert!(kind == 5125 || positions.len() <= 65535);
        let material = primitive["material"].as_u64().unwrap() as usize;
        assert!(material < self.list("materials").len());
        let (indices, []) = indices.as_chunks::<3>() else { panic!("an unfinished triangle") };
        for corners in indices {
            let vec2 = |list: &Vec<Vec<f64>>| corners.map(|corner| DVec2::from_slice(&list[corner]));
            let vec3 = |list: &Vec<Vec<f64>>| corners.map(|corner| DVec3::from_slice(&list[corner]));
            triangles.push(GlbTriangle {
                positions: vec3(&positions).map(|position| scale * position + shift),
                texcoords: texcoords.as_ref().map(|list| vec2(list).map(|uv| DVec2::new(uv.x, 1.0 - uv.y))),
                colours: colours.as_ref().map(|list| corners.map(|corner| list[corner][..].try_into().unwrap())),
                normals: normals.as_ref().map(vec3),
                material,
            });
        }
    }
}

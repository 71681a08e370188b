//! Reads a tile's GLB back: structure, places on the lattice, triangles, skirt.
//!
//! Every byte is hostile: a file is refused with words, and what is allocated is bounded by its size.

use std::borrow::Cow;

use glam::{DVec3, IVec3};
use serde_json::Value;

use crate::tile::meshopt::{decode_attributes, decode_triangles};
use crate::write::glb_format::MESHOPT;

/// Share by which a coordinate may be off its place on the lattice.
const ROUNDING: f64 = 1e-15;

/// Words on what is wrong with a file.
type ContentFault = String;

/// What was read of a GLB.
#[derive(Debug)]
pub struct ReadTile {
    /// Step of the lattice in each direction.
    pub step: f64,
    /// Places of the vertices on the lattice of the scene; z points up.
    pub places: Vec<[i64; 3]>,
    /// Vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles of the skirt, which come last.
    pub skirt_triangles: usize,
    /// Bytes of its image.
    pub image_bytes: u64,
}

/// Reads a GLB.
///
/// # Errors
/// What is wrong with it.
pub fn read_glb(bytes: &[u8]) -> Result<ReadTile, ContentFault> {
    let (json, chunk) = chunks(bytes)?;
    let document: Value = serde_json::from_slice(json).map_err(|error| format!("its JSON: {error}"))?;
    let reader = GlbReader { document: &document, chunk };
    let node = &document["nodes"][0];
    let step = number(&node["scale"][0]).ok_or("its node has no scale")?;
    let translation = [0, 1, 2].map(|axis| number(&node["translation"][axis]));
    let [Some(x), Some(up), Some(south)] = translation else { return Err("its node has no translation".into()) };
    if !(step.is_normal() && step > 0.0) {
        return Err(format!("the scale of its node is {step}"));
    }
    let middle = DVec3::new(x, -south, up) / step;
    // The product of place and step is rounded, and so is the quotient.
    let is_place = (middle.round() - middle).abs().cmple(ROUNDING * middle.abs()).all();
    if !is_place || !middle.is_finite() || middle.abs().max_element() > 1e15 {
        return Err("its translation is no place of the lattice".into());
    }
    let mesh = &document["meshes"][0];
    let primitive = &mesh["primitives"][0];
    let own = reader.positions(&primitive["attributes"]["POSITION"])?;
    let shift = middle.round().to_array().map(|at| at as i64);
    let places = own.into_iter().map(|place| [0, 1, 2].map(|axis| i64::from(place[axis]) + shift[axis]));
    let places: Vec<[i64; 3]> = places.collect();
    let triangles = reader.triangles(&primitive["indices"], places.len())?;
    let skirt_triangles = mesh["extras"]["skirtTriangles"].as_u64().unwrap_or(0);
    let skirt_triangles = usize::try_from(skirt_triangles).ok().filter(|&count| count <= triangles.len());
    let skirt_triangles = skirt_triangles.ok_or("it has fewer triangles than its skirt")?;
    let image_bytes = document["images"][0]["bufferView"]
        .as_u64()
        .map_or(Ok(0), |view| reader.view(view as usize).map(|bytes| bytes.len() as u64))?;
    Ok(ReadTile { step, places, triangles, skirt_triangles, image_bytes })
}

/// The JSON and the binary chunk of a GLB.
fn chunks(bytes: &[u8]) -> Result<(&[u8], &[u8]), ContentFault> {
    let word = |at: usize| bytes.get(at..at + 4).and_then(|word| word.try_into().ok()).map(u32::from_le_bytes);
    if bytes.get(..4) != Some(b"glTF") || word(4) != Some(2) {
        return Err("it is no GLB of version 2".into());
    }
    if word(8).map(|length| length as usize) != Some(bytes.len()) {
        return Err(format!("its header names another length than {} bytes", bytes.len()));
    }
    let mut at = 12;
    let mut next = |kind: &[u8]| {
        let length = word(at).ok_or("it ends inside of a chunk")? as usize;
        let body = bytes.get(at + 8..(at + 8).saturating_add(length)).ok_or("it ends inside of a chunk")?;
        if bytes.get(at + 4..at + 8) != Some(kind) {
            return Err("its chunks are in another order");
        }
        at += 8 + length;
        Ok(body)
    };
    Ok((next(b"JSON")?, next(b"BIN\0")?))
}

struct GlbReader<'a> {
    document: &'a Value,
    chunk: &'a [u8],
}

/// An accessor: its bytes, and where its elements lie in them.
struct Elements<'a> {
    bytes: Cow<'a, [u8]>,
    count: usize,
    stride: usize,
    component: u64,
}

impl<'a> GlbReader<'a> {
    /// The bytes of a buffer view, decoded if they are compressed.
    fn view(&self, number: usize) -> Result<Cow<'a, [u8]>, ContentFault> {
        let view = &self.document["bufferViews"][number];
        let extension = &view["extensions"][MESHOPT];
        if extension.is_null() { self.stored(view).map(Cow::Borrowed) } else { self.decoded(view, extension) }
    }

    fn decoded(&self, view: &Value, extension: &Value) -> Result<Cow<'a, [u8]>, ContentFault> {
        let of = |value: &Value| value.as_u64().and_then(|number| usize::try_from(number).ok());
        let [count, stride] = ["count", "byteStride"].map(|key| of(&extension[key]));
        let (Some(count), Some(stride)) = (count, stride) else { return Err("a compressed view has no size".into()) };
        if of(&view["byteLength"]) != count.checked_mul(stride)
            || view["byteStride"].as_u64().is_some_and(|own| own != stride as u64)
        {
            return Err("a buffer view has another size than its compressed bytes".into());
        }
        let stream = self.stored(extension)?;
        match (extension["mode"].as_str(), stride) {
            (Some("ATTRIBUTES"), _) => Ok(decode_attributes(stream, count, stride)?.into()),
            (Some("TRIANGLES"), 2 | 4) if count.is_multiple_of(3) => {
                let corners = decode_triangles(stream, count / 3)?.into_iter().flatten();
                let too_large = |corner: &u32| stride == 2 && *corner > u32::from(u16::MAX);
                let mut bytes = Vec::with_capacity(count * stride);
                for corner in corners {
                    if too_large(&corner) {
                        return Err(format!("index {corner} in 16 bits"));
                    }
                    bytes.extend_from_slice(&corner.to_le_bytes()[..stride]);
                }
                Ok(bytes.into())
            }
            _ => Err("a compressed view has another mode than its size allows".into()),
        }
    }

    /// The bytes that a buffer view, or its extension, has in the binary chunk.
    fn stored(&self, view: &Value) -> Result<&'a [u8], ContentFault> {
        if view["buffer"].as_u64().unwrap_or(0) != 0 {
            return Err("a buffer view lies outside of the binary chunk".into());
        }
        let offset = view["byteOffset"].as_u64().unwrap_or(0) as usize;
        let length = view["byteLength"].as_u64().ok_or("a buffer view has no length")? as usize;
        let bytes = self.chunk.get(offset..offset.saturating_add(length));
        bytes.ok_or_else(|| "a buffer view ends beyond the binary chunk".into())
    }

    /// The elements of an accessor, each of `width` components.
    fn elements(&self, accessor: &Value, width: usize) -> Result<Elements<'a>, ContentFault> {
        let number = accessor.as_u64().ok_or("an accessor is missing")? as usize;
        let accessor = &self.document["accessors"][number];
        let view = accessor["bufferView"].as_u64().ok_or("an accessor has no buffer view")? as usize;
        let component = accessor["componentType"].as_u64().unwrap_or(0);
        let size = match component {
            5120 | 5121 => 1,
            5122 | 5123 => 2,
            5125 | 5126 => 4,
            _ => return Err(format!("a component type {component}")),
        };
        let stride = self.document["bufferViews"][view]["byteStride"].as_u64().map_or(size * width, |at| at as usize);
        let offset = accessor["byteOffset"].as_u64().unwrap_or(0) as usize;
        let bytes = match self.view(view)? {
            Cow::Borrowed(bytes) => bytes.get(offset..).map(Cow::Borrowed),
            Cow::Owned(bytes) => bytes.get(offset..).map(|rest| Cow::Owned(rest.to_vec())),
        };
        let bytes = bytes.ok_or("an accessor begins beyond its buffer view")?;
        let count = accessor["count"].as_u64().unwrap_or(0) as usize;
        let needed = count.saturating_sub(1).saturating_mul(stride).saturating_add(size * width);
        if count == 0 || stride == 0 || needed > bytes.len() {
            return Err("an accessor ends beyond its buffer view".into());
        }
        Ok(Elements { bytes, count, stride, component })
    }

    fn positions(&self, accessor: &Value) -> Result<Vec<IVec3>, ContentFault> {
        let elements = self.elements(accessor, 3)?;
        let place = |element: &[u8]| -> Result<IVec3, ContentFault> {
            let mut at = [0; 3];
            for (axis, at) in at.iter_mut().enumerate() {
                *at = match elements.component {
                    5122 => i32::from(i16::from_le_bytes([element[2 * axis], element[2 * axis + 1]])),
                    5126 => {
                        let word = element[4 * axis..].first_chunk().copied().unwrap_or_default();
                        let number = f32::from_le_bytes(word);
                        if number.round() != number || number.abs() > 2e9 {
                            return Err(format!("{number} is no place of the lattice"));
                        }
                        number as i32
                    }
                    other => return Err(format!("positions of component type {other}")),
                };
            }
            Ok(IVec3::from(at))
        };
        let all = (0..elements.count).map(|number| place(&elements.bytes[number * elements.stride..]));
        all.collect()
    }

    fn triangles(&self, accessor: &Value, vertices: usize) -> Result<Vec<[u32; 3]>, ContentFault> {
        let elements = self.elements(accessor, 1)?;
        if !elements.count.is_multiple_of(3) {
            return Err("the number of its indices is no multiple of 3".into());
        }
        let index = |number: usize| -> Result<u32, ContentFault> {
            let element = &elements.bytes[number * elements.stride..];
            let index = match elements.component {
                5123 => u32::from(u16::from_le_bytes([element[0], element[1]])),
                5125 => u32::from_le_bytes(element.first_chunk().copied().unwrap_or_default()),
                other => return Err(format!("indices of component type {other}")),
            };
            if (index as usize) < vertices { Ok(index) } else { Err(format!("index {index} of {vertices} vertices")) }
        };
        (0..elements.count / 3).map(|face| Ok([index(3 * face)?, index(3 * face + 1)?, index(3 * face + 2)?])).collect()
    }
}

/// A finite number.
pub fn number(value: &Value) -> Option<f64> {
    value.as_f64().filter(|number| number.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tile::glb::{TileContent, TileVertex};
    use glam::DVec2;
    use proptest::prelude::*;

    fn glb(is_compressed: bool) -> Vec<u8> {
        let vertex = |place| TileVertex { place, texcoord: DVec2::ZERO };
        let vertices = [IVec3::ZERO, IVec3::X, IVec3::new(-40, 7, 3000)].map(vertex).to_vec();
        let content = TileContent {
            vertices,
            triangles: vec![[0, 1, 2]],
            step: 0.25,
            middle: DVec3::new(1.0, -2.0, 3.5),
            ..TileContent::default()
        };
        content.to_glb(is_compressed)
    }

    #[test]
    fn a_tile_is_read_as_it_was_written() {
        for is_compressed in [false, true] {
            let read = read_glb(&glb(is_compressed)).unwrap();
            assert_eq!(read.places, [[4, -8, 14], [5, -8, 14], [-36, -1, 3014]]);
            assert_eq!((read.step, read.triangles, read.skirt_triangles), (0.25, vec![[0, 1, 2]], 0));
        }
    }

    proptest! {
        #[test]
        fn a_tile_far_from_the_origin_is_read_as_it_was_written(place in prop::array::uniform3(-1i32 << 29..1 << 29), far in 0..1i32 << 30, exponent in -40i32..20) {
            let step = f64::from(exponent).exp2();
            let corners = [IVec3::ZERO, IVec3::X, IVec3::new(-40, far, 3000)];
            let vertices = corners.map(|place| TileVertex { place, texcoord: DVec2::ZERO }).to_vec();
            let middle = IVec3::from(place).as_dvec3() * step;
            let mut content = TileContent { vertices, triangles: vec![[0, 1, 2]], step, middle, ..TileContent::default() };
            content.settle();
            let read = read_glb(&content.to_glb(false)).unwrap();
            let moved = i64::from(far) - (read.places[2][1] - i64::from(place[1]));
            prop_assert!(moved.abs() <= i64::from(far >> 24), "{moved}");
            prop_assert_eq!(read.places[0], place.map(i64::from));
        }

        #[test]
        fn damaged_files_are_refused_or_read(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6), cut in any::<prop::sample::Index>(), is_compressed in any::<bool>()) {
            let mut bytes = glb(is_compressed);
            for (at, byte) in changes {
                let at = at.index(bytes.len());
                bytes[at] = byte;
            }
            let _ = read_glb(&bytes);
            bytes.truncate(cut.index(bytes.len()));
            let _ = read_glb(&bytes);
        }
    }
}

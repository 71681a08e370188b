//! Reads the parts of a GLB: its chunks, buffer views and accessors.
//!
//! Every byte is hostile: what is allocated is bounded by the size of the file.

use std::borrow::Cow;

use glam::{DVec2, IVec3};
use serde_json::Value;

use crate::tile::meshopt::{decode_attributes, decode_triangles};
use crate::write::glb_format::MESHOPT;

/// Words on what is wrong with a file.
pub type ContentFault = String;

/// What is wrong with a file that can be read all the same.
#[derive(Debug, PartialEq)]
pub struct TileFault {
    /// The kind of fault.
    pub kind: &'static str,
    /// In words.
    pub words: String,
}

/// The JSON and the binary chunk of a GLB.
pub fn chunks(bytes: &[u8]) -> Result<(&[u8], &[u8]), ContentFault> {
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

/// A GLB that is read.
pub struct GlbReader<'a> {
    /// Its JSON.
    pub document: &'a Value,
    /// Its binary chunk.
    pub chunk: &'a [u8],
}

/// An accessor: its bytes, and where its elements lie in them.
struct Elements<'a> {
    bytes: Cow<'a, [u8]>,
    count: usize,
    stride: usize,
    component: u64,
    /// Bytes of a component.
    size: usize,
}

impl<'a> GlbReader<'a> {
    /// The bytes of a buffer view, decoded if they are compressed.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn view(&self, number: usize) -> Result<Cow<'a, [u8]>, ContentFault> {
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

    /// An accessor by its number.
    pub fn accessor(&self, number: &Value) -> &'a Value {
        number.as_u64().map_or(&Value::Null, |number| &self.document["accessors"][number as usize])
    }

    /// The elements of an accessor, each of `width` components.
    fn elements(&self, accessor: &Value, width: usize) -> Result<Elements<'a>, ContentFault> {
        let accessor = self.accessor(accessor);
        if accessor.is_null() {
            return Err("an accessor is missing".into());
        }
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
        Ok(Elements { bytes, count, stride, component, size })
    }

    /// Places of vertices on the lattice.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn positions(&self, accessor: &Value) -> Result<Vec<IVec3>, ContentFault> {
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

    /// Texture coordinates of vertices.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn texcoords(&self, accessor: &Value) -> Result<Vec<DVec2>, ContentFault> {
        let elements = self.elements(accessor, 2)?;
        let is_normalized = self.accessor(accessor)["normalized"] == true;
        let at = |bytes: &[u8]| match (elements.component, is_normalized) {
            (5121, true) => Ok(f64::from(bytes[0]) / f64::from(u8::MAX)),
            (5123, true) => Ok(f64::from(u16::from_le_bytes([bytes[0], bytes[1]])) / f64::from(u16::MAX)),
            (5126, false) => {
                let at = f32::from_le_bytes(bytes.first_chunk().copied().unwrap_or_default());
                if at.is_finite() { Ok(at.into()) } else { Err(format!("a texture coordinate {at}")) }
            }
            (other, _) => Err(format!("texture coordinates of component type {other}")),
        };
        let size = elements.size;
        let texcoord = |number: usize| {
            let element = &elements.bytes[number * elements.stride..];
            Ok(DVec2::new(at(element)?, at(&element[size..])?))
        };
        (0..elements.count).map(texcoord).collect()
    }

    /// Triangles of `vertices` vertices.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn triangles(&self, accessor: &Value, vertices: usize) -> Result<Vec<[u32; 3]>, ContentFault> {
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

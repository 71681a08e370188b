//! Checks the texture of a tile: that its triangles show an image, and that this is sound.

use std::borrow::Cow;

use glam::DVec2;
use serde_json::Value;

use super::reader::{ContentFault, GlbReader, TileFault};
use crate::image::sound::sound_size;
use crate::model::image_format::ImageFormat;

/// Formats whose textures name their image in an extension.
const EXTENDED: [ImageFormat; 2] = [ImageFormat::WebP(1), ImageFormat::Ktx2(1)];

/// What the triangles of a tile show.
#[derive(Debug, Clone, Default)]
pub struct TileTexture {
    /// Bytes of the image.
    pub image_bytes: u64,
    /// Width and height of the image; 0 if it is damaged.
    pub size: [u32; 2],
    /// Texture coordinates of the vertices.
    pub texcoords: Vec<DVec2>,
}

impl TileTexture {
    /// Area that triangles have in the image, in texels.
    pub fn texels(&self, triangles: &[[u32; 3]]) -> f64 {
        let place = |vertex: u32| self.texcoords.get(vertex as usize).copied().unwrap_or_default();
        let area = |&[a, b, c]: &[u32; 3]| {
            let [a, b, c] = [a, b, c].map(place);
            0.5 * (b - a).perp_dot(c - a).abs()
        };
        let [width, height] = self.size.map(f64::from);
        triangles.iter().map(area).sum::<f64>() * width * height
    }
}

/// The texture of a primitive, and what is wrong with it; `None` if it has none.
pub fn texture_of(reader: &GlbReader<'_>, primitive: &Value, faults: &mut Vec<TileFault>) -> Option<TileTexture> {
    let document = reader.document;
    let accessor = &primitive["attributes"]["TEXCOORD_0"];
    let has_image = document["images"].as_array().is_some_and(|images| !images.is_empty());
    let mut fault = |kind: &'static str, words: String| faults.push(TileFault { kind, words });
    let image = image_of(document, primitive).unwrap_or_else(|words| {
        fault("texture", words);
        None
    });
    let texcoords = Some(accessor).filter(|accessor| !accessor.is_null()).map(|accessor| reader.texcoords(accessor));
    let words = match (image.is_some(), texcoords.is_some(), has_image) {
        (false, true, _) => Some("its vertices have texture coordinates, and its material no texture"),
        (true, false, _) => Some("its material has a texture, and its vertices no texture coordinates"),
        (false, false, true) => Some("it holds an image that no triangle shows"),
        _ => None,
    };
    words.into_iter().for_each(|words| fault("texture", words.into()));
    let texcoords = texcoords.and_then(|texcoords| texcoords.map_err(|words| fault("accessor", words)).ok());
    let image = image?;
    let mut texture = TileTexture { texcoords: texcoords.unwrap_or_default(), ..TileTexture::default() };
    match bytes_of(reader, image) {
        Ok(bytes) => {
            texture.image_bytes = bytes.len() as u64;
            let size = sound_size(&bytes, image["mimeType"].as_str().unwrap_or_default());
            texture.size = size.unwrap_or_else(|words| {
                fault("image", words);
                [0; 2]
            });
        }
        Err(words) => fault("image", words),
    }
    Some(texture)
}

/// The image that a primitive shows; `None` if its material has no texture.
fn image_of<'a>(document: &'a Value, primitive: &Value) -> Result<Option<&'a Value>, ContentFault> {
    let named = |list: &str, number: &Value| {
        let at = number.as_u64().and_then(|number| document[list].get(number as usize));
        at.ok_or_else(|| format!("it names one of its {list} that is missing"))
    };
    if primitive["material"].is_null() {
        return Err("its triangles have no material".into());
    }
    let material = named("materials", &primitive["material"])?;
    let texture = &material["pbrMetallicRoughness"]["baseColorTexture"]["index"];
    if texture.is_null() {
        return Ok(None);
    }
    let texture = named("textures", texture)?;
    let extended = EXTENDED.iter().filter_map(|format| texture["extensions"].get(format.extension()?)).next();
    named("images", &extended.unwrap_or(texture)["source"]).map(Some)
}

/// The bytes of an image.
fn bytes_of<'a>(reader: &GlbReader<'a>, image: &Value) -> Result<Cow<'a, [u8]>, ContentFault> {
    let view = image["bufferView"].as_u64().ok_or("it does not lie in the file")?;
    reader.view(view as usize)
}

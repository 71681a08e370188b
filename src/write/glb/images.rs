//! The images in a GLB: JPEG and PNG files as they are, others as PNG.
//!
//! In: the catalogue, and which parts have faces. Out: the files, and the image of each material. What a GLB cannot hold
//! of objects, groups and materials is reported.
//!
//! # Memory
//! An image that becomes a PNG, decoded.
//!
//! # Files
//! `write-image-<number>.png`, the images that became PNG.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::base::error::escape_path;
use crate::base::id::TiVec;
use crate::base::{Error, Findings, Result};
#[cfg(feature = "images")]
use crate::image::{decode, encode::encode};
use crate::model::Catalogue;
use crate::model::diffuse::diffuse_image;
use crate::model::id::MaterialId;
#[cfg(feature = "images")]
use crate::model::image_format::ImageFormat;
use crate::os::content::Content;
use crate::write::losses::{note_unwritten, used_materials};
use crate::write::numbering::Usage;
use crate::write::textures::TextureStage;

/// An image file that becomes a part of the GLB.
#[derive(Debug)]
pub(super) struct EmbeddedImage {
    pub path: PathBuf,
    /// Its name in the GLB.
    pub name: String,
    pub content: Content,
    pub media_type: &'static str,
}

/// Where images become PNG, and the memory for one of them in bytes.
pub(in crate::write) struct ImageLimits<'a> {
    pub work_folder: &'a Path,
    pub work_bytes: u64,
}

/// Images of the result.
#[derive(Debug, Default)]
pub(in crate::write) struct GlbImages {
    pub(super) files: Vec<EmbeddedImage>,
    /// Index of the image of each material of the catalogue.
    pub(super) of_material: TiVec<MaterialId, Option<usize>>,
    /// What is not written.
    pub(super) findings: Findings,
}

/// Finds the images of the materials that faces use.
///
/// # Errors
/// If an image cannot be read.
pub(in crate::write) fn find_images(
    catalogue: &Catalogue,
    usage: &Usage,
    textures: &mut TextureStage,
    limits: &ImageLimits<'_>,
) -> Result<GlbImages> {
    let mut images = GlbImages { of_material: vec![None; catalogue.materials.len()].into(), ..GlbImages::default() };
    let mut by_name: HashMap<(&Path, &[u8]), Option<usize>> = HashMap::new();
    let mut by_path: HashMap<PathBuf, Option<usize>> = HashMap::new();
    for material in used_materials(catalogue, usage) {
        let Some(definition) = &catalogue.materials[material].definition else { continue };
        let Some(statement) = diffuse_image(definition) else { continue };
        let name = (&*definition.folder, &*statement.name);
        images.of_material[material] = match by_name.entry(name) {
            Entry::Occupied(known) => *known.get(),
            Entry::Vacant(new) => *new.insert(match textures.embed(name.0, name.1)? {
                Some((path, content)) => match by_path.entry(path) {
                    Entry::Occupied(known) => *known.get(),
                    Entry::Vacant(new) => {
                        let index = images.add(new.key().clone(), content, limits)?;
                        *new.insert(index)
                    }
                },
                None => None,
            }),
        };
    }
    note_unwritten(catalogue, usage, "GLB", &mut images.findings, |definition| {
        usize::from(diffuse_image(definition).is_some())
            + definition.statements.iter().filter(|text| is_written(text)).count()
    });
    Ok(images)
}

impl GlbImages {
    /// Adds a file; `None`, with a finding, if it cannot be decoded.
    fn add(&mut self, path: PathBuf, content: Content, limits: &ImageLimits<'_>) -> Result<Option<usize>> {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let image = match media_type(&path)? {
            Some(media_type) => EmbeddedImage { path, name, content, media_type },
            None => {
                let new = limits.work_folder.join(format!("write-image-{:06}.png", self.files.len()));
                if !convert(&path, &new, limits.work_bytes, &mut self.findings)? {
                    return Ok(None);
                }
                let content = Content::of(&new).map_err(|e| Error::io(&new, "read", e))?;
                EmbeddedImage { path: new, name, content, media_type: "image/png" }
            }
        };
        self.files.push(image);
        Ok(Some(self.files.len() - 1))
    }
}

/// Makes a PNG of an image in another format; returns whether it could be decoded, else with a finding.
#[cfg(feature = "images")]
fn convert(path: &Path, new: &Path, allowed_bytes: u64, findings: &mut Findings) -> Result<bool> {
    let decoded = decode::plan(path, allowed_bytes).and_then(|plan| decode::decode(path, &plan));
    match decoded {
        Ok(image) => encode(image.pixels(), image.size(), ImageFormat::Png, new).map(|()| true),
        Err(why) => {
            findings.note("unwritten_images", || format!("{}: {why}", escape_path(path)));
            Ok(false)
        }
    }
}

/// Without a decoder, such an image is not written.
#[cfg(not(feature = "images"))]
fn convert(path: &Path, _: &Path, _: u64, findings: &mut Findings) -> Result<bool> {
    findings.note("unwritten_images", || format!("{}: neither JPEG nor PNG", escape_path(path)));
    Ok(false)
}

/// Type of an image by its first bytes; `None` if a GLB cannot hold it as it is.
fn media_type(path: &Path) -> Result<Option<&'static str>> {
    let mut start = Vec::new();
    let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    file.take(8).read_to_end(&mut start).map_err(|e| Error::io(path, "read", e))?;
    Ok(match &start[..] {
        [0xff, 0xd8, 0xff, ..] => Some("image/jpeg"),
        b"\x89PNG\r\n\x1a\n" => Some("image/png"),
        _ => None,
    })
}

/// Whether a GLB shows what a statement says: the diffuse colour, no highlights. The light is the viewer's.
fn is_written(statement: &[u8]) -> bool {
    let words: Vec<&[u8]> = statement.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).collect();
    let Some((key, values)) = words.split_first() else { return true };
    match &key.to_ascii_lowercase()[..] {
        b"kd" | b"ka" => true,
        b"ks" => values.iter().all(|value| value.iter().all(|digit| b"0.".contains(digit))),
        b"illum" => [[&b"0"[..]], [b"1"]].iter().any(|matt| values == matt),
        _ => false,
    }
}

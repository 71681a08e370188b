//! Counts materials and textures of a run.

use std::path::{Path, PathBuf};

use super::input::Input;
use crate::report::FileFigures;
use crate::write::{self, Companion, Written};

/// Counts materials and textures of the input, those left in the result and their files.
/// Reads the sizes of images only `with_pixels`.
pub(super) fn figures(input: &Input, written: &Written, brings_outside: bool, with_pixels: bool) -> FileFigures {
    let catalogue = &input.catalogue;
    let is_texture = |companion: &&Companion| companion.path.extension().is_none_or(|extension| extension != "mtl");
    let images: Vec<&Companion> = written.companions.iter().filter(is_texture).collect();
    let textures = write::texture_count(catalogue);
    let before = || -> Vec<PathBuf> {
        let named = write::named_textures(catalogue, brings_outside);
        named.into_iter().filter(|texture| !texture.stays).map(|texture| texture.path).collect()
    };
    let materials = catalogue.materials.len() as u64;
    FileFigures {
        materials,
        materials_left: materials.saturating_sub(written.findings.get("lost_materials")),
        textures,
        textures_left: textures.saturating_sub(written.findings.get("lost_textures")),
        images: images.len() as u64,
        image_bytes: images.iter().filter_map(|image| Some(image.content?.bytes)).sum(),
        megapixels: with_pixels
            .then(|| [megapixels(before().iter()), megapixels(images.iter().map(|image| &image.path))]),
    }
}

/// Millions of pixels of all images whose header can be read.
fn megapixels(paths: impl Iterator<Item = impl AsRef<Path>>) -> f64 {
    #[cfg(feature = "images")]
    let size = |path: &Path| if path.is_file() { image::image_dimensions(path).ok() } else { None };
    #[cfg(not(feature = "images"))]
    let size = |_: &Path| None::<(u32, u32)>;
    let sizes = paths.filter_map(|path| size(path.as_ref()));
    // The `sum` of no numbers is -0.
    sizes.map(|(width, height)| f64::from(width) * f64::from(height)).fold(0.0, |sum, pixels| sum + pixels) / 1e6
}

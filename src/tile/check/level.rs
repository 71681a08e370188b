//! Collects what is found of a level.
//!
//! A level lies within a texel of its own from the input, so that the least error of its tiles is that of a texel. The
//! texel is measured: a triangle covers as many texels of the image as its area has.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::borders::BorderEdges;
use super::content::ReadTile;

/// Texels that the least error of a level may be, by the error factor: those of an image may be a little smaller than
/// they should.
const TEXELS_MAX: f64 = 4.0;

/// What was found of a level.
#[derive(Debug, Default, Clone, PartialEq, Serialize)]
pub struct LevelCheck {
    /// Step of its lattice, in the mesh's unit of length.
    pub step: f64,
    /// Files.
    pub tiles: u64,
    /// Triangles, those of skirts included.
    pub triangles: u64,
    /// Most triangles of a tile.
    pub triangles_max: u64,
    /// Bytes of the images.
    pub image_bytes: u64,
    /// Edges along the borders of tiles, each tile counted.
    pub border_edges: u64,
    /// Those of them that no other tile has.
    pub unequal_edges: u64,
    /// Largest length of a skirt, in the mesh's unit of length.
    pub longest_skirt: f64,
    /// Triangles with the same vertices, in the same order, as another one of their tile; without those of skirts.
    pub duplicate_triangles: u64,
}

/// A level under way.
pub struct FoundLevel {
    check: LevelCheck,
    borders: BorderEdges,
    /// Tiles with a texture.
    textured: u64,
    /// Tiles without a texture whose surface has an area.
    bare: Vec<PathBuf>,
    /// Areas of the surfaces of tiles with a texture, and those of the same triangles in the images, in texels.
    area: f64,
    texels: f64,
    /// Least geometric error of a tile.
    least_error: f64,
}

impl FoundLevel {
    /// A level without tiles, by the step of its lattice.
    pub fn new(step: f64) -> Self {
        let check = LevelCheck { step, ..LevelCheck::default() };
        let (borders, bare) = (BorderEdges::default(), Vec::new());
        Self { check, borders, textured: 0, bare, area: 0.0, texels: 0.0, least_error: f64::INFINITY }
    }

    /// Adds a tile with its geometric error.
    pub fn add(&mut self, path: &Path, read: &ReadTile, error: f64) {
        let Self { check, borders, textured, bare, .. } = self;
        borders.add(read);
        check.tiles += 1;
        check.triangles += read.triangles.len() as u64;
        check.triangles_max = check.triangles_max.max(read.triangles.len() as u64);
        check.duplicate_triangles += read.duplicate_triangles();
        let area = read.area();
        match &read.texture {
            Some(texture) => {
                *textured += 1;
                check.image_bytes += texture.image_bytes;
                self.area += area;
                self.texels += texture.texels(read.surface());
            }
            None if area > 0.0 => bare.push(path.to_owned()),
            None => {}
        }
        self.least_error = self.least_error.min(error);
    }

    /// Tiles without a texture, if others have one.
    pub fn without_texture(&self) -> &[PathBuf] {
        if self.textured > 0 { &self.bare } else { &[] }
    }

    /// What is wrong with the level, each by its kind and in words, if errors are this multiple of distances.
    pub fn faults(&self, error_factor: Option<f64>) -> impl Iterator<Item = (&'static str, String)> {
        let step = self.check.step;
        let unequal = self.borders.unequal();
        let border =
            (unequal > 0).then(|| ("border", format!("{unequal} edges of the level with step {step} have no partner")));
        let texel = (self.area / self.texels).sqrt();
        let texels = error_factor.map(|factor| self.least_error / factor / texel);
        let error = texels.filter(|&texels| texel > 0.0 && texels > TEXELS_MAX).map(|texels| {
            let words = format!(
                "all errors of the level with step {step} are more than {texels:.1} texels, by the error factor"
            );
            ("geometric error", words)
        });
        border.into_iter().chain(error)
    }

    /// What was found.
    pub fn into_check(self) -> LevelCheck {
        let Self { check, borders, .. } = self;
        let longest_skirt = borders.longest_skirt * check.step;
        LevelCheck { border_edges: borders.edges, unequal_edges: borders.unequal(), longest_skirt, ..check }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tile::check::texture::TileTexture;
    use glam::DVec2;

    /// A square with a side of 64 steps of 1/4, that shows an image of 16 x 16 texels: a texel is a unit long.
    fn square(is_textured: bool) -> ReadTile {
        let texcoords = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y].to_vec();
        ReadTile {
            step: 0.25,
            places: vec![[0, 0, 0], [64, 0, 0], [64, 64, 0], [0, 64, 0]],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            texture: is_textured.then_some(TileTexture { image_bytes: 100, size: [16, 16], texcoords }),
            ..ReadTile::default()
        }
    }

    fn level(tiles: &[(ReadTile, f64)]) -> FoundLevel {
        let mut level = FoundLevel::new(0.25);
        tiles.iter().for_each(|(tile, error)| level.add(Path::new("tile.glb"), tile, *error));
        level
    }

    #[test]
    fn an_error_factor_that_does_not_fit_the_texels_is_found() {
        let level = level(&[(square(true), 16.0), (square(true), 700.0)]);
        for (factor, is_fault) in [(Some(16.0), false), (Some(8.0), false), (Some(1.0), true), (None, false)] {
            let faults: Vec<_> = level.faults(factor).collect();
            assert_eq!(faults.len(), usize::from(is_fault), "{factor:?}: {faults:?}");
        }
        // Without a texture, texels have no length.
        assert_eq!(self::level(&[(square(false), 16.0)]).faults(Some(1.0)).count(), 0);
    }

    #[test]
    fn a_tile_without_texture_is_found_among_others() {
        let line = ReadTile { triangles: vec![[0, 1, 1]], ..square(false) };
        let mixed = level(&[(square(true), 0.0), (square(false), 0.0), (line, 0.0)]);
        assert_eq!(mixed.without_texture().len(), 1);
        assert_eq!(level(&[(square(false), 0.0), (square(false), 0.0)]).without_texture().len(), 0);
        assert_eq!((mixed.check.image_bytes, mixed.check.tiles), (100, 3));
    }
}

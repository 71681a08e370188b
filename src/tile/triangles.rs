//! The triangles of a level: on its lattice, with what they show.

use glam::{DVec2, DVec3};

use super::scene::TileScene;
use crate::bake::{Original, TexelSource};
use crate::base::{Progress, Result};
use crate::geometry::triangle::{area, texture_area};
use crate::model::id::ImageId;
use crate::surface::cells::SurfaceCells;

/// A level whose triangles are read.
#[derive(Clone, Copy)]
pub struct LevelTriangles<'a> {
    /// Its surface.
    pub surface: &'a SurfaceCells,
    /// Where it lies.
    pub scene: &'a TileScene,
    /// Its number.
    pub level: u32,
    /// The input, if the level is that, and keeps its texels.
    pub original: Option<&'a Original>,
}

/// A triangle of a level.
#[derive(Debug, Clone, Copy)]
pub struct LevelTriangle {
    /// Positions of its corners, relative to the origin of the scene, and texture coordinates.
    pub corners: [(DVec3, DVec2); 3],
    /// What it shows; none if that is the colours of its vertices, and in a level that does not keep its texels.
    pub image: ImageId,
    /// Texels on a unit of its area.
    pub density: f64,
}

impl LevelTriangles<'_> {
    /// Texels that its triangles show, those of images that repeat as often as these do.
    ///
    /// # Errors
    /// If the job was stopped, and on failed reads.
    pub fn texels(&self, progress: &dyn Progress) -> Result<f64> {
        let mut texels = 0.0;
        for cell in 0..self.surface.cells.len() {
            progress.check_stopped()?;
            self.each(cell, |triangle| texels += area(triangle.corners.map(|(corner, _)| corner)) * triangle.density)?;
        }
        Ok(texels)
    }

    /// Passes the triangles of a cell on.
    ///
    /// # Errors
    /// On failed reads.
    pub fn each(&self, cell: usize, mut take: impl FnMut(&LevelTriangle)) -> Result<()> {
        let view = self.surface.cells[cell].view()?;
        let shift = view.origin - self.scene.origin;
        let lattice = self.scene.lattice(self.level);
        let usual = self.scene.texel_of(self.level).powi(-2);
        for number in 0..view.faces.len() as u32 {
            let corners = view.triangle(number).map(|corner| lattice.position(lattice.place(corner + shift)));
            let mut triangle = LevelTriangle {
                corners: corners.map(|corner| (corner, DVec2::ZERO)),
                image: ImageId::NONE,
                density: usual,
            };
            if let Some(original) = self.original {
                let face = view.faces[number as usize];
                (triangle.image, triangle.density) = match original.source_of(&view, number) {
                    TexelSource::Image(image) => {
                        let texels: f64 = image.size().map(f64::from).iter().product();
                        let density = texture_area(face.texcoords) * texels / area(corners);
                        // What has no area on the lattice shows nothing.
                        (face.image, if density.is_finite() { density } else { 0.0 })
                    }
                    TexelSource::Plain(_) => (face.image, 0.0),
                    // Its tile is baked: there is nothing to copy.
                    TexelSource::Nothing => (ImageId::NONE, usual),
                };
                for (corner, texcoord) in triangle.corners.iter_mut().zip(face.texcoords) {
                    corner.1 = DVec2::from(texcoord.map(f64::from));
                }
            }
            take(&triangle);
        }
        Ok(())
    }
}

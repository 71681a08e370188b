//! What can be drawn: the triangles of a mesh, one after the other, with colour or texture.
//!
//! ```text
//! StoredMesh    ──▶ cells, loaded one by one ──┐
//!                                              ├──▶ triangles
//! MeasuredMesh, which lies in cells already ───┘
//! ```
//!
//! # Memory
//! For a stored mesh, that of a partition into cells of `CELL_FACES` triangles, and of one of its clusters at a time.
//!
//! # Files
//! Those of a pass named `pass-view`, removed at the end.

use std::path::Path;

use glam::DVec3;

use crate::base::id::TiVec;
use crate::base::pool::check_stopped;
use crate::base::{Findings, Result};
use crate::image::textures::TextureImages;
use crate::measure::compare::cells::MeasuredMesh;
use crate::mesh::FaceId;
use crate::model::catalogue::MaterialDefinition;
use crate::model::id::{ImageId, PartId};
use crate::model::texture_file::TextureReach;
use crate::model::{Catalogue, StoredMesh};
use crate::partition::{self, ClusterSource, PartitionOptions, TextureScale, cluster, heavy};
use crate::render::{Paint, Triangle};

/// Resources for drawing. They do not change a rendering, unless an image does not fit the memory.
#[derive(Debug, Clone, Copy, Default)]
pub struct DrawResources {
    /// Threads, at least 1.
    pub threads: usize,
    /// Memory in bytes.
    pub work_bytes: u64,
}

/// Approximate number of triangles of a cell.
const CELL_FACES: u64 = 1 << 16;
/// Number of positions that are read at once.
const SWEEP_RECORDS: u64 = 128 << 10;
/// Colour of a surface without image and material.
const STONE: [u8; 3] = [188, 172, 150];

/// A mesh that can be drawn; positions and triangles come in an order that depends on the mesh alone.
pub trait Scene {
    /// Texture images that the mesh shows.
    fn images(&self) -> &TextureImages;

    /// Passes all positions to `look`, many at a time; some may come more than once.
    ///
    /// # Errors
    /// If the job is to stop; on failed reads.
    fn positions(&self, see: &mut dyn FnMut(&[DVec3])) -> Result<()>;

    /// Passes every triangle to `draw`.
    ///
    /// # Errors
    /// If the job is to stop; on a full disk, failed reads and writes.
    fn triangles(&self, resources: &DrawResources, draw: &mut dyn FnMut(&Triangle)) -> Result<()>;
}

/// A stored mesh.
#[derive(Debug)]
pub struct StoredScene<'a> {
    mesh: &'a StoredMesh,
    catalogue: &'a Catalogue,
    folder: &'a Path,
    images: TextureImages,
    /// Colour or texture image of each part.
    paints: TiVec<PartId, Paint>,
}

impl<'a> StoredScene<'a> {
    /// Finds the texture images; intermediate files go to `folder`.
    pub fn new(mesh: &'a StoredMesh, catalogue: &'a Catalogue, folder: &'a Path, findings: &mut Findings) -> Self {
        let images = TextureImages::find(catalogue, &TextureReach::Anywhere, findings);
        let paint = |(part, image): (PartId, &ImageId)| match image.some() {
            Some(image) => Paint::Image(image.number()),
            None => Paint::Colour(colour_of(catalogue, part)),
        };
        let paints = images.of_part.iter_enumerated().map(paint).collect();
        Self { mesh, catalogue, folder, images, paints }
    }

    fn triangle(&self, source: &ClusterSource, face: FaceId) -> Triangle {
        let mesh = &source.mesh;
        let [a, b, c] = mesh.uv_triangle(face);
        let part = mesh.parts[face];
        let paint = self.paints.get(part).copied().unwrap_or(Paint::Colour(STONE));
        let paint = match paint {
            Paint::Image(_) if !(a + b + c).is_finite() => Paint::Colour(colour_of(self.catalogue, part)),
            paint => paint,
        };
        let low = a.min(b).min(c).floor();
        Triangle {
            corners: mesh.triangle(face).map(|corner| corner + source.origin),
            texcoords: [a, b, c].map(|uv| (uv - low).as_vec2().to_array()),
            paint,
        }
    }
}

impl Scene for StoredScene<'_> {
    fn images(&self) -> &TextureImages {
        &self.images
    }

    fn positions(&self, see: &mut dyn FnMut(&[DVec3])) -> Result<()> {
        for segment in self.mesh.position_columns() {
            for range in segment.ranges(SWEEP_RECORDS) {
                check_stopped()?;
                see(&segment.window(range)?);
            }
        }
        Ok(())
    }

    fn triangles(&self, resources: &DrawResources, draw: &mut dyn FnMut(&Triangle)) -> Result<()> {
        let DrawResources { threads, work_bytes } = *resources;
        let options = PartitionOptions {
            cluster_faces: CELL_FACES,
            pass: 0,
            weld: false,
            drop_doubles: false,
            drop_texcoords: false,
            threads,
            work_bytes,
        };
        let partition = partition::partition(self.mesh, self.catalogue, self.folder, "pass-view", &options)?;
        let scale = TextureScale::none(self.catalogue);
        let mut draw_source = |source: ClusterSource| {
            check_stopped()?;
            source.mesh.face_ids().for_each(|face| draw(&self.triangle(&source, face)));
            Ok(())
        };
        for cluster in partition.clusters() {
            match partition.weight(cluster) {
                Some(_) => draw_source(cluster::load(&partition, self.mesh, self.catalogue, &scale, cluster)?)?,
                None => {
                    heavy::load_in_blocks(&partition, self.mesh, self.catalogue, &scale, cluster, &mut draw_source)?
                }
            }
        }
        partition.files().for_each(|path| _ = std::fs::remove_file(path));
        Ok(())
    }
}

impl Scene for MeasuredMesh {
    fn images(&self) -> &TextureImages {
        &self.images
    }

    fn positions(&self, see: &mut dyn FnMut(&[DVec3])) -> Result<()> {
        for cell in &self.surface.cells {
            check_stopped()?;
            let view = cell.view()?;
            see(&view.positions.iter().map(|&position| position + view.origin).collect::<Vec<_>>());
        }
        Ok(())
    }

    fn triangles(&self, _resources: &DrawResources, draw: &mut dyn FnMut(&Triangle)) -> Result<()> {
        for cell in &self.surface.cells {
            check_stopped()?;
            let view = cell.view()?;
            for (number, face) in view.faces.iter().enumerate() {
                let paint = match face.image.some() {
                    Some(image) => Paint::Image(image.number()),
                    None => Paint::Colour(STONE),
                };
                let corners = view.triangle(number as u32).map(|corner| corner + view.origin);
                draw(&Triangle { corners, texcoords: face.texcoords, paint });
            }
        }
        Ok(())
    }
}

/// The diffuse colour (`Kd`) of a part's material.
fn colour_of(catalogue: &Catalogue, part: PartId) -> [u8; 3] {
    let material = catalogue.parts.get(part).and_then(|part| part.material);
    let definition = material.and_then(|material| catalogue.materials[material].definition.as_ref());
    definition.and_then(diffuse).unwrap_or(STONE)
}

fn diffuse(definition: &MaterialDefinition) -> Option<[u8; 3]> {
    let rest = definition.statements.iter().find_map(|statement| statement.strip_prefix(b"Kd"))?;
    let text = std::str::from_utf8(rest).ok()?;
    let numbers: Vec<f32> = text.split_whitespace().map_while(|word| word.parse().ok()).collect();
    match numbers[..] {
        // Modellers write 1 1 1, or 0 0 0, for a material whose colour they do not set.
        [r, g, b, ..] if [r, g, b] != [1.0; 3] && [r, g, b] != [0.0; 3] => {
            Some([r, g, b].map(|channel| (channel.clamp(0.0, 1.0) * 255.0) as u8))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_materials_are_read_where_they_say_something() {
        let definition = |text: &str| MaterialDefinition {
            statements: vec![b"Ns 10".to_vec(), text.as_bytes().to_vec()],
            ..MaterialDefinition::default()
        };
        assert_eq!(diffuse(&definition("Kd 1.0 0.5 0")), Some([255, 127, 0]));
        assert_eq!(diffuse(&definition("Kd 0.5 9 -1")), Some([127, 255, 0]));
        for nothing in ["Kd 1 1 1", "Kd x", "Kd 0.5", "Ka 0.2 0.3 0.4", "Kd spectral a.rfl"] {
            assert_eq!(diffuse(&definition(nothing)), None, "{nothing}");
        }
    }
}

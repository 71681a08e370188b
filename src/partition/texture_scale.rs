//! The scale that makes texture coordinates as large as the surface, so that distances in both can be compared.

use serde::{Deserialize, Serialize};

use super::ranks::SortedIds;
use super::reading::ClusterFaces;
use crate::base::id::{Id, TiSlice, TiVec};
use crate::model::Catalogue;
use crate::model::id::{MaterialId, PartId};

/// Faces of a material and their doubled areas.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MaterialArea {
    /// Number of faces.
    pub faces: u64,
    /// Doubled area in space of the faces that have texture coordinates.
    pub space: f64,
    /// Doubled area of the same faces in texture space.
    pub texture: f64,
}

impl std::ops::AddAssign for MaterialArea {
    fn add_assign(&mut self, other: Self) {
        self.faces += other.faces;
        self.space += other.space;
        self.texture += other.texture;
    }
}

/// Scale of texture coordinates per material, and for faces without one. See `cost::surface`.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct TextureScale {
    scales: TiVec<MaterialId, f64>,
}

impl TextureScale {
    /// Computes the scales from areas by material; a material without area in space or in texture has scale 1.
    pub fn new(areas: &TiSlice<MaterialId, MaterialArea>) -> Self {
        let scale = |area: &MaterialArea| {
            let scale = (area.space / area.texture).sqrt();
            if scale.is_normal() { scale } else { 1.0 }
        };
        Self { scales: areas.iter().map(scale).collect() }
    }

    /// Scale 1 for all materials.
    pub fn none(catalogue: &Catalogue) -> Self {
        Self { scales: catalogue.per_material(1.0) }
    }

    /// Reports whether a recalled value has a scale for each material.
    pub fn is_sound(&self, catalogue: &Catalogue) -> bool {
        self.scales.len() == catalogue.materials.len() + 1
    }

    /// Scale of the material of a part.
    pub fn of(&self, catalogue: &Catalogue, part: PartId) -> f64 {
        self.scales[catalogue.material_of(part)]
    }
}

impl ClusterFaces {
    /// Adds the areas of the faces in space and in texture to those of their materials.
    pub fn add_areas(&self, catalogue: &Catalogue, areas: &mut TiSlice<MaterialId, MaterialArea>) {
        let ranks = SortedIds::new(&self.texcoord_ids);
        for face in &self.faces {
            let sum = &mut areas[catalogue.material_of(face.part)];
            sum.faces += 1;
            if face.texcoords.contains(&Id::NONE) {
                continue;
            }
            let ([a, b, c], uv_of) =
                (self.triangle_of(face), |corner: usize| self.texcoords[ranks.of(face.texcoords[corner])]);
            let (first, second, third) = (uv_of(0), uv_of(1), uv_of(2));
            let texture = (second - first).perp_dot(third - first).abs();
            if texture.is_finite() {
                sum.space += (b - a).cross(c - a).length();
                sum.texture += texture;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_makes_texture_as_large_as_the_surface() {
        let area = MaterialArea { faces: 2, space: 400.0, texture: 1.0 };
        let scale = TextureScale::new(TiSlice::from_ref(&[area, MaterialArea::default()]));
        assert_eq!(scale.scales.raw, [20.0, 1.0]);
    }
}

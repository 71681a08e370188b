//! A triangle mesh in memory, as a program hands it to the library and gets it back.

use crate::base::{Error, Result};

/// A triangle mesh in memory.
///
/// Faces refer to vertices and texture coordinates by index, each corner to one of both, so that a vertex on a texture
/// seam is one vertex with several texture coordinates. Vectors that are empty stand for "none".
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Mesh {
    /// Position of each vertex, in any unit of length.
    pub positions: Vec<[f64; 3]>,
    /// Colour of each vertex; empty if there are none.
    pub colours: Vec<[f32; 3]>,
    /// Texture coordinates.
    pub texcoords: Vec<[f64; 2]>,
    /// Vertices of each face, counter-clockwise.
    pub faces: Vec<[u32; 3]>,
    /// Texture coordinates of each face's corners, or [`Mesh::NO_TEXCOORD`]; empty if no face has any.
    pub face_texcoords: Vec<[u32; 3]>,
    /// Label of each face, such as its material; empty if all are alike. Simplification keeps the lines between labels.
    pub face_labels: Vec<u32>,
}

impl Mesh {
    /// Marks a corner without texture coordinate.
    pub const NO_TEXCOORD: u32 = u32::MAX;

    /// Checks that lengths agree and that every index exists.
    ///
    /// # Errors
    /// [`Error::Limit`] for more than 2³² - 2 vertices or texture coordinates, or 2³² / 3 faces; [`Error::Usage`] for
    /// other faults, with the face at fault.
    pub fn check(&self) -> Result<()> {
        let limit = u32::MAX as usize - 1;
        if self.positions.len() > limit || self.texcoords.len() > limit || self.faces.len() >= u32::MAX as usize / 3 {
            return Err(Error::Limit("a mesh in memory has fewer than 2^32 / 3 faces and 2^32 - 1 vertices".into()));
        }
        let of_faces = [("face_texcoords", self.face_texcoords.len()), ("face_labels", self.face_labels.len())];
        for (name, length) in of_faces {
            if length != 0 && length != self.faces.len() {
                return Err(Error::Usage(format!("{name} has {length} entries for {} faces", self.faces.len())));
            }
        }
        if !self.colours.is_empty() && self.colours.len() != self.positions.len() {
            let (colours, positions) = (self.colours.len(), self.positions.len());
            return Err(Error::Usage(format!("colours has {colours} entries for {positions} positions")));
        }
        if let Some(vertex) = self.positions.iter().position(|position| !position.iter().all(|x| x.is_finite())) {
            return Err(Error::Usage(format!("vertex {vertex} has a coordinate that is not finite")));
        }
        let is_vertex = |&id: &u32| (id as usize) < self.positions.len();
        if let Some(face) = self.faces.iter().position(|face| !face.iter().all(is_vertex)) {
            return Err(Error::Usage(format!("face {face} refers to a vertex that does not exist")));
        }
        let is_texcoord = |&id: &u32| id == Self::NO_TEXCOORD || (id as usize) < self.texcoords.len();
        if let Some(face) = self.face_texcoords.iter().position(|face| !face.iter().all(is_texcoord)) {
            return Err(Error::Usage(format!("face {face} refers to a texture coordinate that does not exist")));
        }
        Ok(())
    }
}

#[cfg(feature = "tobj")]
mod tobj_models {
    use std::collections::HashMap;

    use super::Mesh;

    /// Joins the models; the label of a face is the id of its model's material plus 1, or 0 without one. Vertices of
    /// different models stay apart; normals are left out. The models must be triangulated; other faces are left out.
    impl From<&[tobj::Model]> for Mesh {
        fn from(models: &[tobj::Model]) -> Self {
            let mut joined = Self::default();
            let has_colours = models.iter().any(|model| !model.mesh.vertex_color.is_empty());
            for tobj::Model { mesh, .. } in models {
                let (vertex_base, texcoord_base) = (joined.positions.len() as u32, joined.texcoords.len() as u32);
                #[allow(clippy::useless_conversion)]
                let positions = mesh.positions.chunks_exact(3).map(|p| [p[0], p[1], p[2]].map(f64::from));
                joined.positions.extend(positions);
                #[allow(clippy::useless_conversion)]
                let texcoords = mesh.texcoords.chunks_exact(2).map(|t| [t[0], t[1]].map(f64::from));
                joined.texcoords.extend(texcoords);
                if has_colours {
                    let colours = mesh.vertex_color.chunks_exact(3).map(|c| [c[0], c[1], c[2]].map(|x| x as _));
                    joined.colours.extend(colours);
                    joined.colours.resize(joined.positions.len(), [1.0; 3]);
                }
                let label = mesh.material_id.map_or(0, |id| id as u32 + 1);
                let has_texcoords = !mesh.texcoords.is_empty();
                for corner in (0..mesh.indices.len() / 3 * 3).step_by(3) {
                    let of = |ids: &[u32], base: u32| [0, 1, 2].map(|k| ids[corner + k] + base);
                    joined.faces.push(of(&mesh.indices, vertex_base));
                    joined.face_texcoords.push(match (has_texcoords, mesh.texcoord_indices.is_empty()) {
                        (false, _) => [Self::NO_TEXCOORD; 3],
                        // With `single_index` a vertex has one texture coordinate.
                        (true, true) => of(&mesh.indices, texcoord_base),
                        (true, false) => of(&mesh.texcoord_indices, texcoord_base),
                    });
                    joined.face_labels.push(label);
                }
            }
            joined
        }
    }

    impl Mesh {
        /// One model per label, in ascending order, with an index of its own for texture coordinates. A label of 0 has
        /// no material, any other that of its number less 1.
        pub fn to_tobj(&self) -> Vec<tobj::Model> {
            let label_of = |face: usize| self.face_labels.get(face).copied().unwrap_or(0);
            let mut labels: Vec<u32> = (0..self.faces.len()).map(label_of).collect();
            labels.sort_unstable();
            labels.dedup();
            labels.into_iter().map(|label| self.model_of(label, label_of)).collect()
        }

        fn model_of(&self, label: u32, label_of: impl Fn(usize) -> u32) -> tobj::Model {
            let mut mesh = tobj::Mesh { material_id: label.checked_sub(1).map(|id| id as usize), ..Default::default() };
            let (mut vertices, mut texcoords) = (HashMap::new(), HashMap::new());
            for (face, corners) in self.faces.iter().enumerate().filter(|&(face, _)| label_of(face) == label) {
                for &vertex in corners {
                    let next = vertices.len() as u32;
                    let id = *vertices.entry(vertex).or_insert(next);
                    mesh.indices.push(id);
                    if id == next {
                        self.positions[vertex as usize].iter().for_each(|&x| mesh.positions.push(x as _));
                        let colour = self.colours.get(vertex as usize);
                        colour.into_iter().flatten().for_each(|&x| mesh.vertex_color.push(x as _));
                    }
                }
                let of_face = self.face_texcoords.get(face).filter(|ids| !ids.contains(&Self::NO_TEXCOORD));
                for &texcoord in of_face.into_iter().flatten() {
                    let next = texcoords.len() as u32;
                    let id = *texcoords.entry(texcoord).or_insert(next);
                    mesh.texcoord_indices.push(id);
                    if id == next {
                        self.texcoords[texcoord as usize].iter().for_each(|&x| mesh.texcoords.push(x as _));
                    }
                }
            }
            tobj::Model::new(mesh, format!("label {label}"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ErrorKind;

    fn triangle() -> Mesh {
        Mesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            texcoords: vec![[0.5; 2]],
            faces: vec![[0, 1, 2]],
            face_texcoords: vec![[0, 0, Mesh::NO_TEXCOORD]],
            face_labels: vec![7],
            ..Mesh::default()
        }
    }

    #[test]
    fn what_cannot_be_is_refused() {
        triangle().check().unwrap();
        Mesh::default().check().unwrap();
        type Fault = (&'static str, fn(&mut Mesh));
        let faults: [Fault; 6] = [
            ("a vertex", |mesh| mesh.faces[0][2] = 3),
            ("a texture coordinate", |mesh| mesh.face_texcoords[0][1] = 1),
            ("face_texcoords", |mesh| mesh.face_texcoords.push([0; 3])),
            ("face_labels", |mesh| mesh.face_labels.push(0)),
            ("colours", |mesh| mesh.colours.push([0.0; 3])),
            ("not finite", |mesh| mesh.positions[1][1] = f64::NAN),
        ];
        for (words, spoil) in faults {
            let mut mesh = triangle();
            spoil(&mut mesh);
            let error = mesh.check().unwrap_err();
            assert!(error.kind() == ErrorKind::Usage && error.to_string().contains(words), "{error}");
        }
    }
}

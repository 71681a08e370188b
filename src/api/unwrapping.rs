//! The library's interface for texture coordinates.

use glam::DVec3;

use crate::base::id::TiVec;
use crate::base::{Error, Result};
use crate::mesh::id::{FaceId, LocalVertex};
use crate::model::Mesh;
use crate::unwrap::{ImageSize, Triangles, UnwrapSettings, unwrap};

/// Largest coordinate of a mesh that is unwrapped, in texels.
const TEXELS_MAX: f64 = 1e9;

/// Gives a mesh in memory new texture coordinates, for images in which each texel's side is about `texel` long on the
/// surface, in the mesh's unit of length. No side of an image is longer than `side` texels.
///
/// Returns the mesh and the sizes of the images. The label of a face is the number of its image. Charts do not overlap,
/// neither themselves nor each other, no triangle is turned over, and [`GUTTER`](crate::unwrap::GUTTER) texels around
/// each chart belong to no other. Faces keep their order and their vertices. Takes about 250 bytes a triangle.
///
/// ```
/// use drystone::{Mesh, unwrap_mesh};
///
/// let mesh = Mesh {
///     positions: vec![[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
///     faces: vec![[0, 1, 2], [0, 2, 3]],
///     ..Mesh::default()
/// };
/// let (unwrapped, images) = unwrap_mesh(&mesh, 0.01, 1024)?;
/// assert_eq!((unwrapped.texcoords.len(), images.len()), (4, 1));
/// assert!(images[0].width >= 100 && images[0].height >= 100);
/// # Ok::<(), drystone::Error>(())
/// ```
///
/// # Errors
/// [`Error::Usage`] for indices that do not exist, a `texel` that is not positive or too short for the mesh, and a `side`
/// that is no power of two from 64 to 16384; [`Error::Limit`] for a mesh that is too large.
pub fn unwrap_mesh(mesh: &Mesh, texel: f64, side: u32) -> Result<(Mesh, Vec<ImageSize>)> {
    mesh.check()?;
    let largest = mesh.positions.iter().flatten().fold(0.0, |largest: f64, x| largest.max(x.abs()));
    if !texel.is_normal() || texel < 0.0 || largest / texel > TEXELS_MAX {
        return Err(Error::Usage(format!("texels cannot be {texel} long on this mesh")));
    }
    if !side.is_power_of_two() || !(64..=16384).contains(&side) {
        return Err(Error::Usage(format!("the side of an image is a power of two from 64 to 16384, not {side}")));
    }
    let positions: TiVec<LocalVertex, DVec3> = mesh.positions.iter().copied().map(DVec3::from_array).collect();
    let vertices: TiVec<FaceId, _> = mesh.faces.iter().map(|face| face.map(LocalVertex::new)).collect();
    let texels: TiVec<FaceId, f64> = vec![texel; mesh.faces.len()].into();
    let triangles = Triangles { positions: &positions, vertices: &vertices };
    let unwrapped = unwrap(triangles, &UnwrapSettings { texels: &texels, side })?;
    let mut out = Mesh {
        positions: mesh.positions.clone(),
        colours: mesh.colours.clone(),
        faces: mesh.faces.clone(),
        face_texcoords: vec![[Mesh::NO_TEXCOORD; 3]; mesh.faces.len()],
        face_labels: vec![0; mesh.faces.len()],
        ..Mesh::default()
    };
    // The texture coordinate of each vertex in the chart that came last.
    let mut texcoord_of = vec![(usize::MAX, 0); mesh.positions.len()];
    for (number, chart) in unwrapped.charts.iter().enumerate() {
        let size = unwrapped.images[chart.image as usize];
        for (face, corners) in &chart.faces {
            let face = face.index();
            out.face_labels[face] = chart.image;
            for corner in 0..3 {
                let of_vertex = &mut texcoord_of[mesh.faces[face][corner] as usize];
                if of_vertex.0 != number {
                    *of_vertex = (number, out.texcoords.len() as u32);
                    out.texcoords.push(size.texcoord(corners[corner]).to_array());
                }
                out.face_texcoords[face][corner] = of_vertex.1;
            }
        }
    }
    Ok((out, unwrapped.images))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_is_refused() {
        let mesh = Mesh {
            positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            faces: vec![[0, 1, 2]],
            ..Mesh::default()
        };
        for (texel, side) in [(0.0, 1024), (-1.0, 1024), (f64::NAN, 1024), (1e-12, 1024), (0.1, 100), (0.1, 32768)] {
            assert!(matches!(unwrap_mesh(&mesh, texel, side), Err(Error::Usage(_))), "{texel} {side}");
        }
        let broken = Mesh { faces: vec![[0, 1, 3]], ..mesh };
        assert!(unwrap_mesh(&broken, 0.1, 1024).is_err());
    }

    #[test]
    fn an_empty_mesh_stays_empty() {
        let (unwrapped, images) = unwrap_mesh(&Mesh::default(), 0.1, 1024).unwrap();
        assert!(unwrapped.texcoords.is_empty() && images.is_empty());
    }
}

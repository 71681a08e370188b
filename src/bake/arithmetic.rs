//! A checksum of what unwrapping and encoding make of a small surface: processes whose processor or mathematics differ
//! have another one, and would paint other bytes.

use xxhash_rust::xxh3::Xxh3;

use crate::base::Result;
use crate::base::id::TiVec;
use crate::image::encode::encode_in_memory;
use crate::mesh::id::{FaceId, LocalVertex};
use crate::model::image_format::ImageFormat;
use crate::passes::arithmetic::hill;
use crate::unwrap::{Triangles, UnwrapSettings, unwrap};

/// Side of the image, and of a texel in the mesh's unit of length.
const SIDE: u32 = 64;
const TEXEL: f64 = 0.3;

/// Unwraps a small hill, and encodes an image; returns a checksum of both.
///
/// # Errors
/// [`Stopped`](crate::base::Error::Stopped); [`Io`](crate::base::Error::Io) if the image cannot be encoded.
pub fn checksum(format: ImageFormat) -> Result<u64> {
    let mesh = hill();
    let vertices: TiVec<FaceId, [LocalVertex; 3]> = mesh.face_ids().map(|face| mesh.vertices(face)).collect();
    let texels: TiVec<FaceId, f64> = vec![TEXEL; vertices.len()].into();
    let triangles = Triangles { positions: &mesh.positions, vertices: &vertices };
    let mut hash = Xxh3::new();
    let unwrapped = unwrap(triangles, &UnwrapSettings { texels: &texels, side: SIDE })?;
    for chart in &unwrapped.charts {
        hash.update(&chart.image.to_le_bytes());
        for (face, corners) in &chart.faces {
            hash.update(&face.number().to_le_bytes());
            hash.update(bytemuck::cast_slice(&corners.map(|corner| corner.to_array())));
        }
    }
    let wave = |at: u32| 127.5 + 127.5 * libm::sin(f64::from(at * at) / 700.0);
    let pixels: Vec<u8> = (0..3 * SIDE * SIDE).map(|at| wave(at) as u8).collect();
    hash.update(&encode_in_memory(&pixels, [SIDE as usize; 2], format, "a small image")?);
    Ok(hash.digest())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_same_each_time_and_another_one_for_another_format() {
        let of = |name: &str| checksum(name.parse().unwrap()).unwrap();
        assert_eq!(of("png"), of("png"));
        assert_ne!(of("png"), of("jpeg"));
    }
}

//! Texture seams: which texels meet along them.
//!
//! ```text
//!   1 ┼            ┼ 1      a point of a seam lies at one place on the surface and at two in the images; what both
//!     │ chart  the │        sides show there should look alike, and come from the same position on the original
//!   p ● ◀─── same ─▶ ● p
//!     │   place    │
//!   0 ┼            ┼ 0
//! ```
//! In: edges between two faces that show an image each, with different texture coordinates or materials. Out: points on
//! them, in the form in which textures are compared. Invariant: the points depend on the mesh, the seed and their
//! number alone.
//!
//! # Files
//! `measure-seams.col`, 48 bytes an edge, and `measure-seam-points.col`, 56 bytes a point.

use std::path::Path;

use glam::DVec2;

use super::texture_pair::TexturePair;
use crate::base::Result;
use crate::base::chance;
use crate::file::{Column, ColumnWriter};
use crate::topology::seam_edge::{EdgeTexture, SeamEdge};

/// Maximum number of points on seams for each point by area.
const SEAM_SHARE: f64 = 0.25;
/// Edges and points that are in memory at once.
const WINDOW_RECORDS: u64 = 1 << 14;

/// Texture coordinate at a share of the way along an edge, between 0 and 1.
fn texcoord_at(texture: &EdgeTexture, share: f64) -> [f32; 2] {
    let [from, to] = texture.texcoords;
    [0, 1].map(|axis| {
        let at = f64::from(from[axis]) * (1.0 - share) + f64::from(to[axis]) * share;
        (at - at.floor()) as f32
    })
}

/// Length of an edge in texture space.
fn texture_length(texture: &EdgeTexture) -> f64 {
    let [from, to] = texture.texcoords.map(|uv| DVec2::new(f64::from(uv[0]), f64::from(uv[1])));
    from.distance(to)
}

/// The point at a share of the way along an edge.
fn point(edge: &SeamEdge, share: f64) -> TexturePair {
    let [own, other] = &edge.sides;
    TexturePair {
        closest: [0.0; 3],
        image: own.image,
        other_image: other.image,
        texcoord: texcoord_at(own, share),
        other_texcoord: texcoord_at(other, share),
        other_density: (texture_length(other) / edge.length) as f32,
        zero: 0,
    }
}

/// The seams of a mesh.
#[derive(Debug)]
pub struct SeamEdges {
    /// Edges, in no particular order.
    pub edges: Column<SeamEdge>,
    /// Total length.
    pub length: f64,
}

/// Collects seams.
pub struct SeamWriter {
    file: ColumnWriter<SeamEdge>,
    length: f64,
}

impl SeamWriter {
    /// Creates the file.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn create(folder: &Path) -> Result<Self> {
        Ok(Self { file: ColumnWriter::create(&folder.join("measure-seams.col"), *b"seams   ")?, length: 0.0 })
    }

    /// Adds edges.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn push(&mut self, edges: &[SeamEdge]) -> Result<()> {
        self.length = edges.iter().fold(self.length, |sum, edge| sum + edge.length);
        self.file.append(edges)
    }

    /// Ends the file.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub fn finish(self) -> Result<SeamEdges> {
        Ok(SeamEdges { edges: self.file.finish()?, length: self.length })
    }
}

impl SeamEdges {
    /// Places points on the seams by length: a quarter of `samples`, each at a random position in its part of the
    /// whole.
    ///
    /// # Errors
    /// On a full disk, failed reads and writes.
    pub fn points(&self, folder: &Path, samples: u64, seed: u64) -> Result<Column<TexturePair>> {
        let mut file = ColumnWriter::create(&folder.join("measure-seam-points.col"), *b"samples ")?;
        let count = (samples as f64 * SEAM_SHARE).ceil();
        let step = self.length / count;
        let place = |part: u64| (part as f64 + chance::of_stream(seed, part, 0)) * step;
        let (mut part, mut start) = (0, 0.0);
        let mut points = Vec::new();
        for range in self.edges.ranges(WINDOW_RECORDS) {
            for edge in self.edges.window(range)?.iter() {
                while (part as f64) < count && place(part) < start + edge.length {
                    points.push(point(edge, ((place(part) - start) / edge.length).clamp(0.0, 1.0)));
                    part += 1;
                    if points.len() as u64 == WINDOW_RECORDS {
                        file.append(&points)?;
                        points.clear();
                    }
                }
                start += edge.length;
            }
        }
        file.append(&points)?;
        file.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::id::ImageId;

    fn side(image: u32, from: [f32; 2], to: [f32; 2]) -> EdgeTexture {
        EdgeTexture { image: ImageId::new(image), texcoords: [from, to] }
    }

    #[test]
    fn points_lie_on_seams_by_length_and_show_both_sides() {
        let folder = tempfile::tempdir().unwrap();
        let sides = [side(0, [0.0, 0.0], [0.0, 1.0]), side(1, [0.5, 0.0], [0.5, 0.5])];
        let mut writer = SeamWriter::create(folder.path()).unwrap();
        let edges = [3.0, 1.0].map(|length| SeamEdge::between(length, sides).unwrap());
        writer.push(&edges).unwrap();
        writer.push(&[SeamEdge { sides: [sides[1].reversed(), sides[1]], ..edges[0] }]).unwrap();
        let seams = writer.finish().unwrap();
        assert_eq!(seams.length, 7.0);
        let points = seams.points(folder.path(), 28_000, 1).unwrap();
        let points = points.window(0..points.len()).unwrap();
        // a thousand for each unit of length
        assert_eq!(points.len(), 7000);
        assert_eq!(points.iter().filter(|point| point.image == ImageId::new(0)).count(), 4000);
        for point in &points[..4000] {
            assert!((point.texcoord[1] - 2.0 * point.other_texcoord[1]).abs() < 1e-6);
        }
        assert!(points[..3000].is_sorted_by(|a, b| a.texcoord[1] <= b.texcoord[1]));
        assert!((points[0].other_density - 1.0 / 6.0).abs() < 1e-6);
        // the last edge runs the other way on its first side
        assert!(points[4000..].iter().all(|p| (p.texcoord[1] + p.other_texcoord[1] - 0.5).abs() < 1e-6));
    }

    #[test]
    fn a_side_without_image_makes_no_seam() {
        let sides = [side(0, [0.0; 2], [1.0; 2]), side(u32::MAX, [0.0; 2], [0.0; 2])];
        assert!(SeamEdge::between(1.0, sides).is_none());
        assert!(SeamEdge::between(0.0, [sides[0]; 2]).is_none());
    }

    #[test]
    fn no_seam_has_no_points() {
        let folder = tempfile::tempdir().unwrap();
        let seams = SeamWriter::create(folder.path()).unwrap().finish().unwrap();
        assert_eq!(seams.points(folder.path(), 1000, 1).unwrap().len(), 0);
    }
}

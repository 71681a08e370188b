//! The triangles that are painted.

use glam::DVec3;

use crate::geometry::boxtree::Bounds;
use crate::mesh::id::FaceId;
use crate::unwrap::Triangles;

/// The triangles of a patch, and where they lie.
pub struct PatchSurface<'a> {
    /// The triangles.
    pub triangles: Triangles<'a>,
    /// Their positions are relative to this.
    pub origin: DVec3,
}

impl PatchSurface<'_> {
    /// The smallest box around it.
    pub fn bounds(&self) -> Bounds {
        Bounds::around(self.triangles.positions.iter().map(|&position| position + self.origin))
    }

    /// Corners of a triangle.
    pub fn corners(&self, face: FaceId) -> [DVec3; 3] {
        self.triangles.corners(face).map(|corner| corner + self.origin)
    }
}

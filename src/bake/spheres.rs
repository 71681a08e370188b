//! Spheres around triangles: they exclude most triangles at once.

use glam::{DVec3, Vec3};

use crate::geometry::boxtree::Bounds;

/// Middles and radii of spheres.
#[derive(Default)]
pub(super) struct Spheres {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    radius: Vec<f32>,
    /// Distances of the present point from the spheres, negative inside.
    distances: Vec<f32>,
}

impl Spheres {
    /// Takes all of them out.
    pub fn clear(&mut self) {
        [&mut self.x, &mut self.y, &mut self.z, &mut self.radius].into_iter().for_each(Vec::clear);
    }

    /// Adds one around the corners of a triangle.
    pub fn push(&mut self, corners: [DVec3; 3]) {
        let Bounds { low, high } = Bounds::around(corners);
        let middle = 0.5 * (low + high);
        let [a, b, c] = corners.map(|corner| corner.distance_squared(middle));
        let (middle, radius) = (middle.as_vec3(), a.max(b).max(c).sqrt() as f32);
        self.x.push(middle.x);
        self.y.push(middle.y);
        self.z.push(middle.z);
        self.radius.push(radius);
    }

    /// Measures the distances of a point.
    pub fn measure(&mut self, point: Vec3) {
        self.distances.resize(self.x.len(), 0.0);
        let columns = self.x.iter().zip(&self.y).zip(&self.z).zip(&self.radius);
        for (distance, (((x, y), z), radius)) in self.distances.iter_mut().zip(columns) {
            let (x, y, z) = (x - point.x, y - point.y, z - point.z);
            *distance = (x * x + y * y + z * z).sqrt() - radius;
        }
    }

    /// The distances that were measured.
    pub fn distances(&self) -> &[f32] {
        &self.distances
    }

    /// Measures the distances of a point; returns the number of the nearest sphere.
    pub fn nearest(&mut self, point: Vec3) -> Option<usize> {
        self.measure(point);
        let least = self.distances.iter().copied().fold(f32::INFINITY, |a, b| if b < a { b } else { a });
        self.distances.iter().position(|&distance| distance == least)
    }
}

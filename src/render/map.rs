//! The clusters of a pass from above, with the borders that were locked.
//!
//! Clusters may be drawn in any order, by several threads in turn. Each pixel keeps the highest surface, and of two
//! equally high ones that of the lower cluster number; it also keeps the highest border.

use glam::DVec3;

use super::encode::{distinct, png};
use super::raster;
use super::view::View;
use crate::mesh::ClusterMesh;
use crate::partition::ClusterId;

/// A border is visible if it lies at most this many pixels beneath the surface.
const BORDER_DEPTH: f32 = 2.0;
const BORDER_COLOUR: [u8; 4] = [38, 40, 46, 255];

/// A map of the clusters.
#[derive(Debug, Clone)]
pub struct ClusterMap {
    view: View,
    /// What each pixel shows.
    surface: Vec<TopSurface>,
    /// Height in pixels of the highest locked edge.
    border: Vec<f32>,
}

/// The highest surface of a pixel.
#[derive(Debug, Clone, Copy)]
struct TopSurface {
    /// In pixels; negative infinity without a surface.
    height: f32,
    cluster: ClusterId,
}

/// What a pixel of the map shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spot {
    /// No surface.
    Nothing,
    /// This cluster.
    Cluster(ClusterId),
    /// An edge between two vertices that other clusters use.
    Border,
}

impl ClusterMap {
    /// An empty map; the view should look straight down.
    pub fn new(view: View) -> Self {
        let count = view.size[0] * view.size[1];
        let none = TopSurface { height: f32::NEG_INFINITY, cluster: ClusterId::NONE };
        Self { view, surface: vec![none; count], border: vec![f32::NEG_INFINITY; count] }
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        self.view.size
    }

    /// Draws a cluster, whose positions are relative to `origin`.
    pub fn draw(&mut self, cluster: ClusterId, mesh: &ClusterMesh, origin: DVec3) {
        let size = self.view.size;
        for face in mesh.face_ids() {
            let corners = mesh.triangle(face).map(|corner| self.view.project(corner + origin));
            raster::each_pixel(&corners, size, |pixel, height, _| {
                let (height, top) = (height as f32, &mut self.surface[pixel]);
                if height > top.height || (height == top.height && cluster < top.cluster) {
                    *top = TopSurface { height, cluster };
                }
            });
            let is_shared = mesh.vertices(face).map(|vertex| mesh.is_shared(vertex));
            for (from, to) in [(0, 1), (1, 2), (2, 0)].into_iter().filter(|&(a, b)| is_shared[a] && is_shared[b]) {
                raster::each_pixel_of_line(corners[from], corners[to], size, |pixel, height| {
                    self.border[pixel] = self.border[pixel].max(height as f32);
                });
            }
        }
    }

    /// The map as a PNG, transparent where there is no surface; `None` if it is too large for the format.
    pub fn to_png(&self) -> Option<Vec<u8>> {
        let colour = |spot| match spot {
            Spot::Nothing => [0; 4],
            Spot::Border => BORDER_COLOUR,
            Spot::Cluster(cluster) => {
                let [red, green, blue] = distinct(cluster.number());
                [red, green, blue, 255]
            }
        };
        let pixels: Vec<u8> = (0..self.surface.len()).flat_map(|pixel| colour(self.spot(pixel))).collect();
        png(&pixels, self.view.size)
    }

    /// What a pixel shows.
    pub fn spot(&self, pixel: usize) -> Spot {
        let TopSurface { height, cluster } = self.surface[pixel];
        let border = self.border[pixel];
        match height {
            _ if border > f32::NEG_INFINITY && border >= height - BORDER_DEPTH => Spot::Border,
            f32::NEG_INFINITY => Spot::Nothing,
            _ => Spot::Cluster(cluster),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::cluster::{flag, samples};
    use crate::render::Frame;

    fn spots(order: &[u32]) -> Vec<Spot> {
        let frame = Frame::new(DVec3::ZERO, DVec3::new(8.0, 8.0, 1.0)).unwrap();
        let mut map = ClusterMap::new(frame.view(0.0, 90.0, [32, 32]));
        for &cluster in order {
            // 0: the left half; 1: the right half, its left rim locked
            let mut mesh = samples::two_charts(8);
            let origin = DVec3::new(f64::from(cluster) * 4.0, 0.0, 0.0);
            for vertex in mesh.vertex_ids() {
                mesh.positions[vertex] *= DVec3::new(0.5, 1.0, 1.0);
                if cluster == 1 && mesh.positions[vertex].x == 0.0 {
                    mesh.flags[vertex] |= flag::SHARED;
                }
            }
            map.draw(ClusterId::new(cluster), &mesh, origin);
        }
        (0..32 * 32).map(|pixel| map.spot(pixel)).collect()
    }

    #[test]
    fn clusters_lie_where_they_are_and_the_border_between_them() {
        let spots = spots(&[0, 1]);
        let middle = &spots[16 * 32..17 * 32];
        let [left, right] = [0, 1].map(|number| Spot::Cluster(ClusterId::new(number)));
        assert_eq!((middle[8], middle[16], middle[24]), (left, Spot::Border, right));
        assert_eq!(middle[0], Spot::Nothing);
    }

    #[test]
    fn the_order_of_clusters_does_not_matter() {
        assert_eq!(spots(&[0, 1]), spots(&[1, 0]));
    }
}

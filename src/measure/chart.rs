//! Charts of the texture atlas, and triangles that are folded in it.
//!
//! ```text
//!   texture space        a chart whose triangle c is turned over lies on itself there:
//!   +-----+-----+        the texture is torn on one of the two sides of the fold
//!   | a  /|\ c /
//!   |  /  | \ /          a mirrored chart has all its triangles turned over, and none is folded
//!   |/  b |  +
//!   +-----+
//! ```
//!
//! # Memory
//! 21 bytes a face.

use serde::Serialize;

use super::edges::{EdgeTable, HalfEdge};
use super::forest::DisjointSets;
use super::surface::{NO_TEXCOORD, Surface};
use crate::geometry::triangle::is_flat;

/// Counts of the texture atlas.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct ChartCounts {
    /// Triangles whose corners run clockwise in texture space.
    pub uv_negative: u64,
    /// Triangles whose corners run counter-clockwise in texture space.
    pub uv_positive: u64,
    /// Triangles without area in texture space.
    pub uv_degenerate: u64,
    /// Triangles whose orientation in texture space differs from the majority (by area) of their chart.
    pub folded_uv: u64,
    /// Sets of textured faces connected over edges that are no seams. An edge connects only if its two faces run along
    /// it in opposite directions: otherwise one of them shows its back, and their signs cannot be compared.
    pub charts: u64,
    /// Edges of two faces whose texture coordinates (by value) or materials differ there.
    pub seam_edges: u64,
}

/// Counts charts, seams and folded triangles; a face is textured if all its corners have a texture coordinate.
pub fn count_charts(surface: &Surface, edges: &EdgeTable) -> ChartCounts {
    let mut counts = ChartCounts::default();
    let textured = |face: usize| !surface.face_texcoords[face].contains(&NO_TEXCOORD);
    let mut charts = DisjointSets::new(surface.faces.len());
    for edge in edges.iter() {
        let &[a, b] = edge else { continue };
        if is_seam(surface, a, b) {
            counts.seam_edges += 1;
        } else if textured(a.face()) && textured(b.face()) && a.runs_up(&surface.faces) != b.runs_up(&surface.faces) {
            charts.join(a.face() as u32, b.face() as u32);
        }
    }
    let largest = surface.texcoords.iter().fold(0.0f64, |largest, uv| largest.max(uv.abs().max_element()));
    let mut areas = vec![0.0; surface.faces.len()];
    let mut chart_areas = vec![0.0; surface.faces.len()];
    for face in (0..surface.faces.len()).filter(|&face| textured(face)) {
        let root = charts.root(face as u32);
        counts.charts += u64::from(root as usize == face);
        let [a, b, c] = surface.face_texcoords[face].map(|t| surface.texcoords[t as usize]);
        let area = (b - a).perp_dot(c - a);
        let longest_sq = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared());
        if is_flat(area.abs(), longest_sq, largest) {
            counts.uv_degenerate += 1;
        } else {
            *(if area > 0.0 { &mut counts.uv_positive } else { &mut counts.uv_negative }) += 1;
            areas[face] = area;
            chart_areas[root as usize] += area;
        }
    }
    counts.folded_uv = (0..surface.faces.len())
        .filter(|&face| {
            let chart_area = chart_areas[charts.root(face as u32) as usize];
            areas[face] > 0.0 && chart_area < 0.0 || areas[face] < 0.0 && chart_area > 0.0
        })
        .count() as u64;
    counts
}

fn is_seam(surface: &Surface, a: HalfEdge, b: HalfEdge) -> bool {
    let corners = |half: HalfEdge| half.corners(&surface.faces).map(|k| surface.face_texcoords[half.face()][k]);
    let same = |s: u32, t: u32| {
        s == t || s != NO_TEXCOORD && t != NO_TEXCOORD && surface.texcoords[s as usize] == surface.texcoords[t as usize]
    };
    let ([a_low, a_high], [b_low, b_high]) = (corners(a), corners(b));
    surface.face_materials[a.face()] != surface.face_materials[b.face()] || !same(a_low, b_low) || !same(a_high, b_high)
}

#[cfg(test)]
mod tests {
    use super::super::surface::tests::bare;
    use super::*;

    /// A strip of two faces with the given texture coordinates.
    fn strip(texcoords: &[[f64; 2]], face_texcoords: [[u32; 3]; 2], face_materials: [u32; 2]) -> ChartCounts {
        // 2 - 3
        // | \ |
        // 0 - 1
        let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
        let mut surface = bare(&positions, &[[0, 1, 2], [2, 1, 3]]);
        surface.texcoords = texcoords.iter().map(|&t| t.into()).collect();
        surface.face_texcoords = face_texcoords.to_vec();
        surface.face_materials = face_materials.to_vec();
        count_charts(&surface, &EdgeTable::new(&surface.faces))
    }

    const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];

    #[test]
    fn a_flat_chart_has_no_fold() {
        let counts = strip(&SQUARE, [[0, 1, 2], [2, 1, 3]], [0, 0]);
        assert_eq!(counts, ChartCounts { uv_positive: 2, charts: 1, ..ChartCounts::default() });
    }

    #[test]
    fn a_triangle_turned_over_in_its_chart_is_folded() {
        // the last corner lies on the near side of the diagonal: the second triangle covers part of the first one
        // 2
        // |'.\
        // | 3 \
        // 0 - - 1
        let texcoords = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.3, 0.3]];
        let counts = strip(&texcoords, [[0, 1, 2], [2, 1, 3]], [0, 0]);
        assert_eq!((counts.charts, counts.folded_uv, counts.uv_negative), (1, 1, 1));
    }

    #[test]
    fn a_mirrored_chart_is_not_folded() {
        // the second face has its own texture coordinates, in which left and right are exchanged
        let texcoords = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [2.0, 0.0], [3.0, 1.0], [2.0, 1.0]];
        let counts = strip(&texcoords, [[0, 1, 2], [3, 5, 4]], [0, 0]);
        assert_eq!((counts.charts, counts.seam_edges, counts.folded_uv), (2, 1, 0));
        assert_eq!((counts.uv_positive, counts.uv_negative), (1, 1));
    }

    #[test]
    fn a_triangle_that_shows_its_back_is_in_a_chart_of_its_own() {
        let mut surface =
            bare(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]], &[[0, 1, 2], [1, 2, 3]]);
        surface.texcoords = SQUARE.iter().map(|&t| t.into()).collect();
        surface.face_texcoords = surface.faces.clone();
        let counts = count_charts(&surface, &EdgeTable::new(&surface.faces));
        assert_eq!((counts.charts, counts.seam_edges, counts.folded_uv), (2, 0, 0));
        assert_eq!((counts.uv_positive, counts.uv_negative), (1, 1));
    }

    #[test]
    fn texture_coordinates_are_compared_by_value() {
        let texcoords = [SQUARE[0], SQUARE[1], SQUARE[2], SQUARE[3], SQUARE[2], SQUARE[1]];
        let counts = strip(&texcoords, [[0, 1, 2], [4, 5, 3]], [0, 0]);
        assert_eq!((counts.charts, counts.seam_edges), (1, 0));
    }

    #[test]
    fn a_material_border_is_a_seam() {
        let counts = strip(&SQUARE, [[0, 1, 2], [2, 1, 3]], [0, 1]);
        assert_eq!((counts.charts, counts.seam_edges), (2, 1));
    }

    #[test]
    fn faces_without_texture_are_in_no_chart() {
        let counts = strip(&SQUARE, [[0, 1, 2], [NO_TEXCOORD; 3]], [0, 0]);
        assert_eq!((counts.charts, counts.seam_edges, counts.uv_positive), (1, 1, 1));
    }

    #[test]
    fn a_triangle_on_a_line_of_texture_space_is_degenerate() {
        let texcoords = [[0.1, 0.1], [0.2, 0.2], [0.7, 0.7], [0.9, 0.3]];
        let counts = strip(&texcoords, [[0, 1, 2], [2, 1, 3]], [0, 0]);
        assert_eq!((counts.uv_degenerate, counts.folded_uv), (1, 0));
    }
}

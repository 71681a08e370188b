//! Triangulates polygons with four corners or more once their positions are known.
//!
//! Ear clipping by the `earcutr` crate in the plane of the polygon's Newell normal; a fan where that fails or would
//! take O(n³).

use std::cmp::Ordering;

use glam::DVec3;

use super::simple::is_simple;

/// Outlines with at most this many corners are clipped without a test for self-intersections: even the worst is fast.
const CORNERS_OF_ANY: usize = 32;

/// Writes the n - 2 triangles of a polygon to `out`, as indices into `polygon`; none if n < 3.
///
/// A quad is split along the diagonal that keeps both triangles on the polygon's side; if both or neither do, along the
/// shorter one; if they are equally long, along the one whose lower end comes first by position. The split depends
/// neither on the first corner nor on the direction of the outline. A polygon with more than 32 corners whose outline
/// intersects itself becomes a fan.
pub fn triangulate(polygon: &[DVec3], out: &mut Vec<[usize; 3]>) {
    out.clear();
    let count = polygon.len();
    if count < 3 {
        return;
    }
    let normal = newell_normal(polygon);
    if count == 4 {
        out.extend(cut_quad(polygon, normal));
        return;
    }
    if let Some(triangles) = ear_cut(polygon, normal) {
        out.extend(triangles);
    }
    if out.len() != count - 2 {
        out.clear();
        out.extend((1..count - 1).map(|i| [0, i, i + 1]));
    }
}

/// Area-weighted normal of a polygon (Newell's method), twice its area long.
fn newell_normal(polygon: &[DVec3]) -> DVec3 {
    let origin = polygon[0];
    let mut normal = DVec3::ZERO;
    for (i, &p) in polygon.iter().enumerate() {
        let next = polygon[(i + 1) % polygon.len()];
        normal += (p - origin).cross(next - origin);
    }
    normal
}

fn cut_quad(p: &[DVec3], normal: DVec3) -> [[usize; 3]; 2] {
    let side = |a: usize, b: usize, c: usize| (p[b] - p[a]).cross(p[c] - p[a]).dot(normal);
    let first = side(0, 1, 2).min(side(0, 2, 3));
    let second = side(1, 2, 3).min(side(1, 3, 0));
    let is_first = match (first > 0.0, second > 0.0) {
        (true, false) => true,
        (false, true) => false,
        _ => {
            let lengths = p[0].distance_squared(p[2]).total_cmp(&p[1].distance_squared(p[3]));
            let end = |a: usize, b: usize| if by_position(p[a], p[b]).is_le() { p[a] } else { p[b] };
            lengths.then_with(|| by_position(end(0, 2), end(1, 3))).is_le()
        }
    };
    if is_first { [[0, 1, 2], [0, 2, 3]] } else { [[1, 2, 3], [1, 3, 0]] }
}

fn by_position(a: DVec3, b: DVec3) -> Ordering {
    a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z))
}

fn ear_cut(polygon: &[DVec3], normal: DVec3) -> Option<Vec<[usize; 3]>> {
    let magnitude = normal.abs();
    // Project along the largest component of the normal: it distorts the polygon least. The sign keeps the winding.
    let project = |p: DVec3| -> [f64; 2] {
        let q = p - polygon[0];
        if magnitude.x >= magnitude.y && magnitude.x >= magnitude.z {
            [q.y * normal.x.signum(), q.z]
        } else if magnitude.y >= magnitude.z {
            [q.z * normal.y.signum(), q.x]
        } else {
            [q.x * normal.z.signum(), q.y]
        }
    };
    let outline: Vec<[f64; 2]> = polygon.iter().map(|&p| project(p)).collect();
    if outline.len() > CORNERS_OF_ANY && !is_simple(&outline) {
        return None;
    }
    let indices = earcutr::earcut(outline.as_flattened(), &[], 2).ok()?;
    let oriented = |&[a, b, c]: &[usize; 3]| {
        let across = (polygon[b] - polygon[a]).cross(polygon[c] - polygon[a]);
        if across.dot(normal) < 0.0 { [a, c, b] } else { [a, b, c] }
    };
    Some(indices.as_chunks().0.iter().map(oriented).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(polygon: &[DVec3]) -> f64 {
        let mut triangles = Vec::new();
        triangulate(polygon, &mut triangles);
        let across = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|i| polygon[i]);
            (b - a).cross(c - a).length()
        };
        triangles.iter().map(|t| 0.5 * across(t)).sum()
    }

    //   3        a dart: the diagonal 0-2 would fold over
    //  / \
    // 0 . 2  with 1 pulled up inside
    #[test]
    fn a_dart_is_cut_at_its_notch_wherever_it_starts() {
        let dart = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.8, 0.2]].map(|[x, y]| DVec3::new(x, y, 0.0));
        for start in 0..4 {
            let mut turned = dart;
            turned.rotate_left(start);
            assert!((area(&turned) - 0.4).abs() < 1e-12, "{start}: {}", area(&turned));
        }
    }

    #[test]
    fn a_concave_polygon_keeps_its_area_in_any_plane() {
        let outline = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]];
        for axes in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2]] {
            let polygon = outline.map(|[x, y]| {
                let mut p = [0.0; 3];
                (p[axes[0]], p[axes[1]]) = (x, y);
                DVec3::from_array(p)
            });
            assert!((area(&polygon) - 5.0).abs() < 1e-12, "{axes:?}");
        }
    }

    #[test]
    fn every_triangle_faces_as_its_polygon_does_at_any_size() {
        let outline = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]];
        for size in [1e-4, 1.0, 1e4] {
            for turn in [1.0, -1.0] {
                let polygon = outline.map(|[x, y]| DVec3::new(x, turn * y, 0.3 * x) * size);
                let mut triangles = Vec::new();
                triangulate(&polygon, &mut triangles);
                assert_eq!(triangles.len(), 4);
                for [a, b, c] in triangles.iter().map(|t| t.map(|i| polygon[i])) {
                    assert!((b - a).cross(c - a).z * turn > 0.0, "{size} {turn}");
                }
            }
        }
    }

    #[test]
    fn a_polygon_without_area_becomes_a_fan() {
        let mut triangles = Vec::new();
        triangulate(&[DVec3::ZERO; 6], &mut triangles);
        assert_eq!(triangles.len(), 4);
    }
}

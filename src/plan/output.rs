//! Predicts the size of the mesh that is written, as an OBJ.

use crate::file::packed::RecordBounds;
use crate::read::Counts;

/// Characters of a coordinate in the shortest decimals of single precision, about: where the input has no decimals.
const SHORTEST_BYTES: f64 = 10.0;
/// Bytes of lines, about.
const TEXCOORD_BYTES: f64 = 20.0;
const NORMAL_BYTES: f64 = 24.0;
/// Bytes of a colour behind a position, about.
const COLOUR_BYTES: f64 = 27.0;

/// Powers of the share of triangles that is left, by which each of them has more vertices and texture coordinates than in
/// the input: small parts, borders and seams lose fewer. Within a ninth of results at 50, 10 and 2 % of five meshes.
const VERTEX_GROWTH: f64 = -0.03;
const TEXCOORD_GROWTH: f64 = -0.15;

/// Bytes of `faces` triangles of an input as an OBJ, without images. Its vertices lie in `boxes`.
pub fn obj_bytes(counts: &Counts, boxes: &[RecordBounds], faces: u64) -> u64 {
    let share = faces as f64 / counts.triangles.max(1) as f64;
    let left = |count: u64, growth: f64| if count > 0 { count as f64 * libm::pow(share, 1.0 + growth) } else { 0.0 };
    let [vertices, normals] = [counts.vertices, counts.normals].map(|count| left(count, VERTEX_GROWTH));
    let texcoords = left(counts.texcoords, TEXCOORD_GROWTH);
    let colour = if counts.has_colours { COLOUR_BYTES } else { 0.0 };
    // `v` and the line's end, and a blank before each coordinate.
    let coordinates = (0..3).map(|axis| 1.0 + coordinate_bytes(counts.decimals, boxes, axis)).sum::<f64>();
    let columns = [vertices, texcoords, normals].map(number_bytes);
    // `f` and the line's end, and a blank or a slash before each number.
    let face = 2.0 + 3.0 * columns.iter().sum::<f64>();
    let lines = vertices * (2.0 + coordinates + colour) + texcoords * TEXCOORD_BYTES + normals * NORMAL_BYTES;
    (lines + faces as f64 * face) as u64
}

/// Characters of a coordinate, about.
fn coordinate_bytes(decimals: u32, boxes: &[RecordBounds], axis: usize) -> f64 {
    let least = boxes.iter().map(|bounds| bounds.low[axis]).fold(0.0, f64::min);
    let most = boxes.iter().map(|bounds| bounds.high[axis]).fold(-least, f64::max);
    let sign = f64::from(u8::from(least < 0.0));
    match decimals {
        0 => sign + digits(most),
        1..=15 => sign + digits(most) + 1.0 + f64::from(decimals),
        _ => sign + SHORTEST_BYTES,
    }
}

/// Bytes of a number of this column in a face, with the character before it; none for an empty column.
fn number_bytes(count: f64) -> f64 {
    if count > 0.0 { 1.0 + digits(count) } else { 0.0 }
}

/// Digits before the point of a number up to `most`.
fn digits(most: f64) -> f64 {
    libm::floor(libm::log10(most.clamp(1.0, f64::MAX))) + 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_about(found: u64, measured: u64) -> bool {
        (found as f64 / measured as f64 - 1.0).abs() < 0.1
    }

    #[test]
    fn sizes_are_about_those_of_results() {
        // The town of the fixtures at a tenth.
        let town = Counts {
            bytes: 1_123_258,
            vertices: 9_386,
            texcoords: 12_604,
            normals: 0,
            polygons: 18_218,
            triangles: 18_218,
            has_colours: false,
            decimals: 3,
        };
        let city = RecordBounds { low: [432_100.0, 4_581_200.0, 30.0], high: [432_180.0, 4_581_280.0, 52.0] };
        assert!(is_about(obj_bytes(&town, &[city], 1_821), 125_578));
        // A binary PLY of a scan, half of it.
        let scan = Counts {
            vertices: 134_345,
            texcoords: 0,
            polygons: 268_686,
            triangles: 268_686,
            decimals: u32::MAX,
            ..town
        };
        let unit = RecordBounds { low: [-0.5; 3], high: [0.5; 3] };
        assert!(is_about(obj_bytes(&scan, &[unit], 134_343), 4_844_421));
    }

    #[test]
    fn nothing_has_no_size() {
        assert_eq!(obj_bytes(&Counts::default(), &[], 0), 0);
    }
}

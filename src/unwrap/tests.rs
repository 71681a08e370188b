use glam::{DVec2, DVec3};
use proptest::prelude::*;

use super::*;
use crate::base::id::TiVec;
use crate::geometry::triangle::area;
use crate::mesh::id::{FaceId, LocalVertex};

/// A patch of triangles.
struct Patch {
    positions: TiVec<LocalVertex, DVec3>,
    vertices: TiVec<FaceId, [LocalVertex; 3]>,
}

impl Patch {
    fn triangles(&self) -> Triangles<'_> {
        Triangles { positions: &self.positions, vertices: &self.vertices }
    }

    /// A square grid, lifted by `height` at each place between 0 and 1.
    fn grid(side: u32, height: impl Fn(DVec2) -> DVec3) -> Self {
        let place = |at: u32| height(DVec2::new(f64::from(at % side), f64::from(at / side)) / f64::from(side - 1));
        let cell = |at: u32| {
            let corner = at / (side - 1) * side + at % (side - 1);
            let [a, b, c, d] = [corner, corner + 1, corner + side, corner + side + 1].map(LocalVertex::new);
            [[a, b, d], [a, d, c]]
        };
        Self {
            positions: (0..side * side).map(place).collect(),
            vertices: (0..(side - 1) * (side - 1)).flat_map(cell).collect(),
        }
    }

    fn unwrapped(&self, texel: f64, side: u32) -> Unwrapped {
        let texels: TiVec<FaceId, f64> = vec![texel; self.vertices.len()].into();
        unwrap(self.triangles(), &UnwrapSettings { texels: &texels, side }).unwrap()
    }
}

fn doubled_area([a, b, c]: [DVec2; 3]) -> f64 {
    (b - a).perp_dot(c - a)
}

/// Which triangle covers the middle of each texel of an image; panics where two of them do, or one of another chart is
/// within the gutter.
fn check_images(unwrapped: &Unwrapped) {
    for (number, size) in unwrapped.images.iter().enumerate() {
        let mut owners = vec![None; (size.width * size.height) as usize];
        let charts = unwrapped.charts.iter().enumerate().filter(|(_, chart)| chart.image as usize == number);
        for (chart, PlacedChart { faces, .. }) in charts {
            for (face, corners) in faces {
                let (low, high) =
                    (corners[0].min(corners[1]).min(corners[2]), corners[0].max(corners[1]).max(corners[2]));
                assert!(low.min_element() >= f64::from(GUTTER) - 1e-6, "{low}");
                assert!(high.x <= f64::from(size.width - GUTTER) + 1e-6, "{high} {size:?}");
                assert!(high.y <= f64::from(size.height) + 1e-6, "{high} {size:?}");
                for y in low.y as usize..high.y.ceil() as usize {
                    for x in low.x as usize..high.x.ceil() as usize {
                        let middle = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                        let is_right =
                            |k: usize| (corners[(k + 1) % 3] - corners[k]).perp_dot(middle - corners[k]) < -1e-9;
                        if is_right(0) && is_right(1) && is_right(2) {
                            let before = owners[y * size.width as usize + x].replace((chart, *face));
                            assert_eq!(before, None, "{face:?} lies over another one");
                        }
                    }
                }
            }
        }
        let [width, height] = [size.width as usize, size.height as usize];
        for y in 0..height {
            for x in 0..width {
                let Some((chart, _)) = owners[y * width + x] else { continue };
                for row in y.saturating_sub(GUTTER as usize)..(y + GUTTER as usize + 1).min(height) {
                    for column in x.saturating_sub(GUTTER as usize)..(x + GUTTER as usize + 1).min(width) {
                        let other = owners[row * width + column];
                        assert!(other.is_none_or(|(other, _)| other == chart), "two charts meet at {column}, {row}");
                    }
                }
            }
        }
    }
}

/// Every triangle is in one chart, none is turned over, and none has less than half or more than twice of its texels.
fn check_charts(patch: &Patch, unwrapped: &Unwrapped, texel: f64) {
    let mut are_seen = vec![false; patch.vertices.len()];
    for (face, corners) in unwrapped.charts.iter().flat_map(|chart| &chart.faces) {
        assert!(!std::mem::replace(&mut are_seen[face.index()], true), "{face:?} twice");
        let true_area = area(patch.triangles().corners(*face)) / (texel * texel);
        // Rows go down, so a triangle that is not turned over goes around clockwise.
        let share = -0.5 * doubled_area(*corners) / true_area;
        assert!(true_area < 1e-9 || (0.45..2.1).contains(&share), "{face:?}: {share}");
    }
    assert!(are_seen.into_iter().all(|is_seen| is_seen));
}

#[test]
fn a_plane_is_one_chart() {
    let patch = Patch::grid(12, |at| DVec3::new(100.0 * at.x, 60.0 * at.y, 7.0));
    let unwrapped = patch.unwrapped(0.5, 1024);
    assert_eq!((unwrapped.charts.len(), unwrapped.images.len()), (1, 1));
    check_charts(&patch, &unwrapped, 0.5);
    check_images(&unwrapped);
}

#[test]
fn a_roll_does_not_lie_over_itself() {
    // Three turns of a spiral, whose triangles face every way.
    let patch = Patch::grid(60, |at| {
        let (turn, radius) = (6.0 * std::f64::consts::PI * at.x, 5.0 + 3.0 * at.x);
        DVec3::new(radius * turn.cos(), radius * turn.sin(), 10.0 * at.y)
    });
    let unwrapped = patch.unwrapped(0.2, 1024);
    check_charts(&patch, &unwrapped, 0.2);
    check_images(&unwrapped);
}

#[test]
fn charts_that_do_not_fit_one_image_go_to_several() {
    let patch = Patch::grid(16, |at| DVec3::new(100.0 * at.x, 100.0 * at.y, (30.0 * at.x).sin()));
    let unwrapped = patch.unwrapped(0.25, 256);
    assert!(unwrapped.images.len() > 1);
    assert!(unwrapped.images.iter().all(|size| size.width <= 256 && size.height <= 256));
    assert_eq!(unwrapped.shrunk, 0);
    check_charts(&patch, &unwrapped, 0.25);
    check_images(&unwrapped);
}

#[test]
fn a_triangle_larger_than_an_image_is_made_smaller() {
    let patch = Patch::grid(2, |at| DVec3::new(1000.0 * at.x, 1000.0 * at.y, 0.0));
    let unwrapped = patch.unwrapped(0.5, 256);
    assert_eq!(unwrapped.shrunk, 2);
    check_images(&unwrapped);
}

#[test]
fn triangles_without_area_and_copies_are_placed_too() {
    let mut patch = Patch::grid(4, |at| DVec3::new(at.x, at.y, 0.0));
    let [a, b, c] = [0, 1, 2].map(LocalVertex::new);
    // A line along the border, a point, and two triangles once more.
    patch.vertices.extend([[a, c, b], [a, a, a], patch.vertices[FaceId::new(0)], patch.vertices[FaceId::new(5)]]);
    let unwrapped = patch.unwrapped(0.05, 256);
    let placed: usize = unwrapped.charts.iter().map(|chart| chart.faces.len()).sum();
    assert_eq!(placed, patch.vertices.len());
    check_images(&unwrapped);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn charts_of_any_surface_lie_side_by_side(
        seed in any::<u64>(), side in 3u32..14, roughness in 0.0f64..0.6, texel in 0.005f64..0.1,
    ) {
        let noise = |at: DVec2, salt: u64| {
            let key = at.x.to_bits() ^ at.y.to_bits().rotate_left(17) ^ seed ^ salt;
            (xxhash_rust::xxh3::xxh3_64(&key.to_le_bytes()) >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let patch = Patch::grid(side, |at| {
            DVec3::new(at.x, at.y, 0.0) + roughness * DVec3::new(noise(at, 1), noise(at, 2), noise(at, 3))
        });
        let unwrapped = patch.unwrapped(texel, 512);
        check_charts(&patch, &unwrapped, texel);
        check_images(&unwrapped);
    }
}

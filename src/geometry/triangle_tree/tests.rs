use super::*;
use proptest::prelude::*;

fn by_looking_at_all(point: DVec3, triangles: &[[DVec3; 3]]) -> f64 {
    let distances = triangles.iter().map(|&t| closest_point(point, t).distance_squared(point));
    distances.fold(f64::INFINITY, f64::min)
}

fn vectors(raw: [[i16; 3]; 3], scale: f64) -> [DVec3; 3] {
    raw.map(|p| DVec3::from(p.map(f64::from)) * scale)
}

proptest! {
    #[test]
    fn the_tree_finds_what_a_plain_search_finds(
        raw in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-300i16..300)), 1..200),
        points in prop::collection::vec(prop::array::uniform3(-900i16..900), 1..30),
        scale in prop_oneof![Just(1.0), Just(1e-5), Just(1e6)],
    ) {
        let triangles: Vec<_> = raw.into_iter().map(|t| vectors(t, scale)).collect();
        let tree = build(triangles.len(), |i| triangles[i as usize]);
        let at = |place: u32| triangles[tree.order[place as usize] as usize];
        let nearest = |point, bound_sq, enough_sq| {
            let question = Question { point, bound_sq, enough_sq, looks: u64::MAX };
            tree.view().ask(&question, at).nearest
        };
        for point in points {
            let point = DVec3::from(point.map(|x| f64::from(x) + 0.25)) * scale;
            let (place, distance_sq) = nearest(point, f64::INFINITY, -1.0).unwrap();
            prop_assert_eq!(distance_sq, by_looking_at_all(point, &triangles));
            prop_assert_eq!(closest_point(point, at(place)).distance_squared(point), distance_sq);
            // nothing is nearer than the nearest, and something is near enough
            prop_assert!(nearest(point, distance_sq, -1.0).is_none());
            let enough = nearest(point, f64::INFINITY, distance_sq * 4.0).unwrap();
            prop_assert!(enough.1 <= distance_sq * 4.0);
        }
    }
}

proptest! {
    #[test]
    fn every_triangle_that_meets_a_box_is_visited(
        raw in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(-300i16..300)), 1..200),
        corners in prop::array::uniform2(prop::array::uniform3(-400i16..400)),
        scale in prop_oneof![Just(1.0), Just(1e-5), Just(1e6)],
    ) {
        let triangles: Vec<_> = raw.into_iter().map(|t| vectors(t, scale)).collect();
        let tree = build(triangles.len(), |i| triangles[i as usize]);
        let bounds = Bounds::around(corners.map(|corner| DVec3::from(corner.map(f64::from)) * scale));
        let mut visited = Vec::new();
        tree.view().visit_meeting(bounds, |place| {
            visited.push(tree.order[place as usize]);
            false
        });
        for (number, &triangle) in triangles.iter().enumerate() {
            // A box around a triangle may meet it though the triangle does not, but not the other way around.
            let meets = triangle.iter().any(|&corner| bounds.distance_sq(corner) == 0.0);
            prop_assert!(!meets || visited.contains(&(number as u32)), "{}", number);
        }
        visited.sort_unstable();
        prop_assert!(visited.windows(2).all(|pair| pair[0] < pair[1]));
    }
}

#[test]
fn many_triangles_at_one_place_are_halved() {
    let tree = build(10_000, |_| [DVec3::ONE; 3]);
    assert_eq!(tree.order.len(), 10_000);
    let found = tree.view().ask(&Question::nearest_to(DVec3::ZERO), |_| [DVec3::ONE; 3]);
    assert!((found.nearest.unwrap().1 - 3.0).abs() < 1e-12);
}

#[test]
fn a_fan_of_needles_is_searched_without_looking_at_most_of_them() {
    // a needle for each step around the middle; the point lies between rim and middle, above one of them
    let count = 20_000;
    let rim = |i: u32| {
        let angle = std::f64::consts::TAU * f64::from(i % count) / f64::from(count);
        DVec3::new(100.0 * angle.cos(), 100.0 * angle.sin(), (17.0 * angle).sin())
    };
    let needle = |i: u32| [DVec3::new(0.0, 0.0, 10.0), rim(i), rim(i + 1)];
    let tree = build(count as usize, needle);
    let looks = std::cell::Cell::new(0);
    for angle in [0.3f64, 0.8, 2.2, 4.0] {
        let point = DVec3::new(60.0 * angle.cos(), 60.0 * angle.sin(), 3.0);
        let at = |place: u32| {
            looks.set(looks.get() + 1);
            needle(tree.order[place as usize])
        };
        let found = tree.view().ask(&Question::nearest_to(point), at).nearest.unwrap();
        let all: Vec<[DVec3; 3]> = (0..count).map(needle).collect();
        assert_eq!(found.1, by_looking_at_all(point, &all));
    }
    assert!(looks.get() < 4 * 1000, "{} triangles were measured", looks.get());
}

#[test]
fn a_search_that_ends_early_says_so_and_gives_a_triangle() {
    let triangles: Vec<[DVec3; 3]> =
        (0..1000).map(|i| [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| axis * (1.0 + f64::from(i)))).collect();
    let tree = build(triangles.len(), |i| triangles[i as usize]);
    let at = |place: u32| triangles[tree.order[place as usize] as usize];
    let whole = tree.view().ask(&Question::nearest_to(DVec3::ONE * 200.3), at);
    assert!(!whole.is_cut && whole.looks > 10);
    let cut = tree.view().ask(&Question { looks: 0, ..Question::nearest_to(DVec3::ONE * 200.3) }, at);
    assert!(cut.is_cut && cut.looks < whole.looks);
    assert!(cut.nearest.unwrap().1 >= whole.nearest.unwrap().1);
}

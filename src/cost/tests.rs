//! Laws that hold for every metric, and each metric against a direct evaluation of its formulas.

use glam::{DMat3, DQuat, DVec2, DVec3, Vec2};

use super::fan::{Fan, angle_between};
use super::mesh_stats::MeshStats;
use super::metric::EdgeCase;
use super::*;
use crate::base::id::TiVec;
use crate::mesh::class::{Class, classify};
use crate::mesh::cluster::{ClusterMesh, samples};
use crate::mesh::id::short::{pair, v, w};
use crate::mesh::id::{FaceId, LocalVertex, Wedge, WedgePair};
use crate::mesh::ring::Rings;
use crate::model::id::PartId;

/// Two inner vertices of a grid of 6 × 6 squares, joined by a diagonal.
const A: LocalVertex = v(16);
const B: LocalVertex = v(24);
const INNER: EdgeCase<'_> =
    EdgeCase { from: A, to: B, onto: false, stays: false, wedges: &[pair(16, 24)], insets: [Vec2::ZERO; 2] };
const SWAPPED: EdgeCase<'_> = EdgeCase { from: B, to: A, wedges: &[pair(24, 16)], ..INNER };

struct Prepared<M> {
    mesh: ClusterMesh,
    rings: Rings,
    classes: TiVec<LocalVertex, Class>,
    cost: M,
}

/// A metric on a mesh, with its normalisers set and its state refreshed.
fn prepared<M: Metric>(mesh: &ClusterMesh, settings: impl Into<M::Settings>) -> Prepared<M> {
    let (mut rings, mut classes, mut settings, mut stats) =
        (Rings::default(), TiVec::new(), settings.into(), MeshStats::default());
    rings.build(mesh);
    classify(mesh, &rings, &mut classes);
    mesh.positions.iter().for_each(|&p| stats.enclose(p));
    M::count(&settings, mesh, &rings, &classes, &mut stats);
    M::normalise(&mut settings, &stats);
    let mut cost = M::new(&settings);
    cost.refresh(mesh, &rings, &classes);
    Prepared { mesh: mesh.clone(), rings, classes, cost }
}

impl<M: Metric> Prepared<M> {
    fn price(&self, edge: &EdgeCase<'_>) -> Placement {
        self.cost.place(&self.mesh, edge)
    }
}

fn moved(mesh: &ClusterMesh, scale: f64, turn: DMat3, shift: DVec3) -> ClusterMesh {
    let mut mesh = mesh.clone();
    mesh.positions.iter_mut().for_each(|p| *p = turn * (*p * scale) + shift);
    mesh.wedge_uv.iter_mut().for_each(|uv| *uv *= scale);
    mesh
}

/// The cost is a length to this `power`.
fn obeys_the_laws<M: Metric, const N: usize>(parameters: &[parameter::Parameter; N], power: i32)
where
    M::Settings: From<[f64; N]>,
{
    let defaults = || M::Settings::from(parameters.map(|parameter| parameter.default));
    let mesh = samples::grid(6, 0.7);
    let here = prepared::<M>(&mesh, defaults()).price(&INNER);
    assert!(here.cost > 1e-6, "a bumpy grid costs something: {here:?}");

    let flat = prepared::<M>(&samples::grid(6, 0.0), defaults()).price(&INNER);
    assert!(flat.cost < 1e-5, "flat ground with an affine texture costs no more than its tie breaker: {flat:?}");
    assert!((flat.position.z).abs() < 1e-6);

    let large = prepared::<M>(&moved(&mesh, 3.0, DMat3::IDENTITY, DVec3::ZERO), defaults()).price(&INNER);
    let ratio = large.cost / here.cost / 3f64.powi(power);
    assert!((ratio - 1.0).abs() < 1e-5, "scaling by 3 costs 3^{power} times {ratio}");

    let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 1.1, -0.7));
    let turned = prepared::<M>(&moved(&mesh, 1.0, turn, DVec3::new(30.0, -7.0, 5.0)), defaults()).price(&INNER);
    assert!((turned.cost / here.cost - 1.0).abs() < 1e-6, "a rigid motion changes {here:?} to {turned:?}");
    assert!((turned.position - (turn * here.position + DVec3::new(30.0, -7.0, 5.0))).length() < 1e-5);

    let back = prepared::<M>(&mesh, defaults()).price(&SWAPPED);
    assert!((back.cost / here.cost - 1.0).abs() < 1e-9, "{back:?}");
    assert!((back.position - here.position).length() < 1e-9, "{back:?}");
}

#[test]
fn the_metric_of_1997_obeys_the_laws() {
    obeys_the_laws::<ClassicCost, 3>(&classic::PARAMETERS, 2);
}

#[test]
fn the_curvature_metric_obeys_the_laws() {
    obeys_the_laws::<CurvatureCost, 3>(&curvature::PARAMETERS, 2);
}

#[test]
fn the_sharpness_metric_obeys_the_laws() {
    obeys_the_laws::<SharpnessCost, 5>(&sharpness::PARAMETERS, 2);
}

#[test]
fn the_terrain_metric_obeys_the_laws() {
    obeys_the_laws::<TerrainCost, 7>(&terrain::PARAMETERS, 2);
}

#[test]
fn the_oblique_metric_obeys_the_laws() {
    obeys_the_laws::<ObliqueCost, 10>(&oblique::PARAMETERS, 6);
}

/// Σ (n·(p - q))² over the faces around a vertex.
fn plane_sum(mesh: &ClusterMesh, rings: &Rings, vertex: LocalVertex, p: DVec3) -> f64 {
    let squared = |face: FaceId| {
        let [a, b, c] = mesh.triangle(face);
        (b - a).cross(c - a).normalize().dot(p - a).powi(2)
    };
    rings.faces(mesh, vertex).map(squared).sum()
}

fn fan_of<M>(prepared: &Prepared<M>, vertex: LocalVertex) -> Fan {
    let mut fan = Fan::default();
    fan.gather(&prepared.mesh, &prepared.rings, vertex);
    fan
}

fn agrees(found: f64, wanted: f64) {
    assert!((found / wanted - 1.0).abs() < 1e-4, "{found} instead of {wanted}");
}

#[test]
fn the_metric_of_1997_is_the_sum_of_squared_distances_to_planes() {
    let it = prepared::<ClassicCost>(&samples::grid(6, 0.7), [0.0, 0.0, 1.0]);
    let found = it.price(&INNER);
    let sum = |p| plane_sum(&it.mesh, &it.rings, A, p) + plane_sum(&it.mesh, &it.rings, B, p);
    agrees(found.cost, sum(found.position));
    for step in [DVec3::X, DVec3::Y, DVec3::Z] {
        assert!(sum(found.position) <= sum(found.position + 0.01 * step) + 1e-9);
        assert!(sum(found.position) <= sum(found.position - 0.01 * step) + 1e-9);
    }
}

/// The defaults of all parameters except one.
fn with<const N: usize>(parameters: &[parameter::Parameter; N], name: &str, value: f64) -> [f64; N] {
    assert!(parameters.iter().any(|parameter| parameter.name == name));
    parameters.map(|parameter| if parameter.name == name { value } else { parameter.default })
}

#[test]
fn three_places_are_the_ends_and_the_middle() {
    fn check<M: Metric>(three: Prepared<M>, optimal: Prepared<M>) {
        let (a, b) = (three.mesh.positions[A], three.mesh.positions[B]);
        let found = three.price(&INNER);
        assert!([a, b, 0.5 * (a + b)].contains(&found.position), "{found:?}");
        assert!(found.cost > optimal.price(&INNER).cost * 1.01, "{found:?}");
    }
    let mesh = samples::grid(6, 0.7);
    let classic = with(&classic::PARAMETERS, "placement", 1.0);
    let it = prepared::<ClassicCost>(&mesh, classic);
    let found = it.price(&INNER);
    let sum = |p| plane_sum(&mesh, &it.rings, A, p) + plane_sum(&mesh, &it.rings, B, p);
    let (a, b) = (mesh.positions[A], mesh.positions[B]);
    let least = [a, b, 0.5 * (a + b)].map(sum).into_iter().fold(f64::INFINITY, f64::min);
    agrees(found.cost, least);
    check(it, prepared::<ClassicCost>(&mesh, classic::PARAMETERS.map(|parameter| parameter.default)));
    let oblique = with(&oblique::PARAMETERS, "placement", 1.0);
    let optimal = oblique::PARAMETERS.map(|parameter| parameter.default);
    check(prepared::<ObliqueCost>(&mesh, oblique), prepared::<ObliqueCost>(&mesh, optimal));
}

#[test]
fn the_area_weighted_baseline_follows_a_change_as_the_curvature_metric_does() {
    for curvature in [0.0, 1.0] {
        let settings = || with(&curvature::PARAMETERS, "curvature", curvature);
        let mut it = prepared::<CurvatureCost>(&samples::grid(6, 0.7), settings());
        it.mesh.positions[B].z += 0.4;
        let mut changed = Vec::new();
        it.cost.follow(&it.mesh, &it.rings, &[B], &mut changed);
        changed.sort_unstable();
        assert_eq!(changed, [16, 17, 23, 24, 25, 31, 32].map(v));
        let fresh = prepared::<CurvatureCost>(&it.mesh, settings());
        for &vertex in &changed {
            assert_eq!(it.cost.weight(vertex), fresh.cost.weight(vertex), "{curvature} {vertex:?}");
        }
    }
}

#[test]
fn terrain_quadrics_that_are_not_carried_are_those_of_the_mesh_as_it_stands() {
    // Raw, so that no normaliser changes with the mesh.
    let settings = |carry: f64| {
        terrain::PARAMETERS.map(|parameter| match parameter.name {
            "raw" => 1.0,
            "carry" => carry,
            _ => parameter.default,
        })
    };
    let mut it = prepared::<TerrainCost>(&samples::grid(6, 0.7), settings(0.0));
    it.mesh.positions[B].z += 0.4;
    let mut changed = Vec::new();
    it.cost.follow(&it.mesh, &it.rings, &[B], &mut changed);
    let fresh = prepared::<TerrainCost>(&it.mesh, settings(0.0));
    for to in [16, 32, 25] {
        let edge = EdgeCase { from: B, to: v(to), wedges: &[pair(24, to)], ..INNER };
        agrees(it.price(&edge).cost, fresh.price(&edge).cost);
    }
    let carried = prepared::<TerrainCost>(&samples::grid(6, 0.7), settings(1.0));
    let stale = carried.cost.place(&it.mesh, &INNER).cost;
    assert!((stale / fresh.price(&INNER).cost - 1.0).abs() > 0.05, "carried quadrics ignore the change");
}

#[test]
fn terrain_counts_no_face_without_area() {
    let mut mesh = samples::grid(6, 0.7);
    (mesh.positions[A].z, mesh.positions[v(17)].z) = (0.5, 0.25);
    let raw = || with(&terrain::PARAMETERS, "raw", 1.0);
    let before = prepared::<TerrainCost>(&mesh, raw()).price(&INNER).cost;
    // The normals of its corners differ, so it has a plane in eight dimensions.
    let middle = mesh.push_vertex(0.5 * (mesh.positions[A] + mesh.positions[v(17)]), 0);
    let wedge = mesh.push_wedge(middle, DVec2::new(0.25, 0.2));
    samples::add_faces(&mut mesh, &[[16, wedge.number(), 17]]);
    mesh.link_wedges();
    agrees(prepared::<TerrainCost>(&mesh, raw()).price(&INNER).cost, before);
}

#[test]
fn raw_terrain_has_unit_normals() {
    let mesh = samples::grid(6, 0.7);
    let it = prepared::<TerrainCost>(&mesh, with(&terrain::PARAMETERS, "raw", 1.0));
    let settings = terrain::TerrainSettings::from(with(&terrain::PARAMETERS, "raw", 1.0));
    assert!(TerrainCost::wants_raw_texture(&settings));
    for vertex in mesh.vertex_ids() {
        let length = it.cost.normal(vertex).length();
        assert!(length > 0.5 && length < 1.0 + 1e-12, "{length}");
    }
}

#[test]
fn the_curvature_metric_weights_planes_by_area_and_curvature() {
    let it = prepared::<CurvatureCost>(&samples::grid(6, 0.7), [1.0, 1e-3, 1.0]);
    let found = it.price(&INNER);
    let weight = |vertex: LocalVertex| {
        let fan = fan_of(&it, vertex);
        let third: f64 = fan.spokes.iter().map(|spoke| spoke.area).sum::<f64>() / 3.0;
        let k = (std::f64::consts::TAU - fan.spokes.iter().map(|spoke| spoke.angle).sum::<f64>()) / third;
        let mut h = 0.0;
        for spoke in &fan.spokes {
            let other = fan.spokes.iter().find(|other| other.next == spoke.previous).unwrap();
            let length = it.mesh.positions[spoke.previous].distance(it.mesh.positions[vertex]);
            h += 0.25 * length * spoke.normal.angle_between(other.normal) / third;
        }
        3.0 * third * (4.0 * h * h - 2.0 * k)
    };
    let sum = |v: LocalVertex| weight(v) * plane_sum(&it.mesh, &it.rings, v, found.position);
    agrees(found.cost, sum(A) + sum(B));
}

/// A ball of radius 2 by subdividing an octahedron.
fn ball() -> ClusterMesh {
    let n = 24i32;
    let mut mesh = ClusterMesh::default();
    let mut ids = std::collections::BTreeMap::new();
    for x in -n..=n {
        for y in -(n - x.abs())..=(n - x.abs()) {
            for z in [n - x.abs() - y.abs(), -(n - x.abs() - y.abs())] {
                ids.entry((x, y, z)).or_insert_with(|| {
                    let p = DVec3::new(f64::from(x), f64::from(y), f64::from(z)).normalize() * 2.0;
                    let vertex = mesh.push_vertex(p, 0);
                    mesh.push_wedge(vertex, DVec2::NAN)
                });
            }
        }
    }
    for octant in 0..8 {
        let sign = |bit: i32| if octant >> bit & 1 == 0 { 1 } else { -1 };
        let (sx, sy, sz) = (sign(0), sign(1), sign(2));
        let at = |i: i32, j: i32| ids[&(sx * i, sy * j, sz * (n - i - j))];
        let mut push = |a, b, c| {
            let corners = if sx * sy * sz > 0 { [a, b, c] } else { [a, c, b] };
            mesh.push_face(corners, PartId::new(0));
        };
        for i in 0..n {
            for j in 0..n - i {
                push(at(i, j), at(i + 1, j), at(i, j + 1));
                if i + j + 2 <= n {
                    push(at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
                }
            }
        }
    }
    mesh.link_wedges();
    mesh
}

#[test]
fn the_curvature_of_a_ball_is_that_of_its_radius() {
    let mesh = ball();
    let (mut rings, mut fan) = (Rings::default(), Fan::default());
    rings.build(&mesh);
    let mut mean = [0.0; 3];
    for vertex in mesh.vertex_ids() {
        fan.gather(&mesh, &rings, vertex);
        assert!(fan.is_closed);
        let bend = curvature::Bend::of(&fan, mesh.positions[vertex], &mesh.positions);
        for (sum, value) in mean.iter_mut().zip([bend.gauss, bend.mean, bend.total()]) {
            *sum += value / mesh.positions.len() as f64;
        }
    }
    for (found, wanted) in mean.into_iter().zip([0.25, 0.5, 0.5]) {
        assert!((found / wanted - 1.0).abs() < 0.06, "{mean:?}");
    }
}

#[test]
fn the_sharpness_metric_weights_planes_by_powers_of_two() {
    let it = prepared::<SharpnessCost>(&samples::grid(6, 0.7), [1.0, 1.0, 8.0, 1.0, 0.0]);
    let found = it.price(&INNER);
    let share = |vertex: LocalVertex| {
        let fan = fan_of(&it, vertex);
        let uv_area = |face: FaceId| {
            let [a, b, c] = it.mesh.uv_triangle(face);
            0.5 * (b - a).perp_dot(c - a).abs()
        };
        fan.spokes.iter().map(|spoke| uv_area(spoke.face) / spoke.area).sum::<f64>() / fan.spokes.len() as f64
    };
    let mean = it.mesh.vertex_ids().map(share).sum::<f64>() / 49.0;
    let factor = |vertex: LocalVertex| {
        let fan = fan_of(&it, vertex);
        let sigma: f64 = (0..fan.spokes.len())
            .map(|i| (fan.spokes[i], fan.spokes[(i + 1) % fan.spokes.len()]))
            .map(|(a, b)| (a.area + b.area) / (2.0 * fan.area()) * angle_between(a.normal, b.normal))
            .sum();
        2f64.powf(sigma + share(vertex) / mean)
    };
    let sum = |v: LocalVertex| factor(v) * plane_sum(&it.mesh, &it.rings, v, found.position);
    agrees(found.cost, sum(A) + sum(B));
    let (a, b) = (it.mesh.positions[A], it.mesh.positions[B]);
    assert!([a, b, 0.5 * (a + b)].contains(&found.position));
}

//  The corner of a cube: three square faces of two triangles each; at the corner the three right angles between
//  faces of one side and the next: σ = 3 joints × (S_i + S_i+1) / 2S × 90°, the rest are flat.
#[test]
fn the_sharpness_of_a_cubes_corner_is_a_quarter_turn_times_three_joints_shares() {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| (p, DVec2::NAN));
    let mesh = samples::mesh_of(corners, &[[0, 2, 1], [0, 3, 2], [0, 1, 3]]);
    let (mut rings, mut fan) = (Rings::default(), Fan::default());
    rings.build(&mesh);
    fan.gather(&mesh, &rings, v(0));
    // Each of three joints: (½ + ½) / (2 · 1½) = ⅓; together one quarter turn.
    assert!((sharpness::sharpness(&fan) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
}

/// Σ |w|² - (w·e1)² - (w·e2)² over the faces around a vertex, with w from the face's first corner.
fn wide_sum<const N: usize>(faces: &[[[f64; N]; 3]], v: [f64; N]) -> f64 {
    let dot = |a: &[f64; N], b: &[f64; N]| (0..N).map(|i| a[i] * b[i]).sum::<f64>();
    let minus = |a: &[f64; N], b: &[f64; N]| -> [f64; N] { std::array::from_fn(|i| a[i] - b[i]) };
    let unit = |a: [f64; N]| a.map(|x| x / dot(&a, &a).sqrt());
    let squared = |[p, q, r]: &[[f64; N]; 3]| {
        let e1 = unit(minus(q, p));
        let along = minus(r, p);
        let e2 = unit(std::array::from_fn(|i| along[i] - dot(&e1, &along) * e1[i]));
        let w = minus(&v, p);
        dot(&w, &w) - dot(&w, &e1).powi(2) - dot(&w, &e2).powi(2)
    };
    faces.iter().map(squared).sum()
}

#[test]
fn the_terrain_metric_is_the_squared_distance_to_planes_in_eight_dimensions() {
    let it = prepared::<TerrainCost>(&samples::grid(6, 0.7), terrain::PARAMETERS.map(|parameter| parameter.default));
    let onto = EdgeCase { onto: true, stays: true, ..INNER };
    let found = it.price(&onto);
    let (mut lengths, mut count) = (0.0, 0.0);
    for face in it.mesh.face_ids() {
        let [a, b, c] = it.mesh.triangle(face);
        lengths += a.distance(b) + b.distance(c) + c.distance(a);
        count += 3.0;
    }
    let point = |vertex: LocalVertex| {
        let fan = fan_of(&it, vertex);
        let angles: f64 = fan.spokes.iter().map(|s| s.angle).sum();
        let normal = fan.spokes.iter().map(|s| s.normal * s.angle).sum::<DVec3>() / angles * 0.1 * lengths / count;
        let (p, uv) = (it.mesh.positions[vertex], it.mesh.wedge_uv[w(vertex.number())]);
        [p.x, p.y, p.z, uv.x, uv.y, normal.x, normal.y, normal.z]
    };
    let faces = |vertex: LocalVertex| -> Vec<_> {
        it.rings.faces(&it.mesh, vertex).map(|face| it.mesh.vertices(face).map(point)).collect()
    };
    agrees(found.cost, wide_sum(&faces(A), point(B)) + wide_sum(&faces(B), point(B)));
    assert!(it.price(&INNER).cost < found.cost, "the optimal place is better than an end");
}

#[test]
fn the_oblique_metric_is_the_weighted_sum_of_its_paper() {
    let it = prepared::<ObliqueCost>(&samples::grid(6, 0.7), oblique::PARAMETERS.map(|parameter| parameter.default));
    let onto = EdgeCase { onto: true, stays: true, ..INNER };
    let found = it.price(&onto);
    let normal = |vertex: LocalVertex| {
        fan_of(&it, vertex).spokes.iter().map(|s| s.normal * s.angle * s.area).sum::<DVec3>().normalize()
    };
    let at = |vertex: LocalVertex| it.mesh.positions[vertex];
    let fluctuation = |vertex: LocalVertex| {
        let fan = fan_of(&it, vertex);
        let term = |n: LocalVertex| normal(vertex).angle_between(normal(n)) / at(vertex).distance(at(n));
        fan.spokes.iter().map(|s| term(s.next)).sum::<f64>() / fan.spokes.len() as f64
    };
    let mean_area = |vertex: LocalVertex| fan_of(&it, vertex).area() / fan_of(&it, vertex).spokes.len() as f64;
    let density = |vertex: LocalVertex| {
        let fan = fan_of(&it, vertex);
        let share = |face: FaceId, area: f64| {
            let [a, b, c] = it.mesh.uv_triangle(face);
            0.5 * (b - a).perp_dot(c - a).abs() / area
        };
        fan.spokes.iter().map(|s| share(s.face, s.area)).sum::<f64>() / fan.spokes.len() as f64
    };
    let point = |vertex: LocalVertex| {
        let (p, uv) = (at(vertex), it.mesh.wedge_uv[w(vertex.number())]);
        [p.x, p.y, p.z, uv.x, uv.y]
    };
    let term = |vertex: LocalVertex| {
        let faces: Vec<_> = it.rings.faces(&it.mesh, vertex).map(|face| it.mesh.vertices(face).map(point)).collect();
        mean_area(vertex) / fluctuation(vertex) * wide_sum(&faces, point(B))
    };
    let stretch = at(A).distance(at(B)) * (density(A) + density(B));
    agrees(found.cost, (term(A) + term(B)) * stretch);
}

#[test]
fn the_oblique_factors_follow_a_change_over_two_rings() {
    let mut it =
        prepared::<ObliqueCost>(&samples::grid(6, 0.7), oblique::PARAMETERS.map(|parameter| parameter.default));
    it.mesh.positions[B].z += 0.4;
    let mut changed = Vec::new();
    it.cost.follow(&it.mesh, &it.rings, &[B], &mut changed);
    changed.sort_unstable();
    let fresh = prepared::<ObliqueCost>(&it.mesh, oblique::PARAMETERS.map(|parameter| parameter.default));
    for vertex in it.mesh.vertex_ids() {
        let (followed, wanted) = (it.cost.factors(vertex), fresh.cost.factors(vertex));
        assert_eq!(followed, wanted, "{vertex:?}");
        assert!(changed.contains(&vertex) || prepared_before(vertex) == wanted, "{vertex:?}");
    }

    fn prepared_before(vertex: LocalVertex) -> (f64, f64, f64) {
        let before =
            prepared::<ObliqueCost>(&samples::grid(6, 0.7), oblique::PARAMETERS.map(|parameter| parameter.default));
        before.cost.factors(vertex)
    }
}

#[test]
fn oblique_rules_are_those_of_the_paper() {
    use crate::mesh::class::Rule;
    use crate::mesh::edge::EdgeKind::{Border as OnBorder, Inner, Seam as OnSeam};
    let it = prepared::<ObliqueCost>(&samples::two_charts(6), oblique::PARAMETERS.map(|parameter| parameter.default));
    assert_eq!(it.classes[B], Class::Seam);
    for (from, to, kind, rule) in [
        (Class::Smooth, Class::Smooth, Inner, Rule::Free),
        (Class::Smooth, Class::Seam, Inner, Rule::Onto),
        (Class::Smooth, Class::Corner, Inner, Rule::Onto),
        (Class::Seam, Class::Seam, OnSeam, Rule::Chain),
        (Class::Seam, Class::Seam, Inner, Rule::Never),
        (Class::Seam, Class::Corner, OnSeam, Rule::Never),
        (Class::Smooth, Class::Border, Inner, Rule::Never),
        (Class::Border, Class::Border, OnBorder, Rule::Chain),
        (Class::Border, Class::Border, Inner, Rule::Never),
        (Class::Border, Class::Smooth, Inner, Rule::Never),
        (Class::Corner, Class::Corner, OnSeam, Rule::Never),
    ] {
        assert_eq!(it.cost.rule(from, to, kind), rule, "{from:?} {to:?} {kind:?}");
    }
    // Two seam vertices merge at the middle, and their texture coordinates on both sides do, too.
    let other = it.mesh.wedge_next[w(24)];
    let above = it.mesh.wedge_next[w(31)];
    let edge = EdgeCase {
        from: B,
        to: v(31),
        onto: false,
        stays: false,
        wedges: &[pair(24, 31), WedgePair { from: other, to: above }],
        insets: [Vec2::ZERO; 2],
    };
    let placed = it.price(&edge);
    assert_eq!(placed.position, 0.5 * (it.mesh.positions[B] + it.mesh.positions[v(31)]));
    let mut uvs = Vec::new();
    assert!(it.cost.texcoords(&it.mesh, &edge, placed.position, &mut uvs));
    let mean = |a: Wedge, b: Wedge| 0.5 * (it.mesh.wedge_uv[a] + it.mesh.wedge_uv[b]);
    assert_eq!(uvs, [mean(w(24), w(31)), mean(other, above)]);
}

#[test]
fn terrain_and_sharpness_never_remove_a_border_vertex() {
    use crate::mesh::class::Rule;
    use crate::mesh::edge::EdgeKind::{Border, Inner};
    let terrain =
        prepared::<TerrainCost>(&samples::grid(4, 0.3), terrain::PARAMETERS.map(|parameter| parameter.default));
    let sharp =
        prepared::<SharpnessCost>(&samples::grid(4, 0.3), sharpness::PARAMETERS.map(|parameter| parameter.default));
    for to in Class::ALL {
        for kind in [Border, Inner] {
            assert_eq!(terrain.cost.rule(Class::Border, to, kind), Rule::Never);
            assert_eq!(sharp.cost.rule(Class::Border, to, kind), Rule::Never);
        }
    }
    assert_eq!(terrain.cost.rule(Class::Smooth, Class::Border, Inner), Rule::Onto);
    assert_eq!(sharp.cost.rule(Class::Smooth, Class::Border, Inner), Rule::Never);
}

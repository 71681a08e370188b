//! Moves the vertices of a chart that lies flat so that its triangles keep their shapes.
//!
//! ```text
//!    seen along the normal           each triangle asks its edges to be as long as they are in space, turned as it
//!    ◁▷◁  ──▶  ◁ ▷ ◁                 lies now; each vertex goes where its edges want it, on average; and so on
//! ```
//!
//! # Source
//! Liu, Zhang, Xu, Gotsman & Gortler 2008, "A local/global approach to mesh parameterization": as rigid as possible
//! (section 4), with sweeps from vertex to vertex in the place of the linear system.

use glam::{DVec2, DVec3};

use crate::base::Result;
use crate::base::pool::check_stopped;

/// Sweeps over all vertices at most.
const SWEEPS: usize = 48;
/// A sweep that moves no vertex farther than this is the last, by the longest side of a triangle.
const STILL: f64 = 1e-3;
/// How far a vertex goes, as a share of the way to where its edges want it.
const STEP: f64 = 1.5;
/// Least weight of an edge, for angles beyond 90 degrees.
const WEIGHT_MIN: f64 = 1e-3;
/// Smallest share of its length that a direction of a triangle may keep, or largest factor by which it may grow.
const STRETCH_MAX: f64 = 2.0;

/// A triangle of a chart.
struct RigidTriangle {
    vertices: [usize; 3],
    /// Its sides in its own plane, each from a corner to the next.
    sides: [DVec2; 3],
    /// Cotangents of the angles opposite to the sides.
    weights: [f64; 3],
}

impl RigidTriangle {
    /// `None` if the triangle has no area.
    fn new(vertices: [usize; 3], [a, b, c]: [DVec3; 3]) -> Option<Self> {
        let (ab, ac) = (b - a, c - a);
        let along = ab.try_normalize()?;
        let across = (ac - along * ac.dot(along)).try_normalize()?;
        let [a, b, c] = [a, b, c].map(|corner| DVec2::new((corner - a).dot(along), (corner - a).dot(across)));
        let sides = [b - a, c - b, a - c];
        let doubled_area = sides[0].perp_dot(sides[1]);
        let weights = [0, 1, 2].map(|side: usize| {
            let [from, to] = [sides[(side + 1) % 3], sides[(side + 2) % 3]];
            (-from.dot(to) / doubled_area).max(WEIGHT_MIN)
        });
        weights.into_iter().all(f64::is_finite).then_some(Self { vertices, sides, weights })
    }

    /// The turn, as a unit vector, that brings the sides closest to what they are now.
    fn turn(&self, places: &[DVec2]) -> DVec2 {
        let turns = (0..3).map(|side| {
            let now = places[self.vertices[(side + 1) % 3]] - places[self.vertices[side]];
            let own = self.sides[side];
            DVec2::new(own.dot(now), own.perp_dot(now)) * self.weights[side]
        });
        turns.sum::<DVec2>().normalize_or(DVec2::X)
    }

    /// Largest factor by which a direction shrinks or grows; infinite if the triangle is turned over.
    fn stretch(&self, places: &[DVec2]) -> f64 {
        let [a, b, c] = self.vertices.map(|vertex| places[vertex]);
        // The map in the basis of the first side and of what is across to it.
        let length = self.sides[0].x;
        let along = (b - a) / length;
        let across = ((c - a) + along * self.sides[2].x) / -self.sides[2].y;
        let (sum, product) = (along.length_squared() + across.length_squared(), along.perp_dot(across));
        if product <= 0.0 {
            return f64::INFINITY;
        }
        let largest = (0.5 * (sum + (sum * sum - 4.0 * product * product).max(0.0).sqrt())).sqrt();
        largest.max(largest / product)
    }
}

/// What a triangle asks of one of its vertices.
struct SidePull {
    /// The next vertex and the one before it.
    vertices: [usize; 2],
    /// Numbers of the sides to these, of all triangles' sides, and their weights.
    sides: [usize; 2],
    weights: [f64; 2],
}

impl SidePull {
    fn add_weights(sum: f64, pull: &Self) -> f64 {
        sum + (pull.weights[0] + pull.weights[1])
    }
}

/// What triangles ask of each of `count` vertices.
fn pulls(elements: &[RigidTriangle], count: usize) -> Vec<Vec<SidePull>> {
    let mut pulls: Vec<Vec<SidePull>> = (0..count).map(|_| Vec::new()).collect();
    for (number, &RigidTriangle { vertices, weights, .. }) in elements.iter().enumerate() {
        for (corner, &vertex) in vertices.iter().enumerate() {
            let (next, before) = ((corner + 1) % 3, (corner + 2) % 3);
            pulls[vertex].push(SidePull {
                vertices: [vertices[next], vertices[before]],
                sides: [3 * number + corner, 3 * number + before],
                weights: [weights[corner], weights[before]],
            });
        }
    }
    pulls
}

/// Moves the vertices of a chart, given by the triangles in space and where their corners lie flat. `None` if some triangle
/// is stretched too much.
///
/// # Errors
/// [`Error::Stopped`](crate::base::Error::Stopped).
pub(super) fn relax(triangles: &[([usize; 3], [DVec3; 3])], mut places: Vec<DVec2>) -> Result<Option<Vec<DVec2>>> {
    let elements: Vec<RigidTriangle> =
        triangles.iter().filter_map(|&(vertices, corners)| RigidTriangle::new(vertices, corners)).collect();
    let is_kept = |places: &[DVec2]| elements.iter().all(|element| element.stretch(places) <= STRETCH_MAX);
    let seen = places.clone();
    let pulls_of = pulls(&elements, places.len());
    let totals: Vec<f64> = pulls_of.iter().map(|pulls| pulls.iter().fold(0.0, SidePull::add_weights)).collect();
    let mut turned = vec![DVec2::ZERO; 3 * elements.len()];
    let sides = elements.iter().flat_map(|element| element.sides);
    let still_sq = STILL * STILL * sides.map(|side| side.length_squared()).fold(0.0, f64::max);
    for _ in 0..SWEEPS {
        check_stopped()?;
        let mut moved_sq = 0.0_f64;
        for (turned, element) in turned.as_chunks_mut::<3>().0.iter_mut().zip(&elements) {
            let turn = element.turn(&places);
            *turned = element.sides.map(|side| turn.rotate(side));
        }
        for (vertex, (pulls, &total)) in pulls_of.iter().zip(&totals).enumerate() {
            let mut sum = DVec2::ZERO;
            for SidePull { vertices: [next, before], sides, weights } in pulls {
                sum += weights[0] * (places[*next] - turned[sides[0]]);
                sum += weights[1] * (places[*before] + turned[sides[1]]);
            }
            if total > 0.0 {
                let step = STEP * (sum / total - places[vertex]);
                places[vertex] += step;
                moved_sq = moved_sq.max(step.length_squared());
            }
        }
        if moved_sq <= still_sq {
            break;
        }
    }
    Ok([places, seen].into_iter().find(|places| is_kept(places)))
}

//! Orders triangles so that vertices are used again shortly after, and numbers vertices by their first use.
//!
//! # Source
//! Forsyth, *Linear-speed vertex cache optimisation* (2006). Symbol | here: size of the cache | [`RECENT`]; score of a
//! vertex | [`VertexScores`]; 0.75, 1.5, 2.0, 0.5 | [`LAST_TRIANGLE`], the power of `recency`, the factor and root of `rarity`.

use std::collections::HashMap;

use foldhash::fast::FixedState;

/// Vertices that count as recent: as many as the codec remembers.
const RECENT: usize = 16;
/// Score of the vertices of the triangle before.
const LAST_TRIANGLE: f32 = 0.75;
/// Triangles left at a vertex from which its score stays the same.
const RARE: usize = 32;
/// Triangles of a recent vertex that are looked at.
const LOOKED_AT: usize = 64;
/// Place of a vertex that is not recent.
const NOT_RECENT: usize = usize::MAX;

/// Orders triangles for reuse of their vertices: the same order for the same triangles.
///
/// O(n) for `n` triangles, if few of them meet at each vertex.
///
/// # Panics
/// If a triangle has a vertex from `vertices` on.
pub fn for_reuse(triangles: &[[u32; 3]], vertices: usize) -> Vec<[u32; 3]> {
    let scores = VertexScores::new();
    let mut left = TrianglesLeft::new(triangles, vertices);
    let mut recent: Vec<u32> = Vec::with_capacity(RECENT + 3);
    let mut places = vec![NOT_RECENT; vertices];
    let mut unused = 0;
    let mut ordered = Vec::with_capacity(triangles.len());
    while ordered.len() < triangles.len() {
        let score = |vertex: u32| scores.of(places[vertex as usize], left.at(vertex).len());
        let near = recent.iter().flat_map(|&vertex| left.at(vertex).iter().take(LOOKED_AT)).copied();
        let scored = near.map(|number| (triangles[number as usize].map(score).iter().sum::<f32>(), number));
        // Of equal ones the first triangle.
        let best = scored.max_by(|(a, number), (b, other)| a.total_cmp(b).then(other.cmp(number)));
        let next = best.map_or_else(
            || {
                while left.is_taken[unused] {
                    unused += 1;
                }
                unused as u32
            },
            |(_, number)| number,
        );
        left.take(next, triangles);
        let corners = triangles[next as usize];
        ordered.push(corners);
        recent.retain(|vertex| !corners.contains(vertex));
        recent.splice(0..0, corners);
        recent.iter().skip(RECENT).for_each(|&vertex| places[vertex as usize] = NOT_RECENT);
        recent.truncate(RECENT);
        recent.iter().enumerate().for_each(|(place, &vertex)| places[vertex as usize] = place);
    }
    ordered
}

/// How much a triangle is worth by each of its vertices.
struct VertexScores {
    recency: [f32; RECENT],
    rarity: [f32; RARE],
}

impl VertexScores {
    fn new() -> Self {
        let recency = std::array::from_fn(|place| match place {
            0..3 => LAST_TRIANGLE,
            _ => {
                let share = 1.0 - (place - 3) as f32 / (RECENT - 3) as f32;
                share * share.sqrt()
            }
        });
        Self { recency, rarity: std::array::from_fn(|left| 2.0 / (left.max(1) as f32).sqrt()) }
    }

    /// Score of a vertex, by its place among the recent ones and the triangles left at it.
    fn of(&self, place: usize, left: usize) -> f32 {
        self.recency.get(place).unwrap_or(&0.0) + self.rarity[left.min(RARE - 1)]
    }
}

/// The triangles at each vertex that have no place in the order yet.
struct TrianglesLeft {
    /// Triangles of all vertices, those of a vertex in a row.
    all: Vec<u32>,
    /// Where the row of each vertex starts.
    starts: Vec<u32>,
    /// Triangles left in each row, which come first in it.
    counts: Vec<u32>,
    is_taken: Vec<bool>,
}

impl TrianglesLeft {
    fn new(triangles: &[[u32; 3]], vertices: usize) -> Self {
        let mut counts = vec![0_u32; vertices];
        triangles.iter().flatten().for_each(|&vertex| counts[vertex as usize] += 1);
        let starts = counts.iter().scan(0, |sum, count| Some(std::mem::replace(sum, *sum + count))).collect::<Vec<_>>();
        let mut ends = starts.clone();
        let mut all = vec![0; 3 * triangles.len()];
        for (number, corners) in (0..).zip(triangles) {
            for &vertex in corners {
                let end = &mut ends[vertex as usize];
                all[*end as usize] = number;
                *end += 1;
            }
        }
        Self { all, starts, counts, is_taken: vec![false; triangles.len()] }
    }

    fn at(&self, vertex: u32) -> &[u32] {
        let start = self.starts[vertex as usize] as usize;
        &self.all[start..start + self.counts[vertex as usize] as usize]
    }

    fn take(&mut self, number: u32, triangles: &[[u32; 3]]) {
        self.is_taken[number as usize] = true;
        for &vertex in &triangles[number as usize] {
            let place = self.at(vertex).iter().position(|&other| other == number);
            if let Some(place) = place {
                let (start, count) = (self.starts[vertex as usize] as usize, &mut self.counts[vertex as usize]);
                *count -= 1;
                self.all.swap(start + place, start + *count as usize);
            }
        }
    }
}

/// Orders the strips of a skirt so that each one follows the strip at whose end it starts, if there is one.
///
/// A strip is a pair of triangles, (end, start, foot) and (end, foot, other foot).
pub fn strips_in_rows(triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let (strips, _) = triangles.as_chunks::<2>();
    let mut at_start: HashMap<u32, Vec<usize>, FixedState> = HashMap::default();
    for (number, [[_, start, _], _]) in strips.iter().enumerate().rev() {
        at_start.entry(*start).or_default().push(number);
    }
    let mut is_placed = vec![false; strips.len()];
    let mut ordered = Vec::with_capacity(triangles.len());
    for first in 0..strips.len() {
        let mut next = Some(first);
        while let Some(number) = next.filter(|&number| !std::mem::replace(&mut is_placed[number], true)) {
            ordered.extend(strips[number]);
            let end = strips[number][0][0];
            next = at_start.get_mut(&end).and_then(|all| {
                while all.pop_if(|number| is_placed[*number]).is_some() {}
                all.pop()
            });
        }
    }
    ordered
}

/// Vertices in the order in which triangles use them.
pub struct Renumbered {
    /// The triangles, with the new numbers.
    pub triangles: Vec<[u32; 3]>,
    /// The old number of each new one; vertices that no triangle has are left out.
    pub vertices: Vec<u32>,
}

/// Numbers `vertices` vertices by their first use.
///
/// # Panics
/// If a triangle has a vertex from `vertices` on.
pub fn vertices_by_use(triangles: &[[u32; 3]], vertices: usize) -> Renumbered {
    const UNUSED: u32 = u32::MAX;
    let mut numbers = vec![UNUSED; vertices];
    let mut order = Vec::with_capacity(vertices);
    let mut number = |vertex: u32| {
        let number = &mut numbers[vertex as usize];
        if *number == UNUSED {
            *number = order.len() as u32;
            order.push(vertex);
        }
        *number
    };
    let triangles = triangles.iter().map(|corners| corners.map(&mut number)).collect();
    Renumbered { triangles, vertices: order }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::encode_triangles;
    use super::*;

    /// The triangles of a grid of quads, in an order that scatters them.
    fn scattered(side: u32) -> Vec<[u32; 3]> {
        let corner = |x: u32, y: u32| x + y * (side + 1);
        let quad = |x, y| {
            let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
            [[a, b, c], [a, c, d]]
        };
        let mut all: Vec<[u32; 3]> = (0..side).flat_map(|y| (0..side).flat_map(move |x| quad(x, y))).collect();
        all.sort_by_key(|[a, b, c]| (a * 7919 + b * 104_729 + c) % 1_000_003);
        all
    }

    #[test]
    fn triangles_in_order_take_little_more_than_a_byte() {
        let triangles = scattered(40);
        let vertices = 41 * 41;
        let ordered = for_reuse(&triangles, vertices);
        let bytes = |triangles: &[[u32; 3]]| encode_triangles(&vertices_by_use(triangles, vertices).triangles).len();
        assert!(bytes(&ordered) < triangles.len() * 5 / 4, "{}", bytes(&ordered));
        assert!(bytes(&triangles) > 2 * bytes(&ordered));
    }

    #[test]
    fn strips_follow_each_other_along_a_border() {
        // start: end, feet at 10 more.
        let strip = |start: u32, end: u32| [[end, start, start + 10], [end, start + 10, end + 10]];
        let all = [strip(2, 3), strip(0, 1), strip(7, 8), strip(1, 2), strip(3, 0), strip(8, 7)].concat();
        let expected = [strip(2, 3), strip(3, 0), strip(0, 1), strip(1, 2), strip(7, 8), strip(8, 7)].concat();
        assert_eq!(strips_in_rows(&all), expected);
    }

    proptest! {
        #[test]
        fn the_order_has_the_same_triangles(corners in prop::collection::vec(any::<[u8; 3]>(), 0..300)) {
            let triangles: Vec<[u32; 3]> = corners.iter().map(|all| all.map(u32::from)).collect();
            let mut ordered = for_reuse(&triangles, 256);
            let renumbered = vertices_by_use(&ordered, 256);
            let back = |corners: &[u32; 3]| corners.map(|vertex| renumbered.vertices[vertex as usize]);
            prop_assert!(renumbered.triangles.iter().map(back).eq(ordered.iter().copied()));
            let mut sorted = triangles;
            sorted.sort_unstable();
            ordered.sort_unstable();
            prop_assert_eq!(ordered, sorted);
        }
    }
}

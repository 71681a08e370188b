//! Tests whether the outline of a polygon intersects itself. Such an outline has no ears to clip, and the search for
//! them takes O(n³).

use crate::base::id::{TiVec, ids};

ids! {
    /// A position of an outline, which several of its corners may have.
    Site;
}

/// Largest number of positions at which an outline may touch itself without a bridge there.
const TOUCHES_MAX: usize = 16;

type Point = [f64; 2];

/// Whether a closed outline does not cross itself. It may touch itself along bridges (edges that lead to a hole and
/// back) and at up to 16 other positions.
///
/// O(n²) at worst; a polygon has at most [a few hundred](crate::model::face::POLYGON_CORNERS_MAX) corners.
pub fn is_simple(outline: &[Point]) -> bool {
    let sites = numbered(outline);
    let edges = edges(&sites);
    repeats_at_bridges(sites.len(), &edges) && !crosses(outline, &sites)
}

/// The site of each corner.
fn numbered(outline: &[Point]) -> Vec<Site> {
    let mut order: Vec<usize> = (0..outline.len()).collect();
    order.sort_unstable_by(|&a, &b| {
        let ([ax, ay], [bx, by]) = (outline[a], outline[b]);
        ax.total_cmp(&bx).then(ay.total_cmp(&by))
    });
    let mut sites = vec![Site::new(0); outline.len()];
    let mut last = 0;
    for pair in order.windows(2) {
        last += usize::from(outline[pair[0]] != outline[pair[1]]);
        sites[pair[1]] = Site::from(last);
    }
    sites
}

/// Directed edges between sites, sorted; edges of zero length are left out.
fn edges(sites: &[Site]) -> Vec<[Site; 2]> {
    let next = sites.iter().cycle().skip(1);
    let mut edges: Vec<_> = sites.iter().zip(next).map(|(&a, &b)| [a, b]).filter(|[a, b]| a != b).collect();
    edges.sort_unstable();
    edges
}

/// Whether no directed edge occurs twice, and at most [`TOUCHES_MAX`] repeated sites have no edge that occurs in both
/// directions. There are at most `count` sites.
fn repeats_at_bridges(count: usize, edges: &[[Site; 2]]) -> bool {
    if edges.windows(2).any(|pair| pair[0] == pair[1]) {
        return false;
    }
    let mut counts: TiVec<Site, u32> = vec![0; count].into();
    edges.iter().for_each(|edge| counts[edge[0]] += 1);
    if counts.iter().all(|&count| count < 2) {
        return true;
    }
    let mut bridged: TiVec<Site, u32> = vec![0; count].into();
    for &[a, b] in edges {
        if edges.binary_search(&[b, a]).is_ok() {
            bridged[a] += 1;
        }
    }
    let touches = counts.iter().zip(&bridged).filter(|&(&count, &bridged)| count > 1 && bridged == 0);
    touches.count() <= TOUCHES_MAX
}

/// Whether two edges without a common end intersect.
fn crosses(outline: &[Point], sites: &[Site]) -> bool {
    struct Span {
        low: Point,
        high: Point,
        ends: [Point; 2],
        sites: [Site; 2],
    }
    let mut spans: Vec<Span> = (0..outline.len())
        .map(|corner| (corner, (corner + 1) % outline.len()))
        .filter(|&(a, b)| sites[a] != sites[b])
        .map(|(a, b)| {
            let (p, q) = (outline[a], outline[b]);
            let low = [p[0].min(q[0]), p[1].min(q[1])];
            let high = [p[0].max(q[0]), p[1].max(q[1])];
            Span { low, high, ends: [p, q], sites: [sites[a], sites[b]] }
        })
        .collect();
    spans.sort_unstable_by(|a, b| a.low[0].total_cmp(&b.low[0]));
    for (i, a) in spans.iter().enumerate() {
        for b in spans[i + 1..].iter().take_while(|b| b.low[0] <= a.high[0]) {
            let is_apart = b.low[1] > a.high[1] || b.high[1] < a.low[1];
            if !is_apart && !a.sites.iter().any(|site| b.sites.contains(site)) && meet(a.ends, b.ends) {
                return true;
            }
        }
    }
    false
}

/// Whether two segments with overlapping boxes have a point in common.
fn meet([a, b]: [Point; 2], [c, d]: [Point; 2]) -> bool {
    let side = |p: Point, q: Point, r: Point| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let apart = |one: f64, other: f64| one > 0.0 && other > 0.0 || one < 0.0 && other < 0.0;
    !apart(side(a, b, c), side(a, b, d)) && !apart(side(c, d, a), side(c, d, b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_star_with_a_hole_is_simple_and_a_pentagram_is_not() {
        let corner = |i: usize, radius: f64| {
            let angle = i as f64 * std::f64::consts::TAU / 10.0;
            [radius * angle.cos(), radius * angle.sin()]
        };
        let star: Vec<Point> = (0..10).map(|i| corner(i, if i % 2 == 0 { 2.0 } else { 1.0 })).collect();
        assert!(is_simple(&star));
        let mut with_hole = star.clone();
        let hole = [[0.5, 0.0], [0.0, -0.5], [-0.5, 0.0], [0.0, 0.5], [0.5, 0.0], star[0]];
        with_hole.splice(1..1, hole);
        assert!(is_simple(&with_hole));
        let pentagram: Vec<Point> = [0, 4, 8, 2, 6].map(|i| corner(i, 2.0)).to_vec();
        assert!(!is_simple(&pentagram));
    }

    #[test]
    fn an_outline_that_touches_or_repeats_itself_is_not_simple() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        assert!(!is_simple(&[square, square].concat()));
        let eight = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.0], [2.0, 2.0], [1.0, 2.0], [1.0, 1.0], [0.0, 1.0]];
        assert!(is_simple(&eight), "the outline may touch itself at one corner");
        let touching = [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 0.0], [0.0, 2.0]];
        assert!(!is_simple(&touching));
    }

    #[test]
    fn a_long_comb_is_simple() {
        let teeth = |i: usize| [[i as f64, 0.0], [i as f64, 1.0], [i as f64 + 0.5, 1.0], [i as f64 + 0.5, 0.0]];
        let mut comb: Vec<Point> = (0..250).flat_map(teeth).collect();
        comb.extend([[250.0, 0.0], [250.0, -1.0], [0.0, -1.0]]);
        assert!(is_simple(&comb));
    }

    #[test]
    fn any_numbers_are_looked_at() {
        let odd = [[f64::NAN, 0.0], [f64::INFINITY, 1.0], [0.0, f64::NEG_INFINITY], [1e300, -1e300], [0.0, 0.0]];
        is_simple(&odd);
        is_simple(&[[0.0, 0.0]; 40]);
    }
}
